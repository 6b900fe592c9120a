/* The core's own tests: `own_tests NAME.blob NAME.cases …`, files of inputs.py. Prints what it has
   compared and the worst error; fails at the first number that is not what the numpy guidance says. */
#include <stdio.h>
#include <stdlib.h>

#include "ampi_parts.h"

static const double *next_number;
static double *scratch, worst;
static unsigned long compared;

static void expect(int is_met, const char *what, double told, double expected)
{
    compared++;
    if (!is_met) {
        (void)printf("%s: %.17g, expected %.17g\n", what, told, expected);
        exit(1);
    }
}

/* To the bit; NaN is NaN. */
static void same(const char *what, double told)
{
    const double expected = *next_number++;
    expect((told == expected) || ((told != told) && (expected != expected)), what, told, expected);
}

/* Each of n numbers to a share of the largest. */
static void near(const char *what, const double *told, size_t n, double error)
{
    double largest = 0.0;
    size_t i;
    for (i = 0u; i < n; i++) {
        largest = most(largest, fabs(next_number[i]));
    }
    for (i = 0u; i < n; i++) {
        const double off = fabs(told[i] - next_number[i]);
        expect(off <= error * largest, what, told[i], next_number[i]);
        worst = most(worst, (largest > 0.0) ? (off / largest) : 0.0);
    }
    next_number += n;
}

static void *contents(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    void *bytes;
    if ((file == NULL) || (fseek(file, 0L, SEEK_END) != 0)) {
        (void)printf("cannot read %s\n", path);
        exit(2);
    }
    *size = (size_t)ftell(file);
    rewind(file);
    bytes = malloc(*size);
    if ((bytes == NULL) || (fread(bytes, 1u, *size, file) != *size)) {
        exit(2);
    }
    (void)fclose(file);
    return bytes;
}

static void test_reference(const ampi_table *table, ampi_reference *reference, double error)
{
    const size_t d = table->n.axes, r = table->n.rows, n = table->n.nodes, m = table->n.points;
    double *times = scratch, *rows = &scratch[m], *nodal = &rows[r * m];
    size_t i;
    ampi_reference_at(table, next_number, reference);
    next_number += d;
    for (i = 0u; i < d; i++) { same("cell", (double)reference->cell[i]); }
    for (i = 0u; i < d; i++) { same("clipped", (double)reference->clipped[i]); }
    for (i = 0u; i < d; i++) { same("excess", reference->excess[i]); }
    same("hole", (double)(reference->hole != 0u));
    same("health", (double)reference->health);
    for (i = 0u; i < (r * n); i++) { nodal[i] = (double)reference->rows[(i % n) * r + i / n]; }
    for (i = 0u; i < r; i++) { near("nodal", &nodal[i * n], n, error); }
    near("final time", &reference->final_time, 1u, error);
    ampi_reference_high_density(table, reference, times, rows);
    near("times", times, m, error);
    for (i = 0u; i < r; i++) { near("rows", &rows[i * m], m, error); }
}

static void test_flight(ampi_guidance *guidance, const ampi_table *table, size_t steps, int is_exact,
                        int to_the_bit)
{
    const double *sensed;
    size_t i;
    ampi_guidance_begin(guidance, table, next_number);
    next_number += table->n.axes;
    sensed = (*next_number++ != 0.0) ? &next_number[9] : NULL;
    for (i = 0u; i < steps; i++) {
        const double time = next_number[0], *navigation = &next_number[1];
        const ampi_command command = ampi_guidance_step(guidance, table, time, navigation, sensed);
        double told[3];
        told[0] = command.bank_rate;
        told[1] = command.bank_angle;
        told[2] = command.angle_of_attack;
        next_number += 12;
        if (to_the_bit) {
            same("bank rate", told[0]);
            same("bank angle", told[1]);
            same("angle of attack", told[2]);
        } else if (is_exact) {
            size_t j;
            for (j = 0u; j < 3u; j++) {
                expect(fabs(told[j] - next_number[j]) <= 1e-11, "command", told[j], next_number[j]);
            }
            next_number += 3;
        } else {
            next_number += 3; /* of rounded tables: a law may decide otherwise at a threshold */
        }
        if (is_exact) {
            same("steering", (double)command.steering);
            same("health", (double)command.health);
        } else {
            expect(fabs(command.bank_rate) < HUGE_VAL, "bank rate", command.bank_rate, 0.0);
            next_number += 2;
        }
        sensed = (sensed != NULL) ? &sensed[17] : NULL;
    }
}

/* What no caller should do, and what a caller who does it is told. */
static void test_misuse(ampi_guidance *guidance, ampi_table *table, ampi_reference *reference)
{
    static ampi_table shut;
    static ampi_guidance unbegun;
    static ampi_reference foreign;
    const double nowhere[AMPI_N_NAVIGATED] = {0.0};
    const double beyond[AMPI_MAX_AXES] = {1e300, 1e300, 1e300};
    ampi_command command;

    expect(ampi_table_open(&shut, NULL, 0u) == AMPI_TRUNCATED, "NULL blob", 0.0, 1.0);
    expect(ampi_table_open(&shut, table->blob, 40u) == AMPI_TRUNCATED, "short blob", 0.0, 1.0);
    ampi_reference_at(&shut, nowhere, reference);
    expect(reference->health == AMPI_NOT_BEGUN, "reference of a shut table", 0.0, 9.0);
    ampi_reference_high_density(&shut, reference, scratch, scratch);
    ampi_guidance_begin(&unbegun, &shut, nowhere);
    command = ampi_guidance_step(&unbegun, &shut, 0.0, nowhere, NULL);
    expect(command.health == AMPI_NOT_BEGUN, "step on a shut table", (double)command.health, 9.0);
    command = ampi_guidance_step(&unbegun, table, 0.0, nowhere, NULL);
    expect(command.health == AMPI_NOT_BEGUN, "step before a begin", (double)command.health, 9.0);
    ampi_guidance_follow(&unbegun, table, &foreign, nowhere);
    ampi_guidance_follow(&unbegun, &shut, &foreign, nowhere);
    ampi_reference_high_density(table, &foreign, scratch, scratch);

    ampi_reference_at(table, NULL, reference);
    expect(reference->health == AMPI_BAD_PARAMETERS, "no parameters", (double)reference->health, 4.0);
    ampi_guidance_begin(guidance, table, NULL);
    ampi_guidance_follow(guidance, table, &foreign, NULL);
    expect(guidance->reference.checksum == table->checksum, "foreign reference", 1.0, 0.0);
    command = ampi_guidance_step(guidance, &shut, 0.0, nowhere, NULL);
    expect(command.health == AMPI_NOT_BEGUN, "the table shut before a command", (double)command.health, 9.0);
    expect(command.bank_rate == 0.0, "nothing commanded, nothing held", command.bank_rate, 0.0);
    ampi_guidance_follow(guidance, table, reference, nowhere);
    command = ampi_guidance_step(guidance, table, (double)NAN, nowhere, NULL);
    expect(command.health >= AMPI_BAD_TIME, "no time at the begin", (double)command.health, 7.0);
    command = ampi_guidance_step(guidance, table, 0.0, NULL, NULL);
    expect(command.health >= AMPI_BAD_NAVIGATION, "no navigation", (double)command.health, 6.0);
    guidance->is_asked = 1u;
    command = ampi_guidance_step(guidance, table, 0.5, NULL, NULL);
    expect(command.steering == AMPI_PLANNED, "a plan goes on", (double)command.steering, 3.0);
    guidance->is_asked = 0u;
    ampi_guidance_follow(guidance, table, reference, beyond);
    expect(guidance->limit[0] == table->set.limit[0], "a limit beyond sense", guidance->limit[0], 0.0);
    guidance->reference.checksum ^= 1u;
    command = ampi_guidance_step(guidance, table, 1.0, nowhere, NULL);
    expect(command.health == AMPI_NOT_BEGUN, "another table", (double)command.health, 9.0);
}

static uint32_t crc_32(const unsigned char *bytes, size_t size)
{
    uint32_t crc = 0xFFFFFFFFu, bit;
    for (; size > 0u; size--) {
        crc ^= *bytes++;
        for (bit = 0u; bit < 8u; bit++) { crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u))); }
    }
    return ~crc;
}

static void repair(unsigned char *blob, size_t size)
{
    const uint32_t crc = crc_32(&blob[32], size - 32u);
    (void)memcpy(&blob[20], &crc, sizeof crc);
}

/* A step from a copy of this flight: where longitude is the reference's and so much more, altitude so. */
static double rate_beside(const ampi_guidance *flight, const ampi_table *table, double more, double altitude)
{
    static ampi_guidance copy;
    const double sensed[3] = {-1e3, 0.0, 0.0};
    double navigation[AMPI_N_NAVIGATED] = {0.0};
    size_t i;
    copy = *flight;
    (void)ampi_guidance_step(&copy, table, 1.0, navigation, sensed); /* tells the row */
    for (i = 0u; i < AMPI_N_NAVIGATED; i++) { navigation[i] = copy.row[i]; }
    navigation[LONGITUDE] += more;
    navigation[ALTITUDE] = (altitude != 0.0) ? altitude : navigation[ALTITUDE];
    copy = *flight;
    return ampi_guidance_step(&copy, table, 1.0, navigation, sensed).bank_rate;
}

/* A table to which all states are plausible, and whose lateral gains overflow. */
static void test_edges(ampi_guidance *guidance, const ampi_table *own, const unsigned char *blob, size_t size)
{
    static ampi_table table;
    const size_t set = own->points_of[0] - sizeof own->set;
    unsigned char *copy = malloc(size);
    double rate, turned;
    size_t i;
    table.set = own->set;
    for (i = 0u; i < AMPI_N_STATES; i++) { table.set.reach[i] = 1e300; }
    (void)memcpy(copy, blob, size);
    (void)memcpy(&copy[set], &table.set, sizeof table.set);
    repair(copy, size);
    expect(ampi_table_open(&table, copy, size) == AMPI_OK, "a generous table", 1.0, 0.0);
    ampi_guidance_begin(guidance, &table, NULL);
    rate = rate_beside(guidance, &table, -AMPI_PI, 0.0);
    turned = rate_beside(guidance, &table, -AMPI_TURN - AMPI_PI, 0.0);
    expect(rate == turned, "half a turn is one and a half", turned, rate);
    rate = rate_beside(guidance, &table, 0.0, -table.set.gain[1]); /* at the centre of the planet */
    expect(fabs(rate) < HUGE_VAL, "bank rate at the centre of the planet", rate, 0.0);
    for (i = 0u; i < AMPI_N_GAINS; i++) { table.set.gain[i] = (i < 5u) ? table.set.gain[i] : 1.7e308; }
    table.set.reach[BANK] = 1e300;
    (void)memcpy(&copy[set], &table.set, sizeof table.set);
    repair(copy, size);
    expect(ampi_table_open(&table, copy, size) == AMPI_OK, "a table of great gains", 1.0, 0.0);
    ampi_guidance_begin(guidance, &table, NULL);
    for (i = 0u; i < 2u; i++) { /* off the heading to both sides */
        rate = rate_beside(guidance, &table, (i == 0u) ? -1.0 : 1.0, 0.0);
        expect(fabs(rate) < HUGE_VAL, "bank rate of great gains", rate, 0.0);
    }
    free(copy);
}

static void test_damages(const unsigned char *blob, size_t size, size_t count)
{
    static ampi_table table;
    unsigned char *copy = malloc(size);
    size_t i, j;
    for (i = 0u; i < count; i++) {
        const size_t place = (size_t)*next_number++;
        const int is_fixed = *next_number++ != 0.0;
        const double status = *next_number++;
        const size_t n = (size_t)*next_number++;
        size_t told_size;
        ampi_status told;
        (void)memcpy(copy, blob, size);
        for (j = 0u; j < n; j++) { copy[place + j] = (unsigned char)*next_number++; }
        told_size = (place == 0u) ? n : size;
        if (is_fixed) {
            repair(copy, told_size);
        }
        told = ampi_table_open(&table, copy, told_size);
        expect((double)told == status, "status of a damage", (double)told + 100.0 * (double)i, status);
    }
    for (j = 0u; j < size; j += 1u + size / 200u) { /* cut short anywhere, whatever it says of itself */
        const uint32_t left = (uint32_t)j - 32u;
        (void)memcpy(copy, blob, j);
        if (j > 32u) {
            (void)memcpy(&copy[16], &left, sizeof left);
            repair(copy, j);
        }
        expect(ampi_table_open(&table, copy, j) != AMPI_OK, "a blob cut short", (double)j, 0.0);
    }
    free(copy);
}

static void test_case(const char *blob_path, const char *cases_path)
{
    static ampi_table table;
    static ampi_reference reference;
    static ampi_guidance guidance;
    size_t size, ignored, i, n_references, n_flights, n_steps, n_damages;
    unsigned char *blob = contents(blob_path, &size);
    double *cases = contents(cases_path, &ignored), error;
    int to_the_bit, is_exact;

    expect(ampi_table_open(&table, blob, size) == AMPI_OK, "status of a good blob", 1.0, 0.0);
    next_number = cases;
    same("axes", (double)table.n.axes);
    same("rows", (double)table.n.rows);
    same("nodes", (double)table.n.nodes);
    same("points", (double)table.n.points);
    error = *next_number++;
    to_the_bit = *next_number++ != 0.0;
    n_references = (size_t)*next_number++;
    n_flights = (size_t)*next_number++;
    n_steps = (size_t)*next_number++;
    is_exact = *next_number++ != 0.0;
    n_damages = (size_t)*next_number++;
#ifdef AMPI_SINGLE
    error = most(error, 1e-5);
    to_the_bit = 0;
    is_exact = 0;
#endif
    scratch = malloc(sizeof(double) * (table.n.points + table.n.rows * (table.n.points + table.n.nodes)));
    for (i = 0u; i < n_references; i++) { test_reference(&table, &reference, error); }
    for (i = 0u; i < n_flights; i++) { test_flight(&guidance, &table, n_steps, is_exact, to_the_bit); }
    test_damages(blob, size, n_damages);
    test_edges(&guidance, &table, blob, size);
    test_misuse(&guidance, &table, &reference);
    free(scratch);
    free(cases);
    free(blob);
}

int main(int count, char **paths)
{
    int i;
    for (i = 1; (i + 1) < count; i += 2) { test_case(paths[i], paths[i + 1]); }
    (void)printf("%lu numbers compared, worst error %.2g of a row's largest\n", compared, worst);
    return 0;
}
