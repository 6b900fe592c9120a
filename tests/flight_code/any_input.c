/* What Frama-C Eva analyses: tables of three layouts whose every number is unknown (NaN and infinities
   too), opened and flown with any parameters, times, navigation and sensed accelerations. */
#include "__fc_builtin.h"
#include "ampi_parts.h"

#define N_NODES 6u   /* segments of 3 and 4 */
#define N_POINTS 11u /* 9 and 2 of them */
#define WIDEST 4u
#define SIZE 16384u

typedef struct {
    uint32_t kind, law, rows, points[2], order[2], holes, modulates;
} layout;

static unsigned char blob[SIZE];
static ampi_table table;
static ampi_reference reference;
static ampi_guidance guidance;
static double times[N_POINTS], rows[AMPI_MAX_ROWS * N_POINTS];

static void put(size_t place, uint32_t word) { (void)memcpy(&blob[place], &word, sizeof word); }

static size_t padded(size_t size) { return (size + 7u) / 8u * 8u; }

/* The sizes of a table, as ampi/export/blob.py writes them; all else stays unknown. */
static size_t make(const layout *made)
{
    const unsigned char magic[8] = {0x89u, 'A', 'M', 'P', 'I', 0x0Du, 0x0Au, 0x1Au};
    static const uint32_t BYTES[3] = {8u, 4u, 2u};
    const uint32_t columns = made->rows * N_NODES + 1u, vertices = made->points[0] * made->points[1];
    const uint32_t sizes[16] = {made->kind, made->law, 2u, made->rows, N_NODES, N_POINTS, 2u, WIDEST,
                                1u, 1u, 0u, 1u, 0xFFFFFFFFu, made->holes, 0u, made->modulates};
    const uint32_t axes[2][4] = {{made->points[0], made->order[0], 1u, 0u},
                                 {made->points[1], made->order[1], 0u, 0u}};
    const uint32_t segments[2][4] = {{3u, 9u, 0u, 0u}, {4u, 2u, 0u, 0u}};
    const size_t values = padded((size_t)vertices * columns * BYTES[made->kind]);
    size_t numbers, size, i;

    numbers = sizeof table.set / 8u + made->points[0] + made->points[1];
    numbers += 2u * 2u * WIDEST + 3u * 9u + 4u * 2u + 2u * N_POINTS;
    numbers += (made->kind == (uint32_t)AMPI_INT16) ? (2u * columns) : 0u;
    size = 32u + 64u + 2u * 40u + 2u * 48u + 8u * numbers + values;
    size += (made->holes != 0u) ? padded(vertices) : 0u;

    Frama_C_make_unknown((char *)blob, SIZE);
    (void)memcpy(blob, magic, sizeof magic);
    put(8u, 0x01020304u);
    put(12u, 2u);
    put(16u, (uint32_t)(size - 32u));
    for (i = 0u; i < 16u; i++) {
        put(32u + 4u * i, sizes[i]);
    }
    for (i = 0u; i < 4u; i++) {
        put(96u + 4u * i, axes[0][i]);
        put(136u + 4u * i, axes[1][i]);
        put(176u + 4u * i, segments[0][i]);
        put(224u + 4u * i, segments[1][i]);
    }
    return size;
}

static void fly(void)
{
    double parameters[2], navigation[AMPI_N_NAVIGATED], sensed[3], time;
    const double *known;
    Frama_C_make_unknown((char *)parameters, sizeof parameters);
    known = (Frama_C_interval(0, 1) != 0) ? parameters : NULL;
    ampi_reference_at(&table, known, &reference);
    ampi_reference_high_density(&table, &reference, times, rows);
    ampi_guidance_begin(&guidance, &table, known);
    while (Frama_C_interval(0, 1) != 0) {
        if (Frama_C_interval(0, 1) != 0) {
            ampi_guidance_follow(&guidance, &table, &reference, known);
        }
        Frama_C_make_unknown((char *)navigation, sizeof navigation);
        Frama_C_make_unknown((char *)sensed, sizeof sensed);
        Frama_C_make_unknown((char *)&time, sizeof time);
        (void)ampi_guidance_step(&guidance, &table, time,
                                 (Frama_C_interval(0, 1) != 0) ? navigation : NULL,
                                 (Frama_C_interval(0, 1) != 0) ? sensed : NULL);
    }
}

static void any_flight(const layout *made)
{
    if (ampi_table_open(&table, blob, make(made)) == AMPI_OK) {
        fly();
    } else {
        fly(); /* of a table that has been refused: all of it is held */
    }
}

#ifndef PART /* of any_correction.c */
int main(void)
{
    const layout linear = {AMPI_FLOAT64, AMPI_LINEAR_QUADRATIC, N_STEERED_ROWS + 1, {2u, 4u},
                           {AMPI_LINEAR, AMPI_CUBIC}, 0u, 1u};
    const layout shuttle = {AMPI_FLOAT32, AMPI_DRAG_SHUTTLE, N_DRAG_ROWS, {3u, 3u},
                            {AMPI_NEAREST, AMPI_QUADRATIC}, 1u, 1u};
    const layout sliding = {AMPI_INT16, AMPI_DRAG_SLIDING_MODE, N_DRAG_ROWS, {4u, 1u},
                            {AMPI_SECOND_DIFFERENCES, AMPI_LINEAR}, 0u, 0u};
    fly();
    any_flight(&linear);
    any_flight(&shuttle);
    any_flight(&sliding);
    return 0;
}
#endif
