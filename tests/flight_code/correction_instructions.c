/* What callgrind counts: `correction_instructions NAME.model WHAT`, WHAT `update`, one of the estimator, or
   `steps`, N_STEPS of a prediction, twice. `measured` alone is counted. */
#include <stdio.h>

#include "ampi_correction_parts.h"

#define N_INPUTS 24
#define N_STEPS 25.0

void measured(int is_update, double time, const double *state, const double *sensed);

static ampi_table none; /* not opened */
static ampi_model model;
static ampi_corrector corrector;
static unsigned char blob[32u + sizeof(ampi_model_data)];

__attribute__((noinline)) void measured(int is_update, double time, const double *state, const double *sensed)
{
    const double limit[3] = {1.0, 0.1, 0.1};
    if (is_update) {
        ampi_estimate_update(&corrector.estimate, &model.of, time, state, sensed, 0.01, 0.001);
    } else {
        (void)ampi_correct(&corrector, &model.of, limit);
    }
}

static void one(int is_update, int input)
{
    double state[8] = {50e3, 0.1, 0.5, 4000.0, -0.1, 1.0, 0.3, 0.0}, sensed[3] = {-20.0, 8.0, 1.0};
    size_t i;
    ampi_corrector_begin(&corrector, &model, &none, NULL);
    for (i = 0u; i < 3u; i++) { sensed[i] *= 1.0 + 0.02 * (double)((input + 3 * (int)i) % 7); }
    state[ALTITUDE] += 1e3 * input;
    state[PATH_ANGLE] += 0.01 * input;
    ampi_estimate_update(&corrector.estimate, &model.of, 10.0, state, sensed, 0.01, 0.001);
    sensed[0] *= (input % 6 == 5) ? 3.0 : 1.01; /* gated, or used */
    for (i = 0u; i < AMPI_N_PLAN; i++) { corrector.plan.value[i] = 0.01 * (double)i; }
    corrector.plan.fast = 4200.0;
    corrector.plan.slow = 1.0;
    corrector.target[3] = 1.0; /* never reached in so many steps */
    (void)memcpy(corrector.state, state, sizeof state);
    corrector.time = 100.0; /* no kink of a schedule ahead shortens a step */
    model.of.schedule.end = (model.of.schedule.over_time != 0.0) ? 90.0 : model.of.schedule.end;
    model.of.corrector.longest = N_STEPS * model.of.corrector.step;
    measured(is_update, 10.2, state, sensed);
}

int main(int count, char **words)
{
    FILE *file = (count == 3) ? fopen(words[1], "rb") : NULL;
    size_t size;
    int i;
    if (file == NULL) {
        return 2;
    }
    size = fread(blob, 1u, sizeof blob, file);
    (void)fclose(file);
    if (ampi_model_open(&model, blob, size) != AMPI_OK) {
        return 2;
    }
    for (i = 0; i < N_INPUTS; i++) { one(words[2][0] == 'u', i); }
    return 0;
}
