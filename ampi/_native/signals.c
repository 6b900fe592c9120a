/* Sensors, actuator and their delays: ampi/simulation/{sensors,actuator,delay}.py for each lane. */
#include <math.h>
#include <string.h>

#include "loop.h"

static double *sample(const ampi_delay *delay, size_t age) {
    const size_t at = delay->newest + age; /* less than two rounds */
    return delay->samples + (at < delay->depth ? at : at - delay->depth) * delay->rows * AMPI_LANES;
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

void ampi_delay_values(const ampi_delay *delay, size_t lane, double fraction, double *values) {
    const double back = delay->back[lane], whole = floor(back);
    const double place = whole + (back - whole) + (1.0 - fraction);
    const size_t oldest = delay->depth - 2u;
    const size_t begin = place < (double)oldest ? (size_t)place : oldest;
    const double w = place - (double)begin;
    const double *const newer = sample(delay, begin), *const older = sample(delay, begin + 1u);
    for (size_t row = 0; row < delay->rows; row++) {
        const size_t at = row * AMPI_LANES + lane;
        values[row] = newer[at] * (1.0 - w) + older[at] * w;
    }
}

void ampi_navigation(const ampi_loop *loop, size_t lane, const double *normal, const double *uniform,
                     double told[AMPI_N_NAVIGATED]) {
    const ampi_lanes *const fixed = loop->fixed;
    double error[PLANT_STATES];
    if (fixed[AMPI_FIX_navigation_latency][lane] > 0.0) {
        ampi_delay_values(&loop->navigation, lane, 1.0, told);
    } else {
        for (size_t row = 0; row < PLANT_STATES; row++) {
            told[row] = loop->x[row][lane];
        }
    }
    for (size_t row = 0; row < PLANT_STATES; row++) {
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
            told[row] = (double)NAN;
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
    for (size_t row = 0; row < PLANT_STEERING; row++) {
        const double *const command = loop->command[row], *const before = loop->before[row];
        for (size_t i = 0; i < AMPI_LANES; i++) {
            const double between = command[i] * (1.0 - older) + before[i] * older;
            asked[row][i] = share == 0.0 ? before[i] : share == 1.0 ? command[i] : between;
        }
    }
    for (size_t i = 0; i < AMPI_LANES; i++) {
        if (loop->fixed[AMPI_FIX_actuator_delay][i] > 0.0) {
            double values[PLANT_STEERING];
            ampi_delay_values(&loop->actuator, i, share, values);
            asked[PLANT_RATE][i] = values[PLANT_RATE];
            asked[PLANT_ANGLE][i] = values[PLANT_ANGLE];
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
