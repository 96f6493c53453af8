/* Vectors of LANES numbers: 4 (SSE2, NEON), 8 (AVX2) or 16 (AVX-512). Arithmetic is the compilers' own vector
   extension; the rest is here. Each lane is computed as if alone, with operations that IEEE 754 rounds exactly, so the
   number of lanes changes no result. */
#ifndef FAPENGINE_LANES_H
#define FAPENGINE_LANES_H
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX2__)
#define LANES 8
#else
#define LANES 4
#endif
#ifdef __x86_64__
#include <immintrin.h>
#endif

typedef float F __attribute__((vector_size(4 * LANES)));
typedef int32_t I __attribute__((vector_size(4 * LANES)));
typedef uint16_t H __attribute__((vector_size(4 * LANES)));
typedef float F4 __attribute__((vector_size(16)));

#define INLINE static inline __attribute__((always_inline))

INLINE F all(float x) { return (F){0} + x; }
INLINE I alli(int32_t x) { return (I){0} + x; }
INLINE F load(const float *p) { F x; memcpy(&x, p, sizeof x); return x; }
INLINE void store(float *p, F x) { memcpy(p, &x, sizeof x); }
INLINE I loadi(const void *p) { I x; memcpy(&x, p, sizeof x); return x; }
INLINE void storei(void *p, I x) { memcpy(p, &x, sizeof x); }
INLINE F to_f(I x) { return __builtin_convertvector(x, F); }

#if LANES == 16
typedef __mmask16 M;
INLINE M lt(F a, F b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ); }
INLINE M le(F a, F b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ); }
INLINE M eqi(I a, I b) { return _mm512_cmpeq_epi32_mask((__m512i)a, (__m512i)b); }
INLINE M lti(I a, I b) { return _mm512_cmplt_epi32_mask((__m512i)a, (__m512i)b); }
INLINE unsigned bits(M m) {
    /* GCC 12 at -O1 spills 16 bits of a widened mask and reads 32: tests/native/fuzz.py saw it. kmovw widens it here. */
    unsigned widened;
    __asm__("kmovw %1, %0" : "=r"(widened) : "k"(m));
    return widened;
}
INLINE F sel(M m, F a, F b) { return (F)_mm512_mask_mov_ps((__m512)b, m, (__m512)a); }
INLINE I seli(M m, I a, I b) { return (I)_mm512_mask_mov_epi32((__m512i)b, m, (__m512i)a); }
INLINE F fmin_(F a, F b) { return (F)_mm512_min_ps((__m512)a, (__m512)b); }
INLINE F fmax_(F a, F b) { return (F)_mm512_max_ps((__m512)a, (__m512)b); }
INLINE I mini(I a, I b) { return (I)_mm512_min_epi32((__m512i)a, (__m512i)b); }
INLINE I maxi(I a, I b) { return (I)_mm512_max_epi32((__m512i)a, (__m512i)b); }
INLINE F root(F a) { return (F)_mm512_sqrt_ps((__m512)a); }
INLINE I to_i(F a) { return (I)_mm512_cvttps_epi32((__m512)a); }
INLINE I gather(const void *p, I at) { return (I)_mm512_i32gather_epi32((__m512i)at, p, 4); }
INLINE M none(void) { return 0; }
#else
typedef I M;
INLINE M lt(F a, F b) { return (M)(a < b); }
INLINE M le(F a, F b) { return (M)(a <= b); }
INLINE M eqi(I a, I b) { return (M)(a == b); }
INLINE M lti(I a, I b) { return (M)(a < b); }
INLINE M none(void) { return (M){0}; }
#if LANES == 8
INLINE unsigned bits(M m) { return (unsigned)_mm256_movemask_ps((__m256)m); }
INLINE F sel(M m, F a, F b) { return (F)_mm256_blendv_ps((__m256)b, (__m256)a, (__m256)m); }
INLINE I seli(M m, I a, I b) { return (I)_mm256_blendv_epi8((__m256i)b, (__m256i)a, (__m256i)m); }
INLINE F fmin_(F a, F b) { return (F)_mm256_min_ps((__m256)a, (__m256)b); }
INLINE F fmax_(F a, F b) { return (F)_mm256_max_ps((__m256)a, (__m256)b); }
INLINE I mini(I a, I b) { return (I)_mm256_min_epi32((__m256i)a, (__m256i)b); }
INLINE I maxi(I a, I b) { return (I)_mm256_max_epi32((__m256i)a, (__m256i)b); }
INLINE F root(F a) { return (F)_mm256_sqrt_ps((__m256)a); }
INLINE I to_i(F a) { return (I)_mm256_cvttps_epi32((__m256)a); }
INLINE I gather(const void *p, I at) { return (I)_mm256_i32gather_epi32(p, (__m256i)at, 4); }
#else
INLINE F sel(M m, F a, F b) { return (F)(((I)a & m) | ((I)b & ~m)); }
INLINE I seli(M m, I a, I b) { return (a & m) | (b & ~m); }
INLINE I mini(I a, I b) { return seli(lti(a, b), a, b); }
INLINE I maxi(I a, I b) { return seli(lti(b, a), a, b); }
INLINE I gather(const void *p, I at) {
    const int32_t *q = p;
    return (I){q[at[0]], q[at[1]], q[at[2]], q[at[3]]};
}
#ifdef __SSE2__
INLINE unsigned bits(M m) { return (unsigned)_mm_movemask_ps((__m128)m); }
INLINE F fmin_(F a, F b) { return (F)_mm_min_ps((__m128)a, (__m128)b); }
INLINE F fmax_(F a, F b) { return (F)_mm_max_ps((__m128)a, (__m128)b); }
INLINE F root(F a) { return (F)_mm_sqrt_ps((__m128)a); }
INLINE I to_i(F a) { return (I)_mm_cvttps_epi32((__m128)a); }
#else
INLINE unsigned bits(M m) { return (m[0] & 1) | (m[1] & 2) | (m[2] & 4) | (m[3] & 8); }
INLINE F fmin_(F a, F b) { return sel(lt(a, b), a, b); }
INLINE F fmax_(F a, F b) { return sel(lt(b, a), a, b); }
INLINE F root(F a) { return (F){sqrtf(a[0]), sqrtf(a[1]), sqrtf(a[2]), sqrtf(a[3])}; }
INLINE I to_i(F a) { /* what does not fit is the least integer, as on x86 */
    M fits = lt(a, all(2147483648.0f)) & le(all(-2147483648.0f), a);
    return seli(fits, __builtin_convertvector(sel(fits, a, all(0)), I), alli(INT32_MIN));
}
#endif
#endif
#endif

INLINE F clamp(F x, float low, float high) { return fmin_(fmax_(x, all(low)), all(high)); }
INLINE F unit(F x) { return clamp(x, 0, 1); }
INLINE F mix(F a, F b, F t) { return a + t * (b - a); }
INLINE F absolute(F x) { return (F)((I)x & 0x7fffffff); }
INLINE F down(F x) { F t = to_f(to_i(x)); return t - sel(lt(x, t), all(1), all(0)); } /* floor, below 2^31 */
INLINE F step_(F low, F high, F x) { /* GLSL's smoothstep */
    F t = unit((x - low) / (high - low));
    return t * t * (3 - 2 * t);
}
INLINE F step(float low, float high, F x) {
    F t = unit((x - low) * (1 / (high - low)));
    return t * t * (3 - 2 * t);
}

/* x to the power of y, for x of 0 to 1. Error below 1e-5 of the result for y up to 500. */
INLINE F power(F x, F y) {
    I whole = (I)x;
    I exponent = ((whole - 0x3f3504f3) >> 23);
    F m = (F)(whole - (exponent << 23)); /* root of one half to root of two */
    F t = (m - 1) / (m + 1), s = t * t;
    F log2 = to_f(exponent) + t * (2.885390082f + s * (0.9617966940f + s * (0.5770780164f + s * 0.4121985831f)));
    F power = fmax_(log2 * y, all(-126));
    F low = down(power + 0.5f), f = power - low;
    F mantissa = 1 + f * (0.6931471806f + f * (0.2402265070f + f * (0.05550410866f + f * (0.009618129108f
        + f * (0.001333355815f + f * 0.0001540353039f)))));
    F result = (F)((I)mantissa + (to_i(low) << 23));
    return sel(le(x, all(1e-12f)), all(0), result);
}
INLINE F sine(F x) {
    F turns = down(x * 0.3183098862f + 0.5f);
    F r = (x - turns * 3.140625f) - turns * 9.67653589793e-4f, s = r * r;
    F y = r + r * s * (-0.1666666667f + s * (0.008333333333f + s * (-0.0001984126984f + s * 2.7557319e-6f)));
    return (F)((I)y ^ (to_i(turns) << 31));
}
INLINE F angle(F y, F x) { /* atan2 */
    F high = fmax_(absolute(x), absolute(y)), low = fmin_(absolute(x), absolute(y));
    F t = low / fmax_(high, all(1e-20f)), s = t * t;
    F a = t * (0.99997726f + s * (-0.33262347f + s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f
        + s * -0.01172120f)))));
    a = sel(lt(absolute(x), absolute(y)), 1.5707963268f - a, a);
    a = sel(lt(x, all(0)), 3.1415926536f - a, a);
    return sel(lt(y, all(0)), -a, a);
}

#endif
