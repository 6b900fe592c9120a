/* What is wrong with the model, from sensed accelerations: an extended Kalman filter, as
   ampi/estimation/estimator.py. */
#include "ampi_correction_parts.h"

enum { DRAG = 0, LOCAL, LIFT, EAST, NORTH, ATTACK };

#define WIND_STEP 1.0   /* m/s, of the differences */
#define ATTACK_STEP 1e-3 /* rad */
#define MOST_FACTOR 1.0 /* of the logarithms */
#define MOST_WIND 200.0 /* m/s */
#define MOST_ATTACK 0.1 /* rad */

void ampi_estimate_begin(ampi_estimate *estimate, const ampi_model_data *model)
{
    size_t i;
    (void)memset(estimate, 0, sizeof *estimate);
    for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
        estimate->covariance[i][i] = model->estimator.prior[i] * model->estimator.prior[i];
    }
    for (i = 0u; i < 3u; i++) { estimate->last[i] = AMPI_NAN; }
    estimate->nis = AMPI_NAN;
    estimate->time = AMPI_NAN;
    estimate->gated_since = AMPI_NAN;
}

ampi_factors ampi_factors_at(const ampi_estimate *estimate, const ampi_model_data *model,
                             double altitude)
{
    const double away = fabs(altitude - estimate->altitude), *mean = estimate->mean;
    const double calm = exp(-away / model->estimator.wind_length);
    ampi_factors of;
    of.density = exp(mean[DRAG] + mean[LOCAL] * exp(-away / model->estimator.length));
    of.lift = exp(mean[LIFT]);
    of.wind_east = mean[EAST] * calm;
    of.wind_north = mean[NORTH] * calm;
    of.angle = mean[ATTACK];
    return of;
}

/* The variances over `passed` s in which the altitude has changed by `climbed` m. */
static void grow(ampi_estimate *estimate, const ampi_model_data *model, double passed, double climbed)
{
    const double local = exp(-climbed / model->estimator.length);
    const double wind = exp(-climbed / model->estimator.wind_length);
    const double keep[AMPI_N_ESTIMATED] = {1.0, local, 1.0, wind, wind, 1.0};
    size_t i, j;
    for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
        const double prior = model->estimator.prior[i];
        estimate->mean[i] *= keep[i];
        for (j = 0u; j < AMPI_N_ESTIMATED; j++) { estimate->covariance[i][j] *= keep[i] * keep[j]; }
        estimate->covariance[i][i] += prior * prior * (1.0 - keep[i] * keep[i])
                                      + model->estimator.walk[i] * passed;
    }
}

typedef struct {
    double of[3], slope[3][AMPI_N_ESTIMATED], noise[3][3];
} ampi_expected;

static void add_noise(ampi_expected *expected, const double *direction, double size)
{
    const double sized[3] = {size * direction[0], size * direction[1], size * direction[2]};
    size_t i, j;
    for (i = 0u; i < 3u; i++) {
        for (j = 0u; j < 3u; j++) { expected->noise[i][j] += sized[i] * sized[j]; }
    }
}

/* What the navigation's errors do to the measurement. */
static void set_noise(ampi_expected *expected, const ampi_model_data *model, const double *state,
                      const ampi_angles *angles, double unsure)
{
    const double *f = expected->of;
    const double squares = f[0] * f[0] + f[1] * f[1] + f[2] * f[2];
    const double path[3] = {f[1], -f[0], 0.0};
    const double azimuth[3] = {f[2] * angles->cos_path, -f[2] * angles->sin_path,
                               f[1] * angles->sin_path - f[0] * angles->cos_path};
    const double bank[3] = {0.0, -f[2], f[1]};
    const double attack[3] = {expected->slope[0][ATTACK], expected->slope[1][ATTACK],
                              expected->slope[2][ATTACK]};
    const double angle = model->estimator.angle, relative = model->estimator.relative;
    size_t i;
    (void)memset(expected->noise, 0, sizeof expected->noise);
    add_noise(expected, f, model->estimator.altitude / model->estimator.scale_height);
    add_noise(expected, f, 2.0 * model->estimator.speed / state[SPEED]);
    add_noise(expected, path, angle);
    add_noise(expected, azimuth, angle);
    add_noise(expected, bank, angle);
    add_noise(expected, attack, unsure);
    for (i = 0u; i < 3u; i++) {
        expected->noise[i][i] +=
            relative * relative * squares + model->estimator.floor * model->estimator.floor;
    }
}

static ampi_air felt_at(const ampi_model_data *model, const ampi_factors *factors, const double *state,
                        const ampi_angles *angles, double time)
{
    const double angle = ampi_scheduled_angle(model, time, state[SPEED]) + factors->angle;
    return ampi_air_at(model, factors, state, angles, angle);
}

/* What is expected to be sensed, and its derivatives. */
static void expect(ampi_expected *expected, const ampi_estimate *estimate, const ampi_model_data *model,
                   double time, const double *state, double change, double unsure)
{
    const ampi_angles angles = ampi_angles_of(state);
    ampi_factors factors = ampi_factors_at(estimate, model, state[ALTITUDE]);
    ampi_air air;
    size_t i, column;
    factors.angle += change;
    air = felt_at(model, &factors, state, &angles, time);
    expected->of[0] = air.along;
    expected->of[1] = air.up;
    expected->of[2] = air.right;
    for (column = LIFT; column < AMPI_N_ESTIMATED; column++) {
        ampi_factors beside = factors;
        double step = WIND_STEP;
        ampi_air moved;
        if (column == LIFT) { step = 1.0; beside.lift = 2.0 * factors.lift; } /* it is linear in the lift */
        if (column == EAST) { beside.wind_east += step; }
        if (column == NORTH) { beside.wind_north += step; }
        if (column == ATTACK) { step = ATTACK_STEP; beside.angle += step; }
        moved = felt_at(model, &beside, state, &angles, time);
        expected->slope[0][column] = (moved.along - air.along) / step;
        expected->slope[1][column] = (moved.up - air.up) / step;
        expected->slope[2][column] = (moved.right - air.right) / step;
    }
    for (i = 0u; i < 3u; i++) {
        expected->slope[i][DRAG] = expected->of[i];
        expected->slope[i][LOCAL] = expected->of[i];
    }
    set_noise(expected, model, state, &angles, unsure);
}

/* The lower triangle of the Cholesky factor of a (3, 3) matrix; not positive: NaN. */
static void factor(double s[3][3])
{
    s[0][0] = sqrt(s[0][0]);
    s[1][0] = s[1][0] / s[0][0];
    s[2][0] = s[2][0] / s[0][0];
    s[1][1] = sqrt(s[1][1] - s[1][0] * s[1][0]);
    s[2][1] = (s[2][1] - s[2][0] * s[1][0]) / s[1][1];
    s[2][2] = sqrt(s[2][2] - s[2][0] * s[2][0] - s[2][1] * s[2][1]);
}

/* L^-1 v. */
static void forward(double s[3][3], double v[3])
{
    v[0] = v[0] / s[0][0];
    v[1] = (v[1] - s[1][0] * v[0]) / s[1][1];
    v[2] = (v[2] - s[2][0] * v[0] - s[2][1] * v[1]) / s[2][2];
}

static void keep_sane(ampi_estimate *estimate)
{
    static const double MOST[AMPI_N_ESTIMATED] = {MOST_FACTOR, MOST_FACTOR, MOST_FACTOR,
                                                  MOST_WIND,   MOST_WIND,   MOST_ATTACK};
    size_t i;
    for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
        estimate->mean[i] = clipped(estimate->mean[i], -MOST[i], MOST[i]);
    }
}

/* With W = L^-1 H P: mean += W' L^-1 nu, P -= W' W. */
static void learn(ampi_estimate *estimate, const ampi_model_data *model, const ampi_expected *expected,
                  const double *sensed, double time)
{
    double s[3][3], gain[AMPI_N_ESTIMATED][3], nu[3];
    size_t i, j, k;
    for (i = 0u; i < 3u; i++) { nu[i] = sensed[i] - expected->of[i]; }
    for (k = 0u; k < AMPI_N_ESTIMATED; k++) {
        for (i = 0u; i < 3u; i++) {
            double sum = 0.0;
            for (j = 0u; j < AMPI_N_ESTIMATED; j++) {
                sum += expected->slope[i][j] * estimate->covariance[j][k];
            }
            gain[k][i] = sum;
        }
    }
    for (i = 0u; i < 3u; i++) {
        for (j = 0u; j < 3u; j++) {
            double sum = 0.0;
            for (k = 0u; k < AMPI_N_ESTIMATED; k++) { sum += gain[k][i] * expected->slope[j][k]; }
            s[i][j] = sum + expected->noise[i][j];
        }
    }
    factor(s);
    forward(s, nu);
    estimate->nis = nu[0] * nu[0] + nu[1] * nu[1] + nu[2] * nu[2];
    if (!(estimate->nis <= model->estimator.gate)) {
        estimate->gated += 1u;
        estimate->gated_since = chosen(estimate->gated_since != estimate->gated_since, time,
                                       estimate->gated_since);
        if ((time - estimate->gated_since) >= model->estimator.patience) {
            const double *prior = model->estimator.prior;
            (void)memset(estimate->covariance, 0, sizeof estimate->covariance);
            for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
                estimate->covariance[i][i] = prior[i] * prior[i];
            }
            estimate->gated_since = AMPI_NAN;
            estimate->reset += 1u;
        }
        return;
    }
    for (k = 0u; k < AMPI_N_ESTIMATED; k++) { forward(s, gain[k]); }
    for (i = 0u; i < AMPI_N_ESTIMATED; i++) {
        estimate->mean[i] += gain[i][0] * nu[0] + gain[i][1] * nu[1] + gain[i][2] * nu[2];
        for (j = 0u; j < AMPI_N_ESTIMATED; j++) {
            estimate->covariance[i][j] -=
                gain[i][0] * gain[j][0] + gain[i][1] * gain[j][1] + gain[i][2] * gain[j][2];
        }
    }
    keep_sane(estimate);
    estimate->gated_since = AMPI_NAN;
    estimate->used += 1u;
}

void ampi_estimate_update(ampi_estimate *estimate, const ampi_model_data *model, double time,
                          const double *state, const double *sensed, double change, double unsure)
{
    bool is_known = fabs(time) < AMPI_SANE, is_new = false;
    double size = 0.0;
    ampi_expected expected;
    size_t i;

    estimate->nis = AMPI_NAN;
    for (i = 0u; i < BANK; i++) { is_known = is_known && (fabs(state[i]) < AMPI_SANE); }
    if (!is_known || !(fabs(state[BANK]) < AMPI_SANE)) {
        estimate->unusable += 1u;
        return;
    }
    if (time > estimate->time) {
        const double passed = time - estimate->time;
        grow(estimate, model, passed, fabs(state[SPEED] * sin(state[PATH_ANGLE])) * passed);
    }
    estimate->time = time;
    estimate->altitude = state[ALTITUDE];
    for (i = 0u; i < 3u; i++) {
        is_known = is_known && (fabs(sensed[i]) < AMPI_SANE);
        is_new = is_new || (sensed[i] != estimate->last[i]);
        size += sensed[i] * sensed[i];
        estimate->last[i] = sensed[i];
    }
    if (!is_known) {
        estimate->unusable += 1u;
    } else if (!is_new) {
        estimate->stuck += 1u;
    } else if (!(size >= (model->estimator.weakest * model->estimator.weakest))) {
        estimate->weak += 1u;
    } else {
        expect(&expected, estimate, model, time, state, change, unsure);
        learn(estimate, model, &expected, sensed, time);
    }
}
