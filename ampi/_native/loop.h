/* A closed loop of at most AMPI_LANES flights: sensors, flight code, actuator and plant, cycle by cycle.
 *
 * What ampi/simulation/closed_loop.py does in numpy, in the same order; the flight code is that of
 * ampi/export/c. Names of rows are read from here by Python, which fills them. */
#ifndef AMPI_LOOP_H
#define AMPI_LOOP_H

#include "ampi_correction.h"
#include "plant.h"

/* Numbers of the loop. */
#define AMPI_SETTINGS(X) \
    X(cycle, 1) X(parts, 1) X(stride, 1) X(radius, 1) X(speed_tolerance, 1) X(altitude_tolerance, 1) \
    X(search, 1) X(senses, 1)

/* Numbers of each flight that stay: the first seven are its states at the entry. */
#define AMPI_FIXED(X) \
    X(entry, 7) X(bank_rate, 1) X(angle_of_attack, 1) X(flying, 1) X(target_speed, 1) X(longest, 1) \
    X(navigation_bias, 7) X(navigation_noise, 7) X(navigation_latency, 1) X(navigation_dropout, 1) \
    X(accelerometer_bias, 3) X(accelerometer_noise, 1) X(accelerometer_scale, 1) \
    X(actuator_delay, 1) X(actuator_lag, 1) X(saturated_angle, 1) X(saturated_rate, 1)

/* What comes of each flight; the uses of the limits follow. */
#define AMPI_RESULTS(X) \
    X(final_state, 7) X(final_time, 1) X(status, 1) X(last, 2) X(cycles, 1) X(saturated, 1) \
    X(activity, 1) X(rebound, 1) X(peak, 0)

/* One record: state, state of the reference, steering. */
#define AMPI_RECORD_ROWS 16
#define AMPI_NORMAL_ROWS 10 /* of noise: navigation, accelerometer */

#define AMPI_ROWS_UP_TO(prefix, name, count) prefix##name, prefix##name##_last = prefix##name + (count) - 1,
#define AMPI_SETTING_ROW(name, count) AMPI_ROWS_UP_TO(AMPI_SET_, name, count)
#define AMPI_FIXED_ROW(name, count) AMPI_ROWS_UP_TO(AMPI_FIX_, name, count)
#define AMPI_RESULT_ROW(name, count) AMPI_ROWS_UP_TO(AMPI_END_, name, count)
enum { AMPI_SETTINGS(AMPI_SETTING_ROW) AMPI_N_SETTINGS };
enum { AMPI_FIXED(AMPI_FIXED_ROW) AMPI_N_FIXED };
enum { AMPI_RESULTS(AMPI_RESULT_ROW) AMPI_N_RESULTS };

typedef enum {
    PLANT_REACHED_SPEED, PLANT_GROUND, PLANT_TIME_LIMIT, PLANT_NOT_FINITE, PLANT_STARTED_SLOW
} ampi_flight_status; /* FlightStatus of ampi/simulation/plant.py */

/* A signal of some rows as it was, a time of its own for each lane; linear between samples. */
typedef struct {
    double *samples; /* (depth, rows, lanes), a ring */
    size_t depth, rows, newest;
    ampi_lanes back; /* sample periods */
} ampi_delay;

typedef struct {
    const ampi_engine *engine;
    ampi_plant plant;
    ampi_profiles profiles;
    size_t flights, n_limits;
    double setting[AMPI_N_SETTINGS];
    ampi_lanes fixed[AMPI_N_FIXED];
    const ampi_table *table;
    ampi_guidance *guidance; /* of each flight; NULL: the steering at the entry is held */
    const ampi_model *model;
    ampi_corrector *corrector; /* of each flight; NULL: plans are not corrected */
    size_t cycle;            /* number of the next */
    uint64_t flying[AMPI_LANES]; /* all bits or none */
    ampi_lanes x[PLANT_STATES], flown[PLANT_STEERING], before[PLANT_STEERING], command[PLANT_STEERING];
    ampi_lanes felt[3], tracked[PLANT_STATES];
    ampi_delay navigation, actuator;
    ampi_lanes altitude_before, has_descended;
    ampi_lanes result[AMPI_N_RESULTS];
    ampi_lanes *peak; /* (limits, lanes) */
} ampi_loop;

/* After all fields that are given are set: the flights are at their entries. */
void ampi_loop_begin(ampi_loop *loop);

/* Flies `cycles` cycles at the most, until no flight flies. `normal` (flights, cycles, 10) and `uniform`
 * (flights, cycles) are the noise, NULL if there is none; `record` has room for every cycle that is
 * recorded, (records, 16, flights). Returns how many cycles were flown. */
size_t ampi_loop_fly(ampi_loop *loop, size_t cycles, const double *normal, const double *uniform,
                     double *record);

int ampi_loop_flies(const ampi_loop *loop);

/* How the flight of a lane ends within a step of `h` from `old` to `new` steering. */
void ampi_flight_ends(ampi_loop *loop, size_t lane, const ampi_lanes *old, const ampi_lanes *new,
                      double now, double h);

/* What is told to the flight code: (8) and (3). `normal` (10) and `uniform` may be NULL. */
void ampi_navigation(const ampi_loop *loop, size_t lane, const double *normal, const double *uniform,
                     double told[AMPI_N_NAVIGATED]);
void ampi_accelerometer(const ampi_loop *loop, size_t lane, const double *normal, double told[3]);

/* What is flown at the end of a part of the cycle, given as shares of it, into `flown`. */
void ampi_actuator_advance(ampi_loop *loop, double begin, double end);

void ampi_delay_begin(ampi_delay *delay, const ampi_lanes *value);
void ampi_delay_push(ampi_delay *delay, const ampi_lanes *value);
/* The delayed rows of a lane when `fraction` of the newest sample's period has passed. */
void ampi_delay_values(const ampi_delay *delay, size_t lane, double fraction, double *values);

#endif
