/* Times the flight code on a table: flight_code_timer TABLE PARAMETERS ROUNDS
 *
 * PARAMETERS holds doubles, an entry after the other. Prints medians over them, in ns of CPU time of this
 * process: one high-density reference, its low-density half, one step, and reading the same cell of the
 * table and no more, which is the bound of the memory. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "ampi.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static unsigned char *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    unsigned char *bytes = NULL;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0) {
        *size = (size_t)ftell(file);
        rewind(file);
        bytes = malloc(*size);
        if (bytes == NULL || fread(bytes, 1, *size, file) != *size) exit(2);
        fclose(file);
    }
    return bytes;
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, size_t n)
{
    qsort(values, n, sizeof *values, compare);
    return values[n / 2];
}

/* Reads every vertex of the cell once, in the order in which the interpolation does. */
static double read_cell(const ampi_table *table, const ampi_reference *reference)
{
    static const size_t sizes[3] = {8u, 4u, 2u};
    size_t bytes = table->columns * sizes[table->n.kind], words = bytes / 8u;
    uint64_t sum[4] = {0u, 0u, 0u, 0u};
    for (size_t v = 0; v < (size_t)1 << table->n.axes; v++) {
        size_t place = 0;
        for (size_t i = 0; i < table->n.axes; i++) {
            place += (reference->cell[i] + ((v >> (table->n.axes - 1u - i)) & 1u)) * table->stride[i];
        }
        const uint64_t *row = (const uint64_t *)(const void *)(table->blob + table->values + place * bytes);
        for (size_t k = 0; k + 4u <= words; k += 4u) {
            for (size_t j = 0; j < 4u; j++) sum[j] += row[k + j];
        }
    }
    return (double)(sum[0] ^ sum[1] ^ sum[2] ^ sum[3]);
}

int main(int argc, char **argv)
{
    static ampi_table table;
    static ampi_reference reference;
    static ampi_guidance guidance;
    static double rows[AMPI_MAX_ROWS * AMPI_MAX_POINTS], times[AMPI_MAX_POINTS];
    size_t size = 0, many = 0;
    if (argc != 4) return 2;
    unsigned char *blob = read_file(argv[1], &size);
    double *parameters = (double *)(void *)read_file(argv[2], &many);
    size_t rounds = (size_t)strtoul(argv[3], NULL, 10);
    if (blob == NULL || parameters == NULL || ampi_table_open(&table, blob, size) != AMPI_OK) return 1;
    many /= sizeof(double) * table.n.axes;
    double *whole = calloc(many * rounds, sizeof(double)), *low = calloc(many * rounds, sizeof(double));
    double *step = calloc(many * rounds, sizeof(double)), *bound = calloc(many * rounds, sizeof(double));
    if (whole == NULL || low == NULL || step == NULL || bound == NULL) return 2;
    double kept = 0.0;
    for (size_t i = 0; i < many * rounds; i++) {
        const double *p = parameters + (i % many) * table.n.axes;
        double begin = now();
        ampi_reference_at(&table, p, &reference);
        double middle = now();
        ampi_reference_high_density(&table, &reference, times, rows);
        double end = now();
        low[i] = middle - begin;
        whole[i] = end - begin;
        begin = now();
        kept += read_cell(&table, &reference);
        bound[i] = now() - begin;
        ampi_guidance_begin(&guidance, &table, p);
        double sensed[3] = {-5.0, 4.0, 1.0};
        begin = now();
        for (int k = 0; k < 1000; k++) { /* the clock of a process is read in a microsecond */
            double time = 100.0 + 0.1 * k;
            size_t at = (size_t)(time / reference.final_time * (double)(table.n.points - 1u));
            double navigation[AMPI_N_NAVIGATED];
            for (size_t s = 0; s < AMPI_N_NAVIGATED; s++) navigation[s] = rows[s * table.n.points + at];
            ampi_command command = ampi_guidance_step(&guidance, &table, time, navigation, sensed);
            kept += command.bank_rate;
        }
        step[i] = (now() - begin) / 1000.0;
    }
    printf("{\"reference\": %.1f, \"low_density\": %.1f, \"cell_read\": %.1f, \"step\": %.1f, "
           "\"kept\": %d}\n",
           median(whole, many * rounds), median(low, many * rounds), median(bound, many * rounds),
           median(step, many * rounds), kept == kept);
    return 0;
}
