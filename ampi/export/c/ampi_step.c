/* One guidance cycle: clock, look-up, plausibility, law, limiter. As ampi/guidance.py,
   ampi/onboard/{clock,plausibility}.py and ampi/tracking/bank_limiter.py. */
#include "ampi_parts.h"

#define LONGEST 20.0  /* nominal cycles; after a longer silence the clock is doubted once */
#define FORGOTTEN 0.1 /* of the shortest and the longest cycle, at each command */
#define FASTEST 2.0   /* times the rate limit: said to roll faster is told in another unit */
#define NEAR_INVERTED 2.9670597283903604 /* rad: 10 deg of overshoot are told from the other side */

static double first_shortest(const ampi_table *table)
{
    return (table->is_cycle_stated != 0u) ? table->cycle : AMPI_SHORTEST;
}

/* The next command is the first, whatever its time. */
static void reset(ampi_guidance *guidance, const ampi_table *table)
{
    guidance->begins = 1u;
    guidance->is_first = 1u;
    guidance->given = (double)NAN;
    guidance->now = (double)NAN;
    guidance->interval = (double)NAN;
    guidance->shortest = first_shortest(table);
    guidance->longest = table->cycle;
    guidance->expected = table->cycle;
}

/* Nothing has been commanded yet. */
static void forget(ampi_guidance *guidance)
{
    size_t i;
    guidance->rate = (double)NAN;
    guidance->bank = (double)NAN;
    guidance->angle = 0.0;
    for (i = 0u; i < AMPI_N_MEMORY; i++) {
        guidance->memory[i] = 0.0;
    }
}

/* What flies is guidance->reference, of this vehicle. */
static void follow(ampi_guidance *guidance, const ampi_table *table, const double *parameters)
{
    size_t i;
    if (table->law != (size_t)AMPI_LINEAR_QUADRATIC) {
        ampi_along(table, &guidance->reference, guidance->along);
    }
    for (i = 0u; i < 3u; i++) {
        const size_t axis = table->limit_axis[i];
        guidance->limit[i] = table->limit[i];
        if ((axis < table->n_axes) && (parameters != NULL)) {
            const double told = parameters[axis];
            const int is_used = (told > 0.0) && (told < AMPI_SANE);
            guidance->limit[i] = is_used ? ampi_min(told, table->axis[axis].high) : table->limit[i];
        }
    }
    guidance->begins = 1u;
}

void ampi_guidance_begin(ampi_guidance *guidance, const ampi_table *table, const double *parameters)
{
    size_t i;
    forget(guidance);
    reset(guidance, table);
    for (i = 0u; i < AMPI_MAX_ROWS; i++) {
        guidance->row[i] = (double)NAN;
    }
    guidance->is_begun = 0u;
    ampi_reference_at(table, parameters, &guidance->reference);
    if (table->is_open == AMPI_OPENED) {
        follow(guidance, table, parameters);
        guidance->is_begun = AMPI_OPENED;
    }
}

void ampi_guidance_follow(ampi_guidance *guidance, const ampi_table *table,
                          const ampi_reference *reference, const double *parameters)
{
    if ((table->is_open == AMPI_OPENED) && (reference->checksum == table->checksum)
        && (guidance->is_begun == AMPI_OPENED)) {
        guidance->reference = *reference;
        follow(guidance, table, parameters);
    }
}

/* Takes the time of this command, and how long the command may stand; whether time goes on. */
static int advance(ampi_guidance *guidance, const ampi_table *table, double time)
{
    const double step = time - guidance->given;
    int goes_on = ((AMPI_SHORTEST <= step) && (step <= (LONGEST * table->cycle))) ? 1 : 0;

    guidance->is_first = 0u;
    if (goes_on != 0) {
        double low, high;
        if (!(guidance->interval > 0.0)) { /* none was known: this is the first */
            guidance->interval = step;
            guidance->shortest = step;
            guidance->longest = step;
        }
        low = ampi_min(step, guidance->interval); /* of two, lest a silence counts as a cycle */
        high = ampi_max(step, guidance->interval);
        guidance->shortest = ampi_min(low, guidance->shortest + FORGOTTEN * (low - guidance->shortest));
        guidance->longest = ampi_max(high, guidance->longest + FORGOTTEN * (high - guidance->longest));
        guidance->expected = low;
        guidance->interval = step;
        guidance->now = time;
    } else if ((guidance->begins != 0u) && (fabs(time) < AMPI_SANE)) {
        reset(guidance, table);
        guidance->now = time;
        guidance->interval = (table->is_cycle_stated != 0u) ? table->cycle : (double)NAN;
        goes_on = 1;
    } else {
        guidance->now += (guidance->interval > 0.0) ? guidance->interval : table->cycle;
    }
    guidance->begins = (goes_on != 0) ? 0u : guidance->begins;
    guidance->given = (fabs(time) < AMPI_SANE) ? time : guidance->given;
    return goes_on;
}

/* Whether the table flies such states; longitude and azimuth may be on another turn. */
static int is_plausible(const ampi_table *table, const double *state)
{
    int is_so = 1;
    size_t i;
    for (i = 0u; i < AMPI_N_STATES; i++) {
        const double error = state[i] - table->middle[i];
        const double turned = ampi_on_turn_of(error, 0.0);
        const int turns = (i == (size_t)AMPI_LONGITUDE) || (i == (size_t)AMPI_AZIMUTH);
        is_so &= (fabs(turns ? turned : error) <= table->reach[i]) ? 1 : 0;
    }
    return is_so;
}

/* The bank angle on its turn; one that is lost is that of the last command. */
static double bank_angle(const ampi_guidance *guidance, const ampi_table *table, double told)
{
    const double reference = guidance->row[AMPI_BANK];
    const double last = (guidance->bank != guidance->bank) ? reference : guidance->bank;
    const double bank = (fabs(told) <= table->reach[AMPI_BANK]) ? told : last;
    const double near = ampi_max(guidance->limit[AMPI_ANGLE] - NEAR_INVERTED, 0.0);
    const double middle = ampi_clipped(reference, -near, near);
    return bank - AMPI_TURN * rint((bank - middle) / AMPI_TURN);
}

/* Greatest rate that stops within `room`, braking by a c in each cycle c; a rate back if there is none. */
static double stopping_rate(double room, double acceleration, double cycle)
{
    const double cycles = ampi_max(room, 0.0) / (acceleration * (cycle * cycle));
    const double k = floor(0.5 * (sqrt(1.0 + 8.0 * cycles) - 1.0));
    const double stopping = acceleration * cycle * (k + (cycles - 0.5 * k * (k + 1.0)) / (k + 1.0));
    return stopping + 2.0 * ampi_min(room, 0.0) / cycle;
}

/* The rate at the end of this cycle, within the limits of angle, rate and acceleration. */
static double limited_rate(const ampi_guidance *guidance, double bank, double rate, double command)
{
    const double cycle = guidance->longest;
    const double a = guidance->limit[AMPI_ACCELERATION] * (guidance->shortest / cycle);
    const double change = a * cycle, most = guidance->limit[AMPI_RATE];
    const double ahead = bank + 0.5 * rate * cycle;
    const double up = stopping_rate(guidance->limit[AMPI_ANGLE] - ahead, a, cycle);
    const double down = stopping_rate(guidance->limit[AMPI_ANGLE] + ahead, a, cycle);
    const double wanted = ampi_clipped(ampi_clipped(command, -down, up), -most, most);
    return ampi_clipped(wanted, rate - change, rate + change);
}

ampi_command ampi_guidance_step(ampi_guidance *guidance, const ampi_table *table, double time,
                                const double navigation[AMPI_N_NAVIGATED], const double *sensed)
{
    double state[AMPI_N_STATES], felt[3], rate, bank, last, own, asked, angle;
    int is_in_time, ended, lost, is_state, is_rate, is_sane;
    ampi_command command = {0.0, 0.0, 0.0, (int32_t)AMPI_HELD, (int32_t)AMPI_NOT_BEGUN};
    size_t i;

    if ((table->is_open != AMPI_OPENED) || (guidance->is_begun != AMPI_OPENED)
        || (guidance->reference.checksum != table->checksum)) {
        return command;
    }
    for (i = 0u; i < 3u; i++) {
        felt[i] = (sensed != NULL) ? sensed[i] : (double)NAN;
    }
    for (i = 0u; i < AMPI_N_STATES; i++) {
        state[i] = (navigation != NULL) ? navigation[i] : (double)NAN;
    }
    rate = (navigation != NULL) ? navigation[AMPI_N_STATES] : (double)NAN;
    is_in_time = advance(guidance, table, time);
    if (guidance->is_first != 0u) {
        forget(guidance);
    }
    ampi_row_at(table, &guidance->reference,
                ampi_instant(guidance, table, state, felt, &ended, &lost), guidance->row);
    own = guidance->row[AMPI_BANK_RATE];
    command.health = guidance->reference.health;
    command.steering = (int32_t)AMPI_TRACKED;
    bank = bank_angle(guidance, table, state[AMPI_BANK]);
    is_state = is_plausible(table, state);
    is_rate = (fabs(rate) <= (FASTEST * guidance->limit[AMPI_RATE])) ? 1 : 0;
    is_sane = (fabs(rate) < AMPI_SANE) ? 1 : 0;
    for (i = 0u; i < AMPI_N_STATES; i++) {
        is_sane &= (fabs(state[i]) < AMPI_SANE) ? 1 : 0;
        state[i] = (is_state != 0) ? state[i] : guidance->row[i]; /* for the law's memory */
    }
    state[AMPI_BANK] = bank;
    last = (guidance->rate != guidance->rate) ? own : guidance->rate;
    rate = (is_rate != 0) ? rate : last;
    asked = ampi_law_command(guidance, table, state, felt, &angle);
    if ((is_state == 0) || (is_rate == 0)) {
        command.health = (is_sane != 0) ? (int32_t)AMPI_IMPLAUSIBLE_NAVIGATION
                                        : (int32_t)AMPI_BAD_NAVIGATION;
    }
    if (is_state == 0) {
        asked = own;
        angle = guidance->angle;
        command.steering = (int32_t)AMPI_REFERENCE;
    }
    command.health = (is_in_time != 0) ? command.health : (int32_t)AMPI_BAD_TIME;
    if ((ended != 0) || (lost != 0)) {
        asked = 0.0;
        command.health = (ended != 0) ? (int32_t)AMPI_AFTER_FINAL_TIME : command.health;
        command.steering = (int32_t)AMPI_HELD;
    }
    /* The limits are of commands: from the measured rate, behind a lag of half a second at 10 Hz, they
       would leave a fifth of the acceleration, and the bank angle would overshoot by 19 deg. */
    last = (guidance->rate != guidance->rate) ? rate : guidance->rate;
    guidance->rate = limited_rate(guidance, bank, last, asked);
    guidance->angle = angle;
    guidance->bank = bank + 0.5 * (rate + guidance->rate) * guidance->expected;
    command.bank_rate = guidance->rate;
    command.bank_angle = guidance->bank;
    command.angle_of_attack = guidance->angle;
    return command;
}
