/* The flight code for a page: a table for each mode, one model, and one flight at a time.

   The page writes numbers into `in` and reads `out`. It puts blobs behind all of this, at `room()`, and
   they stay where they are. */
#include "ampi_correction.h"

#include <string.h>

#define EXPORTED(name) __attribute__((export_name(name)))
#define TABLES 4u

static ampi_table table[TABLES];
static ampi_model model;
static ampi_guidance guidance;
static ampi_corrector corrector;
static ampi_reference reference;
static double in[AMPI_MAX_AXES + AMPI_N_NAVIGATED + 3u], out[AMPI_MAX_ROWS * AMPI_MAX_NODES + 1u];
extern unsigned char __heap_base;

EXPORTED("room") unsigned char *room(void) { return &__heap_base; }
EXPORTED("in") double *told(void) { return in; }
EXPORTED("out") double *found(void) { return out; }

EXPORTED("open_table") int open_table(unsigned number, const unsigned char *blob, size_t size)
{
    return (int)ampi_table_open(&table[number], blob, size);
}

EXPORTED("open_model") int open_model(const unsigned char *blob, size_t size)
{
    return (int)ampi_model_open(&model, blob, size);
}

/* Nodal rows and the final time of the parameters in `in`; how many numbers. */
EXPORTED("reference") size_t reference_of(unsigned number)
{
    const size_t columns = table[number].columns;
    size_t i;
    ampi_reference_at(&table[number], in, &reference);
    for (i = 0u; i < columns; i++) {
        out[i] = reference.rows[i];
    }
    return columns;
}

/* Whether that reference is borrowed from beside a case without solution. */
EXPORTED("is_hole") int is_hole(void) { return (reference.hole != 0u) ? 1 : 0; }

/* Begins a flight of the parameters in `in`, aimed at the target behind them if plans are corrected;
   `out` is where the reference begins. */
EXPORTED("begin") void begin(unsigned number, int is_corrected, const double *target)
{
    size_t i;
    ampi_guidance_begin(&guidance, &table[number], in);
    if (is_corrected != 0) {
        ampi_corrector_begin(&corrector, &model, &table[number], in);
        ampi_corrector_aim(&corrector, target);
    }
    for (i = 0u; i < table[number].n.rows; i++) {
        out[i] = guidance.reference.rows[i];
    }
}

/* One cycle: `in` holds navigation and sensed acceleration; `out` bank rate and change of the angle of
   attack. */
EXPORTED("step") void step(unsigned number, int is_corrected, double time)
{
    const double *const sensed = &in[AMPI_N_NAVIGATED];
    const ampi_command command =
        (is_corrected != 0)
            ? ampi_corrected_step(&corrector, &model, &guidance, &table[number], time, in, sensed)
            : ampi_guidance_step(&guidance, &table[number], time, in, sensed);
    out[0] = command.bank_rate;
    out[1] = command.angle_of_attack;
    out[2] = (double)command.steering;
    out[3] = (double)corrector.outcome;
}

__attribute__((no_builtin)) void *memcpy(void *to, const void *from, size_t size)
{
    size_t i;
    for (i = 0u; i < size; i++) {
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    }
    return to;
}

__attribute__((no_builtin)) void *memset(void *to, int value, size_t size)
{
    size_t i;
    for (i = 0u; i < size; i++) {
        ((unsigned char *)to)[i] = (unsigned char)value;
    }
    return to;
}

__attribute__((no_builtin)) int memcmp(const void *one, const void *other, size_t size)
{
    const unsigned char *const a = one, *const b = other;
    size_t i;
    for (i = 0u; (i < size) && (a[i] == b[i]); i++) { }
    return (i < size) ? ((int)a[i] - (int)b[i]) : 0;
}
