/* What the flight code needs of <math.h>; the browser's Math computes what is not an instruction. */
#ifndef EXPLORER_MATH_H
#define EXPLORER_MATH_H
#define NAN __builtin_nanf("")
#define INFINITY __builtin_inff()
#define HUGE_VAL __builtin_inf()
double acos(double), cos(double), exp(double), expm1(double), log(double), pow(double, double);
double sin(double);
#define copysign(x, y) __builtin_copysign(x, y)
#define fabs(x) __builtin_fabs(x)
#define floor(x) __builtin_floor(x)
#define sqrt(x) __builtin_sqrt(x)
#endif
