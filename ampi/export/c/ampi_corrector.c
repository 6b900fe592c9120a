/* The predictor-corrector of the plan that is flown, as ampi/correction. */
#include "ampi_correction_parts.h"

#define NEVER 1e300 /* cost of a flight that does not arrive at the target's speed */
#define BISECTIONS 40u
#define ROUNDS 10u   /* of the active set, at the most */
#define REJECTIONS 6u /* of one step, at the most */
#define BANK_STEP 0.01    /* rad, of the differences */
#define CHANGE_STEP 0.003 /* rad */
#define CHANGE 7u /* place of the change of the angle of attack in a point's state */

/* What a prediction needs besides the plan. */
typedef struct {
    const ampi_model_data *model;
    const ampi_estimate *estimate;
    const double *target; /* h, theta, phi, V */
    double rate, angle;   /* limits of bank rate and bank angle */
} ampi_setting;

double ampi_equivalent_speed(const ampi_model_data *model, const double *target, const double *state)
{
    const double height = 2.0 * model->load_gravity * (state[ALTITUDE] - target[0]);
    return sqrt(most(state[SPEED] * state[SPEED] + height, 0.0));
}

double ampi_planned(const ampi_plan *plan, size_t first, size_t count, double speed)
{
    const double *value = &plan->value[first];
    const double last = (double)count - 1.0;
    const double place = clipped((plan->fast - speed) / (plan->fast - plan->slow) * last, 0.0, last);
    size_t below = count - 2u; /* of what is no number too */
    double share;
    if ((place == place) && (place < last)) { below = (place > 0.0) ? (size_t)place : 0u; }
    share = place - (double)below;
    return value[below] + share * (value[below + 1u] - value[below]);
}

/* Steers a state that is `passed` s after the begin of a step: it follows the plan as fast as it can. */
static void steer(const ampi_setting *with, const ampi_plan *plan, const double *begin, double passed,
                  double *state)
{
    const double speed = ampi_equivalent_speed(with->model, with->target, state);
    const double bank = with->rate * passed, change = with->model->corrector.change_rate * passed;
    state[BANK] = clipped(ampi_planned(plan, 0u, AMPI_N_BANKS, speed), begin[BANK] - bank,
                          begin[BANK] + bank);
    state[CHANGE] = clipped(ampi_planned(plan, AMPI_N_BANKS, AMPI_N_ANGLES, speed),
                            begin[CHANGE] - change, begin[CHANGE] + change);
}

static ampi_air rates_at(const ampi_setting *with, const double *state, double time, double *rates)
{
    const ampi_angles angles = ampi_angles_of(state);
    const ampi_factors factors = ampi_factors_at(with->estimate, with->model, state[ALTITUDE]);
    const double angle = ampi_scheduled_angle(with->model, time, state[SPEED]);
    const ampi_air air =
        ampi_air_at(with->model, &factors, state, &angles, angle + (factors.angle + state[CHANGE]));
    ampi_rates(with->model, state, &angles, &air, rates);
    return air;
}

/* Rates, loads and equivalent speed of a point whose state is known. */
static void complete(const ampi_setting *with, ampi_point *point, const double *peak_before)
{
    const ampi_air air = rates_at(with, point->state, point->time, point->rates);
    double use[3];
    size_t i;
    ampi_use(with->model, &air, use);
    for (i = 0u; i < 3u; i++) { point->peak[i] = most(use[i], peak_before[i]); }
    point->speed = ampi_equivalent_speed(with->model, with->target, point->state);
}

/* As long a step as may be, to the next kink of the schedule of the angle of attack. */
static double step_from(const ampi_model_data *model, double time)
{
    double step = model->corrector.step;
    if (model->schedule.over_time != 0.0) {
        const double start = model->schedule.start - time, end = model->schedule.end - time;
        if (start > 1e-6) { step = least(step, start); }
        if (end > 1e-6) { step = least(step, end); }
    }
    return step;
}

/* One Runge-Kutta step. */
static void fly_step(const ampi_setting *with, const ampi_plan *plan, const ampi_point *from,
                    ampi_point *to)
{
    const double h = step_from(with->model, from->time);
    const double part[3] = {0.5 * h, 0.5 * h, h};
    double sum[6], rates[6];
    size_t stage, i;

    for (i = 0u; i < 6u; i++) {
        sum[i] = from->rates[i];
        rates[i] = from->rates[i];
    }
    for (stage = 0u; stage < 3u; stage++) {
        const double weight = (stage < 2u) ? 2.0 : 1.0;
        for (i = 0u; i < 6u; i++) { to->state[i] = from->state[i] + part[stage] * rates[i]; }
        steer(with, plan, from->state, part[stage], to->state);
        (void)rates_at(with, to->state, from->time + part[stage], rates);
        for (i = 0u; i < 6u; i++) { sum[i] += weight * rates[i]; }
    }
    for (i = 0u; i < 6u; i++) { to->state[i] = from->state[i] + h / 6.0 * sum[i]; }
    steer(with, plan, from->state, h, to->state);
    to->time = from->time + h;
    complete(with, to, from->peak);
}

/* Cubic through two points, a share w of the way. */
static double between(const ampi_point *from, const ampi_point *to, size_t row, double w)
{
    const double h = to->time - from->time, way = to->state[row] - from->state[row];
    const double first = h * from->rates[row], last = h * to->rates[row];
    const double bend = 3.0 * way - 2.0 * first - last, twist = first + last - 2.0 * way;
    return from->state[row] + w * (first + w * (bend + w * twist));
}

/* Where the target's speed is reached between two points: the miss and the excess of the limits. */
static double arrive(const ampi_setting *with, const ampi_point *from, const ampi_point *to,
                     double *missed)
{
    const double *target = with->target, least_share = 1.0 - with->model->corrector.margin;
    double low = 0.0, high = 1.0, w;
    size_t i;
    for (i = 0u; i < BISECTIONS; i++) {
        const double middle = 0.5 * (low + high);
        const bool is_fast = between(from, to, SPEED, middle) > target[3];
        low = is_fast ? middle : low;
        high = is_fast ? high : middle;
    }
    w = 0.5 * (low + high);
    missed[0] = with->model->radius * cos(target[2])
                * on_turn_of(between(from, to, LONGITUDE, w) - target[1], 0.0);
    missed[1] = with->model->radius * (between(from, to, LATITUDE, w) - target[2]);
    missed[2] = between(from, to, ALTITUDE, w) - target[0];
    for (i = 0u; i < 3u; i++) { missed[3u + i] = most(from->peak[i] - least_share, 0.0); }
    return from->time + w * (to->time - from->time);
}

/* Flies a plan from point `first` of the path on, and keeps the points if `keeps`. Whether it arrives. */
static bool predict(ampi_corrector *corrector, const ampi_setting *with, const ampi_plan *plan,
                    size_t first, bool keeps, double *missed)
{
    const size_t most_points = AMPI_MAX_STEPS - 1u;
    ampi_point here = corrector->path[first], next = here;
    size_t i = first;
    bool flies = true, arrives = false;

    corrector->propagations += 1u;
    while (flies && (i < most_points)) {
        fly_step(with, plan, &here, &next);
        i += 1u;
        arrives = next.state[SPEED] <= with->target[3];
        flies = (next.state[SPEED] > with->target[3]) && (next.state[ALTITUDE] > 0.0)
                && ((next.time - corrector->path[0].time) < with->model->corrector.longest);
        if (keeps) { corrector->path[i] = next; }
        if (flies) { here = next; }
    }
    arrives = arrives && (here.state[SPEED] > with->target[3]);
    if (arrives) {
        const double end = arrive(with, &here, &next, missed);
        if (keeps) {
            corrector->to_go = end - corrector->path[0].time;
            corrector->points = (uint32_t)i;
        }
    }
    return arrives;
}

/* The quadratic form of a plan's roughness: second differences of the bank angles. */
static double second_difference(const double *value, size_t i)
{
    return value[i] - 2.0 * value[i + 1u] + value[i + 2u];
}

static double cost_of(const ampi_model_data *model, const double *missed, const double *value)
{
    double sum = 0.0;
    size_t i;
    for (i = 0u; i < AMPI_N_MISSED; i++) {
        const double weighted = model->corrector.weight[i] * missed[i];
        sum += weighted * weighted;
    }
    for (i = 0u; i < (AMPI_N_BANKS - 2u); i++) {
        const double bend = second_difference(value, i);
        sum += model->corrector.plan_roughness * bend * bend;
    }
    for (i = AMPI_N_BANKS; i < AMPI_N_PLAN; i++) {
        sum += model->corrector.plan_change * value[i] * value[i];
    }
    return 0.5 * sum;
}

typedef struct {
    double matrix[AMPI_N_PLAN][AMPI_N_PLAN], right[AMPI_N_PLAN];
} ampi_normal_equations;

static void add_bend(ampi_normal_equations *of, size_t i, double weight)
{
    static const double STENCIL[3] = {1.0, -2.0, 1.0};
    size_t k, j;
    for (k = 0u; k < 3u; k++) {
        for (j = 0u; j < 3u; j++) { of->matrix[i + k][i + j] += weight * STENCIL[k] * STENCIL[j]; }
    }
}

/* (J'W2J + plan + lambda D) d = -(J'W2 e + plan p). */
static void set_equations(const ampi_corrector *corrector, const ampi_model_data *model,
                          const double *missed, double lambda, ampi_normal_equations *of)
{
    const double *value = corrector->plan.value;
    size_t i, j, k;
    (void)memset(of, 0, sizeof *of);
    for (k = 0u; k < AMPI_N_MISSED; k++) {
        const double weight = model->corrector.weight[k] * model->corrector.weight[k];
        const double *slope = corrector->jacobian[k];
        for (i = 0u; i < AMPI_N_PLAN; i++) {
            of->right[i] -= weight * slope[i] * missed[k];
            for (j = 0u; j < AMPI_N_PLAN; j++) { of->matrix[i][j] += weight * slope[i] * slope[j]; }
        }
    }
    for (i = 0u; i < (AMPI_N_BANKS - 2u); i++) {
        const double weight = model->corrector.plan_roughness;
        const double bend = weight * second_difference(value, i);
        of->right[i] -= bend;
        of->right[i + 1u] += 2.0 * bend;
        of->right[i + 2u] -= bend;
        add_bend(of, i, weight + lambda * model->corrector.roughness);
    }
    for (i = 0u; i < AMPI_N_BANKS; i++) { of->matrix[i][i] += lambda * model->corrector.size; }
    for (i = AMPI_N_BANKS; i < AMPI_N_PLAN; i++) {
        of->right[i] -= model->corrector.plan_change * value[i];
        of->matrix[i][i] += model->corrector.plan_change + lambda * model->corrector.change_size;
    }
}

/* Solves for the entries that are free, the others being given in `step`; Cholesky. */
static void solve_free(const ampi_normal_equations *of, const bool *is_free, double *step)
{
    double lower[AMPI_N_PLAN][AMPI_N_PLAN], solved[AMPI_N_PLAN];
    size_t at[AMPI_N_PLAN] = {0u}, n = 0u, i, j, k;
    (void)memset(lower, 0, sizeof lower);
    (void)memset(solved, 0, sizeof solved);
    for (i = 0u; i < AMPI_N_PLAN; i++) {
        if (is_free[i]) { at[n] = i; n += 1u; }
    }
    for (i = 0u; i < n; i++) {
        double sum = of->right[at[i]];
        for (j = 0u; j < AMPI_N_PLAN; j++) {
            sum -= is_free[j] ? 0.0 : (of->matrix[at[i]][j] * step[j]);
        }
        for (j = 0u; j <= i; j++) {
            double entry = of->matrix[at[i]][at[j]];
            for (k = 0u; k < j; k++) { entry -= lower[i][k] * lower[j][k]; }
            lower[i][j] = (i == j) ? sqrt(most(entry, 1e-300)) : (entry / lower[j][j]);
        }
        for (k = 0u; k < i; k++) { sum -= lower[i][k] * solved[k]; }
        solved[i] = sum / lower[i][i];
    }
    for (i = n; i > 0u; i--) {
        const double own = solved[i - 1u] / lower[i - 1u][i - 1u];
        for (k = 0u; k < (i - 1u); k++) { solved[k] -= lower[i - 1u][k] * own; }
        step[at[i - 1u]] = own;
    }
}

static double bound_of(const ampi_setting *with, size_t i)
{
    return (i < AMPI_N_BANKS) ? with->angle : with->model->corrector.change;
}

/* Lets go what is held at a bound and would come back from it by itself. Whether there is such a thing. */
static bool let_go(const ampi_corrector *corrector, const ampi_setting *with,
                   const ampi_normal_equations *of, const double *step, bool *is_free)
{
    bool has_changed = false;
    size_t i, j;
    for (i = 0u; i < AMPI_N_PLAN; i++) {
        const double bound = bound_of(with, i), value = corrector->plan.value[i];
        double slope = 0.0;
        for (j = 0u; j < AMPI_N_PLAN; j++) { slope += of->matrix[i][j] * step[j]; }
        slope -= of->right[i];
        if (!is_free[i]
            && (((step[i] >= (bound - value)) && (slope > 0.0))
                || ((step[i] <= (-bound - value)) && (slope < 0.0)))) {
            is_free[i] = true;
            has_changed = true;
        }
    }
    return has_changed;
}

/* The step that keeps the bounds: what would leave them is held there, and the rest is solved anew. */
static void set_step(const ampi_corrector *corrector, const ampi_setting *with,
                     const ampi_normal_equations *of, double *step)
{
    bool is_free[AMPI_N_PLAN], has_changed = true;
    double size = 0.0;
    size_t i, round;
    for (i = 0u; i < AMPI_N_PLAN; i++) {
        const double bound = bound_of(with, i), value = corrector->plan.value[i];
        const bool is_high = (value >= bound) && (of->right[i] >= 0.0);
        const bool is_low = (value <= -bound) && (of->right[i] <= 0.0);
        is_free[i] = !(is_high || is_low);
        step[i] = 0.0;
    }
    for (round = 0u; (round < ROUNDS) && has_changed; round++) {
        has_changed = false;
        solve_free(of, is_free, step);
        for (i = 0u; i < AMPI_N_PLAN; i++) {
            const double bound = bound_of(with, i), value = corrector->plan.value[i];
            const double kept = clipped(step[i], -bound - value, bound - value);
            if (is_free[i] && (kept != step[i])) {
                is_free[i] = false;
                has_changed = true;
            }
            step[i] = kept;
        }
        if (!has_changed) { has_changed = let_go(corrector, with, of, step, is_free); }
    }
    for (i = 0u; i < AMPI_N_BANKS; i++) { size = most(size, fabs(step[i])); }
    if (size > with->model->corrector.longest_step) {
        for (i = 0u; i < AMPI_N_PLAN; i++) { step[i] *= with->model->corrector.longest_step / size; }
    }
}

/* A point from which on the value i of the plan may make a difference: a step before the one that comes
   to its speeds, as the stages of a step may be slower than both its points. */
static size_t first_point(const ampi_corrector *corrector, size_t i)
{
    const bool is_bank = i < AMPI_N_BANKS;
    const size_t count = is_bank ? AMPI_N_BANKS : AMPI_N_ANGLES;
    const size_t own = is_bank ? i : (i - AMPI_N_BANKS);
    const double way = (corrector->plan.fast - corrector->plan.slow) / ((double)count - 1.0);
    const double fast = corrector->plan.fast - ((double)own - 1.0) * way;
    size_t at = 0u;
    while (((at + 2u) < corrector->points) && (corrector->path[at + 1u].speed > fast)) { at += 1u; }
    return ((own < 2u) || (at == 0u)) ? 0u : (at - 1u);
}

static void set_jacobian(ampi_corrector *corrector, const ampi_setting *with, const double *missed)
{
    size_t i, k;
    for (i = 0u; i < AMPI_N_PLAN; i++) {
        const double value = corrector->plan.value[i];
        double step = (i < AMPI_N_BANKS) ? BANK_STEP : CHANGE_STEP, moved[AMPI_N_MISSED] = {0.0};
        bool arrives = false;
        step = (value > 0.0) ? -step : step; /* inwards */
        for (k = 0u; k < AMPI_N_MISSED; k++) { corrector->jacobian[k][i] = 0.0; }
        if (bound_of(with, i) > 0.0) {
            corrector->trial = corrector->plan;
            corrector->trial.value[i] = value + step;
            arrives = predict(corrector, with, &corrector->trial, first_point(corrector, i), false, moved);
        }
        if (arrives) {
            for (k = 0u; k < AMPI_N_MISSED; k++) {
                corrector->jacobian[k][i] = (moved[k] - missed[k]) / step;
            }
        }
    }
}

static bool is_there(const ampi_model_data *model, const double *missed)
{
    const double far = missed[0] * missed[0] + missed[1] * missed[1] + missed[2] * missed[2];
    const double excess = missed[3] + missed[4] + missed[5];
    return (far <= (model->corrector.tolerance * model->corrector.tolerance)) && (excess <= 0.0);
}

/* Lays the plan on the rest of the flight. */
static void lay(ampi_plan *plan, double fast, double slow)
{
    const ampi_plan before = *plan;
    size_t i;
    plan->fast = most(fast, slow + 1.0);
    plan->slow = slow;
    for (i = 0u; i < AMPI_N_BANKS; i++) {
        const double share = (double)i / ((double)AMPI_N_BANKS - 1.0);
        plan->value[i] = ampi_planned(&before, 0u, AMPI_N_BANKS,
                                      plan->fast - share * (plan->fast - plan->slow));
    }
    for (i = 0u; i < AMPI_N_ANGLES; i++) {
        const double share = (double)i / ((double)AMPI_N_ANGLES - 1.0);
        plan->value[AMPI_N_BANKS + i] = ampi_planned(
            &before, AMPI_N_BANKS, AMPI_N_ANGLES, plan->fast - share * (plan->fast - plan->slow));
    }
}

/* One accepted step from the plan and its miss, or none: whether there was one. */
static bool improve(ampi_corrector *corrector, const ampi_setting *with, double *missed, double *cost,
                    double *lambda)
{
    const uint32_t budget = (uint32_t)with->model->corrector.propagations;
    ampi_normal_equations equations;
    size_t tries;
    for (tries = 0u; (tries < REJECTIONS) && (corrector->propagations < budget); tries++) {
        const double to_go = corrector->to_go;
        double step[AMPI_N_PLAN], moved[AMPI_N_MISSED] = {0.0}, found = NEVER;
        size_t i;
        set_equations(corrector, with->model, missed, *lambda, &equations);
        set_step(corrector, with, &equations, step);
        corrector->trial = corrector->plan;
        for (i = 0u; i < AMPI_N_PLAN; i++) {
            const double bound = bound_of(with, i);
            corrector->trial.value[i] = clipped(corrector->plan.value[i] + step[i], -bound, bound);
        }
        if (predict(corrector, with, &corrector->trial, 0u, true, moved)) {
            found = cost_of(with->model, moved, corrector->trial.value);
        }
        if (found < *cost) {
            corrector->plan = corrector->trial;
            (void)memcpy(missed, moved, sizeof moved);
            *cost = found;
            *lambda *= 0.1;
            return true;
        }
        corrector->to_go = to_go; /* of the plan, not of the trial */
        *lambda *= 10.0;
    }
    return false;
}

ampi_correction ampi_correct(ampi_corrector *corrector, const ampi_model_data *model, const double *limit)
{
    const ampi_setting with = {model, &corrector->estimate, corrector->target, limit[1], limit[0]};
    static const double NOTHING[3] = {0.0, 0.0, 0.0};
    const size_t most_iterations = (size_t)model->corrector.iterations;
    double missed[AMPI_N_MISSED] = {0.0}, cost, lambda = 1.0, far;
    ampi_correction outcome = AMPI_PLAN_BETTERED;
    ampi_point *first = &corrector->path[0];
    bool goes_on = true, has_changed = false;

    corrector->iterations = 0u;
    corrector->propagations = 0u;
    (void)memcpy(first->state, corrector->state, BANK_RATE * sizeof(double));
    first->state[CHANGE] = corrector->change;
    first->time = corrector->time;
    complete(&with, first, NOTHING);
    lay(&corrector->plan, first->speed, corrector->target[3]);
    if (predict(corrector, &with, &corrector->plan, 0u, true, missed)) {
        cost = cost_of(model, missed, corrector->plan.value);
    } else { /* then wings level, on the schedule: that goes the farthest */
        corrector->trial = corrector->plan;
        (void)memset(corrector->trial.value, 0, sizeof corrector->trial.value);
        if (!predict(corrector, &with, &corrector->trial, 0u, true, missed)) { return AMPI_NO_ARRIVAL; }
        corrector->plan = corrector->trial;
        cost = cost_of(model, missed, corrector->plan.value);
        has_changed = true;
    }
    while (goes_on && !is_there(model, missed)) {
        const double last = cost;
        set_jacobian(corrector, &with, missed);
        goes_on = improve(corrector, &with, missed, &cost, &lambda);
        has_changed = has_changed || goes_on;
        corrector->iterations += 1u;
        if (goes_on && (cost > (0.98 * last))) { goes_on = false; }
        if (corrector->iterations >= most_iterations) { goes_on = false; }
    }
    (void)memcpy(corrector->missed, missed, sizeof missed);
    far = sqrt(missed[0] * missed[0] + missed[1] * missed[1]);
    if (is_there(model, missed)) {
        outcome = has_changed ? AMPI_PLAN_REPLACED : AMPI_PLAN_KEPT;
    } else if (far > model->corrector.reach) {
        outcome = AMPI_OUT_OF_REACH;
    } else if (!has_changed) {
        outcome = AMPI_NO_BETTER;
    } else {
        outcome = AMPI_PLAN_BETTERED;
    }
    return outcome;
}
