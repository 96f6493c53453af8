/* The library's interface, and which build of face.c this processor runs. All builds draw the same bytes. */
#include "face.h"

#include <string.h>
#ifdef __x86_64__
#include <cpuid.h>
#endif

#ifdef _WIN32
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

extern const Build face_baseline;
#ifdef __x86_64__
extern const Build face_v3, face_v4;
#endif

static const Build *chosen;

/* Whether the processor and the system have a version of x86-64. Asked of the processor: in what Zig builds,
   __builtin_cpu_supports says no to everything. */
static int runs(int version) {
    if (version == 1) return 1;
#ifdef __x86_64__
    unsigned a, b, c, d, saved, high;
    const unsigned fma_movbe_osxsave_avx_f16c = 1u << 12 | 1u << 22 | 1u << 27 | 1u << 28 | 1u << 29;
    const unsigned bmi_avx2_bmi2 = 1u << 3 | 1u << 5 | 1u << 8, lzcnt = 1u << 5;
    const unsigned avx512_f_dq_cd_bw_vl = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;
    if (!__get_cpuid(1, &a, &b, &c, &d) || ~c & fma_movbe_osxsave_avx_f16c) return 0;
    if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || ~c & lzcnt) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || ~b & bmi_avx2_bmi2) return 0;
    __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0)); /* registers that the system saves: 2, 4 AVX; 0xe0 AVX-512 */
    if (version == 3) return !(~saved & 6);
    if (version == 4) return !(~saved & 0xe6) && !(~b & avx512_f_dq_cd_bw_vl);
#endif
    return 0;
}

/* Selects a build by name, "" the fastest that this processor runs; returns its name, or NULL if it cannot run here. */
PUBLIC const char *fapengine_native_select(const char *name) {
    const Build *builds[] = {
#ifdef __x86_64__
        &face_v4, &face_v3,
#endif
        &face_baseline};
    const int versions[] = {
#ifdef __x86_64__
        4, 3,
#endif
        1};
    for (unsigned i = 0; i < sizeof builds / sizeof *builds; i++)
        if (runs(versions[i]) && (!*name || !strcmp(name, builds[i]->name))) {
            chosen = builds[i];
            return chosen->name;
        }
    return 0;
}

static const Build *build(void) {
    if (!chosen) fapengine_native_select("");
    return chosen;
}

PUBLIC int fapengine_native_version(void) { return 2; }

PUBLIC Face *fapengine_native_open(const float *vertices, int count, const float *displacements,
                                   const float *normal_deltas, int entries, const uint32_t *const *parts,
                                   const int *counts) {
    return build()->open(vertices, count, displacements, normal_deltas, entries, parts, counts);
}

/* The first member of a Face is its build: another one may have been selected since. */
#define OF(face) (*(const Build *const *)(face))

PUBLIC void fapengine_native_close(Face *face) { OF(face)->close(face); }

PUBLIC int fapengine_native_canvas(Face *face, int width, int height, const uint8_t *background) {
    return OF(face)->canvas(face, width, height, background);
}

PUBLIC int fapengine_native_skin(Face *face, int width, int height, const uint8_t *texels) {
    return OF(face)->skin(face, width, height, texels);
}

PUBLIC int fapengine_native_draw(Face *face, const float *uniforms, int at_vertices, int soft, int format,
                                 uint8_t *out) {
    return OF(face)->draw(face, uniforms, at_vertices, soft, format, out);
}

PUBLIC void fapengine_native_resize(const uint8_t *from, int width, int height, uint8_t *to, int new_width,
                                    int new_height) {
    build()->resize(from, width, height, to, new_width, new_height);
}
