/* The adaptive arithmetic coder of MPEG-4 face animation and the loops over fields and planes.

   fapengine/codec/kernels.py is the same in Python: it says how the coder works, has these functions by the same names,
   and writes the same bytes. Arrays are those of numpy: numbers of 64 bits, counts and trees of 32, a bit per byte.

   No byte of a stream makes these functions read or write outside of their arrays: bits after the end read as the
   padding, what is written is counted even where it no longer fits, and is_sound checks the tables first. */
#include <math.h>
#include <stdint.h>

#ifdef _WIN32
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

enum { HALF = 32768, QUARTER = 16384, THREE_QUARTERS = 49152, TOP = 65535 };
enum { LIMIT = 16383, ZERO_RUN = 22, SKIP_LIMIT = 100000, MIN_PLANE_BITS = 5, LOOK_AHEAD = 14 };
enum { FIELD_COUNT = 73, A_END = 3, B_END = 7, MAX_SYMBOLS = 8191 };
enum { DONE, NEED_MORE, AT_CODE, INTRA_NEXT, FULL, BAD_MASK, BAD_STUFFING, BAD_VALUE, WITH_BODY, BAD_SKIP };

typedef struct {
    int64_t on, step, i_min, i_count, p_min, p_count, min_value, max_value;
} Field;

/* The coded fields, and the counts of symbols of each: those of a field begin after base, with their Fenwick tree. */
typedef struct {
    const Field *fields;
    int64_t count;
    int64_t *base;
    int32_t *counts, *tree;
    int64_t *totals;
    int64_t room;
} Models;

static int is_face(const Models *m) { return m->count == FIELD_COUNT; }

/* Whether the alphabets are none too large for the coder, and lie within the arrays. */
static int is_sound(const Models *m) {
    for (int64_t i = 0; i < m->count; i++) {
        const Field *f = &m->fields[i];
        if (!f->on) continue;
        if (f->step < 1 || f->i_count < 1 || f->i_count > MAX_SYMBOLS || f->p_count < 1 || f->p_count > MAX_SYMBOLS ||
            m->base[i] < 0 || m->base[i] + f->p_count >= m->room)
            return 0;
    }
    return 1;
}

PUBLIC int fapengine_native_reset_models(const Models *m) {
    if (!is_sound(m)) return 0;
    for (int64_t field = 0; field < m->count; field++) {
        int64_t size = m->fields[field].on ? m->fields[field].p_count : 0, start = m->base[field];
        m->totals[field] = size;
        for (int64_t i = 1; i <= size; i++) {
            m->counts[start + i] = 1;
            m->tree[start + i] = (int32_t)(i & -i);
        }
    }
    return 1;
}

static void count_symbol(const Models *m, int64_t field, int64_t rank) {
    int64_t size = m->fields[field].p_count;
    int32_t *counts = m->counts + m->base[field], *tree = m->tree + m->base[field];
    if (m->totals[field] == LIMIT) {
        int64_t total = 0;
        for (int64_t i = 1; i <= size; i++) {
            tree[i] = counts[i] = (counts[i] + 1) >> 1;
            total += counts[i];
        }
        for (int64_t i = 1; i <= size; i++)
            if (i + (i & -i) <= size) tree[i + (i & -i)] += tree[i];
        m->totals[field] = total;
    }
    counts[rank + 1]++;
    m->totals[field]++;
    for (int64_t i = rank + 1; i <= size; i += i & -i) tree[i]++;
}

/* Encoding */

typedef struct {
    uint8_t *bits;
    int64_t room, at, low, high, pending, zeros;
} Writer;

static void put_raw(Writer *w, int bit) {
    if (w->at < w->room) w->bits[w->at] = (uint8_t)bit;
    w->at++;
}

static void put(Writer *w, int bit) {
    if (w->zeros == ZERO_RUN) {
        put_raw(w, 1);
        w->zeros = 0;
    }
    put_raw(w, bit);
    w->zeros = bit ? 0 : w->zeros + 1;
}

static void emit(Writer *w, int bit) {
    put(w, bit);
    for (; w->pending; w->pending--) put(w, !bit);
}

static void encode_symbol(Writer *w, int64_t under, int64_t over, int64_t total) {
    int64_t length = w->high - w->low + 1, low = w->low + length * under / total,
            high = w->low - 1 + length * over / total;
    for (;; low = 2 * low, high = 2 * high + 1) {
        int64_t shift;
        if (high < HALF) {
            emit(w, 0);
            continue;
        }
        if (low >= HALF) {
            emit(w, 1);
            shift = HALF;
        } else if (low >= QUARTER && high < THREE_QUARTERS) {
            w->pending++;
            shift = QUARTER;
        } else
            break;
        low -= shift;
        high -= shift;
    }
    w->low = low;
    w->high = high;
}

static void open_writer(Writer *w) {
    w->low = w->pending = w->zeros = 0;
    w->high = TOP;
}

static void flush(Writer *w) {
    w->pending++;
    emit(w, w->low >= QUARTER);
    open_writer(w);
}

/* Returns the field whose symbol is out of range, or -1. */
static int64_t write_plane(const Models *m, int intra, const int64_t *target, const int64_t *flags, int64_t *previous,
                           int clamp, Writer *w) {
    open_writer(w);
    for (int64_t field = 0; field < m->count; field++) {
        const Field *f = &m->fields[field];
        if (is_face(m) && field == A_END && m->fields[0].on) {
            flush(w);
            put_raw(w, flags[0] != 0);
        }
        if (is_face(m) && field == B_END && m->fields[A_END].on) {
            flush(w);
            put_raw(w, flags[1] != 0);
            put_raw(w, flags[2] != 0);
        }
        if (!f->on) continue;
        int64_t first = intra ? f->i_min : f->p_min, size = intra ? f->i_count : f->p_count;
        int64_t before = intra ? 0 : previous[field], wanted = target[field] - before, half = f->step / 2;
        int64_t magnitude = wanted < 0 ? -wanted : wanted;
        int64_t level = magnitude <= half ? 0 : (magnitude + half) / f->step;
        int64_t symbol = (wanted < 0 ? -level : level) - first;
        if (symbol < 0 || symbol >= size) {
            if (!clamp) return field;
            symbol = symbol < 0 ? 0 : size - 1;
        }
        previous[field] = before + (symbol + first) * f->step;
        int64_t rank = size - 1 - symbol;
        if (intra) {
            encode_symbol(w, rank, rank + 1, size);
            continue;
        }
        const int32_t *tree = m->tree + m->base[field];
        int64_t under = 0;
        for (int64_t i = rank; i > 0; i &= i - 1) under += tree[i];
        encode_symbol(w, under, under + m->counts[m->base[field] + rank + 1], m->totals[field]);
        count_symbol(m, field, rank);
    }
    flush(w);
    return -1;
}

/* Sets the end to the bits written, more than fit if there is no room; or to -1 - field. Returns 0 for wrong tables. */
PUBLIC int fapengine_native_encode_plane(const Models *m, int intra, const int64_t *target, const int64_t *flags,
                                         int64_t *previous, int clamp, uint8_t *out, int64_t room, int64_t at,
                                         int64_t *end) {
    if (!is_sound(m)) return 0;
    Writer w = {.bits = out, .room = room, .at = at};
    int64_t bad = write_plane(m, intra, target, flags, previous, clamp, &w);
    *end = bad < 0 ? w.at : -1 - bad;
    return 1;
}

PUBLIC int fapengine_native_encode_predicted(const Models *m, const int64_t *targets, const int64_t *flags,
                                             const int64_t *skips, int64_t planes, int64_t *previous, int clamp,
                                             uint8_t *out, int64_t room, int64_t at, int64_t *end) {
    if (!is_sound(m)) return 0;
    Writer w = {.bits = out, .room = room, .at = at};
    for (int64_t t = 0; t < planes; t++) {
        put_raw(&w, 0);
        put_raw(&w, 0);
        put_raw(&w, 1);
        put_raw(&w, skips[t] != 0);
        for (int64_t left = skips[t]; left >= 0 && skips[t]; left -= 15)
            for (int k = 3; k >= 0; k--) put_raw(&w, (left < 15 ? left : 15) >> k & 1);
        int64_t bad = write_plane(m, 0, targets + t * m->count, flags + t * 3, previous, clamp, &w);
        if (bad >= 0) {
            *end = -1 - bad;
            return 1;
        }
    }
    *end = w.at;
    return 1;
}

/* Decoding */

typedef struct {
    const uint8_t *bits;
    int64_t count;
    int pad;
    int64_t low, high, value, zeros, read, taken, bad;
    int64_t positions[16];
} Reader;

static int raw(const Reader *r, int64_t position) {
    return position < r->count ? r->bits[position] != 0 : r->pad;
}

static int take(Reader *r) {
    int64_t position = r->read;
    if (r->zeros == ZERO_RUN) {
        if (raw(r, position))
            position++;
        else if (r->bad < 0)
            r->bad = r->taken; /* only an error if this data bit is still inside the segment */
        r->zeros = 0;
    }
    int bit = raw(r, position);
    r->read = position + 1;
    r->zeros = bit ? 0 : r->zeros + 1;
    r->positions[r->taken & 15] = position + 1;
    r->taken++;
    return bit;
}

static void open_segment(Reader *r, int64_t position) {
    r->low = r->value = r->taken = r->zeros = 0;
    r->high = TOP;
    r->read = position;
    r->bad = -1;
    for (int k = 0; k < 16; k++) r->value = 2 * r->value + take(r);
}

static int64_t close_segment(const Reader *r) {
    int64_t end = r->taken - LOOK_AHEAD;
    return r->bad >= 0 && r->bad < end ? -1 : r->positions[(end - 1) & 15];
}

static void narrow(Reader *r, int64_t under, int64_t over, int64_t total) {
    int64_t length = r->high - r->low + 1, low = r->low + length * under / total,
            high = r->low - 1 + length * over / total, value = r->value;
    for (;;) {
        int64_t shift;
        if (high < HALF)
            shift = 0;
        else if (low >= HALF)
            shift = HALF;
        else if (low >= QUARTER && high < THREE_QUARTERS)
            shift = QUARTER;
        else
            break;
        low = 2 * (low - shift);
        high = 2 * (high - shift) + 1;
        value = 2 * (value - shift) + take(r);
    }
    r->low = low;
    r->high = high;
    r->value = value;
}

/* A plane that was decoded: found are the values and the ranks of the symbols, the end the bit after it or the wrong
   field, read the furthest bit that was looked at; costs, if any, grow by the bits of each field. */
typedef struct {
    int64_t *found, *flags;
    double *costs;
    int64_t end, read;
} Plane;

static int read_plane(const Models *m, int intra, const uint8_t *bits, int64_t count, int64_t at, int pad,
                      const int64_t *previous, Plane *plane) {
    Reader r = {.bits = bits, .count = count, .pad = pad};
    int opened = 0;
    plane->read = at;
    for (int64_t field = 0; field <= m->count; field++) {
        if (field == m->count || (is_face(m) && ((field == A_END && m->fields[0].on) ||
                                                 (field == B_END && m->fields[A_END].on)))) {
            if (!opened) open_segment(&r, at);
            at = close_segment(&r);
            if (r.read > plane->read) plane->read = r.read;
            opened = 0;
            if (at < 0) {
                plane->end = field;
                return BAD_STUFFING;
            }
            if (is_face(m) && field == A_END) plane->flags[0] = raw(&r, at++);
            if (is_face(m) && field == B_END) {
                plane->flags[1] = raw(&r, at++);
                plane->flags[2] = raw(&r, at++);
            }
        }
        if (field == m->count || !m->fields[field].on) continue;
        const Field *f = &m->fields[field];
        if (!opened) open_segment(&r, at);
        opened = 1;
        int64_t length = r.high - r.low + 1, size = intra ? f->i_count : f->p_count;
        int64_t total = intra ? size : m->totals[field], sought = ((r.value - r.low + 1) * total - 1) / length;
        int64_t rank = 0, under = 0, over;
        if (intra) {
            rank = under = sought;
            over = rank + 1;
        } else {
            const int32_t *tree = m->tree + m->base[field];
            for (int64_t jump = 4096; jump; jump >>= 1)
                if (rank + jump < size && under + tree[rank + jump] <= sought) {
                    rank += jump;
                    under += tree[rank];
                }
            over = under + m->counts[m->base[field] + rank + 1];
        }
        narrow(&r, under, over, total);
        int64_t value = (size - 1 - rank + (intra ? f->i_min : f->p_min)) * f->step + (intra ? 0 : previous[field]);
        if (value < f->min_value || value > f->max_value) {
            if (r.read > plane->read) plane->read = r.read;
            plane->end = field;
            return BAD_VALUE;
        }
        plane->found[field] = value;
        plane->found[m->count + field] = rank;
        if (plane->costs) plane->costs[field] += log2((double)total / (double)(over - under));
    }
    if (at > plane->read) plane->read = at;
    plane->end = at;
    return DONE;
}

static int read_settled(const Models *m, int intra, const uint8_t *bits, int64_t count, int64_t at,
                        const int64_t *previous, Plane *plane) {
    int status = read_plane(m, intra, bits, count, at, 0, previous, plane);
    if (plane->read <= count) return status;
    if (status != DONE || plane->end > count) return NEED_MORE;
    Plane other = *plane;
    other.found += 2 * m->count;
    status = read_plane(m, intra, bits, count, at, 1, previous, &other);
    if (status != DONE || other.end != plane->end) return NEED_MORE;
    for (int64_t field = 0; field < m->count; field++)
        if (m->fields[field].on && plane->found[field] != other.found[field]) return NEED_MORE;
    return DONE;
}

/* Returns the status and sets the end, or returns -1 for wrong tables; costs may be NULL. */
PUBLIC int fapengine_native_decode_settled(const Models *m, int intra, const uint8_t *bits, int64_t count, int64_t at,
                                           const int64_t *previous, int64_t *found, int64_t *flags, double *costs,
                                           int64_t *end) {
    if (!is_sound(m)) return -1;
    Plane plane = {.found = found, .flags = flags, .costs = costs};
    int status = read_settled(m, intra, bits, count, at, previous, &plane);
    *end = plane.end;
    return status;
}

/* Returns 0 for wrong tables or ranks. */
PUBLIC int fapengine_native_keep_plane(const Models *m, int intra, const int64_t *found, int64_t *previous) {
    if (!is_sound(m)) return 0;
    for (int64_t field = 0; field < m->count; field++) {
        int64_t rank = found[m->count + field];
        if (!m->fields[field].on) continue;
        if (!intra && (rank < 0 || rank >= m->fields[field].p_count)) return 0;
        previous[field] = found[field];
        if (!intra) count_symbol(m, field, rank);
    }
    return 1;
}

static int code_after(const uint8_t *bits, int64_t count, int64_t at) {
    int64_t start = (at / 8 + 1) * 8;
    for (int k = 0; k < 24; k++) {
        if (start + k >= count) return -2;
        if (bits[start + k] != (k == 23)) return -1;
    }
    if (start + 32 > count) return -2;
    if (start - at >= MIN_PLANE_BITS && !bits[at] && !bits[at + 1] && bits[at + 2]) return -1;
    int code = 0;
    for (int k = 24; k < 32; k++) code = 2 * code + (bits[start + k] != 0);
    return code;
}

/* Sets how: the planes decoded, the bit after them, and the start code or the wrong field. Returns why it stopped, or -1
   for wrong tables or another number of fields than a face's. */
PUBLIC int fapengine_native_decode_predicted(const Models *m, const uint8_t *bits, int64_t size, int64_t at, int fresh,
                                             int final, int64_t *previous, int64_t *found, int64_t *flags,
                                             double *costs, int64_t room, int64_t *values, int64_t *value_flags,
                                             int64_t *extents, int64_t *how) {
    if (!is_face(m) || !is_sound(m)) return -1;
    int64_t count = 0;
    for (; count < room; count++) {
        int code = fresh && !count ? -1 : code_after(bits, size, at), status;
        how[0] = count;
        how[1] = how[2] = at;
        if (code == 0xBB || code == 0x03 || (0xB0 <= code && code <= 0xBF)) {
            how[2] = code;
            return AT_CODE;
        }
        if ((code == -2 && !final) || at + 4 > size) return NEED_MORE;
        if (bits[at]) return INTRA_NEXT;
        if (bits[at + 1] || !bits[at + 2]) return code == -2 ? NEED_MORE : bits[at + 1] ? WITH_BODY : BAD_MASK;
        int64_t data = at + 4, skip = 0;
        for (int more = bits[at + 3]; more;) {
            if (data + 4 > size) return NEED_MORE;
            int part = 0;
            for (int k = 0; k < 4; k++) part = 2 * part + (bits[data + k] != 0);
            data += 4;
            skip += part;
            more = part == 15;
            if (skip > SKIP_LIMIT) {
                how[2] = skip;
                return BAD_SKIP;
            }
        }
        Plane plane = {.found = found, .flags = flags, .costs = costs};
        status = read_settled(m, 0, bits, size, data, previous, &plane);
        if (status != DONE) {
            how[2] = plane.end;
            return code == -2 ? NEED_MORE : status;
        }
        for (int64_t field = 0; field < m->count; field++) {
            if (m->fields[field].on) {
                previous[field] = found[field];
                count_symbol(m, field, found[m->count + field]);
            }
            values[count * m->count + field] = found[field];
        }
        for (int k = 0; k < 3; k++) value_flags[count * 3 + k] = flags[k];
        extents[count * 3] = at;
        extents[count * 3 + 1] = plane.end;
        extents[count * 3 + 2] = skip;
        at = plane.end;
    }
    how[0] = count;
    how[1] = how[2] = at;
    return FULL;
}

/* The first bit from start on that the fixed bits of an I plane's header fit, or -1. */
PUBLIC int64_t fapengine_native_find_intra(const uint8_t *bits, int64_t n, int64_t start, int bodies) {
    static const uint8_t group_sizes[] = {2, 16, 12, 8, 4, 5, 3, 10, 4, 4};
    for (int64_t first = start; first < n - 40; first++) {
        if (!bits[first] || (bits[first + 1] && !bodies) || !bits[first + 2]) continue;
        int64_t at = first + 3;
        at += bits[at] ? 14 : 1;
        if (at < n && bits[at]) {
            if (at + 12 >= n || !bits[at + 12]) continue;
            at += 18;
        }
        at++;
        if (at < n && bits[at]) {
            at++;
            for (int more = 1; more && at + 4 <= n; at += 4)
                more = bits[at] && bits[at + 1] && bits[at + 2] && bits[at + 3];
        } else
            at++;
        at += 5;
        int good = 1;
        for (unsigned group = 0; group < sizeof group_sizes; group++) {
            if (at + 3 > n || !bits[at]) {
                good = 0;
                break;
            }
            int kind = 2 * (bits[at + 1] != 0) + (bits[at + 2] != 0);
            at += 3;
            if (kind == 1 || kind == 2) at += group_sizes[group];
        }
        if (good && at + 6 <= n && !bits[at + 1]) return first;
    }
    return -1;
}
