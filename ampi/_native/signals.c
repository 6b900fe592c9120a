/* Sensors, actuator and their delays: ampi/simulation/{sensors,actuator,delay}.py for each lane. */
#include <math.h>
#include <string.h>

#include "loop.h"

static double *sample(const ampi_delay *delay, size_t age) {
    const size_t at = (delay->newest + age) % delay->depth;
    return delay->samples + at * delay->rows * AMPI_LANES;
}

void ampi_delay_begin(ampi_delay *delay, const ampi_lanes *value) {
    for (size_t age = 0; age < delay->depth; age++) {
        memcpy(sample(delay, age), value, delay->rows * sizeof(ampi_lanes));
    }
}

void ampi_delay_push(ampi_delay *delay, const ampi_lanes *value) {
    delay->newest = (delay->newest + delay->depth - 1u) % delay->depth;
    memcpy(sample(delay, 0), value, delay->rows * sizeof(ampi_lanes));
}

double ampi_delay_value(const ampi_delay *delay, size_t row, size_t lane, double fraction) {
    const double back = delay->back[lane], whole = floor(back);
    const double place = whole + (back - whole) + (1.0 - fraction);
    const size_t oldest = delay->depth - 2u;
    const size_t begin = place < (double)oldest ? (size_t)place : oldest;
    const double w = place - (double)begin;
    const size_t at = row * AMPI_LANES + lane;
    return sample(delay, begin)[at] * (1.0 - w) + sample(delay, begin + 1u)[at] * w;
}

void ampi_navigation(const ampi_loop *loop, size_t lane, const double *normal, const double *uniform,
                     double told[AMPI_N_NAVIGATED]) {
    const ampi_lanes *const fixed = loop->fixed;
    const int is_late = fixed[AMPI_FIX_navigation_latency][lane] > 0.0;
    double error[PLANT_STATES];
    for (size_t row = 0; row < PLANT_STATES; row++) {
        told[row] = is_late ? ampi_delay_value(&loop->navigation, row, lane, 1.0) : loop->x[row][lane];
        error[row] = fixed[AMPI_FIX_navigation_bias + row][lane];
        if (normal != NULL) {
            error[row] += fixed[AMPI_FIX_navigation_noise + row][lane] * normal[row];
        }
    }
    told[PLANT_STATES] = loop->flown[PLANT_RATE][lane];
    error[PLANT_LONGITUDE] /= loop->setting[AMPI_SET_radius] * cos(told[PLANT_LATITUDE]);
    error[PLANT_LATITUDE] /= loop->setting[AMPI_SET_radius];
    for (size_t row = 0; row < PLANT_STATES; row++) {
        told[row] += error[row];
    }
    if (uniform != NULL && *uniform < fixed[AMPI_FIX_navigation_dropout][lane]) {
        for (size_t row = 0; row < AMPI_N_NAVIGATED; row++) {
            told[row] = NAN;
        }
    }
}

void ampi_accelerometer(const ampi_loop *loop, size_t lane, const double *normal, double told[3]) {
    const ampi_lanes *const fixed = loop->fixed;
    const double scale = 1.0 + fixed[AMPI_FIX_accelerometer_scale][lane];
    const double noise = fixed[AMPI_FIX_accelerometer_noise][lane];
    for (size_t row = 0; row < 3u; row++) {
        const double noisy = normal == NULL ? 0.0 : noise * normal[PLANT_STATES + row];
        told[row] =
            loop->felt[row][lane] * scale + fixed[AMPI_FIX_accelerometer_bias + row][lane] + noisy;
    }
}

/* What acts on the lag at a share of the cycle: the command, reached linearly, as it was. */
static void ask(const ampi_loop *loop, double share, ampi_lanes asked[PLANT_STEERING]) {
    const double older = 1.0 - share; /* the sum that a delay forms */
    const double *const delay = loop->fixed[AMPI_FIX_actuator_delay];
    for (size_t row = 0; row < PLANT_STEERING; row++) {
        for (size_t lane = 0; lane < AMPI_LANES; lane++) {
            const double command = loop->command[row][lane], before = loop->before[row][lane];
            asked[row][lane] = delay[lane] > 0.0
                                   ? ampi_delay_value(&loop->actuator, row, lane, share)
                               : share == 0.0 ? before
                               : share == 1.0 ? command
                                              : command * (1.0 - older) + before * older;
        }
    }
}

void ampi_actuator_advance(ampi_loop *loop, double begin, double end) {
    ampi_lanes asked[PLANT_STEERING], then[PLANT_STEERING];
    ask(loop, begin, asked);
    ask(loop, end, then);
    loop->engine->lag((const ampi_lanes *)asked, (const ampi_lanes *)then,
                      loop->fixed[AMPI_FIX_actuator_lag],
                      (end - begin) * loop->setting[AMPI_SET_cycle], loop->flown);
}
