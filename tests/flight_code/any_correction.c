/* What Frama-C Eva analyses of estimation and correction: a blob of which every byte is unknown is opened;
   then a model of any numbers whose counts are as `ampi_model_open` lets them pass (proof_counts of
   proof.c) flies with any time, navigation, accelerations and memory. PART chooses what is called. */
#include "__fc_builtin.h"
#include "any_input.c"

#include "ampi_correction_parts.h"

static ampi_model model;

#define ANY(of) Frama_C_make_unknown((char *)&(of), sizeof(of))

static double any_double(void)
{
    double any;
    ANY(any);
    return any;
}

/* A count of `low` to `high`. */
static double any_count(int low, int high) { return (double)Frama_C_interval(low, high); }

static void make_any_model(int form)
{
    size_t i;
    ANY(model.of);
    model.of.form = (double)form;
    model.of.log_density.terms = any_count(1, AMPI_MAX_TERMS);
    model.of.sound.terms = any_count(1, AMPI_MAX_TERMS);
    model.of.attack_knots = any_count((form == 2) ? 4 : 0, AMPI_MAX_KNOTS);
    model.of.mach_knots = any_count((form == 2) ? 4 : 0, AMPI_MAX_KNOTS);
    for (i = 0u; i < 4u; i++) { model.of.target_axis[i] = any_count(-1, AMPI_MAX_AXES - 1); }
    model.of.corrector.iterations = any_count(0, 100);
    model.of.corrector.propagations = any_count(0, 10000);
    model.is_open = AMPI_OPEN;
}

#if PART == 0 /* opening */
static void part(void)
{
    static unsigned char bytes[32u + sizeof(ampi_model_data)];
    ANY(bytes);
    (void)ampi_model_open(&model, bytes, (Frama_C_interval(0, 1) != 0) ? sizeof bytes : 0u);
}
#elif PART == 1 /* the estimator, any estimate and model */
static void part(void)
{
    static ampi_estimate estimate;
    double state[AMPI_N_NAVIGATED], sensed[3];
    int form;
    for (form = 0; form < 3; form++) {
        make_any_model(form);
        ampi_estimate_begin(&estimate, &model.of);
        ANY(estimate);
        ANY(state);
        ANY(sensed);
        ampi_estimate_update(&estimate, &model.of, any_double(), state, sensed, any_double(), any_double());
    }
}
#elif PART == 2 /* one correction of any plan, on a path of any numbers */
static void part(void)
{
    static ampi_corrector corrector;
    double limit[3];
    make_any_model(2);
    model.of.form = any_count(0, 2);
    ANY(corrector);
    ANY(limit);
    corrector.points = (uint32_t)Frama_C_interval(0, AMPI_MAX_STEPS - 1);
    (void)ampi_correct(&corrector, &model.of, limit);
}
#else /* flights on a table of any numbers, or of none; a correction leaves anything (PART 2 is of it) */
#define ampi_correct any_correction
#include "../../ampi/export/c/ampi_corrector.c"
#undef ampi_correct

ampi_correction ampi_correct(ampi_corrector *corrector, const ampi_model_data *of, const double *limit)
{
    (void)of;
    (void)limit;
    ANY(corrector->plan);
    ANY(corrector->missed);
    ANY(corrector->to_go);
    return (ampi_correction)Frama_C_interval(AMPI_PLAN_KEPT, AMPI_NO_ARRIVAL);
}

static void fly_corrected(void)
{
    static ampi_corrector corrector;
    double parameters[2], navigation[AMPI_N_NAVIGATED], sensed[3], target[4];
    const double *known;
    make_any_model(2);
    model.of.form = any_count(0, 2);
    model.is_open = (Frama_C_interval(0, 1) != 0) ? AMPI_OPEN : 0u;
    ANY(parameters);
    known = (Frama_C_interval(0, 1) != 0) ? parameters : NULL;
    ampi_guidance_begin(&guidance, &table, known);
    ampi_corrector_begin(&corrector, &model, &table, known);
    while (Frama_C_interval(0, 1) != 0) {
        ANY(navigation);
        ANY(sensed);
        ANY(target);
        ampi_corrector_aim(&corrector, target);
        (void)ampi_corrected_step(&corrector, &model, &guidance, &table, any_double(),
                                  (Frama_C_interval(0, 1) != 0) ? navigation : NULL,
                                  (Frama_C_interval(0, 1) != 0) ? sensed : NULL);
    }
}

static void part(void)
{
    const layout made = {AMPI_FLOAT64, AMPI_LINEAR_QUADRATIC, N_LINEAR_ROWS, {2u, 4u},
                         {AMPI_LINEAR, AMPI_CUBIC}, 0u};
    if (ampi_table_open(&table, blob, make(&made)) == AMPI_OK) {
        fly_corrected();
    } else {
        fly_corrected();
    }
}
#endif

int main(void)
{
    part();
    return 0;
}
