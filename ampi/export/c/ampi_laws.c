/* The tracking laws, as those of ampi/tracking derive them; equation numbers are theirs. */
#include "ampi_parts.h"

#define BEFORE_AIR (-1e9) /* J/kg: below -E of whatever enters; times are counted from it */
#define DISTINCT 1e-6     /* s or J/kg between points of a reference, lest two are the same */
#define ALIKE 2.0         /* slopes of neighbouring intervals, at the most */
#define LEAST_SLOPE 0.1   /* 1/rad: an angle of attack that changes the drag less is left alone */

enum { /* gains, as ampi/export/blob.py writes them: of both drag laws, then of the one */
    MU = 0, RADIUS, FELT_DRAG, DEADBAND, LEAST_RANGE, TURN_RATE, BRAKING, DRAG_GAIN, DESCENT_GAIN,
    LAMBDA = DRAG_GAIN, REACHING, SWITCHING, BOUNDARY, BANDWIDTH, MOST_DISTURBANCE
};
enum { TURNING = 0, SURFACE, DISTURBANCE }; /* memory of the drag laws */

typedef struct {
    double drag, lift; /* m/s^2; the reference's where they are not known */
    bool is_known;
} accelerations;

/* `angle` in [-pi, pi), with the bits of Python's modulo: to subtract a power of two of turns is exact.
   fmod would take as many instructions as the angle has turns. */
static double wrapped(double angle)
{
    const double shifted = angle + AMPI_PI;
    double rest = fabs(shifted), turns;

    rest -= 32.0 * AMPI_TURN * floor(rest / (32.0 * AMPI_TURN));
    for (turns = 16.0 * AMPI_TURN; turns >= AMPI_TURN; turns *= 0.5) {
        rest -= chosen(rest >= turns, turns, 0.0);
    }
    return chosen((shifted < 0.0) && (rest > 0.0), AMPI_TURN - rest, rest) - AMPI_PI;
}

static double linear_quadratic(const ampi_table *table, const double *at, const double *state,
                               double *angle)
{
    double sum = 0.0, of_angle = 0.0, error[AMPI_N_STATES];
    size_t i;
    for (i = 0u; i < AMPI_N_STATES; i++) {
        error[i] = state[i] - at[i];
        if ((i == LONGITUDE) || (i == AZIMUTH)) { error[i] = wrapped(error[i]); }
        sum += at[FIRST_GAIN + i] * error[i];
    }
    for (i = 0u; (table->n.modulates != 0u) && (i < AMPI_N_STATES); i++) {
        of_angle += at[FIRST_ANGLE_GAIN + i] * error[i];
    }
    *angle = -of_angle;
    return at[BANK_RATE] - sum;
}

/* -E of Eq. (1), J/kg. */
static double energy_lost(const double *gain, double altitude, double speed)
{
    return -(0.5 * speed * speed - gain[MU] / (gain[RADIUS] + altitude));
}

void ampi_along(const ampi_table *table, const ampi_reference *reference, double *along)
{
    double points[(LOG_DRAG + 1) * AMPI_CHUNK];
    double furthest = -HUGE_VAL;
    bool is_felt = false;
    size_t s, first, size, j, done = 0u;

    for (s = 0u; s < table->n.segments; s++) {
        for (first = 0u; first < table->segment[s].points; first += size) {
            size = ampi_chunk(table, reference, s, first, LOG_DRAG + 1, points, AMPI_CHUNK);
            for (j = 0u; j < size; j++) {
                const double altitude = points[ALTITUDE * AMPI_CHUNK + j];
                const double speed = points[SPEED * AMPI_CHUNK + j];
                const double drag = exp(points[LOG_DRAG * AMPI_CHUNK + j]);
                const double time = time_of(table, reference->final_time, done);
                is_felt = is_felt || (drag > table->set.gain[FELT_DRAG]);
                furthest = most(furthest, is_felt ? energy_lost(table->set.gain, altitude, speed)
                                                  : (BEFORE_AIR + time));
                along[done] = furthest + DISTINCT * (double)done;
                done++;
            }
        }
    }
}

/* Way along, and slope of the time, between a point and one beside it; slope 0 if they are the same. */
static double slope_between(const ampi_table *table, const ampi_guidance *guidance, size_t point,
                            size_t beside, double *way)
{
    const double final_time = guidance->reference.final_time;
    const double passed = fabs(time_of(table, final_time, beside) - time_of(table, final_time, point));
    *way = fabs(guidance->along[beside] - guidance->along[point]);
    return chosen(*way > 0.0, passed / *way, 0.0);
}

/* Time at which `along` reaches a value, held at the ends: Eq. (1) of onboard/flown_references.py. */
static double instant_of(const ampi_table *table, const ampi_guidance *guidance, double value)
{
    const double *along = guidance->along, final_time = guidance->reference.final_time;
    const size_t last = table->n.points - 1u;
    double way, w, begin, end, slope, before, after, left, right, bend, other, inside, ahead, back;
    bool is_left, is_right, jumps;
    size_t i = 0u, n;

    for (n = last; n > 1u; n -= n / 2u) { /* the last point but one that is reached */
        i = (along[i + n / 2u] <= value) ? (i + n / 2u) : i;
    }
    way = along[i + 1u] - along[i];
    w = clipped((value - along[i]) / way, 0.0, 1.0);
    begin = time_of(table, final_time, i);
    end = time_of(table, final_time, i + 1u);
    slope = (end - begin) / way;
    left = slope_between(table, guidance, i, (i > 0u) ? (i - 1u) : 0u, &before);
    right = slope_between(table, guidance, i + 1u, ((i + 2u) < last) ? (i + 2u) : last, &after);
    is_left = (left <= (ALIKE * slope)) & (slope <= (ALIKE * left)); /* & : as many instructions */
    is_right = (right <= (ALIKE * slope)) & (slope <= (ALIKE * right));
    bend = chosen(is_left, way * (left - slope) / (way + before), 0.0);
    other = chosen(is_right, way * (right - slope) / (way + after), -bend);
    bend = chosen(is_left, bend, -other);
    inside = clipped(value, along[i], along[i + 1u]);
    ahead = least(begin + (inside - along[i]) * left, end);
    back = most(end - (along[i + 1u] - inside) * right, begin);
    jumps = ((left > 0.0) & (right > 0.0)) & ((!is_left) & (!is_right));
    return chosen(jumps, chosen(w < 0.5, ahead, back),
                  begin + way * w * (slope + (1.0 - w) * ((1.0 - w) * bend - w * other)));
}

double ampi_instant(const ampi_guidance *guidance, const ampi_table *table, const double *state,
                    const double *sensed, bool *is_ended, bool *is_lost)
{
    const double *gain = table->set.gain;
    const bool is_by_time = (table->n.law == AMPI_LINEAR_QUADRATIC);
    const double last = guidance->along[table->n.points - 1u];
    const double end = is_by_time ? guidance->reference.final_time : last;
    const bool is_felt = !is_by_time && !(-sensed[0] <= gain[FELT_DRAG]); /* not known: felt */
    double value = guidance->now + (is_by_time ? 0.0 : BEFORE_AIR);

    value = chosen(is_felt, energy_lost(gain, state[ALTITUDE], state[SPEED]), value);
    *is_ended = (value >= end);
    *is_lost = (value != value);
    value = chosen(*is_lost, end, value);
    return is_by_time ? value : instant_of(table, guidance, value);
}

static accelerations sensed_of(const double *at, const double *sensed)
{
    const double drag = -sensed[0], lift = sqrt(sensed[1] * sensed[1] + sensed[2] * sensed[2]);
    const double reference = exp(at[LOG_DRAG]);
    accelerations felt = {drag, lift, (drag > 0.0) & (drag < HUGE_VAL) & (lift < HUGE_VAL)};

    felt.drag = chosen(felt.is_known, drag, reference);
    felt.lift = chosen(felt.is_known, lift, reference * fabs(at[LIFT_TO_DRAG]));
    return felt;
}

/* Sign of the bank angle: the reference's, unless the heading has left the deadband, Eq. (2). */
static double side_of(const double *gain, const double *at, const double *state, double *turning)
{
    const double east = wrapped(state[LONGITUDE] - at[LONGITUDE]) * cos(at[LATITUDE]);
    const double north = state[LATITUDE] - at[LATITUDE];
    const double right = gain[RADIUS] * (east * cos(at[AZIMUTH]) - north * sin(at[AZIMUTH]));
    const double turned = wrapped(state[AZIMUTH] - at[AZIMUTH]);
    const double error = turned + right / most(at[RANGE_TO_GO], gain[LEAST_RANGE]);
    const bool goes_on = ((*turning * error) < 0.0) & (fabs(error) > (0.5 * gain[DEADBAND]));

    *turning = chosen(goes_on, *turning, 0.0);
    *turning = chosen(fabs(error) > gain[DEADBAND], chosen(error > 0.0, -1.0, 1.0), *turning);
    return chosen(*turning != 0.0, *turning, chosen(at[BANK] < 0.0, -1.0, 1.0));
}

/* Bank rate towards a bank angle of this cosine, the reference's until the air is felt, on the side of
   the lateral logic. */
static double steered(const double *gain, const double *at, const double *state, accelerations felt,
                      double cosine, double *turning)
{
    const double inside = clipped(cosine, -1.0, 1.0);
    const bool is_used = (felt.drag > gain[FELT_DRAG]) & (inside == inside);
    const double size = chosen(is_used, acos(inside), fabs(at[BANK]));
    const double side = side_of(gain, at, state, turning), own = chosen(at[BANK] < 0.0, -1.0, 1.0);
    const double missing = side * size - state[BANK], far = fabs(missing);
    const double approach = least(gain[TURN_RATE] * far, sqrt(2.0 * gain[BRAKING] * far));
    const double rate = side * own * at[BANK_RATE] + copysign(approach, missing);
    return chosen(fabs(rate) < HUGE_VAL, rate, at[BANK_RATE]);
}

/* e of Eq. (3): of the drag without the change of the angle of attack. */
static double error_of(const double *at, accelerations felt, double change)
{
    const double off = log(felt.drag / exp(at[LOG_DRAG])) - at[DRAG_SLOPE] * change;
    return chosen(felt.is_known, off, 0.0);
}

/* Eq. (3), beside a bank angle of this cosine. */
static double modulation(const double *gain, const double *at, accelerations felt, double error,
                         double cosine)
{
    const double steep = most(at[DRAG_SLOPE], LEAST_SLOPE);
    const double wanted = most(-error, -most(1.0 - cosine, 0.0)) / steep;
    const bool acts = (felt.drag > gain[FELT_DRAG]) & (at[DRAG_SLOPE] >= LEAST_SLOPE)
                      & (fabs(cosine) < HUGE_VAL);
    return chosen(acts, wanted, 0.0);
}

static double drag_shuttle(ampi_guidance *guidance, const ampi_table *table, const double *state,
                           const double *sensed, double *angle)
{
    const double *at = guidance->row, *gain = table->set.gain;
    const accelerations felt = sensed_of(at, sensed);
    const bool modulates = table->n.modulates != 0u;
    const double error = modulates ? error_of(at, felt, guidance->change) : 0.0;
    const double drag = modulates ? (exp(at[LOG_DRAG]) * exp(error)) : felt.drag;
    const double climb = state[SPEED] * sin(state[PATH_ANGLE]) - at[SPEED] * sin(at[PATH_ANGLE]);
    const double more = drag - exp(at[LOG_DRAG]);
    const double vertical = at[LIFT_TO_DRAG] * cos(at[BANK]) + gain[DRAG_GAIN] * more
                            + gain[DESCENT_GAIN] * climb; /* Eq. (1) */
    const double cosine = vertical * felt.drag / felt.lift;
    *angle = modulates ? modulation(gain, at, felt, error, cosine) : 0.0;
    return steered(gain, at, state, felt, cosine, &guidance->memory[TURNING]);
}

static double drag_sliding_mode(ampi_guidance *guidance, const ampi_table *table,
                                const double *state, const double *sensed, double *angle)
{
    const double *at = guidance->row, *gain = table->set.gain;
    const accelerations felt = sensed_of(at, sensed);
    const double step = guidance->expected, drag = exp(at[LOG_DRAG]);
    const double far = gain[RADIUS] + state[ALTITUDE], gravity = gain[MU] / (far * far);
    const double inverse = 1.0 / at[SCALE_HEIGHT] + 2.0 * gravity / (state[SPEED] * state[SPEED]);
    const double climb = sin(state[PATH_ANGLE]) - felt.drag / drag * sin(at[PATH_ANGLE]);
    const double rate = -inverse * state[SPEED] * climb; /* Eq. (2) */
    const double authority = inverse * cos(state[PATH_ANGLE]);
    const double vertical = drag * at[LIFT_TO_DRAG] * cos(at[BANK]);
    const double above = felt.lift * cos(state[BANK]) - vertical;
    const double bound = gain[MOST_DISTURBANCE] * felt.lift * authority;
    const double forgotten = -expm1(-gain[BANDWIDTH] * step);
    double *memory = guidance->memory;
    const double error = error_of(at, felt, guidance->change);
    const double s = rate + gain[LAMBDA] * drag * error;
    const double known = gain[LAMBDA] * drag * rate - authority * above;
    const bool is_acting = (felt.drag > gain[FELT_DRAG]) & (fabs(s + known) < HUGE_VAL);
    const double ahead = memory[SURFACE] + step * (known + memory[DISTURBANCE]); /* the observer */
    const double d = memory[DISTURBANCE] + forgotten * forgotten / step * (s - ahead);
    double asked, cosine;

    memory[DISTURBANCE] = chosen(is_acting, clipped(d, -bound, bound), 0.0);
    memory[SURFACE] = chosen(is_acting, ahead + forgotten * (2.0 - forgotten) * (s - ahead), 0.0);
    asked = gain[REACHING] * s + gain[SWITCHING] * s / (fabs(s) + gain[BOUNDARY]);
    asked = memory[DISTURBANCE] + drag * (gain[LAMBDA] * rate + asked);
    cosine = (vertical + asked / authority) / felt.lift; /* Eq. (4) */
    *angle = modulation(gain, at, felt, error, chosen(is_acting, cosine, AMPI_NAN));
    *angle = chosen(table->n.modulates != 0u, *angle, 0.0);
    return steered(gain, at, state, felt, cosine, &memory[TURNING]);
}

double ampi_law_command(ampi_guidance *guidance, const ampi_table *table, const double *state,
                        const double *sensed, double *angle)
{
    double rate;

    if (table->n.law == AMPI_LINEAR_QUADRATIC) {
        rate = linear_quadratic(table, guidance->row, state, angle);
    } else if (table->n.law == AMPI_DRAG_SHUTTLE) {
        rate = drag_shuttle(guidance, table, state, sensed, angle);
    } else {
        rate = drag_sliding_mode(guidance, table, state, sensed, angle);
    }
    return rate;
}
