/* Parameters to reference: the subspace on each axis, the weighted sum of its vertices, the conversion
   to high density or to one instant. Sagliano et al. 2016, Eqs. (16) to (19) and (30) to (33), as
   ampi/onboard/{reference,subspace,interpolation,segments}.py derive them. */
#include "ampi_parts.h"

#define FAR_OUT 0.2 /* of an axis' range: further outside, the boundary trajectory is not near */
#define ROUNDING 3.552713678800501e-15 /* 16 eps: an edge in another unit differs in the last digits */
#define WIDEST 4u
#define TOGETHER 4u /* vertices that are added at once */

typedef struct { /* of one axis: what it weighs from its point `first` on */
    size_t first, width;
    double weight[WIDEST];
} factor;

static size_t smaller(size_t a, size_t b) { return (a < b) ? a : b; }

/* The parameter as it is looked up, and how far outside it lies, in shares of its range. */
static double placed(const ampi_table *table, size_t i, double told, double *excess)
{
    const double low = table->axis[i].low, high = table->axis[i].high, range = high - low;
    const bool is_inside = (low <= told) && (told <= high);
    const bool is_sane = is_inside || (fabs(told) < AMPI_SANE), turns = table->axis[i].circular != 0u;
    const double size = most(most(fabs(low), fabs(high)), turns ? AMPI_TURN : 0.0);
    const double turned = turns ? on_turn_of(told, 0.5 * (low + high)) : told;
    const double p = is_sane ? (is_inside ? told : turned) : table->axis[i].nominal;
    const double edge = clipped(p, low, high), beyond = fabs(p - edge);
    const double share = (range > 0.0) ? (beyond / range) : HUGE_VAL;

    *excess = is_sane ? ((beyond <= (ROUNDING * size)) ? 0.0 : share) : HUGE_VAL;
    return edge;
}

/* First of the `width` points that interpolate the cell of `below`: a fixed triple, the centred four. */
static size_t first_of(size_t below, size_t width, size_t points)
{
    const size_t back = (width == 3u) ? (below % 2u) : (((width == 4u) && (below > 0u)) ? 1u : 0u);
    return smaller(below - back, points - width);
}

/* Lagrange's weights, or the nearer point; `below` is the first point of the cell. */
static factor base_of(const ampi_table *table, size_t axis, double inside, size_t *below)
{
    const size_t n = table->axis[axis].points, order = table->axis[axis].order;
    const size_t place = table->points_of[axis];
    factor base = {0u, 0u, {1.0, 0.0, 0.0, 0.0}};
    size_t i, j, cell = 0u;

    for (j = 1u; (j + 1u) < n; j++) { cell += (number(table, place, j) <= inside) ? 1u : 0u; }
    *below = cell;
    base.width = smaller((order == AMPI_SECOND_DIFFERENCES) ? 2u : order, n);
    base.first = first_of(cell, base.width, n);
    if ((base.width == 1u) && (n > 1u)) {
        const double up = number(table, place, cell + 1u) - inside;
        base.first = cell + (((inside - number(table, place, cell)) > up) ? 1u : 0u);
    }
    for (i = 0u; i < base.width; i++) {
        const double own = number(table, place, base.first + i);
        base.weight[i] = 1.0;
        for (j = 0u; j < base.width; j++) {
            const double other = number(table, place, base.first + j);
            base.weight[i] *= (j != i) ? ((inside - other) / (own - other)) : 1.0;
        }
    }
    return base;
}

/* Weights of the correction by second differences, of an axis of three points at least. */
static factor correction_of(const ampi_table *table, size_t axis, double inside, size_t below)
{
    const size_t n = table->axis[axis].points, place = table->points_of[axis];
    const double begin = number(table, place, below), h = number(table, place, below + 1u) - begin;
    const double s = (inside - begin) / h, bubble = s * (s - 1.0) * (h * h);
    factor correction = {0u, smaller(WIDEST, n), {0.0, 0.0, 0.0, 0.0}};
    size_t side;

    correction.first = (n > 3u) ? first_of(below, WIDEST, n) : 0u;
    for (side = 0u; side < 2u; side++) {
        const size_t j = smaller(((below + side) > 1u) ? (below + side) : 1u, n - 2u);
        const double left = number(table, place, j) - number(table, place, j - 1u);
        const double right = number(table, place, j + 1u) - number(table, place, j);
        const double part = bubble * ((side == 0u) ? (1.0 - s) : s);
        double *weight = &correction.weight[j - 1u - correction.first];
        weight[0] += part / (left * (left + right));
        weight[1] -= part / (left * right);
        weight[2] += part / (right * (left + right));
    }
    return correction;
}

static float float32_at(const unsigned char *values, size_t i)
{
    float value;
    (void)memcpy(&value, &values[i * sizeof value], sizeof value);
    return value;
}

static int16_t int16_at(const unsigned char *values, size_t i)
{
    int16_t value;
    (void)memcpy(&value, &values[i * sizeof value], sizeof value);
    return value;
}

/* row += w T_v over all columns, of four vertices: a quarter of the loads and stores of the row. */
static void add_vertices(const ampi_table *table, const size_t *vertex, const ampi_real *weight,
                         ampi_real *row)
{
    const unsigned char *values = &table->blob[table->values];
    const size_t n = table->columns, places = table->values;
    const size_t at[TOGETHER] = {vertex[0] * n, vertex[1] * n, vertex[2] * n, vertex[3] * n};
    const ampi_real a = weight[0], b = weight[1], c = weight[2], d = weight[3];
    size_t i;

    if (table->n.kind == AMPI_FLOAT64) {
        for (i = 0u; i < n; i++) {
            row[i] = (((row[i] + a * (ampi_real)number(table, places, at[0] + i))
                       + b * (ampi_real)number(table, places, at[1] + i))
                      + c * (ampi_real)number(table, places, at[2] + i))
                     + d * (ampi_real)number(table, places, at[3] + i);
        }
    } else if (table->n.kind == AMPI_FLOAT32) {
        for (i = 0u; i < n; i++) {
            row[i] = (((row[i] + a * (ampi_real)float32_at(values, at[0] + i))
                       + b * (ampi_real)float32_at(values, at[1] + i))
                      + c * (ampi_real)float32_at(values, at[2] + i))
                     + d * (ampi_real)float32_at(values, at[3] + i);
        }
    } else {
        for (i = 0u; i < n; i++) {
            row[i] = (((row[i] + a * (ampi_real)int16_at(values, at[0] + i))
                       + b * (ampi_real)int16_at(values, at[1] + i))
                      + c * (ampi_real)int16_at(values, at[2] + i))
                     + d * (ampi_real)int16_at(values, at[3] + i);
        }
    }
}

/* Adds one tensor product: its vertices in C order, each with the product of its axes' weights. */
static void add_product(const ampi_table *table, const factor *factors, ampi_reference *reference)
{
    const size_t d = table->n.axes;
    size_t digit[AMPI_MAX_AXES] = {0u}, vertex[AMPI_MAX_AXES + 1u] = {0u}, window = 1u, from = 0u, i, v;
    size_t vertices[TOGETHER] = {0u}; /* of the last four some with weight 0 */
    double weight[AMPI_MAX_AXES + 1u] = {1.0};
    ampi_real weights[TOGETHER] = {(ampi_real)0};

    for (i = 0u; i < d; i++) { window *= factors[i].width; }
    for (v = 0u; v < window; v++) {
        for (i = from; i < d; i++) { /* the axes on which this vertex is another one */
            weight[i + 1u] = weight[i] * factors[i].weight[digit[i]];
            vertex[i + 1u] = vertex[i] + (factors[i].first + digit[i]) * table->stride[i];
        }
        vertices[v % TOGETHER] = vertex[d];
        weights[v % TOGETHER] = (ampi_real)weight[d];
        if ((((v + 1u) % TOGETHER) == 0u) || ((v + 1u) == window)) {
            add_vertices(table, vertices, weights, reference->rows);
            (void)memset(weights, 0, sizeof weights);
        }
        if ((table->holes != 0u) && (weight[d] != 0.0)) {
            reference->hole |= table->blob[table->holes + vertex[d]];
        }
        from = d;
        do { /* count on, the last axis fastest */
            from--;
            digit[from] = ((digit[from] + 1u) < factors[from].width) ? (digit[from] + 1u) : 0u;
        } while ((from > 0u) && (digit[from] == 0u));
    }
}

static void interpolate(const ampi_table *table, const double *inside, ampi_reference *reference)
{
    factor factors[AMPI_MAX_AXES] = {{0u, 0u, {0.0, 0.0, 0.0, 0.0}}};
    size_t below[AMPI_MAX_AXES] = {0u}, i;

    (void)memset(reference->rows, 0, table->columns * sizeof reference->rows[0]);
    for (i = 0u; i < table->n.axes; i++) {
        factors[i] = base_of(table, i, inside[i], &below[i]);
        reference->cell[i] = (uint32_t)factors[i].first;
    }
    add_product(table, factors, reference);
    for (i = 0u; i < table->n.axes; i++) {
        if ((table->axis[i].order == AMPI_SECOND_DIFFERENCES) && (table->axis[i].points > 2u)) {
            const factor base = factors[i];
            factors[i] = correction_of(table, i, inside[i], below[i]);
            add_product(table, factors, reference);
            factors[i] = base;
        }
    }
    for (i = 0u; (table->n.kind == AMPI_INT16) && (i < table->columns); i++) {
        const double steps = (double)reference->rows[i] * number(table, table->map, table->columns + i);
        reference->rows[i] = (ampi_real)(number(table, table->map, i) + steps); /* weights sum to one */
    }
    reference->final_time = (double)reference->rows[table->columns - 1u];
}

void ampi_reference_at(const ampi_table *table, const double *parameters, ampi_reference *reference)
{
    double inside[AMPI_MAX_AXES] = {0.0}, farthest = 0.0;
    bool is_known = true, is_clipped = false;
    size_t i;

    reference->hole = 0u;
    reference->checksum = 0u;
    reference->final_time = 0.0;
    reference->health = AMPI_NOT_BEGUN;
    if (table->is_open != AMPI_OPEN) { return; }
    for (i = 0u; i < table->n.axes; i++) {
        const double told = (parameters == NULL) ? AMPI_NAN : parameters[i];
        const double end = number(table, table->points_of[i], table->axis[i].points - 1u);
        inside[i] = placed(table, i, told, &reference->excess[i]);
        inside[i] = clipped(inside[i], number(table, table->points_of[i], 0u), end);
        reference->clipped[i] = ((table->n.clips != 0u) && (reference->excess[i] > 0.0)) ? 1u : 0u;
        farthest = most(farthest, reference->excess[i]);
        is_known = is_known && (fabs(told) < AMPI_SANE);
        is_clipped = is_clipped || (reference->clipped[i] != 0u);
    }
    interpolate(table, inside, reference);
    reference->checksum = table->checksum;
    reference->health = is_clipped ? AMPI_BOUNDARY_REFERENCE : AMPI_GOOD;
    reference->health = (reference->hole != 0u) ? AMPI_HOLE_REFERENCE : reference->health;
    if (farthest > FAR_OUT) {
        reference->health = is_known ? AMPI_FAR_OUTSIDE : AMPI_BAD_PARAMETERS;
    }
}

size_t ampi_chunk(const ampi_table *table, const ampi_reference *reference, size_t s, size_t first,
                  size_t count, double *points, size_t stride)
{
    const size_t last = table->segment[s].nodes - 1u, m = table->segment[s].points;
    const size_t rows = table->n.rows, size = smaller(AMPI_CHUNK, m - first);
    ampi_real matrix[AMPI_MAX_DEGREE_NODES][AMPI_CHUNK], sum[AMPI_CHUNK];
    size_t i, j, r;

    for (i = 0u; i <= last; i++) {
        for (j = 0u; j < size; j++) {
            matrix[i][j] = (ampi_real)number(table, table->matrix[s], i * m + first + j);
        }
        for (; j < AMPI_CHUNK; j++) { matrix[i][j] = (ampi_real)0; }
    }
    for (r = 0u; r < count; r++) { /* a whole chunk each time: loops of constant length are vectors */
        const ampi_real *value = &reference->rows[table->first_node[s] * rows + r];
        const ampi_real begin = value[0], end = value[last * rows];
        for (j = 0u; j < AMPI_CHUNK; j++) { sum[j] = begin * matrix[0][j]; }
        for (i = 1u; (i + 3u) < last; i += 4u) { /* four at once: a quarter of the loads and stores */
            const ampi_real a = value[i * rows], b = value[(i + 1u) * rows];
            const ampi_real c = value[(i + 2u) * rows], d = value[(i + 3u) * rows];
            for (j = 0u; j < AMPI_CHUNK; j++) {
                sum[j] = (((sum[j] + a * matrix[i][j]) + b * matrix[i + 1u][j])
                          + c * matrix[i + 2u][j]) + d * matrix[i + 3u][j];
            }
        }
        for (; i < last; i++) {
            const ampi_real a = value[i * rows];
            for (j = 0u; j < AMPI_CHUNK; j++) { sum[j] += a * matrix[i][j]; }
        }
        for (j = 0u; j < size; j++) {
            const ampi_real whole = sum[j] + end * matrix[last][j];
            points[r * stride + j] = (double)whole;
        }
    }
    return size;
}

void ampi_reference_high_density(const ampi_table *table, const ampi_reference *reference,
                                 double *times, double *rows)
{
    const size_t m = table->n.points;
    size_t s, first, size, j, done = 0u;

    if ((table->is_open != AMPI_OPEN) || (reference->checksum != table->checksum)) { return; }
    for (j = 0u; j < m; j++) { times[j] = time_of(table, reference->final_time, j); }
    for (s = 0u; s < table->n.segments; s++) {
        for (first = 0u; first < table->segment[s].points; first += size) {
            size = ampi_chunk(table, reference, s, first, table->n.rows, &rows[done], m);
            done += size;
        }
    }
}

static double start_of(const ampi_table *table, size_t s, double final_time)
{
    return table->segment[s].start[0] + table->segment[s].start[1] * final_time;
}

void ampi_row_at(const ampi_table *table, const ampi_reference *reference, double time, double *row)
{
    const size_t k = table->n.widest; /* slots beyond a segment's nodes: factor 1, weight 0 */
    const size_t rows = table->n.rows;
    const double end = reference->final_time, t = clipped(time, start_of(table, 0u, end), end);
    double factors[AMPI_MAX_DEGREE_NODES], basis[AMPI_MAX_DEGREE_NODES];
    double half, tau, left = 1.0, right = 1.0;
    size_t place[AMPI_MAX_DEGREE_NODES], i, r, s = 0u, last;

    for (i = 1u; i < table->n.segments; i++) { s += (start_of(table, i, end) <= t) ? 1u : 0u; }
    last = table->segment[s].nodes - 1u;
    half = table->segment[s].half_length[0] + table->segment[s].half_length[1] * end;
    tau = (t - start_of(table, s, end)) / half - 1.0;
    for (i = 0u; i < k; i++) { /* no division, no singular node */
        place[i] = smaller(i, last) * rows; /* a finite number, times 0 */
        factors[i] = (i <= last) ? (tau - number(table, table->basis[s], i)) : 1.0;
        basis[i] = number(table, table->basis[s], k + i) * left;
        left *= factors[i];
    }
    for (i = k; i > 0u; i--) {
        basis[i - 1u] *= right;
        right *= factors[i - 1u];
    }
    for (r = 0u; r < rows; r += 4u) { /* four sums that stay in registers; of the last four some anew */
        const size_t begin = smaller(r, rows - 4u);
        const ampi_real *values = &reference->rows[table->first_node[s] * rows + begin];
        double a = 0.0, b = 0.0, c = 0.0, d = 0.0;
        for (i = 0u; i < k; i++) {
            const ampi_real *value = &values[place[i]];
            a += basis[i] * (double)value[0];
            b += basis[i] * (double)value[1];
            c += basis[i] * (double)value[2];
            d += basis[i] * (double)value[3];
        }
        row[begin] = a;
        row[begin + 1u] = b;
        row[begin + 2u] = c;
        row[begin + 3u] = d;
    }
}
