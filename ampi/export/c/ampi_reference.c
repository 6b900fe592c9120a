/* Parameters to reference: the subspace on each axis, the weighted sum of its vertices, and their
   conversion to high density or to one instant. Sagliano et al. 2016, Eqs. (16) to (19), (30) to (33);
   ampi/onboard/{subspace,interpolation,reference,segments}.py have the formulas. */
#include "ampi_parts.h"

#define FAR_OUT 0.2 /* of an axis' range: further outside, the boundary trajectory is not near */
#define ROUNDING 3.552713678800501e-15 /* 16 eps: an edge in another unit differs in the last digits */

/* Weights on one axis. */
typedef struct {
    size_t first, width;
    double weight[AMPI_MAX_WIDTH];
} factor;

static size_t smaller(size_t a, size_t b) { return (a < b) ? a : b; }

static double point_of(const ampi_table *table, const ampi_axis *axis, size_t j)
{
    return ampi_number(table, axis->place, j);
}

/* The parameter as it is looked up, and how far outside it lies, in shares of its range. */
static double placed(const ampi_axis *axis, double told, double *excess)
{
    const int is_inside = (axis->low <= told) && (told <= axis->high);
    const int is_sane = is_inside || (fabs(told) < AMPI_SANE);
    const double range = axis->high - axis->low;
    const double most = ampi_max(fabs(axis->low), fabs(axis->high));
    const double tolerance = ROUNDING * ((axis->circular != 0u) ? ampi_max(most, AMPI_TURN) : most);
    double p = is_sane ? told : axis->nominal;
    const double turned = ampi_on_turn_of(p, 0.5 * (axis->low + axis->high));
    double edge, beyond;

    p = (is_inside || (axis->circular == 0u)) ? p : turned;
    edge = ampi_clipped(p, axis->low, axis->high);
    beyond = fabs(p - edge);
    if (beyond <= tolerance) {
        p = edge;
        beyond = 0.0;
    } else {
        beyond = (range > 0.0) ? (beyond / range) : HUGE_VAL;
    }
    *excess = is_sane ? beyond : HUGE_VAL;
    return p;
}

/* First of the `width` points that interpolate the cell of `below`. */
static size_t first_of(size_t below, size_t width, size_t points)
{
    size_t first = below;
    if (width == 3u) {
        first -= below % 2u;
    } else if (width == 4u) {
        first -= (below > 0u) ? 1u : 0u;
    } else {
        /* the cell itself */
    }
    return smaller(first, points - width);
}

/* Lagrange's weights of a point inside, or of the nearer point; and its cell. */
static factor base_of(const ampi_table *table, const ampi_axis *axis, double inside, size_t *below)
{
    const size_t n = axis->points;
    const size_t order = (axis->order == (size_t)AMPI_SECOND_DIFFERENCES) ? 2u : axis->order;
    factor base = {0u, 0u, {1.0, 0.0, 0.0, 0.0}};
    size_t i, j, cell = 0u;

    for (j = 1u; (j + 1u) < n; j++) {
        cell += (point_of(table, axis, j) <= inside) ? 1u : 0u;
    }
    *below = cell;
    base.width = smaller(order, n);
    base.first = first_of(cell, base.width, n);
    if ((base.width == 1u) && (n > 1u)) {
        const double above = point_of(table, axis, cell + 1u) - inside;
        base.first = cell + (((inside - point_of(table, axis, cell)) > above) ? 1u : 0u);
    }
    for (i = 0u; i < base.width; i++) {
        const double own = point_of(table, axis, base.first + i);
        base.weight[i] = 1.0;
        for (j = 0u; j < base.width; j++) {
            const double other = point_of(table, axis, base.first + j);
            base.weight[i] *= (j != i) ? ((inside - other) / (own - other)) : 1.0;
        }
    }
    return base;
}

/* Weights of the correction by second differences, of an axis of three points at least. */
static factor correction_of(const ampi_table *table, const ampi_axis *axis, double inside, size_t below)
{
    const size_t n = axis->points;
    const double begin = point_of(table, axis, below);
    const double h = point_of(table, axis, below + 1u) - begin;
    const double s = (inside - begin) / h;
    const double bubble = s * (s - 1.0) * (h * h);
    factor correction = {0u, 0u, {0.0, 0.0, 0.0, 0.0}};
    size_t side;

    correction.width = smaller(4u, n);
    correction.first = (n > 3u) ? first_of(below, 4u, n) : 0u;
    for (side = 0u; side < 2u; side++) {
        const size_t node = below + side;
        const size_t j = smaller((node > 1u) ? node : 1u, n - 2u);
        const double at = point_of(table, axis, j);
        const double left = at - point_of(table, axis, j - 1u);
        const double right = point_of(table, axis, j + 1u) - at;
        const double part = bubble * ((side == 0u) ? (1.0 - s) : s);
        double *weight = &correction.weight[j - 1u - correction.first];
        weight[0] += part / (left * (left + right));
        weight[1] -= part / (left * right);
        weight[2] += part / (right * (left + right));
    }
    return correction;
}

/* row += w T_v over all columns. */
static void add_vertex(const ampi_table *table, size_t vertex, ampi_real weight, ampi_real *row)
{
    const size_t n = table->n_columns;
    const unsigned char *from = &table->blob[table->values];
    size_t c;

    if (table->kind == (size_t)AMPI_FLOAT64) {
        from = &from[vertex * n * sizeof(double)];
        for (c = 0u; c < n; c++) {
            double value;
            (void)memcpy(&value, &from[c * sizeof value], sizeof value);
            row[c] += weight * (ampi_real)value;
        }
    } else if (table->kind == (size_t)AMPI_FLOAT32) {
        from = &from[vertex * n * sizeof(float)];
        for (c = 0u; c < n; c++) {
            float value;
            (void)memcpy(&value, &from[c * sizeof value], sizeof value);
            row[c] += weight * (ampi_real)value;
        }
    } else {
        from = &from[vertex * n * sizeof(int16_t)];
        for (c = 0u; c < n; c++) {
            int16_t value;
            (void)memcpy(&value, &from[c * sizeof value], sizeof value);
            row[c] += weight * (ampi_real)value;
        }
    }
}

/* Adds one tensor product: its vertices in C order, each with the product of its axes' weights. */
static void add_product(const ampi_table *table, const factor *factors, ampi_reference *reference)
{
    const size_t d = table->n_axes;
    size_t digit[AMPI_MAX_AXES] = {0u}, vertex[AMPI_MAX_AXES + 1u] = {0u};
    double weight[AMPI_MAX_AXES + 1u] = {1.0};
    size_t window = 1u, changed = 0u, i, v;

    for (i = 0u; i < d; i++) {
        window *= factors[i].width;
    }
    for (v = 0u; v < window; v++) {
        for (i = changed; i < d; i++) {
            weight[i + 1u] = weight[i] * factors[i].weight[digit[i]];
            vertex[i + 1u] = vertex[i] + (factors[i].first + digit[i]) * table->axis[i].stride;
        }
        add_vertex(table, vertex[d], (ampi_real)weight[d], reference->rows);
        if ((table->holes != 0u) && (weight[d] != 0.0)) {
            reference->hole |= table->blob[table->holes + vertex[d]];
        }
        changed = d;
        do { /* count on, the last axis fastest */
            changed--;
            digit[changed] = ((digit[changed] + 1u) < factors[changed].width) ? (digit[changed] + 1u) : 0u;
        } while ((changed > 0u) && (digit[changed] == 0u));
    }
}

static void interpolate(const ampi_table *table, const double *inside, ampi_reference *reference)
{
    const size_t n = table->n_columns;
    factor factors[AMPI_MAX_AXES] = {{0u, 0u, {0.0, 0.0, 0.0, 0.0}}};
    size_t below[AMPI_MAX_AXES] = {0u}, i;

    (void)memset(reference->rows, 0, n * sizeof reference->rows[0]);
    for (i = 0u; i < table->n_axes; i++) {
        factors[i] = base_of(table, &table->axis[i], inside[i], &below[i]);
        reference->cell[i] = (uint32_t)factors[i].first;
    }
    add_product(table, factors, reference);
    for (i = 0u; i < table->n_axes; i++) {
        const ampi_axis *axis = &table->axis[i];
        if ((axis->order == (size_t)AMPI_SECOND_DIFFERENCES) && (axis->points > 2u)) {
            const factor base = factors[i];
            factors[i] = correction_of(table, axis, inside[i], below[i]);
            add_product(table, factors, reference);
            factors[i] = base;
        }
    }
    if (table->kind == (size_t)AMPI_INT16) { /* the weights sum to one: the map goes last */
        for (i = 0u; i < n; i++) {
            const double scale = ampi_number(table, table->affine, n + i);
            const double value = ampi_number(table, table->affine, i) + scale * (double)reference->rows[i];
            reference->rows[i] = (ampi_real)value;
        }
    }
    reference->final_time = (double)reference->rows[n - 1u];
}

void ampi_reference_at(const ampi_table *table, const double *parameters, ampi_reference *reference)
{
    double inside[AMPI_MAX_AXES], most = 0.0;
    uint32_t is_known = 1u, is_clipped = 0u;
    size_t i;

    reference->hole = 0u;
    reference->checksum = 0u;
    reference->final_time = 0.0;
    reference->health = (int32_t)AMPI_NOT_BEGUN;
    if (table->is_open != AMPI_OPENED) {
        return;
    }
    for (i = 0u; i < table->n_axes; i++) {
        const ampi_axis *axis = &table->axis[i];
        const double told = (parameters == NULL) ? (double)NAN : parameters[i];
        double excess;
        const double p = placed(axis, told, &excess);
        const double end = point_of(table, axis, axis->points - 1u);
        inside[i] = ampi_clipped(p, point_of(table, axis, 0u), end);
        is_known &= (fabs(told) < AMPI_SANE) ? 1u : 0u;
        most = ampi_max(most, excess);
        reference->excess[i] = excess;
        reference->clipped[i] = ((table->clips != 0u) && (excess > 0.0)) ? 1u : 0u;
        is_clipped |= reference->clipped[i];
    }
    interpolate(table, inside, reference);
    reference->checksum = table->checksum;
    reference->health = (is_clipped != 0u) ? (int32_t)AMPI_BOUNDARY_REFERENCE : (int32_t)AMPI_GOOD;
    if (reference->hole != 0u) {
        reference->health = (int32_t)AMPI_HOLE_REFERENCE;
    }
    if (most > FAR_OUT) {
        reference->health = (is_known != 0u) ? (int32_t)AMPI_FAR_OUTSIDE : (int32_t)AMPI_BAD_PARAMETERS;
    }
}

void ampi_load_block(const ampi_table *table, const ampi_segment *segment, size_t b, ampi_real *block)
{
    const size_t size = segment->nodes * AMPI_BLOCK;
    size_t i;
    for (i = 0u; i < size; i++) {
        block[i] = (ampi_real)ampi_number(table, segment->blocks, b * size + i);
    }
}

void ampi_convert(const ampi_real *block, const ampi_real *values, size_t nodes, ampi_real *points)
{
    ampi_real sum[AMPI_BLOCK] = {(ampi_real)0};
    size_t i, j;
    for (i = 0u; i < nodes; i++) {
        for (j = 0u; j < AMPI_BLOCK; j++) {
            sum[j] += values[i] * block[i * AMPI_BLOCK + j];
        }
    }
    for (j = 0u; j < AMPI_BLOCK; j++) {
        points[j] = sum[j];
    }
}

double ampi_time_of(const ampi_table *table, const ampi_reference *reference, size_t point)
{
    const double fixed = ampi_number(table, table->times, point);
    return fixed + ampi_number(table, table->times, table->n_points + point) * reference->final_time;
}

void ampi_reference_high_density(const ampi_table *table, const ampi_reference *reference,
                                 double *times, double *rows)
{
    ampi_real block[AMPI_MAX_DEGREE_NODES * AMPI_BLOCK], points[AMPI_BLOCK];
    const size_t n = table->n_nodes, m = table->n_points;
    size_t s, b, r, j, first = 0u;

    if ((table->is_open != AMPI_OPENED) || (reference->checksum != table->checksum)) {
        return;
    }
    for (j = 0u; j < m; j++) {
        times[j] = ampi_time_of(table, reference, j);
    }
    for (s = 0u; s < table->n_segments; s++) {
        const ampi_segment *segment = &table->segment[s];
        for (b = 0u; (b * AMPI_BLOCK) < segment->points; b++) {
            const size_t size = smaller(AMPI_BLOCK, segment->points - b * AMPI_BLOCK);
            ampi_load_block(table, segment, b, block);
            for (r = 0u; r < table->n_rows; r++) {
                ampi_convert(block, &reference->rows[r * n + segment->first_node], segment->nodes, points);
                for (j = 0u; j < size; j++) {
                    rows[r * m + first + j] = (double)points[j];
                }
            }
            first += size;
        }
    }
}

void ampi_row_at(const ampi_table *table, const ampi_reference *reference, double time, double *row)
{
    const size_t k = table->widest;
    const double end = reference->final_time;
    double left[AMPI_MAX_DEGREE_NODES], basis[AMPI_MAX_DEGREE_NODES], t, tau, right = 1.0;
    const ampi_segment *segment = &table->segment[0];
    size_t i, r, s = 0u;

    t = ampi_clipped(time, segment->start[0] + segment->start[1] * end, end);
    for (i = 1u; i < table->n_segments; i++) {
        s += ((table->segment[i].start[0] + table->segment[i].start[1] * end) <= t) ? 1u : 0u;
    }
    segment = &table->segment[s];
    t -= segment->start[0] + segment->start[1] * end;
    tau = t / (segment->half_length[0] + segment->half_length[1] * end) - 1.0;
    left[0] = 1.0;
    for (i = 1u; i < k; i++) { /* no division, no singular node */
        const double node = tau - ampi_number(table, segment->basis, i - 1u);
        left[i] = left[i - 1u] * ((i <= segment->nodes) ? node : 1.0);
    }
    for (i = k; i > 0u; i--) { /* slots beyond the segment's nodes have weight 0 */
        const double node = tau - ampi_number(table, segment->basis, i - 1u);
        basis[i - 1u] = ampi_number(table, segment->basis, k + i - 1u) * left[i - 1u] * right;
        right *= (i <= segment->nodes) ? node : 1.0;
    }
    for (r = 0u; r < table->n_rows; r++) {
        const ampi_real *values = &reference->rows[r * table->n_nodes + segment->first_node];
        double sum = 0.0;
        for (i = 0u; i < k; i++) {
            sum += basis[i] * (double)values[smaller(i, segment->nodes - 1u)];
        }
        row[r] = sum;
    }
}
