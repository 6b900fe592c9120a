/* What the parts of the flight code share; no part of the interface. */
#ifndef AMPI_PARTS_H
#define AMPI_PARTS_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "ampi.h"

#define AMPI_NAN ((double)NAN)
#define AMPI_PI 3.141592653589793
#define AMPI_TURN 6.283185307179586
#define AMPI_SANE 1e12       /* no input in SI units is larger; false for NaN */
#define AMPI_SHORTEST 1e-3   /* s; times that are nearer are the same */
#define AMPI_CHUNK 64u       /* high-density points that are converted at once */
#define AMPI_OPEN 0x41504D49u

enum { AMPI_FLOAT64 = 0, AMPI_FLOAT32, AMPI_INT16 };
enum { AMPI_NEAREST = 1, AMPI_LINEAR, AMPI_QUADRATIC, AMPI_CUBIC, AMPI_SECOND_DIFFERENCES };
enum { AMPI_LINEAR_QUADRATIC = 0, AMPI_DRAG_SLIDING_MODE, AMPI_DRAG_SHUTTLE };

/* Rows of a table, as ampi/onboard/row_layout.py orders them; gains, or loads. */
enum {
    ALTITUDE = 0, LONGITUDE, LATITUDE, SPEED, PATH_ANGLE, AZIMUTH, BANK, BANK_RATE, FIRST_GAIN,
    LOG_DRAG = FIRST_GAIN, LIFT_TO_DRAG, SCALE_HEIGHT, DRAG_SLOPE, RANGE_TO_GO, N_DRAG_ROWS,
    FIRST_ANGLE_GAIN = FIRST_GAIN + 7, N_LINEAR_ROWS = FIRST_ANGLE_GAIN,
    N_STEERED_ROWS = FIRST_ANGLE_GAIN + 7 /* where the law changes the angle of attack, too */
};

/* One of two by its place: as many instructions for the one as for the other, as no branch takes. */
static inline double chosen(bool is_first, double first, double second)
{
    const double of[2] = {second, first};
    return of[is_first ? 1u : 0u];
}

/* As numpy's minimum and maximum: NaN if one of the two is. C's fmin and fmax swallow it. */
static inline double least(double a, double b) { return chosen((a < b) | (a != a), a, b); }
static inline double most(double a, double b) { return chosen((a > b) | (a != a), a, b); }
static inline double clipped(double x, double low, double high) { return least(most(x, low), high); }

/* As rint up to 2^51, whatever the compiler makes of that: as many instructions for NaN as for 1. */
static inline double nearest(double x) { return (x + 6755399441055744.0) - 6755399441055744.0; }

/* Number i at a place of the blob; by copy, for it is not aligned. */
static inline double number(const ampi_table *table, size_t place, size_t i)
{
    double value;
    (void)memcpy(&value, &table->blob[place + sizeof value * i], sizeof value);
    return value;
}

/* `angle` less the whole turns, three at most, that bring it nearest to `reference`. */
static inline double on_turn_of(double angle, double reference)
{
    return angle - AMPI_TURN * clipped(nearest((angle - reference) / AMPI_TURN), -3.0, 3.0);
}

/* Time (s) of a high-density point. */
static inline double time_of(const ampi_table *table, double final_time, size_t point)
{
    return number(table, table->times, point)
           + number(table, table->times, table->n.points + point) * final_time;
}

/* Whether the table flies such states [8]. */
bool ampi_is_plausible(const ampi_table *table, const double *state);

/* A bank angle (rad) that is told, on its turn; one that is none: that of the last command. */
double ampi_bank_angle(const ampi_guidance *guidance, const ampi_table *table, double told);

/* CRC-32 of bytes [begin, end), zlib's. */
uint32_t ampi_crc_32(const unsigned char *bytes, size_t begin, size_t end);

/* The rows of a reference at one instant (s). */
void ampi_row_at(const ampi_table *table, const ampi_reference *reference, double time, double *row);

/* The first `count` rows at high-density points of segment s, from its point `first` on, as many as
   are left of it or fit: [count][stride]. Returns how many. */
size_t ampi_chunk(const ampi_table *table, const ampi_reference *reference, size_t s, size_t first,
                  size_t count, double *points, size_t stride);

/* What a drag law looks up by, increasing: [points]. */
void ampi_along(const ampi_table *table, const ampi_reference *reference, double *along);

/* The instant (s) at which the reference is looked up, and whether it has ended or is unknown. */
double ampi_instant(const ampi_guidance *guidance, const ampi_table *table, const double *state,
                    const double *sensed, bool *is_ended, bool *is_lost);

/* Bank rate (rad/s) that the law asks for, and the change of the angle of attack (rad). */
double ampi_law_command(ampi_guidance *guidance, const ampi_table *table, const double *state,
                        const double *sensed, double *angle);

#endif
