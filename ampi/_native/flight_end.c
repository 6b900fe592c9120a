/* Where a flight ends within a step of the plant: `_end` and `falls_to` of ampi/simulation/plant.py. */
#include <math.h>
#include <string.h>

#include "loop.h"

typedef struct {
    ampi_loop *loop;
    size_t lane;
    const ampi_lanes *old, *new;
    double now, h;
} ampi_step;

static double steered(const ampi_step *step, size_t row, double passed) {
    const double old = step->old[row][step->lane], new = step->new[row][step->lane];
    return old + (new - old) * (passed / step->h);
}

/* State `passed` seconds after the begin. */
static void after(const ampi_step *step, double passed, double state[PLANT_STATES]) {
    const ampi_loop *const loop = step->loop;
    ampi_plant plant = loop->plant;
    ampi_lanes new[PLANT_STEERING], ahead[PLANT_STATES], h;
    for (size_t i = 0; i < AMPI_LANES; i++) {
        h[i] = passed;
    }
    for (size_t row = 0; row < PLANT_STEERING; row++) {
        memcpy(new[row], step->old[row], sizeof(ampi_lanes));
        new[row][step->lane] = steered(step, row, passed);
    }
    plant.span = (ampi_span){(int)step->lane, (int)step->lane + 1, 0};
    loop->engine->advance(&plant, (const ampi_lanes *)loop->x, step->old, (const ampi_lanes *)new,
                          step->now, h, NULL, NULL, ahead);
    for (size_t row = 0; row < PLANT_STATES; row++) {
        state[row] = ahead[row][step->lane];
    }
}

/* Seconds after the begin at which a state has fallen to a level; it is below it at `high`. */
static double falls_to(const ampi_step *step, size_t row, double level, double high) {
    const double *const setting = step->loop->setting;
    const double tolerance =
        setting[row == PLANT_SPEED ? AMPI_SET_speed_tolerance : AMPI_SET_altitude_tolerance];
    const double above = step->loop->x[row][step->lane] - level;
    double low = 0.0, state[PLANT_STATES];
    if (above <= 0.0) {
        return 0.0;
    }
    after(step, high, state);
    double passed = high * above / (above + level - state[row]);
    for (int k = 0; k < (int)setting[AMPI_SET_search]; k++) {
        after(step, passed, state);
        const double excess = state[row] - level;
        if (fabs(excess) < tolerance) {
            break;
        }
        if (excess > 0.0) {
            low = passed;
        } else {
            high = passed;
        }
        const double secant = passed * above / (above - excess);
        /* every third step halves the bracket: the secant alone may creep */
        passed = low < secant && secant < high && k % 3 < 2 ? secant : 0.5 * (low + high);
    }
    return passed;
}

static int is_finite(const double state[PLANT_STATES]) {
    double sum = 0.0;
    for (size_t row = 0; row < PLANT_STATES; row++) {
        sum += state[row] - state[row]; /* 0 of a finite number, not-a-number of others */
    }
    return sum == 0.0;
}

void ampi_flight_ends(ampi_loop *loop, size_t lane, const ampi_lanes *old, const ampi_lanes *new,
                      double now, double h) {
    const ampi_step step = {loop, lane, old, new, now, h};
    const double target = loop->fixed[AMPI_FIX_target_speed][lane];
    const double left = loop->fixed[AMPI_FIX_longest][lane] - now;
    double passed = left < h ? left : h, end[PLANT_STATES];
    ampi_flight_status status = PLANT_TIME_LIMIT;
    after(&step, passed, end);
    if (!is_finite(end)) {
        for (size_t row = 0; row < PLANT_STATES; row++) {
            end[row] = (double)NAN;
        }
        passed = 0.0;
        status = PLANT_NOT_FINITE;
    } else {
        if (end[PLANT_SPEED] <= target) {
            passed = falls_to(&step, PLANT_SPEED, target, passed);
            after(&step, passed, end);
            status = PLANT_REACHED_SPEED;
        }
        if (end[PLANT_ALTITUDE] < 0.0) { /* before the speed was reached */
            passed = falls_to(&step, PLANT_ALTITUDE, 0.0, passed);
            after(&step, passed, end);
            status = PLANT_GROUND;
        }
    }
    for (size_t row = 0; row < PLANT_STATES; row++) {
        loop->result[AMPI_END_final_state + row][lane] = end[row];
    }
    for (size_t row = 0; row < PLANT_STEERING; row++) {
        loop->result[AMPI_END_last + row][lane] = steered(&step, row, passed);
    }
    loop->result[AMPI_END_final_time][lane] = now + passed;
    loop->result[AMPI_END_status][lane] = (double)status;
    loop->flying[lane] = 0u;
}
