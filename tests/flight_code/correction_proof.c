/* What ESBMC proves of the correction, one function a proof; the code is included for its static functions.
   `.ci/flight_code prover` runs each. */
#include <string.h>
#define memcpy(to, from, size) (*(double *)(void *)(to) = *(const double *)(const void *)(from))
#include "../../ampi/export/c/ampi_model.c"
#include "../../ampi/export/c/ampi_corrector.c"

double nondet_double(void);

static double any_between(double low, double high)
{
    const double number = nondet_double();
    __ESBMC_assume((number >= low) && (number <= high));
    return number;
}

/* The place of any speed among the values of any plan, NaN and infinities too, is one of them and has one
   behind it; the share of the way there is in [0, 1] or no number. */
void proof_planned(void)
{
    static ampi_plan plan = {0.0, 0.0, {0.5, 0.5, 0.5}};
    const double told = ampi_planned(&plan, 0u, 3u, nondet_double());
    __ESBMC_assert((told != told) || (told == 0.5), "between");
}

/* What a step makes of a value of the plan is within its bound, whatever the step; no number of none. */
void proof_bound(void)
{
    const double bound = any_between(0.0, 4.0), value = any_between(-bound, bound);
    const double moved = clipped(value + nondet_double(), -bound, bound);
    __ESBMC_assert((moved != moved) || (fabs(moved) <= bound), "bound");
}

/* Counts that pass lead nowhere beyond their arrays: what any_correction.c assumes of a model. */
void proof_counts(void)
{
    static ampi_model_data of;
    of.log_density.terms = nondet_double();
    of.sound.terms = nondet_double();
    of.form = nondet_double();
    of.attack_knots = nondet_double();
    of.mach_knots = nondet_double();
    of.target_axis[0] = nondet_double();
    of.corrector.iterations = nondet_double();
    of.corrector.propagations = nondet_double();
    if (are_counts(&of)) {
        __ESBMC_assert((of.log_density.terms >= 1.0) && (of.log_density.terms <= AMPI_MAX_TERMS), "terms");
        __ESBMC_assert((of.sound.terms >= 1.0) && (of.sound.terms <= AMPI_MAX_TERMS), "terms");
        __ESBMC_assert((of.attack_knots >= 0.0) && (of.attack_knots <= AMPI_MAX_KNOTS), "knots");
        __ESBMC_assert((of.mach_knots >= 0.0) && (of.mach_knots <= AMPI_MAX_KNOTS), "knots");
        __ESBMC_assert((of.form != 2.0) || ((of.attack_knots >= 4.0) && (of.mach_knots >= 4.0)), "splines");
        __ESBMC_assert((of.target_axis[0] >= -1.0) && (of.target_axis[0] < AMPI_MAX_AXES), "axis");
        __ESBMC_assert((of.corrector.iterations >= 0.0) && (of.corrector.iterations <= 1e4), "budget");
        __ESBMC_assert((of.corrector.propagations >= 0.0) && (of.corrector.propagations <= 1e4), "budget");
    }
}
