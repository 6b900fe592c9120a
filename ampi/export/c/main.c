/* A loop of one's own: opens a table, flies what was recorded, prints the commands as CSV.

       main [-m ampi_model.bin] ampi_table.bin [flight.csv]
       main [-m ampi_model.bin] [flight.csv]                      with the table compiled in

   With a model the plan is corrected in flight.

   A line of flight.csv is time, h, theta, phi, V, gamma, psi, sigma, sigma rate and, where they are
   sensed, the specific forces along the velocity, up and right of it. Without a file the vehicle is
   where its reference was at the last cycle. The flight code itself needs no files and no memory. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ampi_correction.h"

#ifdef AMPI_TABLE_DATA
#include "ampi_table_data.h"
#endif

#define LINE 1024
#define CYCLE 0.5 /* s, without a file */

static ampi_table table;
static ampi_guidance guidance;
static ampi_model model; /* not opened: plans are not corrected */
static ampi_corrector corrector;

static unsigned char *contents(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    unsigned char *bytes = NULL;
    long end;
    if ((file != NULL) && (fseek(file, 0L, SEEK_END) == 0) && ((end = ftell(file)) > 0L)) {
        rewind(file);
        bytes = malloc((size_t)end);
        *size = (bytes != NULL) ? fread(bytes, 1u, (size_t)end, file) : 0u;
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return bytes;
}

static void step(double time, const double *navigation, const double *sensed)
{
    const ampi_command command =
        ampi_corrected_step(&corrector, &model, &guidance, &table, time, navigation, sensed);
    (void)printf("%.17g,%.17g,%.17g,%.17g,%d,%d\n", time, command.bank_rate, command.bank_angle,
                 command.angle_of_attack, (int)command.steering, (int)command.health);
}

static int fly_recorded(const char *path)
{
    FILE *file = fopen(path, "r");
    char line[LINE];
    if (file == NULL) {
        (void)fprintf(stderr, "%s cannot be read\n", path);
        return 1;
    }
    while (fgets(line, LINE, file) != NULL) {
        double told[1u + AMPI_N_NAVIGATED + 3u];
        char *at = line, *end;
        size_t n;
        for (n = 0u; n < (sizeof told / sizeof told[0]); n++) {
            told[n] = strtod(at, &end);
            if (end == at) {
                break;
            }
            at = (*end == ',') ? (end + 1) : end;
        }
        if (n > AMPI_N_NAVIGATED) { /* not a heading */
            const int is_sensed = (n == (sizeof told / sizeof told[0]));
            step(told[0], &told[1], is_sensed ? &told[1u + AMPI_N_NAVIGATED] : NULL);
        }
    }
    (void)fclose(file);
    return 0;
}

int main(int count, char **arguments)
{
    static double parameters[AMPI_MAX_AXES], navigation[AMPI_N_NAVIGATED];
    int next = 1;
    size_t i, size = 0u, cycle;
    ampi_status status;
    if ((count > 2) && (strcmp(arguments[1], "-m") == 0)) {
        const unsigned char *on_board = contents(arguments[2], &size);
        status = ampi_model_open(&model, on_board, size);
        if (status != AMPI_OK) {
            (void)fprintf(stderr, "the model cannot be flown: status %d of ampi_status\n", (int)status);
            return 1;
        }
        next = 3;
    }
#ifdef AMPI_TABLE_DATA
    const unsigned char *blob = ampi_table_data;
    size = sizeof ampi_table_data;
#else
    const unsigned char *blob = (count > next) ? contents(arguments[next], &size) : NULL;
    next++;
#endif
    status = ampi_table_open(&table, blob, size);
    if (status != AMPI_OK) {
        (void)fprintf(stderr, "the table cannot be flown: status %d of ampi_status\n", (int)status);
        return 1;
    }
    for (i = 0u; i < table.n.axes; i++) { /* in flight, what was measured at the entry interface */
        parameters[i] = table.axis[i].nominal;
    }
    ampi_guidance_begin(&guidance, &table, parameters);
    ampi_corrector_begin(&corrector, &model, &table, parameters);
    (void)printf("time,bank_rate,bank_angle,angle_of_attack,steering,health\n");
    if (count > next) {
        return fly_recorded(arguments[next]);
    }
    for (cycle = 0u; (CYCLE * (double)cycle) < guidance.reference.final_time; cycle++) {
        for (i = 0u; i < AMPI_N_NAVIGATED; i++) {
            const ampi_real *first = &guidance.reference.rows[i]; /* of the first node */
            navigation[i] = (cycle == 0u) ? (double)*first : guidance.row[i];
        }
        step(CYCLE * (double)cycle, navigation, NULL);
    }
    return 0;
}
