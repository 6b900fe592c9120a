/* Estimate, correct, fly on: what is added to the flight code so that a flight lands when its model is
   wrong.

       ampi_model_open(&model, blob, size)                            once; anything but AMPI_OK: do not
       ampi_guidance_begin(&guidance, &table, parameters)             at the entry interface
       ampi_corrector_begin(&corrector, &model, &table, parameters)
       command = ampi_corrected_step(&corrector, &model, &guidance, &table, time, navigation, sensed)

   The estimator learns from sensed accelerations what is wrong with the model; at fixed instants the
   corrector predicts the flight with it, and changes the plan so that it ends on the target; every cycle
   flies the plan. A plan is replaced by a better one only. No allocation, every loop bounded. */
#ifndef AMPI_CORRECTION_H
#define AMPI_CORRECTION_H

#include "ampi.h"

#ifndef AMPI_N_BANKS /* smaller where a prover reads it */
#define AMPI_N_BANKS 13u   /* values of a plan: bank angles, */
#define AMPI_N_ANGLES 5u   /* changes of the angle of attack */
#define AMPI_MAX_STEPS 320u /* of a prediction */
#endif
#define AMPI_N_PLAN (AMPI_N_BANKS + AMPI_N_ANGLES)
#define AMPI_N_ESTIMATED 6u
#define AMPI_N_MISSED 6u  /* east, north, up; excess of dynamic pressure, heat flux, load factor */
#define AMPI_MAX_TERMS 16u
#define AMPI_MAX_KNOTS 16u

/* The model of vehicle and air, and the settings: float64 all of it, as it stands in the blob
   (ampi/export/model_blob.py); constant after it has been opened. */
typedef struct {
    double top, slope_below, slope_above, terms;
    double even[AMPI_MAX_TERMS], odd[AMPI_MAX_TERMS];
} ampi_curve; /* Eq. (1) of ampi/onboard/flight_model.py */

typedef struct {
    double radius, gravity, j2, rotation, load_gravity; /* m, m^3/s^2, -, rad/s, m/s^2 */
    double area_to_mass, lift_factor, drag_factor;      /* m^2/kg */
    double heat_constant, heat_exponent, load_is_total;
    double limit[3]; /* dynamic pressure (Pa), heat flux (W/m^2), load factor (g) */
    struct {
        double over_time, start, end, start_angle, end_angle, is_parabola, smoothing;
    } schedule; /* of the angle of attack */
    double target[4], target_axis[4]; /* h, theta, phi, V; its axis among the parameters, or -1 */
    double form, attack_knots, mach_knots; /* 0: Newtonian, 1: polar, 2: spline */
    double attack[AMPI_MAX_KNOTS], mach[AMPI_MAX_KNOTS]; /* knots; coefficients of the other forms */
    double lift[AMPI_MAX_KNOTS * AMPI_MAX_KNOTS], drag[AMPI_MAX_KNOTS * AMPI_MAX_KNOTS];
    ampi_curve log_density, sound;
    double sound_is_squared;
    struct {
        double prior[AMPI_N_ESTIMATED]; /* standard deviations */
        double walk[AMPI_N_ESTIMATED];  /* growth of the variances, 1/s */
        double length, wind_length;     /* m */
        double altitude, scale_height, speed, angle, relative, floor; /* noise */
        double weakest, gate, patience; /* m/s^2, -, s */
    } estimator;
    struct {
        double start, period, last_minute, last_period, quiet; /* s */
        double bank, change, change_rate;                      /* rad, rad, rad/s */
        double lead, stiffness, lag;                           /* s, 1/s, s */
        double step, tolerance, reach;                         /* s, m, m */
        double weight[AMPI_N_MISSED];                          /* 1/m, 1/m, 1/m; of a share of the limit */
        double margin;                                         /* share of a limit that is kept free */
        double roughness, size, change_size, plan_roughness, plan_change; /* of a plan */
        double longest_step, iterations, propagations, longest; /* rad, -, -, s */
    } corrector;
} ampi_model_data;

typedef struct {
    ampi_model_data of;
    uint32_t checksum, is_open;
} ampi_model;

/* What is wrong with the model: (a, c, r, w_E, w_N, d). Factors exp(a + c) on the air, exp(r) on the lift
   besides, wind (m/s), error of the angle of attack (rad); c and the wind fade with the distance from the
   altitude where they were measured. */
typedef struct {
    double mean[AMPI_N_ESTIMATED], covariance[AMPI_N_ESTIMATED][AMPI_N_ESTIMATED];
    double altitude, time, gated_since; /* m, s, s */
    double last[3];                     /* sensed */
    double nis;                         /* of the last innovation; NaN: none was used */
    uint32_t used, weak, unusable, stuck, gated, reset; /* how often */
} ampi_estimate;

/* Bank angle and change of the angle of attack over the equivalent speed, linear between equally spaced
   values and held beyond. */
typedef struct {
    double fast, slow; /* m/s, of the first and of the last value */
    double value[AMPI_N_PLAN];
} ampi_plan;

/* What has become of the last correction. */
typedef enum {
    AMPI_NO_CORRECTION = 0,   /* none has been due */
    AMPI_PLAN_KEPT,           /* the plan that is flown is predicted to end on the target */
    AMPI_PLAN_REPLACED,       /* by one that is predicted to end on the target */
    AMPI_PLAN_BETTERED,       /* by a better one, which is not yet there: the budget has ended */
    AMPI_OUT_OF_REACH,        /* the plan leads to the nearest point that is found in reach */
    AMPI_NO_BETTER,           /* rejected: none is predicted better than the plan that is flown */
    AMPI_NO_ARRIVAL,          /* rejected: no prediction arrives at the target's speed */
    AMPI_NO_STATE,            /* not tried: navigation told no plausible state */
    AMPI_N_CORRECTIONS
} ampi_correction;

typedef struct {
    double state[8], rates[6], time, peak[3], speed; /* of ampi_flight_step; equivalent speed */
} ampi_point;

/* All that one flight remembers; memory of the caller, zeroed before it is begun. */
typedef struct {
    ampi_estimate estimate;
    ampi_plan plan, trial;
    double target[4];                       /* h, theta, phi, V */
    double state[AMPI_N_NAVIGATED], time;   /* as navigated, or dead reckoned since */
    double change;                          /* of the angle of attack, as it is flown */
    double next, lost_since;                /* s: of the next correction, of navigation */
    double missed[AMPI_N_MISSED], to_go;    /* predicted: miss and excess of the plan; s */
    uint32_t has_plan, is_begun, iterations, propagations;
    uint32_t count[AMPI_N_CORRECTIONS];
    int32_t outcome;                        /* ampi_correction */
    double jacobian[AMPI_N_MISSED][AMPI_N_PLAN];
    ampi_point path[AMPI_MAX_STEPS];        /* of the plan as predicted last */
    uint32_t points;
} ampi_corrector;

ampi_status ampi_model_open(ampi_model *model, const unsigned char *blob, size_t size);

/* Begins a flight of these parameters [axes of the table]; NULL: none is known. */
void ampi_corrector_begin(ampi_corrector *corrector, const ampi_model *model, const ampi_table *table,
                          const double *parameters);

/* The target from the next correction on: h (m), theta, phi (rad), V (m/s). A target that is no number
   changes nothing. */
void ampi_corrector_aim(ampi_corrector *corrector, const double target[4]);

/* As ampi_guidance_step, by the plan where there is one. */
ampi_command ampi_corrected_step(ampi_corrector *corrector, const ampi_model *model,
                                 ampi_guidance *guidance, const ampi_table *table, double time,
                                 const double navigation[AMPI_N_NAVIGATED], const double *sensed);

#endif
