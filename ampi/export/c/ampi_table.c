/* Opening a table: all of the blob is checked here, so that nothing is left to refuse in flight. The
   layout is that of ampi/export/blob.py. */
#include "ampi_parts.h"

static const unsigned char MAGIC[8] = {0x89u, 0x41u, 0x4Du, 0x50u, 0x49u, 0x0Du, 0x0Au, 0x1Au};
static const size_t BYTES[3] = {sizeof(double), sizeof(float), sizeof(int16_t)};

typedef struct {
    unsigned char magic[8];
    uint32_t mark, format, size, checksum, spare[2];
} header;

typedef struct { /* what is left of the blob to read */
    size_t place, end;
    bool is_short;
} reader;

/* The place of `count` things of `size` bytes; the next begins at a multiple of eight. */
static size_t taken(reader *from, size_t count, size_t size)
{
    const size_t place = from->place, left = from->end - place;
    const bool fits = count <= ((left & ~(size_t)7u) / size);
    from->is_short = from->is_short || !fits;
    from->place += fits ? ((count * size + 7u) & ~(size_t)7u) : 0u;
    return place;
}

/* Copies the next `size` bytes, if they are there. */
static void copy(reader *from, const ampi_table *table, void *to, size_t size)
{
    const size_t place = taken(from, 1u, size);
    if (!from->is_short) { (void)memcpy(to, &table->blob[place], size); }
}

/* CRC-32 of zlib, half a byte at a time: no table to make, and a quarter of the time of bits. */
uint32_t ampi_crc_32(const unsigned char *bytes, size_t begin, size_t end)
{
    static const uint32_t OF_HALF[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u,
        0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u,
        0xA00AE278u, 0xBDBDF21Cu};
    uint32_t crc = 0xFFFFFFFFu;
    size_t i;
    for (i = begin; i < end; i++) {
        crc ^= bytes[i];
        crc = (crc >> 4) ^ OF_HALF[crc & 15u];
        crc = (crc >> 4) ^ OF_HALF[crc & 15u];
    }
    return crc ^ 0xFFFFFFFFu;
}

static ampi_status header_status(const header *told, const unsigned char *blob, size_t size)
{
    if (memcmp(told->magic, MAGIC, sizeof MAGIC) != 0) { return AMPI_FOREIGN; }
    if (told->mark != 0x01020304u) { return AMPI_BYTE_ORDER; }
    if ((told->format != 2u) || ((told->spare[0] | told->spare[1]) != 0u)) { return AMPI_VERSION; }
    if ((size_t)told->size != (size - sizeof *told)) { return AMPI_TRUNCATED; }
    return (ampi_crc_32(blob, sizeof *told, size) == told->checksum) ? AMPI_OK : AMPI_CHECKSUM;
}

static bool is_too_large(const ampi_table *table)
{
    return (table->n.axes > AMPI_MAX_AXES) || (table->n.rows > AMPI_MAX_ROWS)
           || (table->n.nodes > AMPI_MAX_NODES) || (table->n.points > AMPI_MAX_POINTS)
           || (table->n.segments > AMPI_MAX_SEGMENTS) || (table->n.widest > AMPI_MAX_DEGREE_NODES);
}

/* Rows of the law; those of a vehicle without a schedule of the angle of attack end with that. */
static size_t rows_of_law(const ampi_table *table)
{
    const size_t linear = (table->n.modulates != 0u) ? N_STEERED_ROWS : N_LINEAR_ROWS;
    return (table->n.law == AMPI_LINEAR_QUADRATIC) ? linear : N_DRAG_ROWS;
}

/* Copies axes, segments and settings; whether their counts agree with each other. */
static bool are_counts_good(ampi_table *table, reader *from)
{
    const size_t rows = rows_of_law(table);
    bool is_good = (table->n.axes > 0u) && (table->n.points > 1u)
                   && ((table->n.rows == rows) || (table->n.rows == (rows + 1u)))
                   && (table->n.kind <= AMPI_INT16) && (table->n.law <= AMPI_DRAG_SHUTTLE);
    size_t i, node = 0u, points = 0u;

    table->angle_row = (table->n.rows == rows) ? 0u : rows;
    (void)taken(from, table->n.text, 1u); /* for people */
    for (i = 0u; i < table->n.axes; i++) {
        copy(from, table, &table->axis[i], sizeof table->axis[i]);
        is_good = is_good && (table->axis[i].points > 0u) && (table->axis[i].order >= AMPI_NEAREST)
                  && (table->axis[i].order <= AMPI_SECOND_DIFFERENCES);
    }
    for (i = 0u; i < table->n.segments; i++) {
        copy(from, table, &table->segment[i], sizeof table->segment[i]);
        is_good = is_good && (table->segment[i].nodes > 1u)
                  && (table->segment[i].nodes <= table->n.widest);
        table->first_node[i] = node;
        node += is_good ? (table->segment[i].nodes - 1u) : 0u;
        points += table->segment[i].points;
    }
    copy(from, table, &table->set, sizeof table->set);
    return is_good && ((node + 1u) == table->n.nodes) && (points == table->n.points);
}

/* Finds the places of what stays in the blob; whether it ends where they do. */
static bool are_places_good(ampi_table *table, reader *from)
{
    const size_t widest = table->n.widest;
    size_t i, vertices = 1u;

    for (i = 0u; i < table->n.axes; i++) {
        table->points_of[i] = taken(from, table->axis[i].points, sizeof(double));
    }
    for (i = 0u; i < table->n.segments; i++) {
        table->basis[i] = taken(from, 2u * widest, sizeof(double));
        table->matrix[i] = taken(from, table->segment[i].points,
                                 table->segment[i].nodes * sizeof(double));
    }
    table->columns = (size_t)table->n.rows * table->n.nodes + 1u;
    table->times = taken(from, 2u * (size_t)table->n.points, sizeof(double));
    table->map = from->place;
    if (table->n.kind == AMPI_INT16) {
        table->map = taken(from, 2u * table->columns, sizeof(double));
    }
    for (i = table->n.axes; (i > 0u) && !from->is_short; i--) {
        table->stride[i - 1u] = vertices;
        from->is_short = table->axis[i - 1u].points > (from->end / vertices);
        vertices *= table->axis[i - 1u].points;
    }
    table->values = taken(from, vertices, table->columns * BYTES[table->n.kind]);
    table->holes = (table->n.has_holes != 0u) ? taken(from, vertices, 1u) : 0u;
    return !from->is_short && (from->place == from->end);
}

/* Whether all numbers are finite, axes increase, and limits, cycle and edges are what they can be. */
static bool are_numbers_good(const ampi_table *table)
{
    const size_t size = (size_t)table->axis[0].points * table->stride[0] * table->columns;
    bool is_good = table->set.cycle >= AMPI_SHORTEST;
    size_t i, j;

    for (i = table->points_of[0] - sizeof table->set; i < table->values; i += sizeof(double)) {
        is_good = is_good && (fabs(number(table, i, 0u)) < HUGE_VAL);
    }
    for (i = 0u; (table->n.kind == AMPI_FLOAT64) && (i < size); i++) {
        is_good = is_good && (fabs(number(table, table->values, i)) < HUGE_VAL);
    }
    for (i = 0u; (table->n.kind == AMPI_FLOAT32) && (i < size); i++) {
        float value;
        (void)memcpy(&value, &table->blob[table->values + sizeof value * i], sizeof value);
        is_good = is_good && (fabs((double)value) < HUGE_VAL);
    }
    for (i = 0u; i < 3u; i++) {
        is_good = is_good && (table->set.limit[i] > 0.0)
                  && ((table->set.modulation[i] > 0.0) == (table->set.modulation[0] > 0.0));
    }
    for (i = 0u; i < table->n.axes; i++) {
        is_good = is_good && (table->axis[i].low <= table->axis[i].nominal)
                  && (table->axis[i].nominal <= table->axis[i].high)
                  && ((table->axis[i].high - table->axis[i].low) < HUGE_VAL);
        for (j = 1u; j < table->axis[i].points; j++) {
            const double before = number(table, table->points_of[i], j - 1u);
            is_good = is_good && (before < number(table, table->points_of[i], j));
        }
    }
    return is_good;
}

ampi_status ampi_table_open(ampi_table *table, const unsigned char *blob, size_t size)
{
    reader from = {sizeof(header), size, false};
    ampi_status status = AMPI_TRUNCATED;
    header told;

    (void)memset(table, 0, sizeof *table);
    if ((blob != NULL) && (size >= (sizeof told + sizeof table->n))) {
        table->blob = blob;
        (void)memcpy(&told, blob, sizeof told);
        table->checksum = told.checksum;
        status = header_status(&told, blob, size);
        copy(&from, table, &table->n, sizeof table->n);
    }
    if ((status == AMPI_OK) && is_too_large(table)) { status = AMPI_TOO_LARGE; }
    if ((status == AMPI_OK)
        && !(are_counts_good(table, &from) && are_places_good(table, &from)
             && are_numbers_good(table))) {
        status = AMPI_INCONSISTENT;
    }
    table->is_open = (status == AMPI_OK) ? AMPI_OPEN : 0u;
    return status;
}
