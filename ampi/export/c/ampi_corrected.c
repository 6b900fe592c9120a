/* A guidance cycle that estimates, corrects when it is time, and flies the plan; as
   ampi/correction/corrected_cycle.py. */
#include "ampi_correction_parts.h"

#define SAMPLES 33u /* of the reference, to lay a plan on it */
#define CHANGE_SLOWEST 1e-9 /* s: a lag that is shorter is none */

void ampi_corrector_aim(ampi_corrector *corrector, const double target[4])
{
    size_t i, known = 0u;
    for (i = 0u; i < 4u; i++) { known += (fabs(target[i]) < AMPI_SANE) ? 1u : 0u; }
    if (known == 4u) {
        (void)memcpy(corrector->target, target, sizeof corrector->target);
        if (corrector->has_plan != 0u) { corrector->next = 0.0; } /* it is corrected at once */
    }
}

void ampi_corrector_begin(ampi_corrector *corrector, const ampi_model *model, const ampi_table *table,
                          const double *parameters)
{
    const bool is_told = (parameters != NULL) && (table->is_open == AMPI_OPEN);
    double target[4];
    size_t i;
    (void)memset(corrector, 0, sizeof *corrector);
    corrector->outcome = (int32_t)AMPI_NO_CORRECTION;
    if (model->is_open != AMPI_OPEN) { return; }
    ampi_estimate_begin(&corrector->estimate, &model->of);
    for (i = 0u; i < 4u; i++) {
        const double axis = model->of.target_axis[i];
        target[i] = model->of.target[i];
        if (is_told && (axis >= 0.0) && (axis < (double)table->n.axes)) {
            const double told = parameters[(size_t)axis];
            target[i] = chosen(fabs(told) < AMPI_SANE, told, target[i]);
        }
    }
    ampi_corrector_aim(corrector, target);
    corrector->next = model->of.corrector.start;
    corrector->time = AMPI_NAN;
    corrector->lost_since = AMPI_NAN;
    corrector->is_begun = AMPI_OPEN;
}

/* The first plan: the bank angles of the reference. */
static void lay_reference(ampi_corrector *corrector, const ampi_model_data *model,
                          const ampi_guidance *guidance, const ampi_table *table, double fast)
{
    const ampi_reference *reference = &guidance->reference;
    const double begin = corrector->time, way = reference->final_time - begin;
    ampi_plan *plan = &corrector->plan;
    double speed[SAMPLES], bank[SAMPLES], row[AMPI_MAX_ROWS];
    size_t i, at = 0u;
    for (i = 0u; i < SAMPLES; i++) {
        ampi_row_at(table, reference, begin + way * ((double)i / ((double)SAMPLES - 1.0)), row);
        speed[i] = ampi_equivalent_speed(model, corrector->target, row);
        bank[i] = row[BANK];
    }
    plan->fast = fast;
    plan->slow = corrector->target[3];
    for (i = 0u; i < AMPI_N_BANKS; i++) {
        const double share = (double)i / ((double)AMPI_N_BANKS - 1.0);
        const double wanted = plan->fast - share * (plan->fast - plan->slow);
        double w;
        while ((at < (SAMPLES - 2u)) && (speed[at + 1u] > wanted)) { at += 1u; }
        w = clipped((speed[at] - wanted) / most(speed[at] - speed[at + 1u], 1e-9), 0.0, 1.0);
        plan->value[i] = clipped(bank[at] + w * (bank[at + 1u] - bank[at]), -guidance->limit[0],
                                 guidance->limit[0]);
    }
    for (i = 0u; i < AMPI_N_ANGLES; i++) { plan->value[AMPI_N_BANKS + i] = 0.0; }
    corrector->has_plan = 1u;
}

/* The state as it is navigated, or dead reckoned from the last one. Returns whether it is navigated. */
static bool take_state(ampi_corrector *corrector, const ampi_model_data *model,
                       const ampi_guidance *guidance, const ampi_table *table, double time,
                       const double *told)
{
    const bool is_state = ampi_is_plausible(table, told) && (fabs(time) < AMPI_SANE);
    const double passed = clipped(time - corrector->time, 0.0, 10.0);
    size_t i;
    if (is_state) {
        (void)memcpy(corrector->state, told, sizeof corrector->state);
        corrector->state[LONGITUDE] = on_turn_of(told[LONGITUDE], corrector->target[1]);
        corrector->state[BANK] = ampi_bank_angle(guidance, table, told[BANK]);
        if (!(fabs(corrector->state[BANK]) < AMPI_SANE)) { /* before the reference has been looked up */
            corrector->state[BANK] = on_turn_of(told[BANK], 0.0);
        }
        corrector->lost_since = AMPI_NAN;
    } else if (passed > 0.0) {
        const double *state = corrector->state;
        const ampi_angles angles = ampi_angles_of(state);
        const ampi_factors factors = ampi_factors_at(&corrector->estimate, model, state[ALTITUDE]);
        const double angle = ampi_scheduled_angle(model, corrector->time, state[SPEED])
                             + (factors.angle + corrector->change);
        const ampi_air air = ampi_air_at(model, &factors, state, &angles, angle);
        double rates[6];
        ampi_rates(model, state, &angles, &air, rates);
        for (i = 0u; i < 6u; i++) { corrector->state[i] += passed * rates[i]; }
        corrector->state[BANK] = guidance->bank;
        corrector->lost_since =
            chosen(corrector->lost_since != corrector->lost_since, time, corrector->lost_since);
    } else {
        /* nothing has passed, or nobody knows how much: the last state stands */
    }
    if (fabs(time) < AMPI_SANE) { corrector->time = time; }
    return is_state;
}

/* The change of the angle of attack follows its command behind a lag. */
static void lag_change(ampi_corrector *corrector, const ampi_model_data *model, double passed,
                       double commanded)
{
    const double lag = most(model->corrector.lag, CHANGE_SLOWEST);
    if (passed > 0.0) {
        corrector->change += (commanded - corrector->change) * (1.0 - exp(-passed / lag));
    }
}

static void correct_in_time(ampi_corrector *corrector, const ampi_model_data *model,
                            const ampi_guidance *guidance, const ampi_table *table, bool is_state)
{
    const double time = corrector->time;
    bool is_last;
    if (!(time >= corrector->next)) { return; }
    if (!is_state) {
        corrector->outcome = (int32_t)AMPI_NO_STATE;
        corrector->count[AMPI_NO_STATE] += 1u;
        corrector->next = time + model->corrector.last_period;
        return;
    }
    if (corrector->has_plan == 0u) {
        lay_reference(corrector, model, guidance, table,
                      ampi_equivalent_speed(model, corrector->target, corrector->state));
    }
    corrector->outcome = (int32_t)ampi_correct(corrector, model, guidance->limit);
    corrector->count[corrector->outcome] += 1u;
    is_last = corrector->to_go <= model->corrector.last_minute;
    corrector->next = time + (is_last ? model->corrector.last_period : model->corrector.period);
    if ((corrector->outcome != (int32_t)AMPI_NO_ARRIVAL)
        && ((time + corrector->to_go - corrector->next) < model->corrector.quiet)) {
        corrector->next = 1e300; /* the plan is flown to its end */
    }
}

/* What is asked of the vehicle at the end of the cycle. */
static void ask(const ampi_corrector *corrector, const ampi_model_data *model, ampi_guidance *guidance)
{
    const double *state = corrector->state;
    const ampi_angles angles = ampi_angles_of(state);
    const ampi_factors factors = ampi_factors_at(&corrector->estimate, model, state[ALTITUDE]);
    const double angle = ampi_scheduled_angle(model, corrector->time, state[SPEED])
                         + (factors.angle + corrector->change);
    const ampi_air air = ampi_air_at(model, &factors, state, &angles, angle);
    const double speed = ampi_equivalent_speed(model, corrector->target, state);
    const double lead = model->corrector.lead + guidance->expected; /* it is reached at its end */
    double rates[6], slowing, ahead, bank, change;
    ampi_rates(model, state, &angles, &air, rates);
    slowing = (state[SPEED] * rates[SPEED] + model->load_gravity * rates[ALTITUDE]) / most(speed, 1.0);
    ahead = speed + lead * slowing;
    bank = ampi_planned(&corrector->plan, 0u, AMPI_N_BANKS, speed);
    guidance->asked_rate = (ampi_planned(&corrector->plan, 0u, AMPI_N_BANKS, ahead) - bank) / lead
                           + model->corrector.stiffness * (bank - state[BANK]);
    change = ampi_planned(&corrector->plan, AMPI_N_BANKS, AMPI_N_ANGLES, ahead);
    guidance->asked_angle = change;
    guidance->is_asked = ((fabs(guidance->asked_rate) < AMPI_SANE) && (fabs(change) < AMPI_SANE)) ? 1u : 0u;
}

ampi_command ampi_corrected_step(ampi_corrector *corrector, const ampi_model *model,
                                 ampi_guidance *guidance, const ampi_table *table, double time,
                                 const double navigation[AMPI_N_NAVIGATED], const double *sensed)
{
    static const double NOTHING[AMPI_N_NAVIGATED] = {AMPI_NAN, AMPI_NAN, AMPI_NAN, AMPI_NAN,
                                                     AMPI_NAN, AMPI_NAN, AMPI_NAN, AMPI_NAN};
    const double *told = (navigation != NULL) ? navigation : NOTHING;
    const double *felt = (sensed != NULL) ? sensed : NOTHING;
    guidance->is_asked = 0u;
    if ((model->is_open == AMPI_OPEN) && (corrector->is_begun == AMPI_OPEN)
        && (table->is_open == AMPI_OPEN) && (guidance->is_begun == AMPI_OPEN)
        && (guidance->reference.checksum == table->checksum)) {
        const ampi_model_data *of = &model->of;
        const double passed = time - corrector->time;
        const bool is_state = take_state(corrector, of, guidance, table, time, told);
        lag_change(corrector, of, passed, guidance->change);
        if (is_state) {
            const double unsure = 0.5 * fabs(guidance->change - corrector->change);
            ampi_estimate_update(&corrector->estimate, of, time, corrector->state, felt,
                                 corrector->change, unsure);
        } else {
            corrector->estimate.nis = AMPI_NAN;
            corrector->estimate.unusable += 1u;
        }
        correct_in_time(corrector, of, guidance, table, is_state);
        if (corrector->has_plan != 0u) { ask(corrector, of, guidance); }
    }
    return ampi_guidance_step(guidance, table, time, navigation, sensed);
}
