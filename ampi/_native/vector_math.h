/* sin, cos and exp over all lanes, without branches, so that the compiler makes vectors of them.
 *
 * The polynomials and the splitting of pi/2 and ln 2 are those of fdlibm:
 *
 * Copyright (C) 1993, 2004 by Sun Microsystems, Inc. All rights reserved.
 * Permission to use, copy, modify, and distribute this software is freely granted, provided that this
 * notice is preserved.
 *
 * Errors are below one unit in the last place. Angles beyond FAR, for which three parts of pi/2 are not
 * enough, go to the C library one by one. */
#ifndef AMPI_VECTOR_MATH_H
#define AMPI_VECTOR_MATH_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define FAR 1e6              /* rad */
#define ROUNDING 6755399441055744.0 /* 1.5 * 2^52: added and taken away, it rounds to an integer */

static inline uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double from_bits(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline double chosen(uint64_t mask, double where_set, double otherwise) {
    return from_bits((bits_of(where_set) & mask) | (bits_of(otherwise) & ~mask));
}

/* Of |x| <= FAR; not-a-number stays one. */
static inline void near_sincos(double x, double *sine, double *cosine) {
    const double rounded = x * 6.36619772367581382433e-01 + ROUNDING; /* 2/pi */
    const double k = rounded - ROUNDING;
    const uint64_t quadrant = bits_of(rounded);
    /* k times the first 33 bits of pi/2, and times the next 33, has no error */
    const double first = x - k * 1.57079632673412561417e+00;
    const double second = k * 6.07710050630396597660e-11;
    const double third = first - second;
    const double tail = k * 2.02226624879595063154e-21 - ((first - third) - second);
    const double r = third - tail, s = (third - r) - tail;
    const double z = r * r, v = z * r, half = 0.5 * z, w = 1.0 - half;
    const double p = 8.33333333332248946124e-03 +
                     z * (-1.98412698298579493134e-04 +
                          z * (2.75573137070700676789e-06 +
                               z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
    const double q =
        z * (4.16666666666666019037e-02 +
             z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05)) +
        z * z * (z * z) *
            (-2.75573143513906633035e-07 +
             z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    const double sin_r = r - ((z * (0.5 * s - v * p) - s) - v * -1.66666666666666324348e-01);
    const double cos_r = w + (((1.0 - w) - half) + (z * q - r * s));
    const uint64_t odd = (uint64_t)0 - (quadrant & 1u);
    *sine = from_bits(bits_of(chosen(odd, cos_r, sin_r)) ^ ((quadrant & 2u) << 62));
    *cosine = from_bits(bits_of(chosen(odd, sin_r, cos_r)) ^ (((quadrant + 1u) & 2u) << 62));
}

/* exp x; overflow is infinite, underflow gradual, not-a-number stays one. */
static inline double lane_exp(double x) {
    const double least = x < -746.0 ? -746.0 : x;
    const double y = least > 710.0 ? 710.0 : least;
    const double rounded = y * 1.44269504088896338700e+00 + ROUNDING; /* 1/ln 2 */
    const double k = rounded - ROUNDING;
    const double high = y - k * 6.93147180369123816490e-01, low = k * 1.90821492927058770002e-10;
    const double r = high - low, t = r * r;
    const double c = r - t * (1.66666666666666019037e-01 +
                              t * (-2.77777777770155933842e-03 +
                                   t * (6.61375632143793436117e-05 +
                                        t * (-1.65339022054652515390e-06 +
                                             t * 4.13813679705723846039e-08))));
    const double e = 1.0 - ((low - (r * c) / (2.0 - c)) - high);
    /* 2^k as two factors, each of which has a normal exponent */
    const double half = (k * 0.5 + ROUNDING) - ROUNDING, rest = k - half;
    const double one = from_bits((bits_of(half + ROUNDING) + 1023u) << 52);
    const double other = from_bits((bits_of(rest + ROUNDING) + 1023u) << 52);
    return e * one * other;
}

static inline double lane_pow(double x, double y) {
    return y == 2.0 ? x * x : pow(x, y); /* as numpy's x**2 */
}

#endif
