/* The closed loop, cycle by cycle: `_Loop`, `_Tally` and `InFlight` of ampi/simulation. */
#include "loop.h"

#include <math.h>
#include <string.h>

#define EACH_LANE for (size_t i = 0; i < AMPI_LANES; i++)

void ampi_loop_begin(ampi_loop *loop) {
    const ampi_program *const program = loop->plant.program;
    const ampi_list *const lists[] = {&program->rates, &program->rates_and_use, &program->sensed};
    const ampi_lanes *const fixed = (const ampi_lanes *)loop->fixed;
    loop->cycle = 0;
    for (size_t k = 0; k < sizeof lists / sizeof lists[0]; k++) {
        loop->engine->forget(lists[k], loop->plant.places);
    }
    loop->engine->run(&program->begin, loop->plant.places, program->scalars, loop->plant.span);
    memcpy(loop->x, fixed[AMPI_FIX_entry], sizeof loop->x);
    memcpy(loop->flown[PLANT_RATE], fixed[AMPI_FIX_bank_rate], sizeof(ampi_lanes));
    memcpy(loop->flown[PLANT_ANGLE], fixed[AMPI_FIX_angle_of_attack], sizeof(ampi_lanes));
    memcpy(loop->before, loop->flown, sizeof loop->before);
    memcpy(loop->command, loop->flown, sizeof loop->command);
    memset(loop->has_descended, 0, sizeof(ampi_lanes));
    memset(loop->result, 0, sizeof loop->result);
    memset(loop->peak, 0, loop->n_limits * sizeof(ampi_lanes));
    EACH_LANE {
        loop->flying[i] = i < loop->flights && fixed[AMPI_FIX_flying][i] != 0.0 ? ~(uint64_t)0 : 0u;
        loop->altitude_before[i] = -(double)INFINITY;
        loop->result[AMPI_END_rebound][i] = (double)NAN;
    }
    memcpy(loop->navigation.back, fixed[AMPI_FIX_navigation_latency], sizeof(ampi_lanes));
    memcpy(loop->actuator.back, fixed[AMPI_FIX_actuator_delay], sizeof(ampi_lanes));
    ampi_delay_begin(&loop->navigation, (const ampi_lanes *)loop->x);
    ampi_delay_begin(&loop->actuator, (const ampi_lanes *)loop->flown);
}

int ampi_loop_flies(const ampi_loop *loop) {
    uint64_t any = 0;
    EACH_LANE { any |= loop->flying[i]; }
    return any != 0u;
}

/* Asks the flight code of every flight for what is to be reached at the end of the cycle. */
static void command(ampi_loop *loop, double time, const double *normal, const double *uniform,
                    size_t stride) {
    const int senses = loop->setting[AMPI_SET_senses] != 0.0;
    if (loop->guidance == NULL) { /* what is flown is held */
        return;
    }
    ampi_delay_push(&loop->navigation, (const ampi_lanes *)loop->x);
    if (senses) {
        loop->engine->sensed(&loop->plant, (const ampi_lanes *)loop->x, loop->flown[PLANT_ANGLE], time,
                             loop->felt);
    }
    memcpy(loop->before, loop->command, sizeof loop->before);
    for (size_t i = 0; i < loop->flights; i++) {
        double told[AMPI_N_NAVIGATED], felt[3];
        const double *const noise = normal == NULL ? NULL : normal + i * stride * AMPI_NORMAL_ROWS;
        if (loop->flying[i] == 0u) {
            continue;
        }
        ampi_navigation(loop, i, noise, uniform == NULL ? NULL : uniform + i * stride, told);
        if (senses) {
            ampi_accelerometer(loop, i, noise, felt);
        }
        const double *const sensed = senses ? felt : NULL;
        const ampi_command wanted =
            loop->corrector == NULL
                ? ampi_guidance_step(&loop->guidance[i], loop->table, time, told, sensed)
                : ampi_corrected_step(&loop->corrector[i], loop->model, &loop->guidance[i], loop->table,
                                      time, told, sensed);
        loop->command[PLANT_RATE][i] = wanted.bank_rate;
        loop->command[PLANT_ANGLE][i] = wanted.angle_of_attack;
    }
    for (size_t i = loop->flights; i < AMPI_LANES; i++) { /* a lane without a flight repeats the first */
        loop->command[PLANT_RATE][i] = loop->command[PLANT_RATE][0];
        loop->command[PLANT_ANGLE][i] = loop->command[PLANT_ANGLE][0];
    }
    ampi_delay_push(&loop->actuator, (const ampi_lanes *)loop->command);
}

static void note(const ampi_loop *loop, double *record) {
    const size_t n = loop->flights;
    for (size_t i = 0; i < n; i++) {
        const int flies = loop->flying[i] != 0u;
        for (size_t row = 0; row < PLANT_STATES; row++) {
            record[row * n + i] = flies ? loop->x[row][i] : (double)NAN;
            record[(row + PLANT_STATES) * n + i] =
                flies && loop->guidance != NULL ? loop->guidance[i].row[row] : (double)NAN;
        }
        for (size_t row = 0; row < PLANT_STEERING; row++) {
            record[(row + 2u * PLANT_STATES) * n + i] = flies ? loop->flown[row][i] : (double)NAN;
        }
    }
}

static void count(ampi_loop *loop) {
    const ampi_lanes *const fixed = (const ampi_lanes *)loop->fixed;
    ampi_lanes *const result = loop->result;
    EACH_LANE {
        const double size = fabs(loop->flown[PLANT_RATE][i]), altitude = loop->x[PLANT_ALTITUDE][i];
        const int at_limit = fabs(loop->x[PLANT_BANK][i]) >= fixed[AMPI_FIX_saturated_angle][i] ||
                             size >= fixed[AMPI_FIX_saturated_rate][i];
        if (loop->flying[i] != 0u) {
            result[AMPI_END_cycles][i] += 1.0;
            result[AMPI_END_saturated][i] += at_limit ? 1.0 : 0.0;
            result[AMPI_END_activity][i] += size * loop->setting[AMPI_SET_cycle];
            if (loop->has_descended[i] != 0.0 && altitude > loop->altitude_before[i] &&
                !(altitude <= result[AMPI_END_rebound][i])) {
                result[AMPI_END_rebound][i] = altitude;
            }
        }
        if (altitude < loop->altitude_before[i]) {
            loop->has_descended[i] = 1.0;
        }
        loop->altitude_before[i] = altitude;
    }
}

/* One plant step from `old` to what is flown now; some flights end in it. */
static void advance(ampi_loop *loop, const ampi_lanes *old, double now, double h) {
    const ampi_lanes *const flown = (const ampi_lanes *)loop->flown;
    ampi_lanes ahead[PLANT_STATES], length;
    EACH_LANE { length[i] = h; }
    loop->engine->advance(&loop->plant, (const ampi_lanes *)loop->x, old, flown, now, length,
                          loop->flying, loop->peak, ahead);
    for (size_t i = 0; i < loop->flights; i++) {
        const int goes_on = ahead[PLANT_SPEED][i] > loop->fixed[AMPI_FIX_target_speed][i] &&
                            ahead[PLANT_ALTITUDE][i] >= 0.0 &&
                            now + h < loop->fixed[AMPI_FIX_longest][i];
        if (loop->flying[i] != 0u && !goes_on) {
            ampi_flight_ends(loop, i, old, flown, now, h);
        }
    }
    for (size_t row = 0; row < PLANT_STATES; row++) {
        EACH_LANE {
            const size_t own = i < loop->flights ? i : 0u;
            loop->x[row][i] = loop->flying[own] != 0u ? ahead[row][i] : loop->x[row][i];
        }
    }
}

size_t ampi_loop_fly(ampi_loop *loop, size_t cycles, const double *normal, const double *uniform,
                     double *record) {
    const size_t parts = (size_t)loop->setting[AMPI_SET_parts];
    const size_t stride = (size_t)loop->setting[AMPI_SET_stride];
    const double period = loop->setting[AMPI_SET_cycle], h = period / (double)parts;
    size_t done = 0;
    for (; done < cycles && (loop->cycle == 0u || ampi_loop_flies(loop)); done++, loop->cycle++) {
        const double time = (double)loop->cycle * period;
        command(loop, time, normal == NULL ? NULL : normal + done * AMPI_NORMAL_ROWS,
                uniform == NULL ? NULL : uniform + done, cycles);
        if (loop->cycle % stride == 0u) {
            note(loop, record);
            record += AMPI_RECORD_ROWS * loop->flights;
        }
        count(loop);
        for (size_t part = 0; part < parts; part++) {
            ampi_lanes old[PLANT_STEERING];
            memcpy(old, loop->flown, sizeof old);
            ampi_actuator_advance(loop, (double)part / (double)parts,
                                  (double)(part + 1u) / (double)parts);
            advance(loop, (const ampi_lanes *)old, time + (double)part * h, h);
        }
    }
    loop->cycle += cycles - done; /* all loops of a batch count alike, those that have ended too */
    return done;
}
