/* Own tests of estimation and correction: `correction_tests NAME.table PLANS NAME.model NAME.correction …`,
   files of correction_inputs.py. The first model flies on the table, and what it plans is written to PLANS
   for plans.py; prints what it has compared, and fails at the first number that is not as it must be. */
#include <stdio.h>
#include <stdlib.h>

#include "ampi_correction_parts.h"

#define CYCLE 0.5 /* s */
#define N_CYCLES 2000u

static const double *next_number;
static FILE *plans;
static unsigned long compared, corrections;
static double worst_miss;

static void expect(int is_met, const char *what, double told, double expected)
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

/* What differs from one flight to the next. */
typedef struct {
    const char *name;
    double density, east, bias;       /* of the truth: factor, m/s; of the accelerometer: a share */
    double lost_from, lost_to;        /* s: navigation tells nothing */
    double moved_at, moved_east;      /* s, rad: the target */
    double within;                    /* m: where it must end; 0: anywhere */
    double iterations, propagations, change;
} flight;

typedef struct {
    ampi_corrector corrector;
    ampi_guidance guidance;
    ampi_model model;
    double state[AMPI_N_NAVIGATED], angle, time;
} world;

/* Bounds of the plan, and that a command keeps the limits and moves the angle of attack slowly. */
static void keeps_bounds(const world *in, ampi_command command, double before)
{
    const ampi_plan *plan = &in->corrector.plan;
    const double change = in->model.of.corrector.change, rate = in->model.of.corrector.change_rate;
    size_t i;
    for (i = 0u; i < AMPI_N_PLAN; i++) {
        const double bound = (i < AMPI_N_BANKS) ? in->guidance.limit[0] : change;
        expect(fabs(plan->value[i]) <= bound, "a value of the plan", plan->value[i], bound);
    }
    expect(fabs(command.bank_rate) <= in->guidance.limit[1], "bank rate", command.bank_rate, 0.0);
    expect(fabs(command.angle_of_attack) <= change + 1e-15, "change", command.angle_of_attack, change);
    expect(fabs(command.angle_of_attack - before) <= rate * in->guidance.expected + 1e-15, "its rate",
           command.angle_of_attack, before);
}

/* One record of plans.py: what was known, the plan before and after, and what is predicted. */
static void record(const world *in, const ampi_plan *before)
{
    const ampi_corrector *own = &in->corrector;
    const ampi_plan *told[2];
    const double head[5] = {own->time, own->change, in->guidance.limit[0], in->guidance.limit[1],
                            own->estimate.altitude};
    const double tail[3] = {own->to_go, (double)own->outcome, in->model.of.corrector.change};
    size_t i;
    told[0] = before;
    told[1] = &own->plan;
    (void)fwrite(head, sizeof head[0], 5u, plans);
    (void)fwrite(own->state, sizeof own->state[0], 7u, plans);
    (void)fwrite(own->estimate.mean, sizeof own->estimate.mean[0], AMPI_N_ESTIMATED, plans);
    (void)fwrite(own->target, sizeof own->target[0], 4u, plans);
    for (i = 0u; i < 2u; i++) {
        (void)fwrite(&told[i]->fast, sizeof(double), 1u, plans);
        (void)fwrite(&told[i]->slow, sizeof(double), 1u, plans);
        (void)fwrite(told[i]->value, sizeof told[i]->value[0], AMPI_N_PLAN, plans);
    }
    (void)fwrite(own->missed, sizeof own->missed[0], AMPI_N_MISSED, plans);
    (void)fwrite(tail, sizeof tail[0], 3u, plans);
}

/* The truth flies a cycle: bank angle and angle of attack become what was commanded. */
static void fly_truth(world *in, const flight *is, ampi_command command, double *sensed)
{
    const ampi_factors factors = {is->density, 1.0, is->east, 0.0, 0.0};
    const double step = 0.1 * CYCLE, roll = (command.bank_rate - in->state[BANK_RATE]) / CYCLE;
    double rates[6];
    size_t i, k;
    for (k = 0u; k < 10u; k++) {
        const double angle = ampi_scheduled_angle(&in->model.of, in->time, in->state[SPEED]) + in->angle;
        const ampi_angles angles = ampi_angles_of(in->state);
        const ampi_air air = ampi_air_at(&in->model.of, &factors, in->state, &angles, angle);
        ampi_rates(&in->model.of, in->state, &angles, &air, rates);
        for (i = 0u; i < 6u; i++) { in->state[i] += step * rates[i]; }
        in->state[BANK] += step * in->state[BANK_RATE];
        in->state[BANK_RATE] += step * roll;
        in->angle += (command.angle_of_attack - in->angle) * (1.0 - exp(-step / 0.5));
        in->time += step;
        sensed[0] = air.along * (1.0 + is->bias);
        sensed[1] = air.up * (1.0 + is->bias);
        sensed[2] = air.right * (1.0 + is->bias);
    }
}

static void test_flight(world *in, const ampi_model *model, const ampi_table *table, const flight *is)
{
    const double nothing[AMPI_N_NAVIGATED] = {AMPI_NAN};
    double sensed[3] = {0.0}, target[4], miss = 0.0, before = 0.0;
    size_t i;
    (void)memset(in, 0, sizeof *in);
    in->model = *model;
    in->model.of.corrector.iterations = is->iterations;
    in->model.of.corrector.propagations = is->propagations;
    in->model.of.corrector.change = is->change;
    ampi_guidance_begin(&in->guidance, table, NULL);
    ampi_corrector_begin(&in->corrector, &in->model, table, NULL);
    ampi_row_at(table, &in->guidance.reference, 0.0, in->guidance.row);
    (void)memcpy(in->state, in->guidance.row, sizeof in->state);
    in->state[BANK_RATE] = 0.0;
    for (i = 0u; (i < N_CYCLES) && (in->state[SPEED] > in->corrector.target[3]); i++) {
        const ampi_plan plan = in->corrector.plan;
        const uint32_t had = in->corrector.has_plan;
        const int is_lost = (in->time >= is->lost_from) && (in->time < is->lost_to);
        ampi_command command;
        if ((is->moved_at > 0.0) && (fabs(in->time - is->moved_at) < 0.1)) {
            (void)memcpy(target, in->corrector.target, sizeof target);
            target[1] += is->moved_east;
            ampi_corrector_aim(&in->corrector, target);
        }
        command = ampi_corrected_step(&in->corrector, &in->model, &in->guidance, table, in->time,
                                      is_lost ? nothing : in->state, (i == 0u) ? NULL : sensed);
        if (in->corrector.has_plan != 0u) { keeps_bounds(in, command, before); }
        before = command.angle_of_attack;
        if ((had != 0u) && (plan.fast != in->corrector.plan.fast)) { /* corrected: laid anew */
            record(in, &plan);
            corrections++;
        }
        fly_truth(in, is, command, sensed);
    }
    (void)memcpy(target, in->corrector.target, sizeof target);
    miss = model->of.radius * hypot(in->state[LATITUDE] - target[2],
                                    cos(target[2]) * (in->state[LONGITUDE] - target[1]));
    if (getenv("AMPI_TOLD") != NULL) {
        (void)printf("%s: miss %.0f m, up %.0f m, %u %u %u %u %u %u %u\n", is->name, miss,
                     in->state[ALTITUDE] - target[0], in->corrector.count[1], in->corrector.count[2],
                     in->corrector.count[3], in->corrector.count[4], in->corrector.count[5],
                     in->corrector.count[6], in->corrector.count[7]);
    }
    if (is->within > 0.0) {
        expect(miss <= is->within, is->name, miss, is->within);
        worst_miss = (miss > worst_miss) ? miss : worst_miss;
    }
}

int main(int count, char **paths)
{
    static ampi_table table;
    static ampi_model model;
    static ampi_estimate estimate;
    static world in;
    static const flight FLIGHTS[] = {
        {"as modelled", 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 150.0, 10.0, 200.0, 0.078},
        {"denser, windy", 1.15, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0, 10.0, 200.0, 0.078},
        {"thinner, by bank", 0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 200.0, 0.0},
        {"a biased accelerometer", 1.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 200.0, 0.078},
        {"navigation lost", 1.05, 0.0, 0.0, 60.0, 80.0, 0.0, 0.0, 0.0, 10.0, 200.0, 0.078},
        {"the target moved", 1.0, 0.0, 0.0, 0.0, 0.0, 60.0, 0.004, 0.0, 10.0, 200.0, 0.078},
        {"out of reach", 1.0, 0.0, 0.0, 0.0, 0.0, 60.0, 0.5, 0.0, 10.0, 200.0, 0.078},
        {"no iteration", 1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 200.0, 0.078},
        {"no budget", 1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.078},
    };
    size_t size, ignored, i;
    int k;
    unsigned char *of_table = contents(paths[1], &size);
    expect(ampi_table_open(&table, of_table, size) == AMPI_OK, "status of the table", 1.0, 0.0);
    plans = fopen(paths[2], "wb");
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
        for (i = 0u; (k == 3) && (i < (sizeof FLIGHTS / sizeof FLIGHTS[0])); i++) {
            test_flight(&in, &model, &table, &FLIGHTS[i]);
        }
        free(numbers);
        free(blob);
    }
    (void)fclose(plans);
    free(of_table);
    (void)printf("%lu numbers compared, %lu corrections, targets missed by %.0f m\n", compared, corrections,
                 worst_miss);
    return 0;
}
