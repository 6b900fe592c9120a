/* Flights of correction_tests.c: a vehicle that is not as the model says flies by the corrected plan, and
   single corrections at the edges of what may be asked. */
#include <stdio.h>
#include <stdlib.h>

#include "correction_tests.h"

#define CYCLE 0.5 /* s */
#define N_CYCLES 2000u

static FILE *plans;
static unsigned long corrections;
static double worst_miss;

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

static void test_flight(world *in, world *middle, const ampi_model *model, const ampi_table *table, const flight *is)
{
    double nothing[AMPI_N_NAVIGATED], row[AMPI_MAX_ROWS];
    double sensed[3] = {0.0}, target[4], miss = 0.0, before = 0.0;
    size_t i;
    for (i = 0u; i < AMPI_N_NAVIGATED; i++) { nothing[i] = AMPI_NAN; }
    (void)memset(in, 0, sizeof *in);
    in->model = *model;
    in->model.of.corrector.iterations = is->iterations;
    in->model.of.corrector.propagations = is->propagations;
    in->model.of.corrector.change = is->change;
    ampi_guidance_begin(&in->guidance, table, NULL);
    ampi_corrector_begin(&in->corrector, &in->model, table, NULL);
    ampi_row_at(table, &in->guidance.reference, 0.0, row);
    (void)memcpy(in->state, row, sizeof in->state);
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
        if ((middle != NULL) && (i == 200u)) { *middle = *in; }
        fly_truth(in, is, command, sensed);
    }
    (void)memcpy(target, in->corrector.target, sizeof target);
    miss = model->of.radius * hypot(in->state[LATITUDE] - target[2],
                                    cos(target[2]) * (in->state[LONGITUDE] - target[1]));
    if (is->within > 0.0) {
        expect(miss <= is->within, is->name, miss, is->within);
        worst_miss = (miss > worst_miss) ? miss : worst_miss;
    }
}

/* One correction of a copy of this world; its outcome. */
static int corrected(const world *from, const ampi_model_data *of, double speed, double bank)
{
    static world copy;
    double limit[3];
    size_t i;
    copy = *from;
    (void)memcpy(limit, copy.guidance.limit, sizeof limit);
    copy.corrector.state[SPEED] = speed;
    limit[0] = (bank > 0.0) ? 3.2 : limit[0];
    for (i = 0u; (bank > 0.0) && (i < AMPI_N_BANKS); i++) { copy.corrector.plan.value[i] = bank; }
    return (int)ampi_correct(&copy.corrector, of, limit);
}

static void outcome(const char *what, int told, ampi_correction expected)
{
    expect(told == (int)expected, what, (double)told, (double)expected);
}

/* What one correction makes of models and states at the edge of sense. */
static void test_corrections(const world *from)
{
    static world dive;
    const ampi_model_data *good = &from->model.of;
    ampi_model_data of = *good;
    const double speed = from->state[SPEED];
    size_t i;
    outcome("slower than the target", corrected(from, &of, 100.0, 0.0), AMPI_NO_ARRIVAL);
    outcome("no number", corrected(from, &of, AMPI_NAN, 0.0), AMPI_NO_ARRIVAL);
    outcome("inverted", corrected(from, &of, speed, 3.2), AMPI_OUT_OF_REACH); /* which is the bound */
    dive = *from;
    dive.corrector.state[ALTITUDE] = 30e3;
    dive.corrector.state[PATH_ANGLE] = -0.3;
    of.drag_factor *= 0.32;
    outcome("wings level where it would not arrive", corrected(&dive, &of, 2000.0, 3.1), AMPI_PLAN_REPLACED);
    for (i = 0u; i < 20u; i++) { /* ever steeper falls: some are not even bettered */
        of.drag_factor *= 0.9;
        dive.corrector.state[ALTITUDE] = 10e3 + 1e3 * (double)i;
        (void)corrected(&dive, &of, 2000.0, ((i % 2u) == 0u) ? 1.5 : 0.0);
    }
    of.drag_factor *= 0.1;
    outcome("into the ground", corrected(&dive, &of, 2000.0, 3.1), AMPI_NO_ARRIVAL);
    of = *good;
    of.corrector.longest = 10.0;
    outcome("too short a time", corrected(from, &of, speed, 0.0), AMPI_NO_ARRIVAL);
    of = *good;
    of.corrector.step = 0.1;
    outcome("too few steps", corrected(from, &of, speed, 0.0), AMPI_NO_ARRIVAL);
    of = *good;
    of.corrector.tolerance = 0.0;
    of.corrector.reach = 1e9;
    of.corrector.propagations = 1.0;
    outcome("no budget for a step", corrected(from, &of, speed, 0.0), AMPI_NO_BETTER);
    of = *good;
    of.corrector.tolerance = 1e9;
    outcome("near enough", corrected(from, &of, speed, 0.0), AMPI_PLAN_KEPT);
    of.limit[0] = 1.0; /* a limit that is broken */
    expect(corrected(from, &of, speed, 0.0) != (int)AMPI_PLAN_KEPT, "a broken limit", 1.0, 0.0);
    of = *good;
    of.schedule.over_time = 0.0;
    of.schedule.start = 1000.0;
    of.schedule.end = 4000.0;
    expect(corrected(from, &of, speed, 0.0) != (int)AMPI_NO_CORRECTION, "a schedule over speed", 0.0, 1.0);
}

static ampi_command step(world *in, const ampi_table *table, double time, const double *told)
{
    return ampi_corrected_step(&in->corrector, &in->model, &in->guidance, table, time, told, NULL);
}

/* Calls in the wrong order, of what is shut, of another table, with what is no number. */
static void test_misuse(const world *from, const ampi_table *table)
{
    static ampi_table shut;
    static ampi_model closed;
    static world in;
    const double unknown[4] = {1.0, AMPI_NAN, 0.0, 1.0};
    double parameters[AMPI_MAX_AXES] = {0.0};
    uint32_t part;
    size_t i;
    for (part = 0u; part < 7u; part++) {
        in = *from;
        in.model.is_open = (part == 0u) ? 0u : AMPI_OPEN;
        in.corrector.is_begun = (part == 1u) ? 0u : AMPI_OPEN;
        in.guidance.is_begun = (part == 2u) ? 0u : AMPI_OPEN;
        in.guidance.reference.checksum ^= (part == 3u) ? 1u : 0u;
        if (part == 4u) { in.model.of.corrector.stiffness = 1e300; in.state[BANK] = 1.0; }
        for (i = AMPI_N_BANKS; (part == 5u) && (i < AMPI_N_PLAN); i++) { in.corrector.plan.value[i] = AMPI_NAN; }
        (void)step(&in, (part == 6u) ? &shut : table, in.time, in.state);
        expect(in.guidance.is_asked == 0u, "nothing is asked", (double)part, 0.0);
    }
    in = *from;
    ampi_corrector_aim(&in.corrector, unknown);
    expect(memcmp(in.corrector.target, from->corrector.target, sizeof unknown) == 0, "a target", 0.0, 1.0);
    (void)step(&in, table, AMPI_NAN, in.state);
    expect(in.corrector.time == from->corrector.time, "the time stands", in.corrector.time, 0.0);
    (void)step(&in, table, in.time, NULL); /* none has passed */
    expect(in.corrector.lost_since != in.corrector.lost_since, "nothing is reckoned", 0.0, 1.0);
    (void)step(&in, table, in.time + CYCLE, NULL);
    expect(in.corrector.lost_since == (in.time + CYCLE), "navigation is lost", in.corrector.lost_since, in.time);
    expect(ampi_planned(&in.corrector.plan, 0u, AMPI_N_BANKS, AMPI_NAN) != 0.0, "no speed", 0.0, 1.0);

    in.model.of.corrector.longest = 10.0;
    in.corrector.next = 0.0;
    (void)step(&in, table, in.time + CYCLE, from->state);
    outcome("no arrival", in.corrector.outcome, AMPI_NO_ARRIVAL);

    closed.is_open = 0u;
    ampi_corrector_begin(&in.corrector, &closed, table, NULL);
    expect(in.corrector.is_begun == 0u, "a model that is shut", 1.0, 0.0);
    for (i = 0u; i < 4u; i++) { in.model.of.target_axis[i] = (double)i - 1.0; } /* -1, two, and too far */
    parameters[0] = 0.5;
    parameters[1] = AMPI_NAN;
    ampi_corrector_begin(&in.corrector, &in.model, &shut, parameters);
    expect(in.corrector.target[1] == in.model.of.target[1], "parameters of no table", 0.0, 1.0);
    ampi_corrector_begin(&in.corrector, &in.model, table, parameters);
    expect(in.corrector.target[1] == 0.5, "a target that is told", in.corrector.target[1], 0.5);
    expect(in.corrector.target[2] == in.model.of.target[2], "one that is not", 0.0, 1.0);
}

void test_flights(const ampi_model *model, const ampi_table *table, const char *path)
{
    static world in, middle;
    static const flight FLIGHTS[] = {
        {"as modelled", 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 150.0, 10.0, 200.0, 0.078},
        {"denser, windy", 1.15, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0, 10.0, 200.0, 0.078},
        {"thinner, by bank", 0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 200.0, 0.0},
        {"a biased accelerometer", 1.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 200.0, 0.078},
        {"navigation lost", 1.05, 0.0, 0.0, 60.0, 80.0, 0.0, 0.0, 300.0, 10.0, 200.0, 0.078},
        {"the target moved", 1.0, 0.0, 0.0, 0.0, 0.0, 60.0, 0.004, 0.0, 10.0, 200.0, 0.078},
        {"out of reach", 1.0, 0.0, 0.0, 0.0, 0.0, 60.0, 0.5, 0.0, 10.0, 200.0, 0.078},
        {"no iteration", 1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 200.0, 0.078},
        {"no budget", 1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.078},
    };
    size_t i;
    plans = fopen(path, "wb");
    for (i = 0u; i < (sizeof FLIGHTS / sizeof FLIGHTS[0]); i++) {
        test_flight(&in, i == 0u ? &middle : NULL, model, table, &FLIGHTS[i]);
    }
    (void)fclose(plans);
    test_corrections(&middle);
    test_misuse(&middle, table);
    (void)printf("%lu corrections, targets missed by %.0f m, ", corrections, worst_miss);
}
