/* What ESBMC proves, one function a proof: for every number that meets the assumptions, by bit-precise
   arithmetic. The core is included for its static functions. `.ci/flight_code proofs` runs each. */
#include <string.h>
/* Of doubles alone, and aligned here: an assignment spares the prover a loop over bytes. */
#define memcpy(to, from, size) (*(double *)(void *)(to) = *(const double *)(const void *)(from))
#include "../../ampi/export/c/ampi_reference.c"
#include "../../ampi/export/c/ampi_step.c"

double nondet_double(void);
size_t nondet_size(void);
uint32_t nondet_word(void);
int nondet_int(void);

#define POINTS 4u

static double AXIS[POINTS] = {-0.7, 0.1, 0.4, 1.9};

/* Any that increases, of sane numbers. */
static void any_axis(void)
{
    size_t j;
    for (j = 0u; j < POINTS; j++) {
        AXIS[j] = nondet_double();
        __ESBMC_assume((fabs(AXIS[j]) < AMPI_SANE) && ((j == 0u) || (AXIS[j - 1u] < AXIS[j])));
    }
}

static void make_axis(ampi_table *table, size_t points, uint32_t order)
{
    table->blob = (const unsigned char *)AXIS;
    table->n.axes = 1u;
    table->axis[0].points = (uint32_t)points;
    table->axis[0].order = order;
    table->axis[0].low = AXIS[0];
    table->axis[0].high = AXIS[points - 1u];
    table->axis[0].nominal = AXIS[1];
}

/* Any parameter, NaN and infinities too, any axis: looked up within it; the excess is no NaN. */
void proof_placed(void)
{
    static ampi_table table;
    double excess, p;
    any_axis();
    make_axis(&table, POINTS, AMPI_LINEAR);
    table.axis[0].circular = (nondet_int() != 0) ? 1u : 0u;
    p = placed(&table, 0u, nondet_double(), &excess);
    __ESBMC_assert((p >= AXIS[0]) && (p <= AXIS[POINTS - 1u]), "inside");
    __ESBMC_assert(excess >= 0.0, "excess");
}

static double any_inside(size_t points)
{
    const double inside = nondet_double();
    __ESBMC_assume((inside >= AXIS[0]) && (inside <= AXIS[points - 1u]));
    return inside;
}

/* Linear, any axis: the cell is in bounds and holds the parameter. */
void proof_cell(void)
{
    static ampi_table table;
    factor base;
    size_t below;
    double inside;
    any_axis();
    make_axis(&table, POINTS, AMPI_LINEAR);
    inside = any_inside(POINTS);
    base = base_of(&table, 0u, inside, &below);
    __ESBMC_assert((base.width == 2u) && (base.first == below) && (below + 1u < POINTS), "cell");
    __ESBMC_assert((AXIS[below] <= inside) && (inside <= AXIS[below + 1u]), "holds it");
}

/* Linear, of the parameter in its cell: weights in [0, 1]. Of one cell: dividing by any number is more
   than a prover does in a minute, and the quotients round alike in all cells. */
void proof_weights(void)
{
    static ampi_table table;
    factor base;
    size_t below;
    make_axis(&table, 2u, AMPI_LINEAR);
    base = base_of(&table, 0u, any_inside(2u), &below);
    __ESBMC_assert((base.weight[0] >= 0.0) && (base.weight[0] <= 1.0), "of the first");
    __ESBMC_assert((base.weight[1] >= 0.0) && (base.weight[1] <= 1.0), "of the second");
}

/* Their sum is 1: in real numbers (--ir), for of rounded ones no prover finds an end. */
void proof_sum(void)
{
    static ampi_table table;
    factor base;
    size_t below;
    make_axis(&table, 2u, AMPI_LINEAR);
    base = base_of(&table, 0u, any_inside(2u), &below);
    __ESBMC_assert(fabs(base.weight[0] + base.weight[1] - 1.0) <= 4.5e-16, "sum");
}

/* A rate that stops is no NaN and not below a rate back, for any vehicle and cycle of sane size. */
void proof_stopping(void)
{
    const double room = nondet_double(), acceleration = nondet_double(), cycle = nondet_double();
    double rate;
    __ESBMC_assume((fabs(room) <= 1e3) && (acceleration >= 1e-9) && (acceleration <= 1e12));
    __ESBMC_assume((cycle >= AMPI_SHORTEST) && (cycle <= 1e3));
    rate = stopping_rate(room, acceleration, cycle);
    __ESBMC_assert(rate == rate, "a number");
}

/* The limiter: whatever is wanted that is no NaN, infinities too, the rate stays within its limit and
   within the change that the acceleration allows. */
void proof_limiter(void)
{
    const double last = nondet_double(), wanted = nondet_double();
    const double most = nondet_double(), change = nondet_double();
    double rate;
    __ESBMC_assume((wanted == wanted) && (most > 0.0) && (most <= AMPI_SANE) && (fabs(last) <= most));
    __ESBMC_assume((change > 0.0) && (change <= AMPI_SANE));
    rate = next_rate(last, wanted, most, change);
#if CLAUSE == 0
    __ESBMC_assert(rate <= most, "rate");
#elif CLAUSE == 1
    __ESBMC_assert(rate >= -most, "rate");
#else
    __ESBMC_assert((rate >= (last - change)) && (rate <= (last + change)), "acceleration");
#endif
}

/* The limiter of the angle of attack: whatever is wanted, NaN too, it moves to a change within its limit. Its
   rate there passes `proof_stopping` and `proof_limiter`, as that of the bank angle does. */
void proof_modulation(void)
{
    const double limit = nondet_double(), change = nondet_double();
    double told;
    __ESBMC_assume((limit > 0.0) && (limit <= AMPI_SANE) && (fabs(change) <= limit));
    told = change_to(nondet_double(), change, limit);
    __ESBMC_assert((told >= -limit) && (told <= limit), "within");
}

/* What `limited_rate` asks of it is a number for every finite command. */
void proof_command(void)
{
    const double up = nondet_double(), down = nondet_double(), command = nondet_double();
    double wanted;
    __ESBMC_assume((up == up) && (down == down) && (fabs(command) < HUGE_VAL));
    wanted = clipped(command, -down, up);
    __ESBMC_assert(wanted == wanted, "a number");
}

/* The clock: from any memory of an earlier step, after any time the numbers that are used are numbers. */
static double any_between(double low, double high)
{
    const double number = nondet_double();
    __ESBMC_assume((number >= low) && (number <= high));
    return number;
}

void proof_clock(void)
{
    static ampi_guidance guidance;
    static ampi_table table;
    const double time = nondet_double();
    table.set.cycle = any_between(AMPI_SHORTEST, 1e3);
    table.n.is_cycle_stated = (nondet_int() != 0) ? 1u : 0u;
    guidance.begins = (nondet_int() != 0) ? 1u : 0u;
    guidance.given = nondet_double();
    __ESBMC_assume((guidance.given != guidance.given) || (fabs(guidance.given) < AMPI_SANE));
    guidance.now = any_between(-1e12, 1e15);
    guidance.interval = nondet_double();
    __ESBMC_assume((guidance.interval != guidance.interval)
                   || ((guidance.interval >= AMPI_SHORTEST) && (guidance.interval <= LONGEST * table.set.cycle)));
    guidance.shortest = any_between(AMPI_SHORTEST, 1e3);
    guidance.longest = any_between(guidance.shortest, LONGEST * 1e3);
    guidance.expected = any_between(AMPI_SHORTEST, LONGEST * 1e3);
    (void)advance(&guidance, &table, time);
#if CLAUSE == 0
    __ESBMC_assert(fabs(guidance.now) < HUGE_VAL, "now");
#elif CLAUSE == 1
    __ESBMC_assert((guidance.expected >= AMPI_SHORTEST) && (guidance.expected < HUGE_VAL), "expected");
#elif CLAUSE == 2
    __ESBMC_assert(guidance.shortest >= AMPI_SHORTEST, "shortest");
#elif CLAUSE == 3
    __ESBMC_assert((guidance.longest >= guidance.shortest) && (guidance.longest < HUGE_VAL), "longest");
#endif
}
