/* Entry guidance from a table of optimal trajectories: the flight code. C99, hosted or freestanding
   with <math.h> and <string.h>. SI units and radians throughout.

       ampi_table_open(&table, blob, size)                       once; anything but AMPI_OK: do not fly
       ampi_guidance_begin(&guidance, &table, parameters)        at the entry interface
       command = ampi_guidance_step(&guidance, &table, time, navigation, sensed)        at every cycle

   No allocation, no recursion, every loop bounded by a size of the table, no state but that of the
   caller. After `ampi_table_open` nothing fails: what is unusual is told by the health of a command.
   Compile with -ffp-contract=off and without -ffast-math: a command then has the bits of the Python. */
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

#define AMPI_MAX_WIDTH 4u  /* points of an axis that one reference may use */
#define AMPI_BLOCK 8u      /* high-density points that are converted at once */
#define AMPI_NO_AXIS 255u  /* of a limit that is no parameter */
#define AMPI_N_STATES 7u   /* h, theta, phi, V, gamma, psi, sigma */
#define AMPI_N_NAVIGATED 8u
#define AMPI_N_GAINS 16u
#define AMPI_N_MEMORY 4u

typedef enum {
    AMPI_OK = 0,
    AMPI_TRUNCATED,    /* shorter or longer than it says */
    AMPI_FOREIGN,      /* not a guidance table */
    AMPI_BYTE_ORDER,   /* of a machine of the other byte order */
    AMPI_VERSION,      /* of a format that this code does not know */
    AMPI_CHECKSUM,     /* damaged: its CRC-32 is another one */
    AMPI_TOO_LARGE,    /* larger than the limits of ampi_config.h */
    AMPI_INCONSISTENT  /* a size, an order or a number that no writer of ours makes */
} ampi_status;

/* Of several that apply the greatest is told. */
typedef enum {
    AMPI_GOOD = 0,
    AMPI_BOUNDARY_REFERENCE,     /* parameters outside the hypercube: reference of its boundary */
    AMPI_HOLE_REFERENCE,         /* a case without solution, its neighbour stands for it */
    AMPI_FAR_OUTSIDE,            /* by more than 20 % of an axis' range, in another unit perhaps */
    AMPI_BAD_PARAMETERS,         /* no finite number: what is none is nominal */
    AMPI_IMPLAUSIBLE_NAVIGATION, /* far outside of all that the table flies */
    AMPI_BAD_NAVIGATION,         /* no number */
    AMPI_BAD_TIME,               /* no number, or it does not go on: counted on by the last cycle */
    AMPI_AFTER_FINAL_TIME,       /* the reference has ended: the bank angle is held */
    AMPI_NOT_BEGUN               /* no open table, or a flight not begun with it: rate zero */
} ampi_health;

typedef enum { AMPI_TRACKED = 0, AMPI_REFERENCE, AMPI_HELD } ampi_steering; /* by what is steered */

typedef struct {
    double bank_rate;       /* rad/s, to be reached at the end of the cycle */
    double bank_angle;      /* rad, there */
    double angle_of_attack; /* rad, to be added to the schedule's */
    int32_t steering;       /* ampi_steering */
    int32_t health;         /* ampi_health */
} ampi_command;

typedef struct {
    size_t points, order, circular; /* on the axis; how it interpolates; an angle modulo a turn? */
    size_t stride, place;           /* vertices from point to point; where in the blob its points are */
    double low, high, nominal;      /* of the whole table, of which a mode may use a part */
} ampi_axis;

typedef struct {
    size_t first_node, nodes, points; /* low-density nodes; high-density points */
    size_t basis, blocks;             /* in the blob: its (node, 1/product), and its part of the matrix */
    double start[2], half_length[2];  /* (a, b) of a + b t_f, s */
} ampi_segment;

/* A blob that has been opened; constant from then on. The values stay in the blob. */
typedef struct {
    const unsigned char *blob;
    uint32_t checksum, is_open;
    size_t kind, law, clips, is_cycle_stated;
    size_t n_axes, n_rows, n_nodes, n_points, n_segments, widest, n_columns, n_vertices;
    size_t values, affine, holes, times; /* places in the blob; no holes: 0 */
    size_t limit_axis[3];                /* of angle, rate, acceleration */
    double limit[3];                     /* rad, rad/s, rad/s^2 */
    double cycle;                        /* s, nominal */
    double middle[AMPI_N_STATES], reach[AMPI_N_STATES]; /* plausible: |x - middle| <= reach */
    double gain[AMPI_N_GAINS];                          /* of the law */
    ampi_axis axis[AMPI_MAX_AXES];
    ampi_segment segment[AMPI_MAX_SEGMENTS];
} ampi_table;

/* What the parameters make of the table. */
typedef struct {
    ampi_real rows[AMPI_MAX_ROWS * AMPI_MAX_NODES + 1u]; /* (r, n) row-major at the nodes, then t_f */
    double final_time;                                   /* s */
    double excess[AMPI_MAX_AXES];    /* how far outside, in shares of the axis' range; 0 inside */
    uint32_t cell[AMPI_MAX_AXES];    /* first point used of each axis */
    uint32_t clipped[AMPI_MAX_AXES]; /* whether outside */
    uint32_t hole;                   /* whether a case without solution has weight */
    uint32_t checksum;               /* of its table */
    int32_t health;                  /* ampi_health */
} ampi_reference;

/* All that one flight remembers. Memory of the caller, to be zeroed or begun before the first step. */
typedef struct {
    ampi_reference reference;
    double along[AMPI_MAX_POINTS]; /* what a drag law looks up by: s, then J/kg */
    double row[AMPI_MAX_ROWS];     /* of the reference, where the last command looked it up */
    double memory[AMPI_N_MEMORY];  /* of the law */
    double limit[3];               /* bank angle, rate, acceleration of this vehicle */
    double rate, bank, angle;      /* last command; NaN before the first, but for the angle of attack */
    double given, now, interval, shortest, longest, expected; /* the clock, s */
    uint32_t begins, is_first;     /* whether a time that does not go on begins a flight; it has */
    uint32_t checksum;             /* of the table that it flies */
    uint32_t is_begun;
} ampi_guidance;

/* Opens a blob of `size` bytes (no alignment needed); it must outlive the table. Checks all of it:
   milliseconds. On failure the table is closed and safe to fly: see AMPI_NOT_BEGUN. */
ampi_status ampi_table_open(ampi_table *table, const unsigned char *blob, size_t size);

/* Reference for measured parameters [n_axes], in the table's order and units. NULL: none is known. */
void ampi_reference_at(const ampi_table *table, const double *parameters, ampi_reference *reference);

/* Its times [n_points] (s) and rows [n_rows * n_points], row-major; zeros of a table that is closed
   are not written. Not needed to fly. */
void ampi_reference_high_density(const ampi_table *table, const ampi_reference *reference,
                                 double *times, double *rows);

/* Begins a flight; the next step is its first, whatever its time. */
void ampi_guidance_begin(ampi_guidance *guidance, const ampi_table *table, const double *parameters);

/* Flies this reference from the next step on; the clock goes on. */
void ampi_guidance_follow(ampi_guidance *guidance, const ampi_table *table,
                          const ampi_reference *reference, const double *parameters);

/* Command of one cycle. `time` since the entry interface (s); navigation: h (m), theta, phi (rad),
   V (m/s), gamma, psi, sigma (rad), sigma rate (rad/s), NULL: none is known; sensed: specific force
   (m/s^2) along the velocity, up and to the right of it, NULL: none. */
ampi_command ampi_guidance_step(ampi_guidance *guidance, const ampi_table *table, double time,
                                const double navigation[AMPI_N_NAVIGATED], const double *sensed);

#endif
