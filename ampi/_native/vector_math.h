/* Functions of one number as numpy computes them: by the C library, which both call.
 *
 * Polynomials over all lanes would take a third of the time and differ in the last bit at three angles
 * of a hundred. A flight that swings about its bank limit makes centimetres of such bits, and campaigns
 * of the two engines would no longer be the same. */
#ifndef AMPI_VECTOR_MATH_H
#define AMPI_VECTOR_MATH_H

#include <math.h>
#include <stdint.h>
#include <string.h>

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

static inline void lane_sincos(double x, double *sine, double *cosine) {
#if defined(__GLIBC__)
    sincos(x, sine, cosine); /* of the bits of the two */
#else
    *sine = sin(x);
    *cosine = cos(x);
#endif
}

static inline double lane_pow(double x, double y) {
    return y == 2.0 ? x * x : pow(x, y); /* as numpy's x**2 */
}

#endif
