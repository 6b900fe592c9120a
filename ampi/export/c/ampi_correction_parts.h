/* What the parts of estimator and corrector share; no part of the interface. */
#ifndef AMPI_CORRECTION_PARTS_H
#define AMPI_CORRECTION_PARTS_H

#include "ampi_correction.h"
#include "ampi_parts.h"

/* What is known to differ from the model, at one altitude. */
typedef struct {
    double density, lift, wind_east, wind_north, angle; /* factors; m/s; rad */
} ampi_factors;

/* The air's doing, m/s^2 and rad; its speed in m/s, density in kg/m^3. */
typedef struct {
    double lift, drag, density, angle, speed;
    double along, up, right; /* of the velocity over the ground: what is sensed */
} ampi_air;

/* Sines and cosines of a state. */
typedef struct {
    double sin_latitude, cos_latitude, sin_path, cos_path, sin_azimuth, cos_azimuth, sin_bank, cos_bank;
} ampi_angles;

double ampi_scheduled_angle(const ampi_model_data *model, double time, double speed);
ampi_angles ampi_angles_of(const double *state);
ampi_air ampi_air_at(const ampi_model_data *model, const ampi_factors *factors, const double *state,
                     const ampi_angles *angles, double angle_of_attack);
/* Time derivatives [6] of h, theta, phi, V, gamma, psi. */
void ampi_rates(const ampi_model_data *model, const double *state, const ampi_angles *angles,
                const ampi_air *air, double *rates);
/* Shares [3] of dynamic pressure, heat flux and load factor that are used. */
void ampi_use(const ampi_model_data *model, const ampi_air *air, double *use);

void ampi_estimate_begin(ampi_estimate *estimate, const ampi_model_data *model);
/* `change`: of the angle of attack as it is flown, `unsure` by so much (rad). */
void ampi_estimate_update(ampi_estimate *estimate, const ampi_model_data *model, double time,
                          const double *state, const double *sensed, double change, double unsure);
ampi_factors ampi_factors_at(const ampi_estimate *estimate, const ampi_model_data *model,
                             double altitude);

/* Speed at the target's altitude of a vehicle that keeps its energy. */
double ampi_equivalent_speed(const ampi_model_data *model, const double *target, const double *state);
double ampi_planned(const ampi_plan *plan, size_t first, size_t count, double speed);
/* Corrects the plan that is flown, from `corrector->state` on. */
ampi_correction ampi_correct(ampi_corrector *corrector, const ampi_model_data *model,
                             const double *limit);

#endif
