/* Entry guidance from a table of optimal trajectories: the flight code. C99; SI units and radians.

       ampi_table_open(&table, blob, size)                  once; anything but AMPI_OK: do not fly
       ampi_guidance_begin(&guidance, &table, parameters)   at the entry interface
       command = ampi_guidance_step(&guidance, &table, time, navigation, sensed)     at every cycle

   No allocation, no recursion, every loop bounded by a size of the table, no state but the caller's.
   After `ampi_table_open` nothing fails: what is unusual is told by the health of a command. Compile
   with -ffp-contract=off and without -ffast-math: commands then have the bits of the Python. */
#ifndef AMPI_H
#define AMPI_H

#include <stddef.h>
#include <stdint.h>

#include "ampi_config.h"

#ifdef AMPI_SINGLE /* arithmetic of the reference; that of a step is always double */
typedef float ampi_real;
#else
typedef double ampi_real;
#endif

#define AMPI_N_STATES 7u    /* h, theta, phi, V, gamma, psi, sigma */
#define AMPI_N_NAVIGATED 8u /* and the bank rate */
#define AMPI_N_GAINS 16u
#define AMPI_N_MEMORY 3u

typedef enum {
    AMPI_OK = 0,
    AMPI_TRUNCATED,   /* shorter or longer than it says */
    AMPI_FOREIGN,     /* no guidance table */
    AMPI_BYTE_ORDER,  /* of a machine of the other byte order */
    AMPI_VERSION,     /* of a format that this code does not know */
    AMPI_CHECKSUM,    /* damaged: its CRC-32 is another one */
    AMPI_TOO_LARGE,   /* beyond the limits of ampi_config.h */
    AMPI_INCONSISTENT /* a size, an order or a number that no writer of ours makes */
} ampi_status;

/* Of several that apply the greatest is told. */
typedef enum {
    AMPI_GOOD = 0,
    AMPI_BOUNDARY_REFERENCE,     /* parameters outside the hypercube: reference of its boundary */
    AMPI_HOLE_REFERENCE,         /* a case without solution: its neighbour stands for it */
    AMPI_FAR_OUTSIDE,            /* by more than 20 % of an axis' range, in another unit perhaps */
    AMPI_BAD_PARAMETERS,         /* no finite number: what is none is nominal */
    AMPI_IMPLAUSIBLE_NAVIGATION, /* far outside of all that the table flies */
    AMPI_BAD_NAVIGATION,         /* no number */
    AMPI_BAD_TIME,               /* no number, or it does not go on: counted on by the last cycle */
    AMPI_AFTER_FINAL_TIME,       /* the reference has ended: the bank angle is held */
    AMPI_NOT_BEGUN               /* no open table, or a flight not begun with it: held */
} ampi_health;

typedef enum { AMPI_TRACKED = 0, AMPI_REFERENCE, AMPI_HELD, AMPI_PLANNED } ampi_steering;

typedef struct {
    double bank_rate;       /* rad/s, to be reached at the end of the cycle */
    double bank_angle;      /* rad, there */
    double angle_of_attack; /* rad, there: to be added to the schedule's; itself, where there is none */
    int32_t steering;       /* ampi_steering: by the law, the reference's own rate, held, by a plan */
    int32_t health;         /* ampi_health */
} ampi_command;

/* A blob that has been opened, and stays where it is; constant from then on. The first four parts are
   copies of the blob's (ampi/export/blob.py); `places` are counted in bytes from its begin. */
typedef struct {
    struct {
        uint32_t kind, law, axes, rows, nodes, points, segments, widest, clips, is_cycle_stated;
        uint32_t limit_axis[3], has_holes, text, modulates; /* the law, the angle of attack */
    } n;
    struct {
        uint32_t points, order, circular, spare;
        double low, high, nominal; /* of the whole table; a mode may use a part */
    } axis[AMPI_MAX_AXES];
    struct {
        uint32_t nodes, points, spare[2];
        double start[2], half_length[2]; /* s: (a, b) of a + b t_f */
    } segment[AMPI_MAX_SEGMENTS];
    struct {
        double limit[3], cycle; /* bank angle, rate, acceleration; s, nominal */
        double modulation[3];   /* the same of the change of the angle of attack; 0: there is none */
        double angle[3];        /* of the angle of attack itself: least and greatest, rad; rate, rad/s */
        double middle[AMPI_N_STATES], reach[AMPI_N_STATES]; /* plausible: |x - middle| <= reach */
        double gain[AMPI_N_GAINS];                          /* of the law */
    } set;
    const unsigned char *blob;
    size_t points_of[AMPI_MAX_AXES], stride[AMPI_MAX_AXES]; /* places; vertices a point further */
    size_t basis[AMPI_MAX_SEGMENTS], matrix[AMPI_MAX_SEGMENTS], first_node[AMPI_MAX_SEGMENTS];
    size_t times, map, values, holes, columns, angle_row; /* 0: the angle of attack is scheduled */
    uint32_t checksum, is_open;
} ampi_table;

/* What parameters make of a table. */
typedef struct {
    ampi_real rows[AMPI_MAX_ROWS * AMPI_MAX_NODES + 1u]; /* [nodes][rows]; then t_f */
    double final_time;                                   /* s */
    double excess[AMPI_MAX_AXES];     /* how far outside, in shares of the axis' range; 0 inside */
    uint32_t cell[AMPI_MAX_AXES];     /* first point of each axis that is used */
    uint32_t clipped[AMPI_MAX_AXES];  /* whether outside */
    uint32_t hole, checksum;          /* whether a borrowed case has weight; of the table */
    int32_t health;
} ampi_reference;

/* All that one flight remembers; memory of the caller, zeroed before it is begun. */
typedef struct {
    ampi_reference reference;
    double along[AMPI_MAX_POINTS]; /* what a drag law looks up by */
    double row[AMPI_MAX_ROWS];     /* of the reference, where the last command looked it up */
    double memory[AMPI_N_MEMORY];  /* of the law */
    double limit[3];               /* bank angle, rate, acceleration of this vehicle */
    double rate, bank, angle;      /* last command; NaN before the first */
    double change, change_rate;    /* of the angle of attack, as commanded */
    double asked_rate, asked_angle; /* by a plan (ampi_correction.h), if `is_asked` */
    double given, now, interval, shortest, longest, expected; /* the clock, s */
    uint32_t begins, is_first; /* a time that does not go on begins a flight; the last one did */
    uint32_t is_begun, is_asked;
} ampi_guidance;

/* Checks all of a blob of `size` bytes, of any alignment, which must outlive the table. On failure the
   table is closed: flown all the same, commands are AMPI_NOT_BEGUN and hold the last bank angle. */
ampi_status ampi_table_open(ampi_table *table, const unsigned char *blob, size_t size);

/* Reference for measured parameters [axes], in the table's order and units; NULL: none is known. */
void ampi_reference_at(const ampi_table *table, const double *parameters, ampi_reference *reference);

/* Its times [points] (s) and rows [rows x points], row-major. Not needed to fly. */
void ampi_reference_high_density(const ampi_table *table, const ampi_reference *reference,
                                 double *times, double *rows);

/* Begins a flight; the next step is its first, whatever its time. */
void ampi_guidance_begin(ampi_guidance *guidance, const ampi_table *table, const double *parameters);

/* Begins another flight on the reference that is flown: the next step is its first. */
void ampi_guidance_reset(ampi_guidance *guidance, const ampi_table *table);

/* Flies another reference of the same table from the next step on; the clock goes on. */
void ampi_guidance_follow(ampi_guidance *guidance, const ampi_table *table,
                          const ampi_reference *reference, const double *parameters);

/* Command of one cycle. time: since the entry interface (s). navigation: h (m), theta, phi (rad),
   V (m/s), gamma, psi, sigma (rad), sigma rate (rad/s); NULL: none is known. sensed: specific force
   (m/s^2) along the velocity, up and to the right of it; NULL: none. */
ampi_command ampi_guidance_step(ampi_guidance *guidance, const ampi_table *table, double time,
                                const double navigation[AMPI_N_NAVIGATED], const double *sensed);

#endif
