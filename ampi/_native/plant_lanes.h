/* The plant over all lanes; included once for each instruction set, with ENGINE and ENGINE_NAME. */
#include "interpreter.h"

static double *input(const ampi_plant *plant, size_t k) {
    return plant->places + (size_t)AMPI_LANES * k;
}

/* As `Profiles` in ampi/simulation/true_model.py: held at both ends, not-a-number goes through. */
static void look_up(const ampi_plant *plant) {
    const ampi_profiles *const profiles = plant->profiles;
    const size_t functions = profiles->functions;
    if (functions == 0u) {
        return;
    }
    const double *const altitude = input(plant, PLANT_ALTITUDE);
    const double per_metre = 1.0 / profiles->step, last = (double)profiles->points - 1.0;
    double share[AMPI_LANES];
    int32_t below[AMPI_LANES];
    EACH_LANE {
        const double place = altitude[i] * per_metre;
        const double above = place < 0.0 ? 0.0 : place;
        const double held = above > last ? last : above;
        const double known = held >= 0.0 ? held : 0.0;
        const double most = known > last - 1.0 ? last - 1.0 : known;
        below[i] = (int32_t)most;
        share[i] = held - (double)below[i];
    }
    for (size_t f = 0; f < functions; f++) {
        double *const found = input(plant, profiles->inputs[f]);
        for (int i = plant->span.begin; i < plant->span.end; i++) {
            const double *const lower = profiles->values[i] + (size_t)below[i] * functions + f;
            found[i] = lower[0] + share[i] * (lower[functions] - lower[0]);
        }
        repeat_first(found, plant->span);
    }
}

/* Inputs of a moment: the states are there already. */
static void set_moment(const ampi_plant *plant, const double *rate, const double *angle,
                       const double *time) {
    memcpy(input(plant, PLANT_IN_RATE), rate, sizeof(ampi_lanes));
    memcpy(input(plant, PLANT_IN_ANGLE), angle, sizeof(ampi_lanes));
    memcpy(input(plant, PLANT_IN_TIME), time, sizeof(ampi_lanes));
    look_up(plant);
}

static void run_on(const ampi_plant *plant, const ampi_list *list) {
    run(list, plant->places, plant->program->scalars, plant->span);
}

static const double *output(const ampi_plant *plant, const ampi_list *list, size_t k) {
    return plant->places + (size_t)AMPI_LANES * list->outputs[k];
}

static void sensed(const ampi_plant *plant, const ampi_lanes *x, const double *angle, double time,
                   ampi_lanes *felt) {
    const ampi_list *const list = &plant->program->sensed;
    double now[AMPI_LANES];
    EACH_LANE { now[i] = time; }
    memcpy(plant->places, x, PLANT_STATES * sizeof(ampi_lanes));
    set_moment(plant, now, angle, now); /* no specific force depends on the bank rate */
    run_on(plant, list);
    for (size_t k = 0; k < 3u; k++) {
        memcpy(felt[k], output(plant, list, k), sizeof(ampi_lanes));
    }
}

static void grow(const ampi_plant *plant, const uint64_t *flying, ampi_lanes *peak) {
    const ampi_list *const list = &plant->program->rates_and_use;
    for (size_t k = PLANT_STATES; k < list->n_outputs; k++) {
        const double *const use = output(plant, list, k);
        double *const most = peak[k - PLANT_STATES];
        EACH_LANE {
            const double one = most[i], other = use[i];
            const double greater = one > other || one != one ? one : other;
            most[i] = chosen(flying[i], greater, one);
        }
    }
}

/* One stage of the classical method: `total` += weight k, states of the next at x + share k. */
static void take_stage(const ampi_plant *plant, const ampi_list *list, const ampi_lanes *x,
                       const double *share, double weight, ampi_lanes *total) {
    for (size_t row = 0; row < PLANT_STATES; row++) {
        const double *const k = output(plant, list, row), *const from = x[row];
        double *const sum = total[row], *const next = input(plant, row);
        if (weight == 0.0) { /* the first */
            EACH_LANE {
                const double slope = k[i];
                sum[i] = slope;
                next[i] = from[i] + share[i] * slope;
            }
        } else {
            EACH_LANE {
                const double slope = k[i];
                sum[i] = sum[i] + weight * slope;
                next[i] = from[i] + share[i] * slope;
            }
        }
    }
}

static void advance(const ampi_plant *plant, const ampi_lanes *x, const ampi_lanes *old,
                    const ampi_lanes *new, double time, const double *h, const uint64_t *flying,
                    ampi_lanes *peak, ampi_lanes *ahead) {
    const ampi_program *const program = plant->program;
    const ampi_list *const first = peak != NULL ? &program->rates_and_use : &program->rates;
    ampi_lanes middle[PLANT_STEERING], total[PLANT_STATES];
    double now[AMPI_LANES], half[AMPI_LANES], halfway[AMPI_LANES], end[AMPI_LANES];
    double *const angle_rate = input(plant, PLANT_IN_ANGLE_RATE);
    EACH_LANE {
        now[i] = time;
        half[i] = 0.5 * h[i];
        halfway[i] = time + half[i];
        end[i] = time + h[i];
        middle[PLANT_RATE][i] = 0.5 * (old[PLANT_RATE][i] + new[PLANT_RATE][i]);
        middle[PLANT_ANGLE][i] = 0.5 * (old[PLANT_ANGLE][i] + new[PLANT_ANGLE][i]);
        angle_rate[i] = (new[PLANT_ANGLE][i] - old[PLANT_ANGLE][i]) / h[i];
    }
    memcpy(plant->places, x, PLANT_STATES * sizeof(ampi_lanes));
    set_moment(plant, old[PLANT_RATE], old[PLANT_ANGLE], now);
    run_on(plant, first);
    if (peak != NULL) {
        grow(plant, flying, peak);
    }
    take_stage(plant, first, x, half, 0.0, total);
    set_moment(plant, middle[PLANT_RATE], middle[PLANT_ANGLE], halfway);
    run_on(plant, &program->rates);
    take_stage(plant, &program->rates, x, half, 2.0, total);
    set_moment(plant, middle[PLANT_RATE], middle[PLANT_ANGLE], halfway);
    run_on(plant, &program->rates);
    take_stage(plant, &program->rates, x, h, 2.0, total);
    set_moment(plant, new[PLANT_RATE], new[PLANT_ANGLE], end);
    run_on(plant, &program->rates);
    for (size_t row = 0; row < PLANT_STATES; row++) {
        const double *const k = output(plant, &program->rates, row), *const from = x[row];
        const double *const sum = total[row];
        double *const then = ahead[row];
        EACH_LANE { then[i] = from[i] + h[i] / 6.0 * (sum[i] + k[i]); }
    }
}

/* Eq. (1) of ampi/simulation/actuator.py, where there is a lag. */
static void lagged(const ampi_lanes *asked, const ampi_lanes *then, const double *lag, double h,
                   ampi_lanes *flown) {
    double decay[AMPI_LANES];
    EACH_LANE { decay[i] = exp(-h / (lag[i] > 0.0 ? lag[i] : 1.0)); }
    for (size_t row = 0; row < PLANT_STEERING; row++) {
        const double *const from = asked[row], *const to = then[row];
        double *const own = flown[row];
        EACH_LANE {
            const double slope = (to[i] - from[i]) / h;
            const double answer =
                from[i] + slope * (h - lag[i]) + (own[i] - from[i] + slope * lag[i]) * decay[i];
            own[i] = lag[i] > 0.0 ? answer : to[i];
        }
    }
}

const ampi_engine ENGINE = {ENGINE_NAME, forget, run, sensed, advance, lagged};
