/* The plant: AMPI_LANES vehicles in the air as it is, by the traced equations of motion.
 *
 * What ampi/simulation/plant.py does for n flights in numpy. All lanes are always computed, so that the
 * bits of a flight do not depend on its company; a lane without a flight repeats the first one. */
#ifndef AMPI_PLANT_H
#define AMPI_PLANT_H

#include <stddef.h>

#include "instructions.h"

enum { PLANT_ALTITUDE, PLANT_LONGITUDE, PLANT_LATITUDE, PLANT_SPEED, PLANT_BANK = 6, PLANT_STATES };
enum { PLANT_RATE, PLANT_ANGLE, PLANT_STEERING }; /* rows of what steers */
/* places of the inputs that change: the states first */
enum {
    PLANT_IN_RATE = PLANT_STATES,
    PLANT_IN_ANGLE,
    PLANT_IN_ANGLE_RATE, /* of use to limits alone */
    PLANT_IN_TIME,
    PLANT_IN_DENSITY, /* factor of the profile; then the wind to east and north */
    PLANT_IN_EAST,
    PLANT_IN_NORTH,
    PLANT_INPUTS
};

typedef double ampi_lanes[AMPI_LANES];

typedef struct {
    const ampi_instruction *code;
    size_t count;
    const uint16_t *outputs; /* their places */
    size_t n_outputs;
} ampi_list;

typedef struct {
    ampi_list begin, rates, rates_and_use, sensed; /* rates: 7; uses after them */
    const double *scalars;
    size_t n_scalars, n_places;
    const uint16_t *numbers; /* places of the numbers of a flight */
    size_t n_numbers;
} ampi_program;

/* Functions of altitude, each linear between points `step` apart from 0. */
typedef struct {
    const double *values[AMPI_LANES]; /* of each lane (points, functions) */
    double step;
    size_t points, functions;
    uint16_t inputs[3]; /* which inputs the functions are */
} ampi_profiles;

/* The lanes that are wanted. All are computed where that costs nothing; others are not to be read. */
typedef struct {
    int begin, end, is_whole; /* whole: every lane with a flight; those without repeat the first */
} ampi_span;

typedef struct {
    const ampi_program *program;
    const ampi_profiles *profiles;
    double *places;
    ampi_span span; /* those that have a flight, or one of them */
} ampi_plant;

/* Compiled once for each instruction set; all give the same bits. */
typedef struct {
    const char *name;
    void (*forget)(const ampi_list *list, double *places); /* before the first run */
    void (*run)(const ampi_list *list, double *places, const double *scalars, ampi_span span);
    /* Specific force (3 rows) at the states. */
    void (*sensed)(const ampi_plant *plant, const ampi_lanes *x, const double *angle, double time,
                   ampi_lanes *felt);
    /* States `h` later, of every lane its own; `peak`, where given, grows by the uses at the begin of
     * the lanes that fly. `ahead` may not be `x`. */
    void (*advance)(const ampi_plant *plant, const ampi_lanes *x, const ampi_lanes *old,
                    const ampi_lanes *new, double time, const double *h, const uint64_t *flying,
                    ampi_lanes *peak, ampi_lanes *ahead);
    /* Delayed and lagged steering over a step of `h`: from `old` towards `then`, `asked` at its begin. */
    void (*lag)(const ampi_lanes *asked, const ampi_lanes *then, const double *lag, double h,
                ampi_lanes *flown);
} ampi_engine;

extern const ampi_engine ampi_engine_baseline;
#if defined(__x86_64__) && defined(__GNUC__)
#define AMPI_HAS_V3 1
extern const ampi_engine ampi_engine_v3;
#endif

/* The best that this processor has. */
const ampi_engine *ampi_engine_here(void);

#endif
