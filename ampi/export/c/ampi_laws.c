/* The tracking laws, as ampi/tracking/{linear_quadratic,drag_reference,drag_sliding_mode,drag_shuttle}.py
   derive them; equation numbers are theirs. */
#include "ampi_parts.h"

#define BEFORE_AIR (-1e9) /* J/kg: below -E of whatever enters; times are counted from it */
#define DISTINCT 1e-3     /* s or J/kg between points of a reference, lest two are the same */
#define LEAST_SLOPE 0.1   /* 1/rad: an angle of attack that changes the drag less is left alone */

/* Gains, as `ampi.export.blob` writes them: those of both drag laws, then of the one. */
enum {
    MU = 0, RADIUS, FELT_DRAG, DEADBAND, LEAST_RANGE, TURNING_RATE, BRAKING, FIRST_OF_LAW,
    DRAG_GAIN = FIRST_OF_LAW, DESCENT_GAIN,
    LAMBDA = FIRST_OF_LAW, REACHING, SWITCHING, BOUNDARY, BANDWIDTH, MOST_DISTURBANCE, MOST_ANGLE,
    ANGLE_RATE
};

/* Memory of the drag laws. */
enum { TURNING = 0, SURFACE, DISTURBANCE, ANGLE };

typedef struct {
    double drag, lift; /* m/s^2, the reference's where they are not known */
    int is_known;
} accelerations;

/* `angle` in [-pi, pi), to the bit as Python's modulo: a power of two of turns is exact, a multiple by
   division is not; fmod would take as many instructions as the angle has turns. */
static double wrapped(double angle)
{
    const double shifted = angle + AMPI_PI;
    double rest = fabs(shifted), turns;

    rest -= (32.0 * AMPI_TURN) * floor(rest / (32.0 * AMPI_TURN));
    for (turns = 16.0; turns >= 1.0; turns *= 0.5) {
        rest -= (rest >= (turns * AMPI_TURN)) ? (turns * AMPI_TURN) : 0.0;
    }
    rest = ((shifted < 0.0) && (rest > 0.0)) ? (AMPI_TURN - rest) : rest;
    return rest - AMPI_PI;
}

static double linear_quadratic(const double *at, const double *state)
{
    double error[AMPI_N_STATES], sum = 0.0;
    size_t i;
    for (i = 0u; i < AMPI_N_STATES; i++) {
        error[i] = state[i] - at[i];
    }
    error[AMPI_LONGITUDE] = wrapped(error[AMPI_LONGITUDE]);
    error[AMPI_AZIMUTH] = wrapped(error[AMPI_AZIMUTH]);
    for (i = 0u; i < AMPI_N_STATES; i++) {
        sum += at[(size_t)AMPI_FIRST_GAIN + i] * error[i];
    }
    return at[AMPI_BANK_RATE] - sum;
}

/* Minus E of Eq. (1), J/kg. */
static double energy_lost(const double *gain, double altitude, double speed)
{
    return -(0.5 * speed * speed - gain[MU] / (gain[RADIUS] + altitude));
}

void ampi_along(const ampi_table *table, const ampi_reference *reference, double *along)
{
    ampi_real block[AMPI_MAX_DEGREE_NODES * AMPI_BLOCK], drag[AMPI_BLOCK], height[AMPI_BLOCK];
    ampi_real speed[AMPI_BLOCK];
    const size_t n = table->n_nodes;
    double most = -HUGE_VAL;
    int is_felt = 0;
    size_t s, b, j, point = 0u;

    for (s = 0u; s < table->n_segments; s++) {
        const ampi_segment *segment = &table->segment[s];
        const ampi_real *values = &reference->rows[segment->first_node];
        const size_t nodes = segment->nodes;
        for (b = 0u; (b * AMPI_BLOCK) < segment->points; b++) {
            ampi_load_block(table, segment, b, block);
            ampi_convert(block, &values[(size_t)AMPI_LOG_DRAG * n], nodes, drag);
            ampi_convert(block, &values[(size_t)AMPI_ALTITUDE * n], nodes, height);
            ampi_convert(block, &values[(size_t)AMPI_SPEED * n], nodes, speed);
            for (j = 0u; (j < AMPI_BLOCK) && ((b * AMPI_BLOCK + j) < segment->points); j++) {
                const double lost = energy_lost(table->gain, (double)height[j], (double)speed[j]);
                const double time = ampi_time_of(table, reference, point);
                is_felt |= (exp((double)drag[j]) > table->gain[FELT_DRAG]) ? 1 : 0;
                most = ampi_max(most, (is_felt != 0) ? lost : (BEFORE_AIR + time));
                along[point] = most + DISTINCT * (double)point;
                point++;
            }
        }
    }
}

double ampi_instant(const ampi_guidance *guidance, const ampi_table *table, const double *state,
                    const double *sensed, int *ended, int *lost)
{
    const double *along = guidance->along;
    const size_t last = table->n_points - 1u;
    const int is_by_time = (table->law == (size_t)AMPI_LINEAR_QUADRATIC) ? 1 : 0;
    const double end = (is_by_time != 0) ? guidance->reference.final_time : along[last];
    double value = guidance->now, w, before;
    size_t i = 0u, step;

    if ((is_by_time == 0) && (-sensed[0] <= table->gain[FELT_DRAG])) {
        value += BEFORE_AIR;
    } else if (is_by_time == 0) { /* a drag that is not known counts as felt */
        value = energy_lost(table->gain, state[AMPI_ALTITUDE], state[AMPI_SPEED]);
    } else {
        /* the time */
    }
    *ended = (value >= end) ? 1 : 0;
    *lost = (value != value) ? 1 : 0;
    value = (*lost != 0) ? end : value;
    if (is_by_time != 0) {
        return value;
    }
    for (step = AMPI_MAX_POINTS; step > 0u; step /= 2u) { /* the last point at or below the value */
        i += (((i + step) < last) && (along[(i + step < last) ? (i + step) : 0u] <= value)) ? step : 0u;
    }
    w = ampi_clipped((value - along[i]) / (along[i + 1u] - along[i]), 0.0, 1.0);
    before = ampi_time_of(table, &guidance->reference, i);
    return before + w * (ampi_time_of(table, &guidance->reference, i + 1u) - before);
}

/* Drag and lift, as sensed where they are. */
static accelerations sensed_of(const double *at, const double *sensed)
{
    const double reference = exp(at[AMPI_LOG_DRAG]);
    const double drag = -sensed[0], lift = sqrt(sensed[1] * sensed[1] + sensed[2] * sensed[2]);
    accelerations felt;

    felt.is_known = ((drag > 0.0) && (drag < HUGE_VAL) && (lift < HUGE_VAL)) ? 1 : 0;
    felt.drag = (felt.is_known != 0) ? drag : reference;
    felt.lift = (felt.is_known != 0) ? lift : (reference * fabs(at[AMPI_LIFT_TO_DRAG]));
    return felt;
}

/* Bank angle without sign of this cosine; the reference's until the air is felt. */
static double size_of(const double *gain, const double *at, accelerations felt, double cosine)
{
    const double inside = ampi_clipped(cosine, -1.0, 1.0);
    const int is_used = (felt.drag > gain[FELT_DRAG]) && (inside == inside);
    return is_used ? acos(inside) : fabs(at[AMPI_BANK]);
}

/* Sign of the bank angle: the reference's, unless the heading has left the deadband, Eq. (2). */
static double side_of(const double *gain, const double *at, const double *state, double *turning)
{
    const double east = wrapped(state[AMPI_LONGITUDE] - at[AMPI_LONGITUDE]) * cos(at[AMPI_LATITUDE]);
    const double north = state[AMPI_LATITUDE] - at[AMPI_LATITUDE];
    const double right = gain[RADIUS] * (east * cos(at[AMPI_AZIMUTH]) - north * sin(at[AMPI_AZIMUTH]));
    const double to_go = ampi_max(at[AMPI_RANGE_TO_GO], gain[LEAST_RANGE]);
    const double error = wrapped(state[AMPI_AZIMUTH] - at[AMPI_AZIMUTH]) + right / to_go;
    const int goes_on = ((*turning * error) < 0.0) && (fabs(error) > (0.5 * gain[DEADBAND]));

    *turning = goes_on ? *turning : 0.0;
    if (fabs(error) > gain[DEADBAND]) {
        *turning = (error > 0.0) ? -1.0 : 1.0;
    }
    return (*turning != 0.0) ? *turning : ((at[AMPI_BANK] < 0.0) ? -1.0 : 1.0);
}

/* Bank rate towards a bank angle of this size, on the side of the lateral logic. */
static double steered(const double *gain, const double *at, const double *state, double size,
                      double *turning)
{
    const double side = side_of(gain, at, state, turning);
    const double own = (at[AMPI_BANK] < 0.0) ? -1.0 : 1.0;
    const double missing = side * size - state[AMPI_BANK];
    const double most = fabs(missing);
    const double approach = ampi_min(gain[TURNING_RATE] * most, sqrt(2.0 * gain[BRAKING] * most));
    const double rate = side * own * at[AMPI_BANK_RATE] + copysign(approach, missing);
    return (fabs(rate) < HUGE_VAL) ? rate : at[AMPI_BANK_RATE];
}

static double drag_shuttle(ampi_guidance *guidance, const double *gain, const double *state,
                           const double *sensed)
{
    const double *at = guidance->row;
    const accelerations felt = sensed_of(at, sensed);
    const double climb = state[AMPI_SPEED] * sin(state[AMPI_PATH_ANGLE])
                         - at[AMPI_SPEED] * sin(at[AMPI_PATH_ANGLE]);
    const double more = felt.drag - exp(at[AMPI_LOG_DRAG]);
    double vertical = at[AMPI_LIFT_TO_DRAG] * cos(at[AMPI_BANK]);

    vertical = vertical + gain[DRAG_GAIN] * more + gain[DESCENT_GAIN] * climb;
    vertical = vertical * felt.drag / felt.lift;
    return steered(gain, at, state, size_of(gain, at, felt, vertical), &guidance->memory[TURNING]);
}

static double drag_sliding_mode(ampi_guidance *guidance, const double *gain, const double *state,
                                const double *sensed, double *angle)
{
    const double *at = guidance->row;
    const accelerations felt = sensed_of(at, sensed);
    const double step = guidance->expected;
    const double drag = exp(at[AMPI_LOG_DRAG]), slope = at[AMPI_DRAG_SLOPE];
    const double far = gain[RADIUS] + state[AMPI_ALTITUDE];
    const double gravity = gain[MU] / (far * far);
    const double inverse = 1.0 / at[AMPI_SCALE_HEIGHT]
                           + 2.0 * gravity / (state[AMPI_SPEED] * state[AMPI_SPEED]); /* Eq. (1) */
    const double climb = sin(state[AMPI_PATH_ANGLE]) - felt.drag / drag * sin(at[AMPI_PATH_ANGLE]);
    const double rate = -inverse * state[AMPI_SPEED] * climb; /* Eq. (2) */
    const double authority = inverse * cos(state[AMPI_PATH_ANGLE]);
    const double vertical = drag * at[AMPI_LIFT_TO_DRAG] * cos(at[AMPI_BANK]);
    const double above = felt.lift * cos(state[AMPI_BANK]) - vertical;
    const double most = gain[MOST_DISTURBANCE] * felt.lift * authority;
    const double steep = ampi_max(slope, LEAST_SLOPE);
    const double forgotten = -expm1(-gain[BANDWIDTH] * step);
    double *memory = guidance->memory;
    double error = log(felt.drag / drag) - slope * memory[ANGLE];
    double s, known, ahead, d, reaching, cosine, spare, wanted, size;
    int is_acting;

    error = (felt.is_known != 0) ? error : 0.0;
    s = rate + gain[LAMBDA] * drag * error;
    known = gain[LAMBDA] * drag * rate - authority * above;
    is_acting = (felt.drag > gain[FELT_DRAG]) && (fabs(s + known) < HUGE_VAL);
    ahead = memory[SURFACE] + step * (known + memory[DISTURBANCE]); /* the observer of (s, d) */
    d = memory[DISTURBANCE] + forgotten * forgotten / step * (s - ahead);
    memory[DISTURBANCE] = is_acting ? ampi_clipped(d, -most, most) : 0.0;
    memory[SURFACE] = is_acting ? (ahead + forgotten * (2.0 - forgotten) * (s - ahead)) : 0.0;

    reaching = gain[REACHING] * s + gain[SWITCHING] * s / (fabs(s) + gain[BOUNDARY]);
    cosine = memory[DISTURBANCE] + drag * (gain[LAMBDA] * rate + reaching);
    cosine = (vertical + cosine / authority) / felt.lift; /* Eq. (4) */
    spare = is_acting ? ampi_max(1.0 - cosine, 0.0) : 0.0;
    wanted = (is_acting && (slope >= LEAST_SLOPE)) ? (-error / steep) : 0.0; /* Eq. (5) */
    wanted = ampi_clipped(ampi_max(wanted, -spare / steep), -gain[MOST_ANGLE], gain[MOST_ANGLE]);
    memory[ANGLE] = ampi_clipped(wanted, memory[ANGLE] - gain[ANGLE_RATE] * step,
                                 memory[ANGLE] + gain[ANGLE_RATE] * step);
    *angle = memory[ANGLE];
    size = size_of(gain, at, felt, cosine);
    return steered(gain, at, state, size, &memory[TURNING]);
}

double ampi_law_command(ampi_guidance *guidance, const ampi_table *table, const double *state,
                        const double *sensed, double *angle)
{
    double asked;
    *angle = 0.0;
    if (table->law == (size_t)AMPI_LINEAR_QUADRATIC) {
        asked = linear_quadratic(guidance->row, state);
    } else if (table->law == (size_t)AMPI_DRAG_SHUTTLE) {
        asked = drag_shuttle(guidance, table->gain, state, sensed);
    } else {
        asked = drag_sliding_mode(guidance, table->gain, state, sensed, angle);
    }
    return asked;
}
