/* What callgrind counts: `instructions NAME.blob WHAT i` makes input i of 40 and does one thing with it:
   WHAT is `reference`, or `step` of the table's law. `measured` alone is counted. Unknown i: exit 3. */
#include <stdio.h>
#include <stdlib.h>

#include "ampi_parts.h"

#define N_INPUTS 40

void measured(int is_step, const double *parameters, const double *navigation, const double *sensed);

static ampi_table table;
static ampi_reference reference;
static ampi_guidance guidance;
static unsigned char blob[1u << 23];
static double elapsed;

__attribute__((noinline)) void measured(int is_step, const double *parameters, const double *navigation,
                                        const double *sensed)
{
    if (is_step) {
        (void)ampi_guidance_step(&guidance, &table, elapsed, navigation, sensed);
    } else {
        ampi_reference_at(&table, parameters, &reference);
    }
}

/* Repeatable, in [0, 1). */
static double chance(void)
{
    static uint32_t state = 12345u;
    state = 1664525u * state + 1013904223u;
    return (double)(state >> 8) / 16777216.0;
}

/* Inside; at an edge, or beyond it; nonsense. */
static double parameter(size_t axis, int input)
{
    static const double NONSENSE[5] = {1e300, -1e300, 5e-324, 57.3, -0.0};
    const double low = table.axis[axis].low, high = table.axis[axis].high, w = chance();
    switch (input % 8) {
    case 0: return (w < 0.5) ? low : high;
    case 1: return low + (high - low) * (3.0 * w - 1.0);
    case 2: return (w < 0.5) ? (double)NAN : (low + (high - low) * w);
    case 3: return (w < 0.3) ? HUGE_VAL : ((w < 0.6) ? -HUGE_VAL : low);
    case 4: return NONSENSE[(size_t)(5.0 * w)];
    case 5: return (double)NAN;
    default: return low + (high - low) * w;
    }
}

static void one(int is_step, int input)
{
    double parameters[AMPI_MAX_AXES], navigation[AMPI_N_NAVIGATED], sensed[3] = {-8.0, 3.0, 1.0};
    size_t i;
    for (i = 0u; i < table.n.axes; i++) { parameters[i] = parameter(i, is_step ? 7 : input); }
    ampi_guidance_begin(&guidance, &table, parameters);
    elapsed = (double)(input % 7) * guidance.reference.final_time / 5.0; /* up to beyond the end */
    (void)ampi_guidance_step(&guidance, &table, elapsed, NULL, NULL);
    for (i = 0u; i < AMPI_N_NAVIGATED; i++) {
        navigation[i] = guidance.row[i] * (1.0 + 1e-3 * (chance() - 0.5));
        navigation[i] = ((input % 8) == 5) ? (double)NAN : navigation[i];
        navigation[i] = (((input % 8) == 3) && (chance() < 0.3)) ? -HUGE_VAL : navigation[i];
        navigation[i] = (((input % 8) == 4) && (chance() < 0.3)) ? 1e300 : navigation[i];
    }
    for (i = 0u; i < 3u; i++) {
        sensed[i] *= 0.5 + chance();
        sensed[i] = (((input % 5) == 4) && (chance() < 0.5)) ? (double)NAN : sensed[i];
    }
    elapsed = ((input % 9) == 8) ? (double)NAN : (elapsed + 0.5);
    measured(is_step, parameters, ((input % 11) == 10) ? NULL : navigation, ((input % 6) == 5) ? NULL : sensed);
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
    if (ampi_table_open(&table, blob, size) != AMPI_OK) {
        return 2;
    }
    for (i = 0; i < N_INPUTS; i++) { one(words[2][0] == 's', i); }
    return 0;
}
