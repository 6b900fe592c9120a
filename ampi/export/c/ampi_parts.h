/* What the parts of the flight code share; no part of the interface. */
#ifndef AMPI_PARTS_H
#define AMPI_PARTS_H

#include <math.h>
#include <string.h>

#include "ampi.h"

#define AMPI_PI 3.141592653589793
#define AMPI_TURN 6.283185307179586
#define AMPI_SANE 1e12       /* no input in SI units is larger; false for NaN */
#define AMPI_MOST_TURNS 3.0  /* that an angle may be away: beyond, it is in another unit */
#define AMPI_SHORTEST 1e-3   /* s; times that are nearer are the same */
#define AMPI_OPENED 0x41504D49u

enum { AMPI_FLOAT64 = 0, AMPI_FLOAT32, AMPI_INT16 };
enum { AMPI_NEAREST = 1, AMPI_LINEAR, AMPI_QUADRATIC, AMPI_CUBIC, AMPI_SECOND_DIFFERENCES };
enum { AMPI_LINEAR_QUADRATIC = 0, AMPI_DRAG_SLIDING_MODE, AMPI_DRAG_SHUTTLE };
enum { AMPI_ANGLE = 0, AMPI_RATE, AMPI_ACCELERATION };

/* Rows of a table, as `ampi.onboard.row_layout` orders them. */
enum {
    AMPI_ALTITUDE = 0, AMPI_LONGITUDE, AMPI_LATITUDE, AMPI_SPEED, AMPI_PATH_ANGLE, AMPI_AZIMUTH,
    AMPI_BANK, AMPI_BANK_RATE, AMPI_FIRST_GAIN,
    AMPI_LOG_DRAG = AMPI_FIRST_GAIN, AMPI_LIFT_TO_DRAG, AMPI_SCALE_HEIGHT, AMPI_DRAG_SLOPE,
    AMPI_RANGE_TO_GO, AMPI_DRAG_ROWS, AMPI_LINEAR_ROWS = AMPI_FIRST_GAIN + 7
};

/* As numpy's minimum and maximum: NaN if one of the two is. C's fmin and fmax swallow it. */
static inline double ampi_min(double a, double b) { return ((a < b) || (a != a)) ? a : b; }
static inline double ampi_max(double a, double b) { return ((a > b) || (a != a)) ? a : b; }
static inline double ampi_clipped(double x, double low, double high)
{
    return ampi_min(ampi_max(x, low), high);
}

/* By copy: whatever its alignment, and whatever the aliasing rules say of typed pointers. */
static inline double ampi_number(const ampi_table *table, size_t place, size_t i)
{
    double number;
    (void)memcpy(&number, &table->blob[place + 8u * i], sizeof number);
    return number;
}

/* `angle` less the whole turns, three at most, that bring it nearest to `reference`. */
static inline double ampi_on_turn_of(double angle, double reference)
{
    const double turns = rint((angle - reference) / AMPI_TURN);
    return angle - AMPI_TURN * ampi_clipped(turns, -AMPI_MOST_TURNS, AMPI_MOST_TURNS);
}

/* The rows [n_rows] of a reference at one instant (s). */
void ampi_row_at(const ampi_table *table, const ampi_reference *reference, double time, double *row);

/* Block b of a segment's part of the LD->HD matrix: [nodes][AMPI_BLOCK], zero beyond its last point. */
void ampi_load_block(const ampi_table *table, const ampi_segment *segment, size_t b, ampi_real *block);

/* One row [AMPI_BLOCK] at the points of a block, from its values at the nodes of the segment. */
void ampi_convert(const ampi_real *block, const ampi_real *values, size_t nodes, ampi_real *points);

/* Time (s) of a high-density point. */
double ampi_time_of(const ampi_table *table, const ampi_reference *reference, size_t point);

/* What a drag law looks up by, [n_points], increasing. */
void ampi_along(const ampi_table *table, const ampi_reference *reference, double *along);

/* The instant (s) at which the reference is looked up, and whether it has ended or is unknown. */
double ampi_instant(const ampi_guidance *guidance, const ampi_table *table, const double *state,
                    const double *sensed, int *ended, int *lost);

/* Bank rate (rad/s) that the law asks for, and the change of the angle of attack (rad). */
double ampi_law_command(ampi_guidance *guidance, const ampi_table *table, const double *state,
                        const double *sensed, double *angle);

#endif
