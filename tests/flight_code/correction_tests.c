/* Own tests of estimation and correction: `correction_tests NAME.table PLANS NAME.model NAME.correction …`,
   files of correction_inputs.py. The first model flies on the table, and what it plans is written to PLANS
   for plans.py; prints what it has compared, and fails at the first number that is not as it must be. */
#include <stdio.h>
#include <stdlib.h>

#include "correction_tests.h"

static const double *next_number;
static unsigned long compared;

void expect(int is_met, const char *what, double told, double expected)
{
    compared++;
    if (!is_met) {
        (void)printf("%s: %.17g, expected %.17g\n", what, told, expected);
        exit(1);
    }
}

/* n numbers to a share of the largest; NaN is NaN. */
static void near(const char *what, const double *told, size_t n, double error)
{
    double largest = 0.0;
    size_t i;
    for (i = 0u; i < n; i++) { largest = (fabs(next_number[i]) > largest) ? fabs(next_number[i]) : largest; }
    for (i = 0u; i < n; i++) {
        const double expected = next_number[i];
        const int is_same = (told[i] != told[i]) && (expected != expected);
        expect(is_same || (fabs(told[i] - expected) <= error * largest), what, told[i], expected);
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

static void test_air(const ampi_model_data *model)
{
    const double time = next_number[0], *state = &next_number[1], *told = &next_number[9];
    const ampi_factors factors = {told[0], told[1], told[2], told[3], 0.0};
    const double angle = ampi_scheduled_angle(model, time, state[SPEED]) + told[4];
    const ampi_angles angles = ampi_angles_of(state);
    const ampi_air air = ampi_air_at(model, &factors, state, &angles, angle);
    double rates[6], sensed[3], use[3];
    ampi_rates(model, state, &angles, &air, rates);
    ampi_use(model, &air, use);
    sensed[0] = air.along;
    sensed[1] = air.up;
    sensed[2] = air.right;
    next_number += 14;
    near("rates", rates, 6u, 1e-12);
    near("sensed", sensed, 3u, 1e-11);
    near("used limits", use, 3u, 1e-11);
}

static void test_update(ampi_estimate *estimate, const ampi_model_data *model)
{
    const double *told = next_number, *prior = model->estimator.prior;
    double mean[AMPI_N_ESTIMATED], covariance[AMPI_N_ESTIMATED * AMPI_N_ESTIMATED], counts[6];
    size_t i, j;
    ampi_estimate_update(estimate, model, told[0], &told[1], &told[9], told[12], told[13]);
    next_number += 14;
    for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
        mean[i] = estimate->mean[i] / prior[i];
        for (j = 0u; j < AMPI_N_ESTIMATED; j++) {
            expect(estimate->covariance[i][j] == estimate->covariance[j][i], "symmetry", 0.0, 1.0);
            covariance[i * AMPI_N_ESTIMATED + j] = estimate->covariance[i][j] / prior[i] / prior[j];
        }
    }
    counts[0] = (double)estimate->used;
    counts[1] = (double)estimate->weak;
    counts[2] = (double)estimate->unusable;
    counts[3] = (double)estimate->stuck;
    counts[4] = (double)estimate->gated;
    counts[5] = (double)estimate->reset;
    near("mean", mean, AMPI_N_ESTIMATED, 1e-8);
    near("covariance", covariance, AMPI_N_ESTIMATED * AMPI_N_ESTIMATED, 1e-9);
    near("NIS", &estimate->nis, 1u, 1e-7);
    near("counts", counts, 6u, 0.0);
}

static void repair(unsigned char *blob, size_t size)
{
    const uint32_t crc = ampi_crc_32(blob, 32u, size);
    (void)memcpy(&blob[20], &crc, sizeof crc);
}

static void test_damages(const unsigned char *blob, size_t size, size_t count)
{
    static ampi_model model;
    unsigned char *copy = malloc(size + 8u);
    size_t i, j;
    for (i = 0u; i < count; i++) {
        const size_t place = (size_t)next_number[0], n = (size_t)next_number[3];
        const int is_fixed = next_number[1] != 0.0;
        const double status = next_number[2];
        ampi_status told;
        next_number += 4;
        (void)memcpy(copy, blob, size);
        for (j = 0u; j < n; j++) { copy[place + j] = (unsigned char)*next_number++; }
        if (is_fixed) { repair(copy, size); }
        told = ampi_model_open(&model, copy, size);
        expect((double)told == status, "status of a damage", (double)told + 100.0 * (double)i, status);
        expect(model.is_open == 0u, "a damaged model is shut", 1.0, 0.0);
    }
    expect(ampi_model_open(&model, NULL, 0u) == AMPI_TRUNCATED, "no blob", 0.0, 1.0);
    expect(ampi_model_open(&model, copy, size - 8u) == AMPI_TRUNCATED, "a blob too short", 0.0, 1.0);
    expect(ampi_model_open(&model, copy, size + 8u) == AMPI_TRUNCATED, "a blob too long", 0.0, 1.0);
    free(copy);
}

int main(int count, char **paths)
{
    static ampi_table table;
    static ampi_model model;
    static ampi_estimate estimate;
    size_t size, ignored, i;
    int k;
    unsigned char *of_table = contents(paths[1], &size);
    expect(ampi_table_open(&table, of_table, size) == AMPI_OK, "status of the table", 1.0, 0.0);
    for (k = 3; (k + 1) < count; k += 2) {
        unsigned char *blob = contents(paths[k], &size);
        double *numbers = contents(paths[k + 1], &ignored);
        const size_t n_air = (size_t)numbers[0], n_updates = (size_t)numbers[1], n_bad = (size_t)numbers[2];
        next_number = &numbers[3];
        expect(ampi_model_open(&model, blob, size) == AMPI_OK, "status of a model", 1.0, 0.0);
        for (i = 0u; i < n_air; i++) { test_air(&model.of); }
        ampi_estimate_begin(&estimate, &model.of);
        for (i = 0u; i < n_updates; i++) { test_update(&estimate, &model.of); }
        test_damages(blob, size, n_bad);
        if (k == 3) { test_flights(&model, &table, paths[2]); }
        free(numbers);
        free(blob);
    }
    free(of_table);
    (void)printf("%lu numbers compared\n", compared);
    return 0;
}
