/* One guidance cycle: clock, look-up, plausibility, law, limiter, as ampi/guidance_cycle.py,
   ampi/onboard/{clock,plausibility}.py and ampi/tracking/bank_limiter.py. */
#include "ampi_parts.h"

#define LONGEST 20.0  /* nominal cycles; after a longer silence the clock is doubted once */
#define FORGOTTEN 0.1 /* of the shortest and the longest cycle, at each command */
#define FASTEST 2.0   /* times the rate limit: said to roll faster is told in another unit */
#define NEAR_INVERTED 2.9670597283903604 /* rad: 10 deg of overshoot are told from the other side */

/* The next time is taken as it is. */
static void restart(ampi_guidance *guidance, const ampi_table *table)
{
    guidance->begins = 1u;
    guidance->is_first = 1u;
    guidance->given = guidance->now = guidance->interval = AMPI_NAN;
    guidance->longest = guidance->expected = table->set.cycle;
    guidance->shortest = (table->n.is_cycle_stated != 0u) ? table->set.cycle : AMPI_SHORTEST;
}

/* Nothing has been commanded yet. */
static void forget(ampi_guidance *guidance)
{
    guidance->rate = guidance->bank = guidance->angle = AMPI_NAN;
    guidance->change = guidance->change_rate = 0.0;
    (void)memset(guidance->memory, 0, sizeof guidance->memory);
}

/* What flies from now on is guidance->reference, of the vehicle of these parameters. */
static void take_up(ampi_guidance *guidance, const ampi_table *table, const double *parameters)
{
    size_t i;
    if (table->n.law != AMPI_LINEAR_QUADRATIC) {
        ampi_along(table, &guidance->reference, guidance->along);
    }
    for (i = 0u; i < 3u; i++) {
        const size_t axis = table->n.limit_axis[i];
        guidance->limit[i] = table->set.limit[i];
        if ((axis < table->n.axes) && (parameters != NULL)) {
            const double told = parameters[axis]; /* one that is no positive number is nominal */
            const bool is_used = (told > 0.0) && (told < AMPI_SANE);
            guidance->limit[i] = is_used ? least(told, table->axis[axis].high) : table->set.limit[i];
        }
    }
    guidance->begins = 1u;
}

void ampi_guidance_reset(ampi_guidance *guidance, const ampi_table *table)
{
    restart(guidance, table);
    forget(guidance);
}

void ampi_guidance_begin(ampi_guidance *guidance, const ampi_table *table, const double *parameters)
{
    size_t i;
    ampi_guidance_reset(guidance, table);
    for (i = 0u; i < AMPI_MAX_ROWS; i++) { guidance->row[i] = AMPI_NAN; }
    ampi_reference_at(table, parameters, &guidance->reference);
    guidance->is_begun = table->is_open;
    if (table->is_open == AMPI_OPEN) { take_up(guidance, table, parameters); }
}

void ampi_guidance_follow(ampi_guidance *guidance, const ampi_table *table,
                          const ampi_reference *reference, const double *parameters)
{
    if ((table->is_open == AMPI_OPEN) && (guidance->is_begun == AMPI_OPEN)
        && (reference->checksum == table->checksum)) {
        guidance->reference = *reference;
        take_up(guidance, table, parameters);
    }
}

/* Takes the time of this command, and how long the command may stand; whether time goes on. All is
   computed whatever it is, so that every cycle takes as many instructions. */
static bool advance(ampi_guidance *guidance, const ampi_table *table, double time)
{
    const double step = time - guidance->given, cycle = table->set.cycle;
    const bool goes_on = (AMPI_SHORTEST <= step) && (step <= (LONGEST * cycle));
    const bool is_sane = fabs(time) < AMPI_SANE, is_known = guidance->interval > 0.0; /* is a cycle? */
    const bool is_first = !goes_on && is_sane && (guidance->begins != 0u);
    const double before = chosen(is_known, guidance->interval, step);
    const double low = least(step, before), high = most(step, before);
    const double shortest = chosen(is_known, guidance->shortest, step);
    const double longest = chosen(is_known, guidance->longest, step);
    const double counted = guidance->now + (is_known ? guidance->interval : cycle);
    const double given = chosen(is_sane, time, guidance->given);
    double forgot;

    if (is_first) {
        restart(guidance, table);
        guidance->interval = (table->n.is_cycle_stated != 0u) ? cycle : AMPI_NAN;
    }
    /* of two, lest a silence counts as a cycle; both bounds forget slowly */
    forgot = least(low, shortest + FORGOTTEN * (low - shortest));
    guidance->shortest = chosen(goes_on, forgot, guidance->shortest);
    forgot = most(high, longest + FORGOTTEN * (high - longest));
    guidance->longest = chosen(goes_on, forgot, guidance->longest);
    guidance->expected = chosen(goes_on, low, guidance->expected);
    guidance->interval = chosen(goes_on, step, guidance->interval);
    guidance->now = chosen(goes_on || is_first, time, counted);
    guidance->begins = (goes_on || is_first) ? 0u : guidance->begins;
    guidance->is_first = is_first ? 1u : 0u;
    guidance->given = given;
    return goes_on || is_first;
}

/* Whether the table flies such states; longitude and azimuth may be on another turn. */
bool ampi_is_plausible(const ampi_table *table, const double *state)
{
    size_t i, within = 0u;
    for (i = 0u; i < AMPI_N_STATES; i++) {
        double error = state[i] - table->set.middle[i];
        if ((i == LONGITUDE) || (i == AZIMUTH)) { error = on_turn_of(error, 0.0); }
        within += (fabs(error) <= table->set.reach[i]) ? 1u : 0u;
    }
    return within == AMPI_N_STATES;
}

/* The bank angle on its turn; one that is lost is that of the last command. */
double ampi_bank_angle(const ampi_guidance *guidance, const ampi_table *table, double told)
{
    const double reference = guidance->row[BANK];
    const double last = chosen(guidance->bank != guidance->bank, reference, guidance->bank);
    const double bank = (fabs(told) <= table->set.reach[BANK]) ? told : last;
    const double near = most(guidance->limit[0] - NEAR_INVERTED, 0.0);
    return bank - AMPI_TURN * nearest((bank - clipped(reference, -near, near)) / AMPI_TURN);
}

/* Greatest rate that stops within `room`, braking by a c in each cycle c; a rate back if none does. */
static double stopping_rate(double room, double a, double cycle)
{
    const double cycles = most(room, 0.0) / (a * (cycle * cycle));
    const double k = floor(0.5 * (sqrt(1.0 + 8.0 * cycles) - 1.0));
    const double stopping = a * cycle * (k + (cycles - 0.5 * k * (k + 1.0)) / (k + 1.0));
    return stopping + 2.0 * least(room, 0.0) / cycle; /* one of the two is 0 */
}

/* After `rate` the one nearest to what is wanted, within `fastest` and a change; no NaN but of NaN. */
static double next_rate(double rate, double wanted, double fastest, double change)
{
    return clipped(clipped(wanted, -fastest, fastest), rate - change, rate + change);
}

/* The rate at the end of this cycle, within the limits of angle, rate and acceleration. */
static double limited_rate(const ampi_guidance *guidance, const double limit[3], double angle,
                           double rate, double command)
{
    const double cycle = guidance->longest;
    const double a = limit[2] * (guidance->shortest / cycle);
    const double ahead = angle + 0.5 * rate * cycle;
    const double up = stopping_rate(limit[0] - ahead, a, cycle);
    const double down = stopping_rate(limit[0] + ahead, a, cycle);
    return next_rate(rate, clipped(command, -down, up), limit[1], a * cycle);
}

/* The change of the angle of attack that is wanted, within its limit; of no number: it stays. */
static double change_to(double wanted, double change, double limit)
{
    return clipped(chosen(fabs(wanted) < AMPI_SANE, wanted, change), -limit, limit);
}

/* Changes the angle of attack towards what is wanted, and stops there in time. */
static void modulate(ampi_guidance *guidance, const double limit[3], double wanted)
{
    const double cycle = guidance->longest, last = guidance->change_rate;
    const double a = limit[2] * (guidance->shortest / cycle);
    const double ahead = guidance->change + 0.5 * last * cycle;
    const double room = change_to(wanted, guidance->change, limit[0]) - ahead;
    const double asked = copysign(stopping_rate(fabs(room), a, cycle), room);

    guidance->change_rate = limited_rate(guidance, limit, guidance->change, last, asked);
    guidance->change += 0.5 * (last + guidance->change_rate) * guidance->expected;
}

/* Of a vehicle without a schedule: the reference's angle of attack and its change, within the bounds of the
   angle; a reference that jumps, as one that is looked up by energy may, is followed at its rate. */
static double steered_angle(const ampi_guidance *guidance, const ampi_table *table)
{
    const double *limit = table->set.angle, most_of_all = limit[2] * guidance->expected;
    const double wanted = clipped(guidance->row[table->angle_row] + guidance->change, limit[0], limit[1]);
    const double last = chosen(guidance->angle != guidance->angle, wanted, guidance->angle);
    return clipped(wanted, last - most_of_all, last + most_of_all);
}

/* Without the table that the flight was begun with: the bank angle of the last command is held, and its
   rate taken away within the limit of acceleration. All zero before any command, and of zeroed memory. */
static ampi_command held(ampi_guidance *guidance)
{
    ampi_command command = {0.0, 0.0, 0.0, AMPI_HELD, AMPI_NOT_BEGUN};

    if ((guidance->is_begun == AMPI_OPEN) && (guidance->rate == guidance->rate)) {
        const double rate = guidance->rate, change = guidance->limit[2] * guidance->shortest;
        guidance->rate = clipped(0.0, rate - change, rate + change);
        guidance->bank += 0.5 * (rate + guidance->rate) * guidance->expected;
        command.bank_rate = guidance->rate;
        command.bank_angle = guidance->bank;
        command.angle_of_attack = guidance->angle;
    }
    return command;
}

ampi_command ampi_guidance_step(ampi_guidance *guidance, const ampi_table *table, double time,
                                const double navigation[AMPI_N_NAVIGATED], const double *sensed)
{
    ampi_command command;
    static const double NOTHING[AMPI_N_NAVIGATED] = {AMPI_NAN, AMPI_NAN, AMPI_NAN, AMPI_NAN,
                                                     AMPI_NAN, AMPI_NAN, AMPI_NAN, AMPI_NAN};
    const double *told = (navigation != NULL) ? navigation : NOTHING;
    const double *felt = (sensed != NULL) ? sensed : NOTHING;
    double state[AMPI_N_STATES], bank, rate, own, wanted, angle, last;
    bool is_in_time, is_ended, is_lost, is_state, is_rate, is_held;
    const bool is_asked = (guidance->is_asked != 0u);
    size_t i, known = 0u;
    int32_t fault;

    if ((table->is_open != AMPI_OPEN) || (guidance->is_begun != AMPI_OPEN)
        || (guidance->reference.checksum != table->checksum)) {
        return held(guidance);
    }
    for (i = 0u; i < AMPI_N_NAVIGATED; i++) { known += (fabs(told[i]) < AMPI_SANE) ? 1u : 0u; }
    is_in_time = advance(guidance, table, time);
    if (guidance->is_first != 0u) { forget(guidance); }
    ampi_row_at(table, &guidance->reference,
                ampi_instant(guidance, table, told, felt, &is_ended, &is_lost), guidance->row);
    own = guidance->row[BANK_RATE];
    bank = ampi_bank_angle(guidance, table, told[BANK]);
    is_state = ampi_is_plausible(table, told);
    is_rate = fabs(told[BANK_RATE]) <= (FASTEST * guidance->limit[1]);
    for (i = 0u; i < AMPI_N_STATES; i++) {
        state[i] = chosen(is_state, told[i], guidance->row[i]); /* for the law's memory */
    }
    state[BANK] = bank;
    wanted = ampi_law_command(guidance, table, state, felt, &angle);
    wanted = chosen(is_state, wanted, own);
    angle = chosen(is_state, angle, guidance->change);
    is_ended = is_ended && !is_asked; /* a plan has an end of its own */
    is_held = is_ended || (is_lost && !is_asked);

    fault = (known == AMPI_N_NAVIGATED) ? AMPI_IMPLAUSIBLE_NAVIGATION : AMPI_BAD_NAVIGATION;
    command.health = (is_state && is_rate) ? guidance->reference.health : fault;
    command.health = is_in_time ? command.health : AMPI_BAD_TIME;
    command.health = is_ended ? AMPI_AFTER_FINAL_TIME : command.health;
    command.steering = is_state ? AMPI_TRACKED : AMPI_REFERENCE;
    command.steering = is_held ? AMPI_HELD : command.steering;
    command.steering = is_asked ? AMPI_PLANNED : command.steering;
    wanted = chosen(is_held, 0.0, wanted);
    wanted = chosen(is_asked, guidance->asked_rate, wanted);
    angle = chosen(is_asked, guidance->asked_angle, angle);
    /* The limits are of commands: from the measured rate, behind a lag of half a second at 10 Hz, they
       would leave a fifth of the acceleration, and the bank angle would overshoot by 19 deg. */
    last = chosen(guidance->rate != guidance->rate, own, guidance->rate);
    rate = chosen(is_rate, told[BANK_RATE], last);
    last = chosen(guidance->rate != guidance->rate, rate, guidance->rate);
    guidance->rate = limited_rate(guidance, guidance->limit, bank, last, wanted);
    guidance->bank = bank + 0.5 * (rate + guidance->rate) * guidance->expected;
    if (table->set.modulation[0] > 0.0) { modulate(guidance, table->set.modulation, angle); }
    guidance->angle = (table->angle_row != 0u) ? steered_angle(guidance, table) : guidance->change;
    command.bank_rate = guidance->rate;
    command.bank_angle = guidance->bank;
    command.angle_of_attack = guidance->angle;
    return command;
}
