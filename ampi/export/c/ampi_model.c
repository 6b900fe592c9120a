/* The model of vehicle and air, as ampi/onboard/{flight_model,aerodynamic_forms}.py, in wind. */
#include "ampi_correction_parts.h"

#define HEADER 32u
#define FORMAT 1u
#define AMPI_FINITE 1e300 /* false for infinities and NaN */
#define MOST_ITERATIONS 100.0 /* of one correction */
#define MOST_PROPAGATIONS 10000.0

static const unsigned char MODEL_MAGIC[8] = {0x89, 'A', 'M', 'P', 'C', '\r', '\n', 0x1a};

static bool is_count(double value, double least_of_all, double most_of_all)
{
    return (value >= least_of_all) && (value <= most_of_all) && (value == floor(value));
}

/* Whether all of the body are numbers. */
static bool is_finite(const unsigned char *blob)
{
    bool is_good = true;
    double told;
    size_t at;
    for (at = HEADER; at < (HEADER + sizeof(ampi_model_data)); at += sizeof told) {
        (void)memcpy(&told, &blob[at], sizeof told);
        is_good = is_good && (fabs(told) < AMPI_FINITE);
    }
    return is_good;
}

static bool are_increasing(const double *knots, double count)
{
    bool is_good = true;
    size_t i;
    for (i = 1u; i < AMPI_MAX_KNOTS; i++) {
        is_good = is_good && (((double)i >= count) || (knots[i - 1u] < knots[i]));
    }
    return is_good;
}

/* Whether counts lead nowhere beyond their arrays. */
static bool are_counts(const ampi_model_data *of)
{
    size_t i;
    bool is_good = is_count(of->log_density.terms, 1.0, (double)AMPI_MAX_TERMS)
                   && is_count(of->sound.terms, 1.0, (double)AMPI_MAX_TERMS);
    is_good = is_good && is_count(of->form, 0.0, 2.0);
    is_good = is_good && is_count(of->attack_knots, 0.0, (double)AMPI_MAX_KNOTS);
    is_good = is_good && is_count(of->mach_knots, 0.0, (double)AMPI_MAX_KNOTS);
    if (is_good && (of->form == 2.0)) {
        is_good = (of->attack_knots > 3.0) && are_increasing(of->attack, of->attack_knots)
                  && (of->mach_knots > 3.0) && are_increasing(of->mach, of->mach_knots);
    }
    for (i = 0u; i < 4u; i++) {
        is_good = is_good && is_count(of->target_axis[i], -1.0, (double)AMPI_MAX_AXES - 1.0);
    }
    return is_good && is_count(of->corrector.iterations, 0.0, MOST_ITERATIONS)
           && is_count(of->corrector.propagations, 0.0, MOST_PROPAGATIONS);
}

/* Whether what is divided by is positive, and no bound crosses another. */
static bool are_sizes(const ampi_model_data *of)
{
    const double positive[] = {
        of->radius,            of->gravity,             of->load_gravity,     of->area_to_mass,
        of->limit[0],          of->limit[1],            of->limit[2],         of->log_density.top,
        of->sound.top,         of->estimator.length,    of->corrector.step,   of->estimator.scale_height,
        of->corrector.longest, of->corrector.period,    of->corrector.lead,   of->estimator.wind_length,
        of->target[3],         of->corrector.last_period, fabs(of->schedule.end - of->schedule.start)};
    bool is_good = (of->corrector.change >= 0.0) && (of->corrector.change_rate >= 0.0);
    size_t i;
    for (i = 0u; i < (sizeof positive / sizeof positive[0]); i++) {
        is_good = is_good && (positive[i] > 0.0);
    }
    return is_good;
}

ampi_status ampi_model_open(ampi_model *model, const unsigned char *blob, size_t size)
{
    ampi_status status = AMPI_OK;
    uint32_t word[6] = {0u, 0u, 0u, 0u, 0u, 0u};

    model->is_open = 0u;
    if ((blob == NULL) || (size != (HEADER + sizeof model->of))) { return AMPI_TRUNCATED; }
    (void)memcpy(word, &blob[sizeof MODEL_MAGIC], sizeof word);
    if (memcmp(blob, MODEL_MAGIC, sizeof MODEL_MAGIC) != 0) {
        status = AMPI_FOREIGN;
    } else if (word[0] != 0x01020304u) {
        status = AMPI_BYTE_ORDER;
    } else if ((word[1] != FORMAT) || (word[2] != (uint32_t)(sizeof model->of))) {
        status = AMPI_VERSION;
    } else if (word[3] != ampi_crc_32(blob, HEADER, size)) {
        status = AMPI_CHECKSUM;
    } else {
        (void)memcpy(&model->of, &blob[HEADER], sizeof model->of);
        status = (is_finite(blob) && are_counts(&model->of) && are_sizes(&model->of)) ? AMPI_OK
                                                                             : AMPI_INCONSISTENT;
    }
    model->checksum = word[3];
    model->is_open = (status == AMPI_OK) ? AMPI_OPEN : 0u;
    return status;
}

static double along_curve(const ampi_curve *curve, double altitude)
{
    const double inside = clipped(altitude, 0.0, curve->top);
    const double xi = inside * (2.0 / curve->top) - 1.0;
    const double eta = 2.0 * xi * xi - 1.0;
    const size_t terms = (size_t)curve->terms;
    double even = 0.0, odd = 0.0, power = 1.0;
    size_t k;
    for (k = 0u; k < terms; k++) {
        even += curve->even[k] * power;
        odd += curve->odd[k] * power;
        power *= eta;
    }
    return even + xi * odd + curve->slope_below * least(altitude, 0.0)
           + curve->slope_above * most(altitude - curve->top, 0.0);
}

/* The functions that span the cubic splines with zero slope at both ends: [knots]. */
static void basis(const double *knots, size_t count, double x, double *found)
{
    const double begin = knots[0], end = knots[count - 1u], before = knots[count - 2u];
    const double value = clipped(x, begin, end), length = end - begin, last = end - before;
    const double t = (value - begin) / length, beyond = most(value - before, 0.0);
    const double r = beyond * beyond * beyond / (3.0 * (last * last));
    size_t k;
    found[0] = 1.0;
    found[1] = t * t - 2.0 / length * r;
    found[2] = t * t * t - 3.0 / length * r;
    for (k = 1u; k < (count - 2u); k++) {
        const double width = end - knots[k], share = most(value - knots[k], 0.0) / width;
        found[k + 2u] = share * share * share - 3.0 / width * r;
    }
}

static double tensor(const double *weights, const double *left, size_t rows, const double *right,
                     size_t columns)
{
    double sum = 0.0;
    size_t i, j;
    for (i = 0u; i < rows; i++) {
        double row = 0.0;
        for (j = 0u; j < columns; j++) { row += weights[i * AMPI_MAX_KNOTS + j] * right[j]; }
        sum += row * left[i];
    }
    return sum;
}

static double horner(const double *coefficient, size_t count, double x)
{
    double sum = 0.0;
    size_t k;
    for (k = count; k > 0u; k--) { sum = sum * x + coefficient[k - 1u]; }
    return sum;
}

/* (C_L, C_D), without their factors. */
static void coefficients(const ampi_model_data *model, double angle, double mach, double *lift,
                         double *drag)
{
    const size_t rows = (size_t)model->attack_knots, columns = (size_t)model->mach_knots;
    if (model->form == 0.0) {
        const double sine = sin(angle), cosine = cos(angle);
        const double normal = (model->attack[0] * sine + model->attack[1]) * sine;
        *lift = normal * cosine - model->attack[2] * sine;
        *drag = normal * sine + model->attack[2] * cosine;
    } else if (model->form == 1.0) {
        *lift = horner(model->attack, rows, angle * (180.0 / AMPI_PI));
        *drag = horner(model->mach, columns, *lift);
    } else {
        double left[AMPI_MAX_KNOTS] = {0.0}, right[AMPI_MAX_KNOTS] = {0.0};
        basis(model->attack, rows, angle, left);
        basis(model->mach, columns, mach, right);
        *lift = tensor(model->lift, left, rows, right, columns);
        *drag = tensor(model->drag, left, rows, right, columns);
    }
}

double ampi_scheduled_angle(const ampi_model_data *model, double time, double speed)
{
    const double at = (model->schedule.over_time != 0.0) ? time : speed;
    const double way = model->schedule.end - model->schedule.start;
    const double f = (at - model->schedule.start) / way, s = model->schedule.smoothing;
    double share = clipped(f, 0.0, 1.0);
    if (s > 0.0) {
        share = 0.5 * (1.0 + sqrt(f * f + s * s) - sqrt((f - 1.0) * (f - 1.0) + s * s));
    }
    if (model->schedule.is_parabola != 0.0) { share = share * (2.0 - share); }
    return model->schedule.start_angle
           + (model->schedule.end_angle - model->schedule.start_angle) * share;
}

ampi_angles ampi_angles_of(const double *state)
{
    ampi_angles of;
    of.sin_latitude = sin(state[LATITUDE]);
    of.cos_latitude = cos(state[LATITUDE]);
    of.sin_path = sin(state[PATH_ANGLE]);
    of.cos_path = cos(state[PATH_ANGLE]);
    of.sin_azimuth = sin(state[AZIMUTH]);
    of.cos_azimuth = cos(state[AZIMUTH]);
    of.sin_bank = sin(state[BANK]);
    of.cos_bank = cos(state[BANK]);
    return of;
}

/* ampi/physics/wind.py, Eqs. (1) to (3). */
ampi_air ampi_air_at(const ampi_model_data *model, const ampi_factors *factors, const double *state,
                     const ampi_angles *angles, double angle_of_attack)
{
    const double east = factors->wind_east, north = factors->wind_north;
    const double f = state[SPEED] * angles->cos_path - north * angles->cos_azimuth
                     - east * angles->sin_azimuth;
    const double v = state[SPEED] * angles->sin_path;
    const double s = north * angles->sin_azimuth - east * angles->cos_azimuth;
    const double level = sqrt(f * f + s * s), speed = sqrt(f * f + s * s + v * v);
    double lift, drag, mach = 0.0, pressure, against, across, forward, upward, lift_up;
    ampi_air air;

    air.speed = speed;
    air.angle = angle_of_attack;
    air.density = factors->density * exp(along_curve(&model->log_density, state[ALTITUDE]));
    if (model->form == 2.0) {
        const double sound = along_curve(&model->sound, state[ALTITUDE]);
        mach = speed / ((model->sound_is_squared != 0.0) ? sqrt(sound) : exp(sound));
    }
    coefficients(model, angle_of_attack, mach, &lift, &drag);
    pressure = 0.5 * air.density * speed * speed * model->area_to_mass;
    air.lift = pressure * (model->lift_factor * factors->lift * lift);
    air.drag = pressure * (model->drag_factor * drag);
    lift_up = air.lift * angles->cos_bank;
    against = (air.drag + lift_up * v / level) / speed;
    across = air.lift * angles->sin_bank / level;
    forward = -against * f - across * s;
    upward = (lift_up * level - air.drag * v) / speed;
    air.along = forward * angles->cos_path + upward * angles->sin_path;
    air.up = upward * angles->cos_path - forward * angles->sin_path;
    air.right = across * f - against * s;
    return air;
}

/* Sagliano 2016, Eq. (2). */
void ampi_rates(const ampi_model_data *model, const double *state, const ampi_angles *angles,
                const ampi_air *air, double *rates)
{
    const double sin_lat = angles->sin_latitude, cos_lat = angles->cos_latitude;
    const double sin_fpa = angles->sin_path, cos_fpa = angles->cos_path;
    const double sin_azi = angles->sin_azimuth, cos_azi = angles->cos_azimuth;
    const double radius = model->radius + state[ALTITUDE], speed = state[SPEED];
    const double share = model->radius / radius, omega = model->rotation;
    const double g = model->gravity / (radius * radius)
                     * (1.0 + 1.5 * model->j2 * share * share * (1.0 - 3.0 * sin_lat * sin_lat));
    const double centrifugal = omega * omega * radius * cos_lat;
    const double level = speed * cos_fpa, turning = level / radius;

    rates[ALTITUDE] = speed * sin_fpa;
    rates[LONGITUDE] = turning * sin_azi / cos_lat;
    rates[LATITUDE] = turning * cos_azi;
    rates[SPEED] = centrifugal * (sin_fpa * cos_lat - cos_fpa * sin_lat * cos_azi) + air->along
                   - g * sin_fpa;
    rates[PATH_ANGLE] = air->up / speed + (speed / radius - g / speed) * cos_fpa
                        + 2.0 * omega * cos_lat * sin_azi
                        + centrifugal / speed * (cos_fpa * cos_lat + sin_fpa * sin_lat * cos_azi);
    rates[AZIMUTH] = air->right / level + turning * sin_azi * sin_lat / cos_lat
                     - 2.0 * omega * (sin_fpa / cos_fpa * cos_lat * cos_azi - sin_lat)
                     + centrifugal / level * sin_lat * sin_azi;
}

/* Eq. (4), over the limits. */
void ampi_use(const ampi_model_data *model, const ampi_air *air, double *use)
{
    const double heat = model->heat_constant * sqrt(air->density) * pow(air->speed, model->heat_exponent);
    const double total = sqrt(air->lift * air->lift + air->drag * air->drag);
    const double normal = fabs(air->lift * cos(air->angle) + air->drag * sin(air->angle));
    const double load = (model->load_is_total != 0.0) ? total : normal;
    use[0] = 0.5 * air->density * air->speed * air->speed / model->limit[0];
    use[1] = heat / model->limit[1];
    use[2] = load / model->load_gravity / model->limit[2];
}
