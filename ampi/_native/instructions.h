/* The operations of the interpreter, written once: Python reads their names from here.
 *
 * v: an operand at a place (one number for each lane), s: a scalar (one number for all).
 * mul_add is a b + c, mul_sub a b - c, sub_mul c - a b, each operation rounded. */
#ifndef AMPI_INSTRUCTIONS_H
#define AMPI_INSTRUCTIONS_H

#include <stdint.h>

#define AMPI_LANES 64

#define AMPI_BINARY(X, name) X(name##_vv) X(name##_vs) X(name##_sv)
#define AMPI_COMMUTATIVE(X, name) X(name##_vv) X(name##_vs)
#define AMPI_TERNARY(X, name) X(name##_vvv) X(name##_vvs) X(name##_vsv) X(name##_vss)

#define AMPI_OPERATIONS(X) \
    X(fill) X(horner) X(sincos_v) \
    AMPI_COMMUTATIVE(X, add) AMPI_BINARY(X, sub) AMPI_COMMUTATIVE(X, mul) AMPI_BINARY(X, div) \
    AMPI_TERNARY(X, mul_add) AMPI_TERNARY(X, mul_sub) AMPI_TERNARY(X, sub_mul) \
    AMPI_COMMUTATIVE(X, min) AMPI_COMMUTATIVE(X, max) \
    AMPI_BINARY(X, lt) AMPI_BINARY(X, le) AMPI_COMMUTATIVE(X, eq) AMPI_COMMUTATIVE(X, ne) \
    X(pow_vv) X(pow_vs) X(atan2_vv) \
    X(neg_v) X(abs_v) X(sqrt_v) X(sign_v) X(floor_v) X(exp_v) X(log_v) X(tan_v) \
    X(asin_v) X(acos_v) X(atan_v) X(tanh_v)

#define AMPI_ENUMERATED(name) AMPI_OP_##name,
enum ampi_opcode { AMPI_OPERATIONS(AMPI_ENUMERATED) AMPI_N_OPERATIONS };

#define AMPI_NOWHERE 0xFFFFu

typedef struct {
    uint16_t opcode, result, second, a, b, c;
} ampi_instruction;

#endif
