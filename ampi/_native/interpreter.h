/* Runs a list of instructions for AMPI_LANES flights at once; included once per instruction set.
 *
 * Each instruction is a loop over the lanes that the compiler turns into vectors. Operands and results
 * lie at the same place or at different ones, they never overlap otherwise. */
#include "plant.h"
#include "vector_math.h"

#if defined(__clang__)
#define EACH_LANE \
    _Pragma("clang loop vectorize(assume_safety)") for (int i = 0; i < AMPI_LANES; i++)
#elif defined(__GNUC__)
#define EACH_LANE _Pragma("GCC ivdep") for (int i = 0; i < AMPI_LANES; i++)
#else
#define EACH_LANE for (int i = 0; i < AMPI_LANES; i++)
#endif

typedef void operation(const ampi_instruction *, double *, const double *, ampi_span span);

#define OPERATION(name) \
    static void run_##name(const ampi_instruction *at, double *places, const double *scalars, \
                           ampi_span span)
#define PLACE(k) (places + (size_t)AMPI_LANES * (k))
#define V(x) x[i]
#define S(x) x[0]
#define V_AT(k) PLACE(k)
#define S_AT(k) (scalars + (k))

#define UNARY(name, expression) \
    OPERATION(name##_v) { \
        const double *const a = PLACE(at->a); \
        double *const result = PLACE(at->result); \
        (void)scalars; \
        (void)span; \
        EACH_LANE { \
            const double x = a[i]; \
            result[i] = (expression); \
        } \
    }

#define BINARY_OF(name, expression, kinds, A, B) \
    OPERATION(name##_##kinds) { \
        const double *const a = A##_AT(at->a), *const b = B##_AT(at->b); \
        double *const result = PLACE(at->result); \
        (void)scalars; \
        (void)span; \
        EACH_LANE { \
            const double x = A(a), y = B(b); \
            result[i] = (expression); \
        } \
    }
#define COMMUTATIVE(name, expression) \
    BINARY_OF(name, expression, vv, V, V) BINARY_OF(name, expression, vs, V, S)
#define BINARY(name, expression) \
    COMMUTATIVE(name, expression) BINARY_OF(name, expression, sv, S, V)

#define TERNARY_OF(name, expression, kinds, A, B, C) \
    OPERATION(name##_##kinds) { \
        const double *const a = A##_AT(at->a), *const b = B##_AT(at->b), *const c = C##_AT(at->c); \
        double *const result = PLACE(at->result); \
        (void)scalars; \
        (void)span; \
        EACH_LANE { \
            const double x = A(a), y = B(b), z = C(c); \
            result[i] = (expression); \
        } \
    }
#define TERNARY(name, expression) \
    TERNARY_OF(name, expression, vvv, V, V, V) TERNARY_OF(name, expression, vvs, V, V, S) \
    TERNARY_OF(name, expression, vsv, V, S, V) TERNARY_OF(name, expression, vss, V, S, S)

/* Of the C library, one by one: only the lanes of the span; the others repeat its first. */
#define OF_THE_LIBRARY(name, kinds, expression, A, B) \
    OPERATION(name##_##kinds) { \
        const double *const a = A##_AT(at->a), *const b = B##_AT(at->b); \
        double *const result = PLACE(at->result); \
        (void)scalars; \
        for (int i = span.begin; i < span.end; i++) { \
            const double x = A(a), y = B(b); \
            (void)y; \
            result[i] = (expression); \
        } \
        repeat_first(result, span); \
    }

static inline void repeat_first(double *values, ampi_span span) {
    for (int i = 0; i < span.begin; i++) {
        values[i] = values[span.begin];
    }
    for (int i = span.end; i < AMPI_LANES; i++) {
        values[i] = values[span.begin];
    }
}

COMMUTATIVE(add, x + y)
BINARY(sub, x - y)
COMMUTATIVE(mul, x * y)
BINARY(div, x / y)
TERNARY(mul_add, x * y + z)
TERNARY(mul_sub, x * y - z)
TERNARY(sub_mul, z - x * y)
/* of not-a-number numpy's: it goes through */
COMMUTATIVE(min, x < y || x != x ? x : y)
COMMUTATIVE(max, x > y || x != x ? x : y)
BINARY(lt, x < y ? 1.0 : 0.0)
BINARY(le, x <= y ? 1.0 : 0.0)
COMMUTATIVE(eq, x == y ? 1.0 : 0.0)
COMMUTATIVE(ne, x != y ? 1.0 : 0.0)
UNARY(neg, -x)
UNARY(abs, fabs(x))
UNARY(sqrt, sqrt(x))
UNARY(sign, x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x)
UNARY(floor, floor(x))
OF_THE_LIBRARY(exp, v, exp(x), V, V)
OF_THE_LIBRARY(log, v, log(x), V, V)
OF_THE_LIBRARY(tan, v, tan(x), V, V)
OF_THE_LIBRARY(asin, v, asin(x), V, V)
OF_THE_LIBRARY(acos, v, acos(x), V, V)
OF_THE_LIBRARY(atan, v, atan(x), V, V)
OF_THE_LIBRARY(tanh, v, tanh(x), V, V)
OF_THE_LIBRARY(atan2, vv, atan2(x, y), V, V)
OF_THE_LIBRARY(pow, vv, lane_pow(x, y), V, V)
OF_THE_LIBRARY(pow, vs, lane_pow(x, y), V, S)

OPERATION(fill) {
    const double value = scalars[at->a];
    double *const result = PLACE(at->result);
    (void)span;
    EACH_LANE { result[i] = value; }
}

#define ABREAST 16 /* lanes of a polynomial that stay in registers */

OPERATION(horner) {
    const double *const a = PLACE(at->a), *const coefficients = scalars + at->b;
    double *const result = PLACE(at->result);
    (void)span;
    for (int begin = 0; begin < AMPI_LANES; begin += ABREAST) {
        double x[ABREAST], total[ABREAST];
        for (int i = 0; i < ABREAST; i++) {
            x[i] = a[begin + i];
            total[i] = coefficients[0] * x[i] + coefficients[1];
        }
        for (int k = 2; k < at->c; k++) {
            const double next = coefficients[k];
            for (int i = 0; i < ABREAST; i++) {
                total[i] = total[i] * x[i] + next;
            }
        }
        for (int i = 0; i < ABREAST; i++) {
            result[begin + i] = total[i];
        }
    }
}

/* Sine and cosine; where b is a place it remembers the angles. An angle of attack that is held, as most
 * schedules do, has the sines of the stage before. */
OPERATION(sincos_v) {
    const double *const angle = PLACE(at->a);
    double *const sine = PLACE(at->result), *const cosine = PLACE(at->second);
    (void)scalars;
    if (at->b != AMPI_NOWHERE) {
        if (memcmp(PLACE(at->b), angle, AMPI_LANES * sizeof(double)) == 0) {
            return;
        }
        memcpy(PLACE(at->b), angle, AMPI_LANES * sizeof(double));
        if (!span.is_whole) {
            PLACE(at->b)[span.begin] = (double)NAN;
        }
    }
    for (int i = span.begin; i < span.end; i++) {
        const double own = angle[i]; /* may lie where a result goes */
        lane_sincos(own, &sine[i], &cosine[i]);
    }
    repeat_first(sine, span);
    repeat_first(cosine, span);
}

#define IN_THE_TABLE(name) run_##name,
static operation *const OPERATIONS[] = {AMPI_OPERATIONS(IN_THE_TABLE)};

/* Nothing is remembered: not-a-number, whose sine is one. */
static void forget(const ampi_list *list, double *places) {
    for (size_t k = 0; k < list->count; k++) {
        const ampi_instruction *const at = &list->code[k];
        if (at->opcode == AMPI_OP_sincos_v && at->b != AMPI_NOWHERE) {
            for (int i = 0; i < AMPI_LANES; i++) {
                PLACE(at->b)[i] = PLACE(at->result)[i] = PLACE(at->second)[i] = (double)NAN;
            }
        }
    }
}

static void run(const ampi_list *list, double *places, const double *scalars, ampi_span span) {
    for (const ampi_instruction *at = list->code; at < list->code + list->count; at++) {
        OPERATIONS[at->opcode](at, places, scalars, span);
    }
}
