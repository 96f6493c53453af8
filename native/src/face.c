/* Draws a head as the shaders do (../../shaders: the formulas and constants are theirs), into a picture in memory.

   Theory of operation
   -------------------
   Vertices are moved by the FAPs, lit and projected, LANES at once. Triangles that face the camera are sorted into
   tiles of 32 x 32 pixels. In a tile each triangle marks the pixels at which it is nearest, by exact integer edge
   functions; only then are the marked pixels shaded, so that hidden surfaces cost nothing. Strands are blended over
   them. What no FAP moves is drawn once (the ground), and tiles without a moving triangle keep it. At last edges are
   smoothed in the tiles that changed and around them.

   A pixel is computed from its place alone, with additions, multiplications, divisions and square roots that IEEE 754
   rounds exactly and in a fixed order (no contraction to fused multiply-add), and with functions of lanes.h made of
   these: so the picture has the same bytes on every x86-64 processor, whatever the number of lanes. */
#include "face.h"
#include "lanes.h"

#include <stdlib.h>

#define TILE 32
#define BLOCK_ROWS (LANES / 4) /* a vector covers 4 x BLOCK_ROWS pixels */
#define TILE_PX (TILE * TILE)
#define COLUMNS 21             /* floats per vertex in the input, as PackedMesh.vertices */
#define ROW 16                 /* floats per vertex that triangles interpolate */
#define MAX_CHANNELS 128
#define BONES 5
#define GUARD 4.0f             /* triangles are clipped where they leave the picture by so many halves of its side */
#define REACH 5                /* of the smoothing, in pixels */
#define NEAR 12                /* rows of texels around a vertex, fetched from memory before they are needed */

enum { FACE, CUTOUT, EYEBALL, EYE, STRAND, PARTS };
enum { RGB, RGBA, I420 };

/* Places of a frame's uniforms. */
enum { U_CHANNELS = 0, U_BONES = MAX_CHANNELS, U_IRIS = U_BONES + 16 * BONES, U_LIDS = U_IRIS + 2,
       U_IRIS_ALBEDO = U_LIDS + 4, U_CLIP = U_IRIS_ALBEDO + 3, U_EYE = U_CLIP + 16, U_DEPTH = U_EYE + 3,
       UNIFORMS = U_DEPTH + 2 };

/* Rows of vertices lit at pixels, and at vertices. */
enum { A_POSITION = 0, A_NORMAL = 3, A_ALBEDO = 6, A_SURFACE = 9, A_UV = 12, A_OCCLUSION = 14, A_FOLD = 15 };
enum { L_DIFFUSE = 0, L_SPECULAR = 3, L_UV = 6, L_FOLD = 8, LIT = 9 };

typedef struct {
    int32_t a[3], b[3];  /* edge functions: change per 1/256 pixel in x and y */
    int32_t x, y;        /* of the first corner, in 1/256 pixel */
    int64_t area;        /* twice, in 1/256 of a pixel squared */
    int32_t corner[3];
    float ax, ay;        /* the first corner in pixels */
    float l1x, l1y, l2x, l2y, z, zx, zy;
    int16_t left, top, right, bottom;
    int32_t part;
    float pixel;         /* of a strand: what a pixel is across it, mm */
} Triangle;

typedef struct {
    int count, padded, room, triangles, strands, has_pixel_parts;
    float *rest, *normal;          /* (count, 4) */
    float *plane[9];               /* albedo 3, surface 3, u, v, occlusion */
    int32_t *texel;                /* the first of the NEAR rows of texels around u, v */
    float *fold;
    int32_t *bone, *first, *entries;
    float *bone_weight, *head_weight;
    F4 *move, *turn;               /* per entry; the fourth of turn is the change of folds or occlusion */
    int32_t *channel;
    uint32_t *corners;
    uint8_t *part, *is_pixel_lit;
    /* of the frame */
    float *at[6], *occlusion, *folds;      /* position, normal */
    float *clip[4], *depth, *inverse_w;
    int32_t *x, *y;
    uint8_t *is_clipped;
    float *lit, *pixel;            /* (room, ROW), divided by w */
    int extra;                     /* vertices that clipping added */
    Triangle *shown;
    int shown_room, shown_count;
    int32_t *bin_start, *bin, bin_room;
} Mesh;

struct Face {
    const Build *build;
    Mesh mesh[2];                  /* what no FAP moves; everything else */
    int width, height, stride, tiles_x, tiles_y;
    uint32_t *backdrop;            /* tile by tile, like ground */
    uint32_t *ground, *colour, *out, *edge;
    float *ground_depth, *brightness;
    uint8_t *was, *is_dirty;
    uint32_t *texels;
    int skin_width, skin_height;
    int ground_is_drawn;
    float ground_uniforms[U_DEPTH + 2 - U_CLIP];
    int ground_at_vertices;
    int32_t id[TILE_PX] __attribute__((aligned(64)));
    float z[TILE_PX] __attribute__((aligned(64)));
    uint32_t tile[TILE_PX] __attribute__((aligned(64)));
};

typedef struct { F x, y, z; } V3;

INLINE V3 v3(float x, float y, float z) { return (V3){all(x), all(y), all(z)}; }
INLINE F dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
INLINE V3 scaled(V3 a, F k) { return (V3){a.x * k, a.y * k, a.z * k}; }
INLINE V3 plus(V3 a, V3 b) { return (V3){a.x + b.x, a.y + b.y, a.z + b.z}; }
INLINE V3 minus(V3 a, V3 b) { return (V3){a.x - b.x, a.y - b.y, a.z - b.z}; }
INLINE V3 mix3(V3 a, V3 b, F t) { return (V3){mix(a.x, b.x, t), mix(a.y, b.y, t), mix(a.z, b.z, t)}; }
INLINE V3 normalised(V3 a) { return scaled(a, 1 / root(dot(a, a))); }

/* ---- lights.glsl ---- */

#define KEY_FROM v3(-0.47f, 0.53f, 0.706f)
#define KEY_COLOUR v3(1.53f, 1.43f, 1.35f)
#define FILL_FROM v3(0.80f, 0.10f, 0.59f)
#define FILL_COLOUR v3(0.30f, 0.30f, 0.30f)
#define RIM_FROM v3(0.62f, 0.40f, -0.68f)
#define RIM_FROM_RIGHT v3(-0.62f, 0.40f, -0.68f)
#define RIM_COLOUR v3(1.4f, 1.52f, 1.75f)
#define SKY v3(0.36f, 0.365f, 0.38f)
#define GROUND v3(0.235f, 0.165f, 0.135f)

INLINE F wrapped_diffuse(F cosine, F softness) {
    F light = unit((cosine + softness) / (1 + softness));
    return light * light * (1 + softness) * 0.5f + light * (1 - softness) * 0.5f;
}

INLINE V3 irradiance(V3 normal, F softness, F occlusion) {
    F key = dot(normal, KEY_FROM);
    V3 terminator = mix3(v3(1, 1, 1), v3(1.25f, 0.72f, 0.60f), softness * step_(all(0.55f), all(-0.1f), key));
    F shade = mix(all(0.35f), all(1), step(0.05f, 0.6f, occlusion));
    F k = wrapped_diffuse(key, softness) * shade;
    V3 light = {KEY_COLOUR.x * k * terminator.x, KEY_COLOUR.y * k * terminator.y, KEY_COLOUR.z * k * terminator.z};
    light = plus(light, scaled(FILL_COLOUR, wrapped_diffuse(dot(normal, FILL_FROM), softness)
                                                * mix(all(0.5f), all(1), occlusion)));
    light = plus(light, scaled(mix3(GROUND, SKY, 0.5f + 0.5f * normal.y), occlusion));
    V3 red = mix3(v3(1.06f, 0.97f, 0.94f), v3(1, 1, 1), step(0.05f, 0.65f, occlusion));
    return (V3){light.x * red.x, light.y * red.y, light.z * red.z};
}

INLINE F half_way(V3 light, V3 view, F cosines) {
    return unit(cosines * (1 / root(dot(light, light) + 1 + 2 * dot(light, view))));
}

INLINE V3 highlight(V3 normal, V3 view, F gloss) {
    F facing = dot(normal, view), away = 1 - unit(facing);
    F fresnel = 0.04f + 0.55f * away * away * away * away * away;
    F key = dot(normal, KEY_FROM), lit = unit(key * 4);
    F on_key = half_way(KEY_FROM, view, key + facing);
    F high = power(on_key, gloss) * lit
        + 0.25f * power(half_way(FILL_FROM, view, dot(normal, FILL_FROM) + facing), gloss);
    F rough = 0.22f * gloss;
    F broad = power(on_key, rough) * lit;
    F k = (0.25f + fresnel) * ((gloss + 8) * high + 0.6f * (rough + 8) * broad) * (1 / 25.0f);
    return scaled(KEY_COLOUR, k);
}

typedef struct { V3 diffuse, specular; } Light;

INLINE Light shade(V3 position, V3 normal, V3 eye, V3 albedo, V3 surface, F occlusion) {
    normal = normalised(normal);
    V3 view = normalised(minus(eye, position));
    F away = 1 - unit(dot(normal, view));
    F left = unit(dot(normal, RIM_FROM) + 0.3f), right = unit(dot(normal, RIM_FROM_RIGHT) + 0.2f);
    F rim = away * away * away * (left + 0.55f * right);
    V3 rim_light = scaled(RIM_COLOUR, rim * (0.10f + 0.5f * surface.x) * occlusion);
    V3 all_over = plus(irradiance(normal, surface.z, occlusion), rim_light);
    return (Light){{albedo.x * all_over.x, albedo.y * all_over.y, albedo.z * all_over.z},
                   plus(scaled(highlight(normal, view, surface.y), surface.x * occlusion), scaled(rim_light, all(0.15f)))};
}

INLINE F tone(F c) {
    c = c * (1 + c * 0.12f) / (1 + c * 0.42f);
    F r = root(fmax_(c, all(0)));
    return mix(r, root(r), all(0.07f));
}

INLINE I rgb(V3 c) { /* 0..1 to bytes, alpha 255 */
    I r = to_i(unit(c.x) * 255 + 0.5f), g = to_i(unit(c.y) * 255 + 0.5f), b = to_i(unit(c.z) * 255 + 0.5f);
    return r | (g << 8) | (b << 16) | (I)((I){0} - (1 << 24));
}

INLINE V3 toned(V3 c) { return (V3){tone(c.x), tone(c.y), tone(c.z)}; }

/* ---- textures ---- */

INLINE H lerp8(H a, H b, H weight) { return (a * (256 - weight) + b * weight + 128) >> 8; } /* weight 0..256 */

/* Four bytes per lane between four, weights of 1/256. Two channels at once. */
typedef struct { H even, odd; } Bytes;
INLINE Bytes bilinear(I a, I b, I c, I d, I wx, I wy) {
    H x = (H)(wx | (wx << 16)), y = (H)(wy | (wy << 16));
#define EVEN(p) ((H)((p) & 0xff00ff))
#define ODD(p) ((H)(((p) >> 8) & 0xff00ff))
    return (Bytes){lerp8(lerp8(EVEN(a), EVEN(b), x), lerp8(EVEN(c), EVEN(d), x), y),
                   lerp8(lerp8(ODD(a), ODD(b), x), lerp8(ODD(c), ODD(d), x), y)};
}

INLINE I repeated(I at, int size) {
    at = seli(lti(at, alli(0)), at + size, at);
    at = seli(lti(at, alli(size)), at, at - size);
    return maxi(mini(at, alli(size - 1)), alli(0)); /* for places that are no numbers */
}

typedef struct { F r, g, b, a; } Texel;
INLINE Texel sampled(const Face *face, F u, F v) {
    const int width = face->skin_width, height = face->skin_height;
    u = (u - down(u)) * (float)width - 0.5f;
    v = (v - down(v)) * (float)height - 0.5f;
    F whole_u = down(u), whole_v = down(v);
    I wx = to_i((u - whole_u) * 256 + 0.5f) & 511, wy = to_i((v - whole_v) * 256 + 0.5f) & 511;
    I x = to_i(whole_u), y = to_i(whole_v);
    I x0 = repeated(x, width), x1 = repeated(x + 1, width);
    I y0 = repeated(y, height) * width, y1 = repeated(y + 1, height) * width;
    Bytes t = bilinear(gather(face->texels, y0 + x0), gather(face->texels, y0 + x1), gather(face->texels, y1 + x0),
                       gather(face->texels, y1 + x1), wx, wy);
    const float k = 1 / 255.0f;
    return (Texel){to_f((I)t.even & 0xffff) * k, to_f((I)t.odd & 0xffff) * k, to_f((I)t.even >> 16) * k,
                   to_f((I)t.odd >> 16) * k};
}

INLINE V3 painted(const Face *face, V3 diffuse, V3 specular, F u, F v, F fold, M is_cut_out) {
    if (!face->texels) return plus(diffuse, specular);
    Texel paint = sampled(face, u, v);
    F relief = 2 * paint.a - 1, pores = clamp(relief, -0.25f, 0.25f);
    F kd = 1 + 0.9f * fold * (relief - pores), ks = 1 + 2 * fmin_(28 * fold, all(1)) * pores;
    kd = sel(is_cut_out, all(1), kd);
    ks = sel(is_cut_out, all(1), ks);
    return (V3){paint.r * paint.r * diffuse.x * kd + specular.x * ks, paint.g * paint.g * diffuse.y * kd + specular.y * ks,
                paint.b * paint.b * diffuse.z * kd + specular.z * ks};
}

/* ---- a mesh in memory ---- */

static void *zeroed(size_t count, size_t size) {
    size_t bytes = (count * size + 127) & ~(size_t)63;
    void *made = NULL;
#ifdef _WIN32
    made = _aligned_malloc(bytes, 64);
#else
    if (posix_memalign(&made, 64, bytes)) made = NULL;
#endif
    if (made) memset(made, 0, bytes);
    return made;
}

static void freed(void *p) {
#ifdef _WIN32
    _aligned_free(p);
#else
    free(p);
#endif
}

/* Enlarges an array of which the first `used` elements are kept. */
static int enlarged(void **array, size_t used, size_t room, size_t size) {
    void *made = zeroed(room, size);
    if (!made) return 0;
    if (*array) memcpy(made, *array, used * size);
    freed(*array);
    *array = made;
    return 1;
}

static int room_for(Mesh *m, int wanted) { /* vertices in what the frame computes */
    if (wanted <= m->room) return 1;
    int room = wanted + wanted / 2 + LANES;
    for (int k = 0; k < 4; k++)
        if (!enlarged((void **)&m->clip[k], m->room, room, 4)) return 0;
    int done = enlarged((void **)&m->depth, m->room, room, 4) && enlarged((void **)&m->inverse_w, m->room, room, 4)
        && enlarged((void **)&m->x, m->room, room, 4) && enlarged((void **)&m->y, m->room, room, 4)
        && enlarged((void **)&m->is_clipped, m->room, room, 1)
        && enlarged((void **)&m->lit, m->room, room, 4 * ROW) && enlarged((void **)&m->pixel, m->room, room, 4 * ROW);
    if (done) m->room = room;
    return done;
}

static void mesh_close(Mesh *m) {
    void *arrays[] = {m->rest, m->normal, m->fold, m->bone, m->first, m->entries, m->bone_weight, m->head_weight, m->move,
                      m->texel, m->turn, m->channel, m->corners, m->part, m->is_pixel_lit, m->occlusion, m->folds,
                      m->depth, m->inverse_w, m->x, m->y, m->is_clipped, m->lit, m->pixel, m->shown, m->bin_start, m->bin};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) freed(arrays[i]);
    for (int k = 0; k < 9; k++) freed(m->plane[k]);
    for (int k = 0; k < 6; k++) freed(m->at[k]);
    for (int k = 0; k < 4; k++) freed(m->clip[k]);
}

/* Columns of a vertex. */
enum { C_POSITION = 0, C_NORMAL = 3, C_PLANES = 6, C_FOLD = 15, C_BONE = 16, C_FIRST = 19, C_ENTRIES = 20 };

static int is_still(const float *vertex) {
    return vertex[C_BONE + 1] == 0 && vertex[C_BONE + 2] == 0 && vertex[C_ENTRIES] == 0;
}

static int add_triangles(Mesh *m, int part, int still, const float *vertices, const uint32_t *triangles, int count,
                         int32_t *number) {
    int entries = 0;
    for (int t = 0; t < count; t++) {
        const uint32_t *corner = triangles + 3 * (size_t)t;
        int stays = part != STRAND;
        for (int k = 0; k < 3; k++) stays &= is_still(vertices + (size_t)COLUMNS * corner[k]);
        if (stays != still) continue;
        for (int k = 0; k < 3; k++) {
            if (!number[corner[k]]) {
                number[corner[k]] = ++m->count;
                entries += (int)vertices[(size_t)COLUMNS * corner[k] + C_ENTRIES];
            }
            m->corners[3 * (size_t)m->triangles + k] = (uint32_t)number[corner[k]] - 1;
        }
        m->part[m->triangles++] = (uint8_t)part;
    }
    return entries;
}

/* Copies the triangles that are still, or the others, and the vertices that they use. Returns 0 without memory. */
static int mesh_open(Mesh *m, int still, const float *vertices, int count, const float *displacements,
                     const float *normal_deltas, const uint32_t *const *parts, const int *counts) {
    int32_t *number = zeroed((size_t)count, 4); /* of a vertex in this mesh, from 1; 0: it is not in it */
    size_t triangles = 0, entries = 0;
    for (int p = 0; p < PARTS; p++) triangles += (size_t)counts[p];
    int done = number && (m->corners = zeroed(triangles, 12)) && (m->part = zeroed(triangles, 1));
    for (int p = 0; p < PARTS && done; p++)
        entries += (size_t)add_triangles(m, p, still, vertices, parts[p], counts[p], number);
    m->padded = (m->count + LANES - 1) / LANES * LANES;
    size_t n = (size_t)m->padded;
    done = done && (m->rest = zeroed(n, 16)) && (m->normal = zeroed(n, 16)) && (m->fold = zeroed(n, 4))
        && (m->bone = zeroed(n, 4)) && (m->first = zeroed(n, 4)) && (m->entries = zeroed(n, 4))
        && (m->bone_weight = zeroed(n, 4)) && (m->head_weight = zeroed(n, 4)) && (m->move = zeroed(entries, 16))
        && (m->turn = zeroed(entries, 16)) && (m->channel = zeroed(entries, 4)) && (m->is_pixel_lit = zeroed(n, 1))
        && (m->texel = zeroed(n, 4)) && (m->occlusion = zeroed(n, 4)) && (m->folds = zeroed(n, 4));
    for (int k = 0; k < 9; k++) done = done && (m->plane[k] = zeroed(n, 4));
    for (int k = 0; k < 6; k++) done = done && (m->at[k] = zeroed(n, 4));
    done = done && room_for(m, m->padded + LANES);
    int32_t next = 0;
    for (int v = 0; v < count && done; v++) {
        if (!number[v]) continue;
        const float *from = vertices + (size_t)COLUMNS * v;
        const int to = number[v] - 1;
        memcpy(m->rest + 4 * to, from + C_POSITION, 12);
        memcpy(m->normal + 4 * to, from + C_NORMAL, 12);
        for (int k = 0; k < 9; k++) m->plane[k][to] = from[C_PLANES + k];
        m->fold[to] = from[C_FOLD];
        m->bone[to] = (int32_t)from[C_BONE];
        m->bone_weight[to] = from[C_BONE + 1];
        m->head_weight[to] = from[C_BONE + 2];
        m->first[to] = next;
        m->entries[to] = (int32_t)from[C_ENTRIES];
        for (int e = 0; e < m->entries[to]; e++, next++) {
            const size_t entry = (size_t)from[C_FIRST] + e;
            memcpy(m->move + next, displacements + 4 * entry, 12);
            memcpy(m->turn + next, normal_deltas + 4 * entry, 16);
            m->channel[next] = (int32_t)displacements[4 * entry + 3];
        }
    }
    for (int t = 0; t < m->triangles && done; t++) {
        if (m->part[t] != EYE && m->part[t] != EYEBALL) continue;
        m->has_pixel_parts = 1;
        for (int k = 0; k < 3; k++) m->is_pixel_lit[m->corners[3 * t + k]] = 1;
    }
    freed(number);
    return done;
}

/* Whether every number in the arrays is one that indexes what is there. */
static int is_valid(const float *vertices, int count, const float *displacements, int entries,
                    const uint32_t *const *parts, const int *counts) {
    double all_entries = 0;
    for (int v = 0; v < count; v++) {
        const float *at = vertices + (size_t)COLUMNS * v;
        const float bone = at[C_BONE], first = at[C_FIRST], run = at[C_ENTRIES];
        if (!(bone >= 0 && bone < BONES && first >= 0 && run >= 0 && (double)first + run <= entries)) return 0;
        all_entries += run;
    }
    for (int e = 0; e < entries; e++)
        if (!(displacements[4 * (size_t)e + 3] >= 0 && displacements[4 * (size_t)e + 3] < MAX_CHANNELS)) return 0;
    double triangles = 0;
    for (int p = 0; p < PARTS; p++) {
        if (counts[p] < 0) return 0;
        triangles += counts[p];
        for (size_t i = 0; i < 3 * (size_t)counts[p]; i++)
            if (parts[p][i] >= (uint32_t)count) return 0;
    }
    return all_entries < 1 << 27 && triangles < 1 << 27 && count < 1 << 27;
}

/* ---- a frame's vertices ---- */

INLINE F4 transformed(const float *m, F4 p) {
    F4 a, b, c, d;
    memcpy(&a, m, 16), memcpy(&b, m + 4, 16), memcpy(&c, m + 8, 16), memcpy(&d, m + 12, 16);
    return a * p[0] + b * p[1] + c * p[2] + d;
}

INLINE F4 rotated(const float *m, F4 n) {
    F4 a, b, c;
    memcpy(&a, m, 16), memcpy(&b, m + 4, 16), memcpy(&c, m + 8, 16);
    return a * n[0] + b * n[1] + c * n[2];
}

static void move_vertices(Mesh *m, const float *u) {
    const float *bones = u + U_BONES;
    for (int v = 0; v < m->count; v++) {
        F4 position, normal;
        memcpy(&position, m->rest + 4 * v, 16);
        memcpy(&normal, m->normal + 4 * v, 16);
        for (int e = m->first[v], end = e + m->entries[v]; e < end; e++) {
            const float weight = u[U_CHANNELS + m->channel[e]];
            position += weight * m->move[e];
            normal += weight * m->turn[e];
        }
        const float change = normal[3];
        if (m->bone_weight[v] != 0) {
            const float *bone = bones + 16 * m->bone[v];
            position += m->bone_weight[v] * (transformed(bone, position) - position);
            normal += m->bone_weight[v] * (rotated(bone, normal) - normal);
        }
        if (m->head_weight[v] != 0) {
            const float *head = bones + 16 * 4;
            position += m->head_weight[v] * (transformed(head, position) - position);
            normal += m->head_weight[v] * (rotated(head, normal) - normal);
        }
        for (int k = 0; k < 3; k++) m->at[k][v] = position[k], m->at[3 + k][v] = normal[k];
        const float fold = m->fold[v], occlusion = m->plane[8][v];
        const float occluded = occlusion + change, folded = fold + change;
        m->occlusion[v] = fold >= 0 ? occlusion : occluded < 0 ? 0 : occluded > 1 ? 1 : occluded;
        m->folds[v] = !(fold > 0) || folded < 0 ? 0 : folded > 1 ? 1 : folded;
    }
}

/* From clip space to pixels and depth. The row of a vertex that needs clipping is not divided by w. */
static void project(const Face *face, Mesh *m, const float *clip) {
    const float half_x = 0.5f * (float)face->width, half_y = 0.5f * (float)face->height;
    for (int v = 0; v < m->padded; v += LANES) {
        F x = load(m->at[0] + v), y = load(m->at[1] + v), z = load(m->at[2] + v), c[4];
        for (int k = 0; k < 4; k++) {
            c[k] = clip[k] * x + clip[4 + k] * y + clip[8 + k] * z + clip[12 + k];
            store(m->clip[k] + v, c[k]);
        }
        F side = GUARD * c[3];
        M inside = lt(all(0), c[3]) & le(-c[3], c[2]) & le(absolute(c[0]), side) & le(absolute(c[1]), side);
        F inverse = 1 / c[3];
        store(m->inverse_w + v, sel(inside, inverse, all(1)));
        storei(m->x + v, to_i(down((c[0] * inverse + 1) * (half_x * 256) + 0.5f)));
        storei(m->y + v, to_i(down((c[1] * inverse + 1) * (half_y * 256) + 0.5f)));
        store(m->depth + v, (c[2] * inverse + 1) * 0.5f);
        const unsigned flags = bits(inside);
        for (int k = 0; k < LANES; k++) m->is_clipped[v + k] = !(flags >> k & 1);
    }
}

INLINE V3 load3(float *const *planes, int v) { return (V3){load(planes[0] + v), load(planes[1] + v), load(planes[2] + v)}; }

INLINE void put(float *rows, int v, int column, F values) {
    float each[LANES];
    store(each, values);
    for (int k = 0; k < LANES; k++) rows[(size_t)ROW * (v + k) + column] = each[k];
}

static void light_vertices(Mesh *m, const float *u) {
    const V3 eye = v3(u[U_EYE], u[U_EYE + 1], u[U_EYE + 2]);
    for (int v = 0; v < m->padded; v += LANES) {
        Light light = shade(load3(m->at, v), load3(m->at + 3, v), eye, load3(m->plane, v), load3(m->plane + 3, v),
                            load(m->occlusion + v));
        F w = load(m->inverse_w + v);
        put(m->lit, v, L_DIFFUSE, light.diffuse.x * w);
        put(m->lit, v, L_DIFFUSE + 1, light.diffuse.y * w);
        put(m->lit, v, L_DIFFUSE + 2, light.diffuse.z * w);
        put(m->lit, v, L_SPECULAR, light.specular.x * w);
        put(m->lit, v, L_SPECULAR + 1, light.specular.y * w);
        put(m->lit, v, L_SPECULAR + 2, light.specular.z * w);
        put(m->lit, v, L_UV, load(m->plane[6] + v) * w);
        put(m->lit, v, L_UV + 1, load(m->plane[7] + v) * w);
        put(m->lit, v, L_FOLD, load(m->folds + v) * w);
    }
}

static void fill_pixel_rows(Mesh *m, int all_vertices) {
    for (int v = 0; v < m->count; v++) {
        if (!all_vertices && !m->is_pixel_lit[v]) continue;
        float *row = m->pixel + (size_t)ROW * v;
        const float w = m->inverse_w[v];
        for (int k = 0; k < 6; k++) row[A_POSITION + k] = m->at[k][v] * w;
        for (int k = 0; k < 8; k++) row[A_ALBEDO + k] = m->plane[k][v] * w;
        row[A_OCCLUSION] = m->occlusion[v] * w;
        row[A_FOLD] = m->folds[v] * w;
    }
}

/* ---- triangles ---- */

INLINE int lower(int a, int b) { return a < b ? a : b; }
INLINE int higher(int a, int b) { return a > b ? a : b; }

static int add_shown(const Face *face, Mesh *m, int part, const int32_t *corner, int at_vertices) {
    const int32_t a = corner[0], b = corner[1], c = corner[2];
    const int32_t x = m->x[a], y = m->y[a], x1 = m->x[b] - x, y1 = m->y[b] - y, x2 = m->x[c] - x, y2 = m->y[c] - y;
    const int64_t area = (int64_t)x1 * y2 - (int64_t)x2 * y1; /* below 0: it faces the camera */
    if (area >= 0 && (part != STRAND || area == 0)) return 1;
    const int left = higher((lower(0, lower(x1, x2)) + x + 127) >> 8, 0);
    const int right = lower((higher(0, higher(x1, x2)) + x - 128) >> 8, face->width - 1);
    const int top = higher((lower(0, lower(y1, y2)) + y + 127) >> 8, 0);
    const int bottom = lower((higher(0, higher(y1, y2)) + y - 128) >> 8, face->height - 1);
    if (left > right || top > bottom) return 1;
    if (m->shown_count == m->shown_room) {
        const int room = m->shown_room + m->shown_room / 2 + 1024;
        if (!enlarged((void **)&m->shown, m->shown_room, room, sizeof(Triangle))) return 0;
        m->shown_room = room;
    }
    Triangle *t = m->shown + m->shown_count++;
    const int sign = area < 0 ? -1 : 1;
    t->a[1] = y2 * sign, t->b[1] = -x2 * sign;
    t->a[2] = -y1 * sign, t->b[2] = x1 * sign;
    t->a[0] = -(t->a[1] + t->a[2]), t->b[0] = -(t->b[1] + t->b[2]);
    t->x = x, t->y = y, t->area = area * sign;
    t->ax = (float)x * (1 / 256.0f), t->ay = (float)y * (1 / 256.0f);
    t->corner[0] = a, t->corner[1] = b, t->corner[2] = c;
    t->part = part;
    t->left = (int16_t)left, t->right = (int16_t)right, t->top = (int16_t)top, t->bottom = (int16_t)bottom;
    const float k = 256.0f / (float)t->area;
    t->l1x = (float)t->a[1] * k, t->l1y = (float)t->b[1] * k;
    t->l2x = (float)t->a[2] * k, t->l2y = (float)t->b[2] * k;
    const float z1 = m->depth[b] - m->depth[a], z2 = m->depth[c] - m->depth[a];
    t->z = m->depth[a];
    t->zx = z1 * t->l1x + z2 * t->l2x, t->zy = z1 * t->l1y + z2 * t->l2y;
    if (part == STRAND) {
        float across[3];
        for (int i = 0; i < 3; i++) {
            const float *row = at_vertices ? m->lit + (size_t)ROW * corner[i] + L_UV
                                           : m->pixel + (size_t)ROW * corner[i] + A_UV;
            across[i] = *row / m->inverse_w[corner[i]];
        }
        const float d1 = across[1] - across[0], d2 = across[2] - across[0];
        const float dx = d1 * t->l1x + d2 * t->l2x, dy = d1 * t->l1y + d2 * t->l2y;
        const float length = sqrtf(dx * dx + dy * dy);
        t->pixel = length > 1e-4f ? length : 1e-4f;
    }
    return 1;
}

typedef struct { float clip[4], lit[ROW], pixel[ROW]; } Corner;

static float distance_to(const float *clip, int plane) {
    switch (plane) {
    case 0: return clip[2] + clip[3];
    case 1: return GUARD * clip[3] - clip[0];
    case 2: return GUARD * clip[3] + clip[0];
    case 3: return GUARD * clip[3] - clip[1];
    default: return GUARD * clip[3] + clip[1];
    }
}

/* A triangle that reaches behind the camera or far out of the picture: the part of it that does not. */
static int add_clipped(const Face *face, Mesh *m, int part, const int32_t *corner, int at_vertices) {
    Corner polygon[2][10];
    int count = 3, now = 0;
    for (int i = 0; i < 3; i++) {
        const int32_t v = corner[i];
        const float w = m->is_clipped[v] ? 1 : m->clip[3][v];
        for (int k = 0; k < 4; k++) polygon[0][i].clip[k] = m->clip[k][v];
        for (int k = 0; k < ROW; k++) {
            polygon[0][i].lit[k] = m->lit[(size_t)ROW * v + k] * w;
            polygon[0][i].pixel[k] = m->pixel[(size_t)ROW * v + k] * w;
        }
    }
    for (int plane = 0; plane < 5; plane++, now ^= 1) {
        const Corner *from = polygon[now];
        Corner *to = polygon[!now];
        int kept = 0;
        for (int i = 0; i < count; i++) {
            if (kept > 8) return 1; /* five planes leave at most eight corners: these numbers overflowed */
            const Corner *p = from + i, *q = from + (i + 1) % count;
            const float before = distance_to(p->clip, plane), after = distance_to(q->clip, plane);
            if (before >= 0) to[kept++] = *p;
            if ((before >= 0) == (after >= 0)) continue;
            const float t = before / (before - after);
            Corner *cut = to + kept++;
            for (int k = 0; k < 4; k++) cut->clip[k] = p->clip[k] + t * (q->clip[k] - p->clip[k]);
            for (int k = 0; k < ROW; k++) {
                cut->lit[k] = p->lit[k] + t * (q->lit[k] - p->lit[k]);
                cut->pixel[k] = p->pixel[k] + t * (q->pixel[k] - p->pixel[k]);
            }
        }
        count = kept;
        if (count < 3) return 1;
    }
    const int first = m->padded + m->extra;
    if (!room_for(m, first + count)) return 0;
    for (int i = 0; i < count; i++) {
        const Corner *p = polygon[now] + i;
        const float inverse = 1 / p->clip[3];
        const float x = (p->clip[0] * inverse + 1) * 0.5f, y = (p->clip[1] * inverse + 1) * 0.5f;
        if (!(x > -GUARD && x < GUARD && y > -GUARD && y < GUARD)) return 1; /* of no size, or no number */
        const int v = first + i;
        m->x[v] = (int32_t)floorf(x * (float)face->width * 256 + 0.5f);
        m->y[v] = (int32_t)floorf(y * (float)face->height * 256 + 0.5f);
        m->depth[v] = (p->clip[2] * inverse + 1) * 0.5f;
        m->inverse_w[v] = inverse;
        for (int k = 0; k < ROW; k++) {
            m->lit[(size_t)ROW * v + k] = p->lit[k] * inverse;
            m->pixel[(size_t)ROW * v + k] = p->pixel[k] * inverse;
        }
    }
    m->extra += count;
    for (int i = 2; i < count; i++) {
        const int32_t fan[3] = {first, first + i - 1, first + i};
        if (!add_shown(face, m, part, fan, at_vertices)) return 0;
    }
    return 1;
}

static int find_shown(const Face *face, Mesh *m, int at_vertices) {
    m->shown_count = m->extra = 0;
    for (int t = 0; t < m->triangles; t++) {
        int32_t corner[3];
        memcpy(corner, m->corners + 3 * (size_t)t, 12);
        const int is_clipped = m->is_clipped[corner[0]] | m->is_clipped[corner[1]] | m->is_clipped[corner[2]];
        if (!(is_clipped ? add_clipped : add_shown)(face, m, m->part[t], corner, at_vertices)) return 0;
    }
    return 1;
}

/* Lists of triangles per tile, in order: of tile i from bin_start[i] to bin_start[i + 1]. */
static int sort_into_tiles(const Face *face, Mesh *m) {
    const int tiles = face->tiles_x * face->tiles_y;
    int32_t *start = m->bin_start + 1;
    memset(m->bin_start, 0, 4 * ((size_t)tiles + 2));
    int64_t total = 0;
#define EACH_TILE(t) \
    for (int j = (t)->top / TILE; j <= (t)->bottom / TILE; j++) \
        for (int i = (t)->left / TILE; i <= (t)->right / TILE; i++)
    for (int n = 0; n < m->shown_count; n++) {
        const Triangle *t = m->shown + n;
        EACH_TILE(t) start[j * face->tiles_x + i + 1]++, total++;
    }
    if (total > 1 << 28) return 0;
    if (total > m->bin_room) {
        if (!enlarged((void **)&m->bin, 0, total + total / 2, 4)) return 0;
        m->bin_room = (int32_t)(total + total / 2);
    }
    for (int i = 0; i < tiles; i++) start[i + 1] += start[i];
    for (int n = 0; n < m->shown_count; n++) {
        const Triangle *t = m->shown + n;
        EACH_TILE(t) m->bin[start[j * face->tiles_x + i]++] = n;
    }
    return 1; /* start[i] has become the end of tile i, so bin_start[i] is its start */
}

/* ---- tiles ---- */

#if LANES == 16
#define ACROSS {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3}
#define DOWN {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3}
#elif LANES == 8
#define ACROSS {0, 1, 2, 3, 0, 1, 2, 3}
#define DOWN {0, 0, 0, 0, 1, 1, 1, 1}
#else
#define ACROSS {0, 1, 2, 3}
#define DOWN {0, 0, 0, 0}
#endif
static const I across = ACROSS, below = DOWN;
static const F across_f = ACROSS, below_f = DOWN;

/* Index in a tile's arrays of the vector at column 4 x and row BLOCK_ROWS y. */
#define BLOCK(x, y) (((y) * (TILE / 4) + (x)) * LANES)

typedef struct { I value[3]; int first_x, last_x, first_y, last_y; int32_t at[3]; } Edges;

INLINE int begin_edges(Edges *e, const Triangle *t, int x, int y) {
    const int64_t dx = 256 * (int64_t)x + 128 - t->x, dy = 256 * (int64_t)y + 128 - t->y;
    for (int k = 0; k < 3; k++) {
        const int32_t a = t->a[k], b = t->b[k];
        int64_t value = a * dx + b * dy;
        if (k == 0) value += t->area;
        value -= !(a > 0 || (a == 0 && b > 0)); /* a pixel on a common edge belongs to one triangle */
        value >>= 8;
        const int64_t limit = 1 << 30;
        const int32_t at = (int32_t)(value > limit ? limit : value < -limit ? -limit : value);
        e->value[k] = at + (I)((across & 1) * a) + (across >> 1) * (2 * a) + below * b;
    }
    e->first_x = (higher(t->left, x) - x) / 4;
    e->last_x = (lower(t->right, x + TILE - 1) - x) / 4;
    e->first_y = (higher(t->top, y) - y) / BLOCK_ROWS;
    e->last_y = (lower(t->bottom, y + TILE - 1) - y) / BLOCK_ROWS;
    return 1;
}

typedef struct { I value[3]; } Line; /* edge functions at a vector's pixels */

INLINE Line line_of(const Edges *e, const Triangle *t, int by) {
    Line line;
    for (int k = 0; k < 3; k++) line.value[k] = e->value[k] + (4 * e->first_x * t->a[k] + BLOCK_ROWS * by * t->b[k]);
    return line;
}

/* Where a triangle covers a vector's pixels; and on to the next vector. */
INLINE M covered(Line *line, const I *step) {
    I outside = line->value[0] | line->value[1] | line->value[2];
    for (int k = 0; k < 3; k++) line->value[k] += step[k];
    return lti(alli(-1), outside);
}

/* Places of a vector's pixels relative to a triangle's first corner, in pixels. */
INLINE F from_corner_x(const Triangle *t, int x) { return across_f + ((float)x + 0.5f - t->ax); }
INLINE F from_corner_y(const Triangle *t, int y) { return below_f + ((float)y + 0.5f - t->ay); }
INLINE F depth_at(const Triangle *t, F rx, F ry) { return t->z + (t->zx * rx + t->zy * ry); }

/* The first corner's row, and how far the others' differ from it, in memory: so a lane reads each number from there. */
typedef struct { const float *first; float second[ROW], third[ROW]; F l1, l2; } Place;

INLINE void place_in(Place *p, const Triangle *t, const float *rows, F rx, F ry) {
    p->first = rows + (size_t)ROW * t->corner[0];
    const float *second = rows + (size_t)ROW * t->corner[1], *third = rows + (size_t)ROW * t->corner[2];
    for (int k = 0; k < ROW; k += LANES) {
        const F first = load(p->first + k);
        store(p->second + k, load(second + k) - first);
        store(p->third + k, load(third + k) - first);
    }
    __asm__("" : "+m"(p->second), "+m"(p->third)); /* or the compiler computes each difference alone */
    p->l1 = t->l1x * rx + t->l1y * ry;
    p->l2 = t->l2x * rx + t->l2y * ry;
}

INLINE F value_at(const Place *p, int column) {
    return p->first[column] + (p->l1 * p->second[column] + p->l2 * p->third[column]);
}

/* w from the depth: what was divided by w is multiplied by it. */
INLINE F w_of(const float *u, F z) { return u[U_DEPTH + 1] / (u[U_DEPTH] - z); }

static M without_holes(const Face *face, const Mesh *m, const Triangle *t, const float *u, int at_vertices, F rx, F ry,
                       F z) {
    Place p;
    place_in(&p, t, at_vertices ? m->lit : m->pixel, rx, ry);
    const int uv = at_vertices ? L_UV : A_UV;
    F w = w_of(u, z);
    return le(all(0.5f), sampled(face, value_at(&p, uv) * w, value_at(&p, uv + 1) * w).a);
}

/* Between marking a tile's pixels and shading them the memory has time to answer. */
INLINE void fetch_texels(const Face *face, const Mesh *m, int32_t vertex) {
    if (vertex >= m->count || face->skin_height < NEAR) return;
    const uint32_t *row = face->texels + m->texel[vertex];
    for (int k = 0; k < NEAR; k++, row += face->skin_width) __builtin_prefetch(row);
}

static void cover(Face *face, const Mesh *m, const Triangle *t, int number, const float *u, int at_vertices, int x,
                  int y) {
    Edges edges;
    begin_edges(&edges, t, x, y);
    fetch_texels(face, m, t->corner[0]);
    const I step[3] = {alli(4 * t->a[0]), alli(4 * t->a[1]), alli(4 * t->a[2])};
    for (int by = edges.first_y; by <= edges.last_y; by++) {
        Line line = line_of(&edges, t, by);
        for (int bx = edges.first_x; bx <= edges.last_x; bx++) {
            M mask = covered(&line, step);
            if (!bits(mask)) continue;
            const int at = BLOCK(bx, by);
            F rx = from_corner_x(t, x + 4 * bx), ry = from_corner_y(t, y + BLOCK_ROWS * by);
            F z = depth_at(t, rx, ry), old = load(face->z + at);
            mask &= lt(z, old);
            if (!bits(mask)) continue;
            if (t->part == CUTOUT && face->texels) mask &= without_holes(face, m, t, u, at_vertices, rx, ry, z);
            store(face->z + at, sel(mask, z, old));
            storei(face->id + at, seli(mask, alli(number), loadi(face->id + at)));
        }
    }
}

/* ---- eye.frag ---- */

INLINE V3 iris_colour(const float *u, F x, F y, F radius, F soft) {
    F share = radius / u[U_IRIS], around = angle(y, x);
    F fibres = 0.5f + 0.5f * sine(around * 37 + 3 * sine(around * 11)) * sine(around * 23 + share * 9);
    F k = mix(all(1), all(0.26f), step(0.35f, 0.95f, share)) * (0.72f + 0.56f * fibres);
    k *= 1 + 1.05f * step_(all(0.3f), all(-0.8f), y / u[U_IRIS]);
    k *= 1 - 0.9f * step(0.70f, 0.98f, share);
    V3 colour = {u[U_IRIS_ALBEDO] * k, u[U_IRIS_ALBEDO + 1] * k, u[U_IRIS_ALBEDO + 2] * k};
    const float pupil = u[U_IRIS + 1];
    return mix3(v3(0.003f, 0.003f, 0.003f), colour, step_(pupil - soft, pupil + soft, radius));
}

typedef struct { V3 position, normal; F u, v; } EyePlace;
typedef struct { V3 normal, view, front; F x, y, radius, on_cornea, facing, mirrored; M is_left; } Gaze;

/* What the highlight on the cornea depends on; its change from pixel to pixel is needed too. */
INLINE Gaze gaze_at(const float *u, const EyePlace *p) {
    const float *bones = u + U_BONES, *head = bones + 16 * 4;
    Gaze g;
    g.normal = normalised(p->normal);
    g.view = normalised(minus(v3(u[U_EYE], u[U_EYE + 1], u[U_EYE + 2]), p->position));
    g.x = (p->u - 0.5f) * 2, g.y = (p->v - 0.5f) * 2;
    g.radius = root(g.x * g.x + g.y * g.y);
    V3 side = v3(head[0], head[1], head[2]);
    g.is_left = lt(all(0), dot(side, minus(p->position, v3(head[12], head[13], head[14]))));
    V3 gaze[2];
    for (int eye = 0; eye < 2; eye++) {
        const float *z = bones + 16 * (2 + eye) + 8;
        float turned[3];
        for (int k = 0; k < 3; k++) turned[k] = head[k] * z[0] + head[4 + k] * z[1] + head[8 + k] * z[2];
        gaze[eye] = v3(turned[0], turned[1], turned[2]);
    }
    V3 ahead = {sel(g.is_left, gaze[0].x, gaze[1].x), sel(g.is_left, gaze[0].y, gaze[1].y),
                sel(g.is_left, gaze[0].z, gaze[1].z)};
    g.on_cornea = 1 - step_(all(0.95f * u[U_IRIS]), all(1.3f * u[U_IRIS]), g.radius);
    g.front = normalised(mix3(g.normal, plus(ahead, scaled(minus(g.normal, ahead), all(1.75f))), g.on_cornea));
    g.facing = dot(g.front, g.view);
    g.mirrored = half_way(KEY_FROM, g.view, dot(g.front, KEY_FROM) + g.facing);
    return g;
}

/* p: at the pixel, at its horizontal and at its vertical neighbour in a square of 2 x 2. */
static I eye_colour(const float *u, const EyePlace *p, V3 ball, F softness) {
    const float *head = u + U_BONES + 16 * 4;
    Gaze g = gaze_at(u, p), gx = gaze_at(u, p + 1), gy = gaze_at(u, p + 2);
    F change = absolute(gx.radius - g.radius) + absolute(gy.radius - g.radius);
    F soft = fmax_(0.35f * change, all(0.02f));
    F veined = step(0.35f, 0.95f, absolute(g.x));
    V3 white = {ball.x * 0.76f * mix(all(1), all(0.95f), veined), ball.y * 0.72f * mix(all(1), all(0.80f), veined),
                ball.z * 0.69f * mix(all(1), all(0.75f), veined)};
    V3 albedo = mix3(iris_colour(u, g.x, g.y, g.radius, soft), white,
                     step_(u[U_IRIS] - 0.025f - soft, u[U_IRIS] + 0.015f + soft, g.radius));

    F place_x = dot(v3(head[0], head[1], head[2]), g.normal), place_y = dot(v3(head[4], head[5], head[6]), g.normal);
    F outwards = sel(g.is_left, place_x, -place_x);
    const float *lid = u + U_LIDS;
    F upper_margin = sel(g.is_left, all(lid[0]), all(lid[2])), lower_margin = sel(g.is_left, all(lid[1]), all(lid[3]));
    F aside = fmin_(absolute(outwards) * (1 / 0.965f), all(1));
    F arch = 1 - power(aside, 2.2f + 6 * fmax_(upper_margin - 0.5f, all(0)));
    F corner = -0.13f + 0.11f * outwards;
    F upper = mix(corner, upper_margin, arch), lower_lid = mix(corner, lower_margin, arch);
    F below_upper = upper - place_y, above_lower = place_y - lower_lid;
    F opening = upper_margin - lower_margin;
    F shade = mix(all(0.10f), all(0.36f), step(0.1f, 0.8f, opening));
    F occlusion = mix(all(0.22f), all(1), step_(all(-0.05f), shade, below_upper));
    occlusion *= mix(all(0.66f), all(1), step(-0.03f, 0.18f, above_lower)) * mix(all(1), all(0.7f), step(0.55f, 1, aside));
    V3 light = scaled(irradiance(g.normal, softness, occlusion), mix(all(0.62f), all(1), occlusion));
    F lashes = mix(all(0.13f), all(0.015f), step(0.08f, 0.28f, opening)) + 0.04f * step(-0.1f, 0.7f, outwards);
    light = scaled(light, step_(lashes - 0.05f, lashes + 0.02f, below_upper));
    V3 colour = {albedo.x * light.x, albedo.y * light.y, albedo.z * light.z};

    F edge = 0.6f * (absolute(gx.mirrored - g.mirrored) + absolute(gy.mirrored - g.mirrored));
    F catchlight = step_(0.9830f - edge, 0.9930f + edge, g.mirrored);
    catchlight *= catchlight;
    catchlight += 0.22f * step(0.990f, 0.997f, half_way(FILL_FROM, g.view, dot(g.front, FILL_FROM) + g.facing));
    F k = 1.1f * catchlight * mix(all(0.08f), all(1), g.on_cornea) * step(0.02f, 0.10f, below_upper);
    colour = plus(colour, scaled(KEY_COLOUR, k));
    F tears = step_(all(0.036f), all(0.012f), above_lower);
    F wet = 0.40f * tears * fmax_(dot(g.normal, KEY_FROM), all(0));
    colour = (V3){colour.x + wet, colour.y + wet, colour.z + wet};
    return rgb(toned(colour));
}

/* ---- shading ---- */

typedef struct { F at[ROW]; } Row;

INLINE void keep(Row *row, const Place *p, int first, int end, M mine) {
#pragma GCC unroll 16
    for (int k = first; k < end; k++) row->at[k] = sel(mine, value_at(p, k), row->at[k]);
}

INLINE V3 of_row(const Row *r, int k, F w) { return (V3){r->at[k] * w, r->at[k + 1] * w, r->at[k + 2] * w}; }

INLINE Light shaded(const Row *row, F w, const float *u) {
    return shade(of_row(row, A_POSITION, w), of_row(row, A_NORMAL, w), v3(u[U_EYE], u[U_EYE + 1], u[U_EYE + 2]),
                 of_row(row, A_ALBEDO, w), of_row(row, A_SURFACE, w), row->at[A_OCCLUSION] * w);
}

/* The values of an eye's triangle at the pixels and at their neighbours. */
static void keep_eye(EyePlace *places, const Mesh *m, const Triangle *t, const float *u, int x, int y, F rx, F ry, M mine) {
    for (int n = 0; n < 3; n++) {
        F dx = {0}, dy = {0};
        if (n == 1) dx = 1 - 2 * to_f((across + x) & 1);
        if (n == 2) dy = 1 - 2 * to_f((below + y) & 1);
        F w = w_of(u, depth_at(t, rx + dx, ry + dy));
        Place p;
        place_in(&p, t, m->pixel, rx + dx, ry + dy);
        EyePlace *to = places + n;
#define KEEP(value, column) value = sel(mine, value_at(&p, column) * w, value)
        KEEP(to->position.x, A_POSITION);
        KEEP(to->position.y, A_POSITION + 1);
        KEEP(to->position.z, A_POSITION + 2);
        KEEP(to->normal.x, A_NORMAL);
        KEEP(to->normal.y, A_NORMAL + 1);
        KEEP(to->normal.z, A_NORMAL + 2);
        KEEP(to->u, A_UV);
        KEEP(to->v, A_UV + 1);
    }
}

static void shade_block(Face *face, const Mesh *m, const float *u, int at_vertices, int at, int x, int y) {
    I ids = loadi(face->id + at);
    const int32_t *id = face->id + at;
    unsigned left = bits(lti(alli(-1), ids));
    Row lit = {{{0}}}, pixel;
    EyePlace eyes[3];
    M is_lit = none(), is_pixel = none(), is_eye = none(), is_cut_out = none();
    int is_first = 1;
    while (left) {
        const Triangle *t = m->shown + id[__builtin_ctz(left)];
        M mine = eqi(ids, alli(id[__builtin_ctz(left)]));
        left &= ~bits(mine);
        F rx = from_corner_x(t, x), ry = from_corner_y(t, y);
        if (t->part == CUTOUT) is_cut_out |= mine;
        if (at_vertices && t->part <= CUTOUT) {
            Place p;
            place_in(&p, t, m->lit, rx, ry);
            is_lit |= mine;
            keep(&lit, &p, 0, LIT, mine);
            continue;
        }
        if (is_first) memset(&pixel, 0, sizeof pixel), memset(eyes, 0, sizeof eyes), is_first = 0;
        Place p;
        place_in(&p, t, m->pixel, rx, ry);
        keep(&pixel, &p, 0, ROW, mine);
        if (t->part == EYE) {
            keep_eye(eyes, m, t, u, x, y, rx, ry, mine);
            is_eye |= mine;
        } else
            is_pixel |= mine;
    }
    F w = w_of(u, load(face->z + at));
    I colour = loadi(face->tile + at);
    if (bits(is_lit)) {
        V3 c = painted(face, of_row(&lit, L_DIFFUSE, w), of_row(&lit, L_SPECULAR, w), lit.at[L_UV] * w,
                       lit.at[L_UV + 1] * w, lit.at[L_FOLD] * w, is_cut_out);
        colour = seli(is_lit, rgb(toned(c)), colour);
    }
    if (bits(is_pixel)) {
        Light light = shaded(&pixel, w, u);
        V3 c = painted(face, light.diffuse, light.specular, pixel.at[A_UV] * w, pixel.at[A_UV + 1] * w,
                       pixel.at[A_FOLD] * w, is_cut_out);
        colour = seli(is_pixel, rgb(toned(c)), colour);
    }
    if (bits(is_eye))
        colour = seli(is_eye, eye_colour(u, eyes, of_row(&pixel, A_ALBEDO, w), pixel.at[A_SURFACE + 2] * w), colour);
    storei(face->tile + at, colour);
}

INLINE I blended(I old, V3 c, F alpha) {
    I made = {0};
    F over[4] = {unit(c.x) * 255, unit(c.y) * 255, unit(c.z) * 255, all(255)};
    for (int k = 0; k < 4; k++) {
        F under = to_f((old >> (8 * k)) & 255);
        made |= to_i(over[k] * alpha + under * (1 - alpha) + 0.5f) << (8 * k);
    }
    return made;
}

static void draw_strand(Face *face, const Mesh *m, const Triangle *t, const float *u, int at_vertices, int x, int y) {
    Edges edges;
    begin_edges(&edges, t, x, y);
    const I step[3] = {alli(4 * t->a[0]), alli(4 * t->a[1]), alli(4 * t->a[2])};
    for (int by = edges.first_y; by <= edges.last_y; by++) {
        Line line = line_of(&edges, t, by);
        for (int bx = edges.first_x; bx <= edges.last_x; bx++) {
            M mask = covered(&line, step);
            if (!bits(mask)) continue;
            const int at = BLOCK(bx, by);
            F rx = from_corner_x(t, x + 4 * bx), ry = from_corner_y(t, y + BLOCK_ROWS * by);
            F z = depth_at(t, rx, ry), w = w_of(u, z);
            mask &= lt(z, load(face->z + at));
            if (!bits(mask)) continue;
            Place p;
            place_in(&p, t, at_vertices ? m->lit : m->pixel, rx, ry);
            const int uv = at_vertices ? L_UV : A_UV;
            F place = value_at(&p, uv) * w, half = value_at(&p, uv + 1) * w;
            const float pixel = t->pixel;
            F overlap = fmin_(place + 0.5f * pixel, half) - fmax_(place - 0.5f * pixel, -half);
            F alpha = unit(overlap / pixel);
            mask &= lt(all(0), alpha);
            if (!bits(mask)) continue;
            V3 c;
            Row row;
            for (int k = 0; k < (at_vertices ? 6 : ROW); k++) row.at[k] = value_at(&p, k);
            if (at_vertices)
                c = plus(of_row(&row, L_DIFFUSE, w), of_row(&row, L_SPECULAR, w));
            else {
                Light light = shaded(&row, w, u);
                c = plus(light.diffuse, light.specular);
            }
            I old = loadi(face->tile + at);
            storei(face->tile + at, seli(mask, blended(old, toned(c), alpha), old));
        }
    }
}

/* ---- from tiles to the picture ---- */

INLINE F brightness(F r, F g, F b, F a) { return r * 0.299f + g * 0.587f + b * 0.114f + 0.25f * a; }

INLINE F brightness_of(I c) {
    return brightness(to_f(c & 255), to_f((c >> 8) & 255), to_f((c >> 16) & 255), to_f((I)((H)(c >> 16) >> 8) & 255))
        * (1 / 255.0f);
}

/* Where brightness lies: one more column at each side. */
#define BRIGHT(face, x, y) ((face)->brightness + (size_t)(y) * ((face)->stride + 2) + (x) + 1)

static void show_tile(Face *face, int x, int y) {
    for (int by = 0; by < TILE / BLOCK_ROWS; by++)
        for (int bx = 0; bx < TILE / 4; bx++) {
            const uint32_t *from = face->tile + BLOCK(bx, by);
            float bright[LANES];
            store(bright, brightness_of(loadi(from)));
            for (int row = 0; row < BLOCK_ROWS; row++) {
                const int px = x + 4 * bx, py = y + BLOCK_ROWS * by + row;
                memcpy(face->colour + (size_t)py * face->stride + px, from + 4 * row, 16);
                memcpy(BRIGHT(face, px, py), bright + 4 * row, 16);
            }
        }
}

static void draw_tiles(Face *face, Mesh *m, const float *u, int at_vertices, int is_ground) {
    for (int j = 0; j < face->tiles_y; j++)
        for (int i = 0; i < face->tiles_x; i++) {
            const int n = j * face->tiles_x + i, x = i * TILE, y = j * TILE;
            const int32_t *bin = m->bin + m->bin_start[n], *end = m->bin + m->bin_start[n + 1];
            const int is_used = bin < end;
            face->is_dirty[n] |= is_used || face->was[n];
            if (!is_ground && !face->is_dirty[n]) continue;
            face->was[n] = !is_ground && is_used;
            uint32_t *ground = face->ground + (size_t)TILE_PX * n;
            float *depth = face->ground_depth + (size_t)TILE_PX * n;
            if (is_ground)
                memcpy(face->tile, face->backdrop + (size_t)TILE_PX * n, sizeof face->tile);
            else
                memcpy(face->tile, ground, sizeof face->tile);
            if (is_ground)
                for (int k = 0; k < TILE_PX; k++) face->z[k] = 1;
            else
                memcpy(face->z, depth, sizeof face->z);
            if (is_used) {
                memset(face->id, -1, sizeof face->id);
                for (; bin < end && m->shown[*bin].part != STRAND; bin++)
                    cover(face, m, m->shown + *bin, *bin, u, at_vertices, x, y);
                for (int by = 0; by < TILE / BLOCK_ROWS; by++)
                    for (int bx = 0; bx < TILE / 4; bx++) {
                        const int at = BLOCK(bx, by);
                        if (bits(lti(alli(-1), loadi(face->id + at))))
                            shade_block(face, m, u, at_vertices, at, x + 4 * bx, y + BLOCK_ROWS * by);
                    }
                for (; bin < end; bin++) draw_strand(face, m, m->shown + *bin, u, at_vertices, x, y);
            }
            if (is_ground) {
                memcpy(ground, face->tile, sizeof face->tile);
                memcpy(depth, face->z, sizeof face->z);
            } else
                show_tile(face, x, y);
        }
}

/* neighbours.glsl, edges.frag: lists the pixels of a row that lie on an edge. */
static int list_edges(const Face *face, int y, int first, int end, uint32_t *list) {
    const float *here = BRIGHT(face, 0, y), *above = BRIGHT(face, 0, y ? y - 1 : 0),
                *beneath = BRIGHT(face, 0, y + 1 < face->height ? y + 1 : y);
    int count = 0;
    for (int x = first; x < end; x += LANES) {
        F a = load(above + x - 1), b = load(above + x + 1), c = load(beneath + x - 1), d = load(beneath + x + 1);
        F centre = load(here + x);
        F low = fmin_(centre, fmin_(fmin_(a, b), fmin_(c, d))), high = fmax_(centre, fmax_(fmax_(a, b), fmax_(c, d)));
        unsigned found = bits(le(fmax_(all(0.04f), 0.11f * high), high - low));
        for (; found; found &= found - 1) {
            const int at = x + __builtin_ctz(found);
            if (at < end) list[count++] = (uint32_t)y << 16 | (uint32_t)at;
        }
    }
    return count;
}

INLINE Bytes colour_at(const Face *face, F x, F y) {
    x = x - 0.5f, y = y - 0.5f;
    F whole_x = down(x), whole_y = down(y);
    I wx = to_i((x - whole_x) * 256 + 0.5f), wy = to_i((y - whole_y) * 256 + 0.5f);
    I ix = to_i(whole_x), iy = to_i(whole_y), zero = alli(0), right = alli(face->width - 1), bottom = alli(face->height - 1);
    I x0 = maxi(mini(ix, right), zero), x1 = maxi(mini(ix + 1, right), zero);
    I y0 = maxi(mini(iy, bottom), zero) * face->stride, y1 = maxi(mini(iy + 1, bottom), zero) * face->stride;
    return bilinear(gather(face->colour, y0 + x0), gather(face->colour, y0 + x1), gather(face->colour, y1 + x0),
                    gather(face->colour, y1 + x1), wx, wy);
}

/* smooth.frag, for LANES pixels. */
static I smoothed(const Face *face, I x, I y) {
    const int line = face->stride + 2;
    I above = maxi(y - 1, alli(0)) * line + 1, beneath = mini(y + 1, alli(face->height - 1)) * line + 1;
#define AT(index) ((F)gather(face->brightness, index))
    F nw = AT(beneath + x - 1), ne = AT(beneath + x + 1), sw = AT(above + x - 1), se = AT(above + x + 1);
    F centre = AT(y * line + 1 + x);
    F low = fmin_(centre, fmin_(fmin_(nw, sw), fmin_(ne, se))), high = fmax_(centre, fmax_(fmax_(nw, sw), fmax_(ne, se)));
    F along_x = -((nw + ne) - (sw + se)), along_y = (nw + sw) - (ne + se);
    F shorter = 1 / (fmin_(absolute(along_x), absolute(along_y)) + fmax_(0.03f * (nw + ne + sw + se), all(0.008f)));
    along_x = clamp(along_x * shorter, -6, 6), along_y = clamp(along_y * shorter, -6, 6);
    F px = to_f(x) + 0.5f, py = to_f(y) + 0.5f;
    const float sixth = 1 / 6.0f;
    Bytes a = colour_at(face, px - along_x * sixth, py - along_y * sixth);
    Bytes b = colour_at(face, px + along_x * sixth, py + along_y * sixth);
    Bytes c = colour_at(face, px - along_x * 0.5f, py - along_y * 0.5f);
    Bytes d = colour_at(face, px + along_x * 0.5f, py + along_y * 0.5f);
    H even = a.even + b.even, odd = a.odd + b.odd;
    H wide_even = even + c.even + d.even, wide_odd = odd + c.odd + d.odd;
    F wide = brightness(to_f((I)wide_even & 0xffff), to_f((I)wide_odd & 0xffff), to_f((I)wide_even >> 16),
                        to_f((I)wide_odd >> 16)) * (1 / 1020.0f);
    I narrow_colour = (I)((even + 1) >> 1) | ((I)((odd + 1) >> 1) << 8);
    I wide_colour = (I)((wide_even + 2) >> 2) | ((I)((wide_odd + 2) >> 2) << 8);
    return seli(lt(wide, low) | lt(high, wide), narrow_colour, wide_colour);
}

static void smooth(Face *face, int soft) {
    for (int y = 0; y < face->height; y++) {
        BRIGHT(face, 0, y)[-1] = *BRIGHT(face, 0, y);
        *BRIGHT(face, face->width, y) = *BRIGHT(face, face->width - 1, y);
    }
    int count = 0;
    for (int y = 0; y < face->height; y++) {
        int first = face->tiles_x, last = -1;
        const int top = higher(y - REACH, 0) / TILE, bottom = lower(y + REACH, face->height - 1) / TILE;
        for (int j = top; j <= bottom; j++)
            for (int i = 0; i < face->tiles_x; i++)
                if (face->is_dirty[j * face->tiles_x + i]) first = lower(first, i), last = higher(last, i);
        if (last < first) continue;
        const int begin = higher(first * TILE - REACH, 0), end = lower(last * TILE + TILE + REACH, face->width);
        const size_t row = (size_t)y * face->stride;
        memcpy(face->out + row + begin, face->colour + row + begin, 4 * (size_t)(end - begin));
        if (soft) count += list_edges(face, y, begin, end, face->edge + count);
    }
    for (int i = 0; i < count; i += LANES) {
        const int n = lower(LANES, count - i);
        for (int k = n; k < LANES; k++) face->edge[i + k] = face->edge[i];
        I at = loadi(face->edge + i), x = at & 0xffff, y = at >> 16;
        uint32_t made[LANES];
        storei(made, smoothed(face, x, y));
        for (int k = 0; k < n; k++) face->out[(size_t)y[k] * face->stride + x[k]] = made[k];
    }
}

static void write_rgb(const Face *face, uint8_t *out) {
    for (int y = 0; y < face->height; y++) {
        const uint32_t *row = face->out + (size_t)y * face->stride;
        int x = 0;
        for (; x < face->width - 1; x++, out += 3) memcpy(out, row + x, 4); /* the fourth is written over */
        memcpy(out, row + x, 3);
        out += 3;
    }
}

static void write_rgba(const Face *face, uint8_t *out) {
    for (int y = 0; y < face->height; y++)
        memcpy(out + 4 * (size_t)y * face->width, face->out + (size_t)y * face->stride, 4 * (size_t)face->width);
}

#define RED(c) (int)((c) & 255)
#define GREEN(c) (int)((c) >> 8 & 255)
#define BLUE(c) (int)((c) >> 16 & 255)

INLINE void write_chroma(uint32_t a, uint32_t b, uint32_t c, uint32_t d, uint8_t *u, uint8_t *v) {
    const int red = RED(a) + RED(b) + RED(c) + RED(d), green = GREEN(a) + GREEN(b) + GREEN(c) + GREEN(d);
    const int blue = BLUE(a) + BLUE(b) + BLUE(c) + BLUE(d);
    *u = (uint8_t)((-38 * red - 74 * green + 112 * blue + 512 + 131072) >> 10);
    *v = (uint8_t)((112 * red - 94 * green - 18 * blue + 512 + 131072) >> 10);
}

/* Rec. 601, limited range; chroma is the mean of 2 x 2 pixels. The restricted pointers permit vectors. */
static void write_i420(const Face *face, uint8_t *out) {
    const int width = face->width, height = face->height, half = (width + 1) / 2;
    for (int y = 0; y < height; y++) {
        const uint32_t *restrict c = face->out + (size_t)y * face->stride;
        uint8_t *restrict to = out + (size_t)y * width;
        for (int x = 0; x < width; x++)
            to[x] = (uint8_t)((66 * RED(c[x]) + 129 * GREEN(c[x]) + 25 * BLUE(c[x]) + 128 + 4096) >> 8);
    }
    uint8_t *restrict u = out + (size_t)width * height, *restrict v = u + (size_t)half * ((height + 1) / 2);
    for (int y = 0; y < height; y += 2, u += half, v += half) {
        const uint32_t *restrict c = face->out + (size_t)y * face->stride;
        const uint32_t *restrict d = y + 1 < height ? c + face->stride : c;
        for (int x = 0; x < width / 2; x++) write_chroma(c[2 * x], c[2 * x + 1], d[2 * x], d[2 * x + 1], u + x, v + x);
        if (width % 2) write_chroma(c[width - 1], c[width - 1], d[width - 1], d[width - 1], u + half - 1, v + half - 1);
    }
}

/* ---- the interface ---- */

static void face_close(Face *face) {
    mesh_close(face->mesh);
    mesh_close(face->mesh + 1);
    void *arrays[] = {face->backdrop, face->ground, face->colour, face->out, face->edge, face->ground_depth,
                      face->brightness, face->was, face->is_dirty, face->texels, face};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) freed(arrays[i]);
}

extern const Build BUILD;

static Face *face_open(const float *vertices, int count, const float *displacements, const float *normal_deltas,
                       int entries, const uint32_t *const *parts, const int *counts) {
    if (count < 0 || entries < 0 || !is_valid(vertices, count, displacements, entries, parts, counts)) return NULL;
    Face *face = zeroed(1, sizeof *face);
    if (!face) return NULL;
    face->build = &BUILD;
    for (int moving = 0; moving < 2; moving++)
        if (!mesh_open(face->mesh + moving, !moving, vertices, count, displacements, normal_deltas, parts, counts)) {
            face_close(face);
            return NULL;
        }
    return face;
}

static int face_canvas(Face *face, int width, int height, const uint8_t *background) {
    if (width < 1 || height < 1 || width > 4096 || height > 4096) return 0;
    face->width = 0; /* until everything is there */
    face->tiles_x = (width + TILE - 1) / TILE, face->tiles_y = (height + TILE - 1) / TILE;
    face->stride = face->tiles_x * TILE;
    const size_t tiles = (size_t)face->tiles_x * face->tiles_y, pixels = tiles * TILE_PX;
    int done = enlarged((void **)&face->backdrop, 0, pixels, 4) && enlarged((void **)&face->ground, 0, pixels, 4)
        && enlarged((void **)&face->colour, 0, pixels, 4) && enlarged((void **)&face->out, 0, pixels, 4)
        && enlarged((void **)&face->edge, 0, pixels + LANES, 4) && enlarged((void **)&face->ground_depth, 0, pixels, 4)
        && enlarged((void **)&face->brightness, 0, pixels + 2 * (size_t)face->tiles_y * TILE + LANES, 4)
        && enlarged((void **)&face->was, 0, tiles, 1) && enlarged((void **)&face->is_dirty, 0, tiles, 1);
    for (int k = 0; k < 2; k++) done = done && enlarged((void **)&face->mesh[k].bin_start, 0, tiles + 2, 4);
    if (!done) return 0;
    for (int y = 0; y < height && background; y++)
        for (int x = 0; x < width; x++) {
            const size_t tile = (size_t)(y / TILE) * face->tiles_x + x / TILE;
            const int in_x = x % TILE, in_y = y % TILE;
            uint32_t *to = face->backdrop + tile * TILE_PX + BLOCK(in_x / 4, in_y / BLOCK_ROWS)
                + in_y % BLOCK_ROWS * 4 + in_x % 4;
            memcpy(to, background + 4 * ((size_t)y * width + x), 4);
        }
    face->ground_is_drawn = 0;
    face->width = width, face->height = height;
    return 1;
}

static int texel_at(float place, int size) {
    place -= floorf(place);
    return place >= 0 && place < 1 ? (int)(place * (float)size) : 0; /* it may be no number */
}

static void find_texels(const Face *face, Mesh *m) {
    for (int v = 0; v < m->count; v++) {
        const int x = texel_at(m->plane[6][v], face->skin_width), y = texel_at(m->plane[7][v], face->skin_height);
        m->texel[v] = higher(lower(y - NEAR / 2, face->skin_height - NEAR), 0) * face->skin_width + x;
    }
}

static int face_skin(Face *face, int width, int height, const uint8_t *texels) {
    if (width < 1 || height < 1 || width > 32768 || height > 32768) return 0;
    if (!enlarged((void **)&face->texels, 0, (size_t)width * height, 4)) return 0;
    memcpy(face->texels, texels, 4 * (size_t)width * height);
    face->skin_width = width, face->skin_height = height;
    for (int k = 0; k < 2; k++) find_texels(face, face->mesh + k);
    face->ground_is_drawn = 0;
    return 1;
}

static int draw_mesh(Face *face, Mesh *m, const float *u, int at_vertices, int is_ground) {
    move_vertices(m, u);
    project(face, m, u + U_CLIP);
    if (at_vertices) light_vertices(m, u);
    if (!at_vertices || m->has_pixel_parts) fill_pixel_rows(m, !at_vertices);
    if (!find_shown(face, m, at_vertices) || !sort_into_tiles(face, m)) return 0;
    draw_tiles(face, m, u, at_vertices, is_ground);
    return 1;
}

static int face_draw(Face *face, const float *u, int at_vertices, int soft, int format, uint8_t *out) {
    if (!face->width) return 0;
    const size_t tiles = (size_t)face->tiles_x * face->tiles_y;
    memset(face->is_dirty, 0, tiles);
    if (!face->ground_is_drawn || face->ground_at_vertices != at_vertices
        || memcmp(face->ground_uniforms, u + U_CLIP, sizeof face->ground_uniforms)) {
        face->ground_is_drawn = 0;
        if (!draw_mesh(face, face->mesh, u, at_vertices, 1)) return 0;
        memset(face->is_dirty, 1, tiles);
        memcpy(face->ground_uniforms, u + U_CLIP, sizeof face->ground_uniforms);
        face->ground_at_vertices = at_vertices, face->ground_is_drawn = 1;
    }
    if (!draw_mesh(face, face->mesh + 1, u, at_vertices, 0)) {
        face->ground_is_drawn = 0;
        return 0;
    }
    smooth(face, soft);
    (format == RGB ? write_rgb : format == RGBA ? write_rgba : write_i420)(face, out);
    return 1;
}

/* Linear, as OpenGL's: four bytes per pixel. */
static void resize(const uint8_t *from, int width, int height, uint8_t *to, int new_width, int new_height) {
    for (int y = 0; y < new_height; y++) {
        const float fy = ((float)y + 0.5f) * (float)height / (float)new_height - 0.5f, whole_y = floorf(fy);
        const int y0 = lower(higher((int)whole_y, 0), height - 1), y1 = lower((int)whole_y + 1, height - 1);
        for (int x = 0; x < new_width; x++) {
            const float fx = ((float)x + 0.5f) * (float)width / (float)new_width - 0.5f, whole_x = floorf(fx);
            const int x0 = lower(higher((int)whole_x, 0), width - 1), x1 = lower((int)whole_x + 1, width - 1);
            const float wx = fx - whole_x, wy = fy - whole_y;
            for (int k = 0; k < 4; k++) {
                const float a = from[4 * ((size_t)y0 * width + x0) + k], b = from[4 * ((size_t)y0 * width + x1) + k];
                const float c = from[4 * ((size_t)y1 * width + x0) + k], d = from[4 * ((size_t)y1 * width + x1) + k];
                const float above = a + wx * (b - a), beneath = c + wx * (d - c);
                *to++ = (uint8_t)(above + wy * (beneath - above) + 0.5f);
            }
        }
    }
}

#define TEXT(x) #x
#define NAMED(x) TEXT(x)
const Build BUILD = {NAMED(NAME), face_open, face_close, face_canvas, face_skin, face_draw, resize};
