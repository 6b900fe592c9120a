/* Opening a table: all of the blob is checked here, so that nothing is left to refuse in flight. The
   layout is that of ampi/export/blob.py: header, sizes, text, then what each part counts. */
#include "ampi_parts.h"

#define HEADER 32u
#define BYTE_ORDER_MARK 0x01020304u
#define FORMAT 1u
#define N_SIZES 16u
#define N_SETTINGS (4u + 2u * AMPI_N_STATES + AMPI_N_GAINS)

static const unsigned char MAGIC[8] = {0x89u, 'A', 'M', 'P', 'I', 0x0Du, 0x0Au, 0x1Au};

/* What is left of the blob to read; once too little is, all fails. */
typedef struct {
    const unsigned char *blob;
    size_t place, end;
    int is_short;
} reader;

/* The place of `count` things of `size` bytes, and past them, to the next multiple of eight. */
static size_t taken(reader *from, size_t count, size_t size)
{
    const size_t place = from->place, left = from->end - place;
    size_t bytes;
    if ((size != 0u) && (count > (left / size))) {
        from->is_short = 1;
        return place;
    }
    bytes = count * size;
    bytes += (8u - (bytes % 8u)) % 8u;
    if (bytes > left) {
        from->is_short = 1;
        return place;
    }
    from->place = place + bytes;
    return place;
}

static uint32_t word(const unsigned char *blob, size_t place, size_t i)
{
    uint32_t value;
    (void)memcpy(&value, &blob[place + 4u * i], sizeof value);
    return value;
}

/* CRC-32 of zlib, half a byte at a time: no table to make, and a quarter of the time of bits. */
static uint32_t crc_32(const unsigned char *bytes, size_t size)
{
    static const uint32_t OF_HALF[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u,
        0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u,
        0xA00AE278u, 0xBDBDF21Cu};
    uint32_t crc = 0xFFFFFFFFu;
    size_t i;
    for (i = 0u; i < size; i++) {
        crc ^= bytes[i];
        crc = (crc >> 4) ^ OF_HALF[crc & 15u];
        crc = (crc >> 4) ^ OF_HALF[crc & 15u];
    }
    return crc ^ 0xFFFFFFFFu;
}

static ampi_status header_status(const unsigned char *blob, size_t size)
{
    ampi_status status = AMPI_OK;
    if ((blob == NULL) || (size < HEADER)) {
        status = AMPI_TRUNCATED;
    } else if (memcmp(blob, MAGIC, sizeof MAGIC) != 0) {
        status = AMPI_FOREIGN;
    } else if (word(blob, 8u, 0u) != BYTE_ORDER_MARK) {
        status = AMPI_BYTE_ORDER;
    } else if (word(blob, 8u, 1u) != FORMAT) {
        status = AMPI_VERSION;
    } else if ((size_t)word(blob, 8u, 2u) != (size - HEADER)) {
        status = AMPI_TRUNCATED;
    } else if ((word(blob, 8u, 4u) | word(blob, 8u, 5u)) != 0u) {
        status = AMPI_VERSION; /* kept free */
    } else if (crc_32(&blob[HEADER], size - HEADER) != word(blob, 8u, 3u)) {
        status = AMPI_CHECKSUM;
    } else {
        /* it is ours, and whole */
    }
    return status;
}

static ampi_status read_sizes(ampi_table *table, reader *from)
{
    const size_t sizes = taken(from, N_SIZES, 4u);
    int is_large;
    if (from->is_short != 0) {
        return AMPI_INCONSISTENT;
    }
    table->kind = word(table->blob, sizes, 0u);
    table->law = word(table->blob, sizes, 1u);
    table->n_axes = word(table->blob, sizes, 2u);
    table->n_rows = word(table->blob, sizes, 3u);
    table->n_nodes = word(table->blob, sizes, 4u);
    table->n_points = word(table->blob, sizes, 5u);
    table->n_segments = word(table->blob, sizes, 6u);
    table->widest = word(table->blob, sizes, 7u);
    table->clips = word(table->blob, sizes, 8u);
    table->is_cycle_stated = word(table->blob, sizes, 9u);
    table->limit_axis[0] = word(table->blob, sizes, 10u);
    table->limit_axis[1] = word(table->blob, sizes, 11u);
    table->limit_axis[2] = word(table->blob, sizes, 12u);
    table->holes = word(table->blob, sizes, 13u);
    is_large = (table->n_axes > AMPI_MAX_AXES) || (table->n_rows > AMPI_MAX_ROWS)
               || (table->n_nodes > AMPI_MAX_NODES) || (table->n_points > AMPI_MAX_POINTS)
               || (table->n_segments > AMPI_MAX_SEGMENTS) || (table->widest > AMPI_MAX_DEGREE_NODES);
    if (is_large) {
        return AMPI_TOO_LARGE;
    }
    (void)taken(from, word(table->blob, sizes, 14u), 1u); /* the text that explains it */
    table->n_columns = table->n_rows * table->n_nodes + 1u;
    return ((table->n_axes > 0u) && (table->n_points > 1u) && (table->n_segments > 0u)
            && (table->kind <= (size_t)AMPI_INT16) && (table->law <= (size_t)AMPI_DRAG_SHUTTLE)
            && (table->n_rows == (size_t)((table->law == (size_t)AMPI_LINEAR_QUADRATIC)
                                              ? AMPI_LINEAR_ROWS : AMPI_DRAG_ROWS)))
               ? AMPI_OK : AMPI_INCONSISTENT;
}

/* Counts of axes and segments; whether they agree with each other. */
static int read_counts(ampi_table *table, reader *from)
{
    const size_t axes = taken(from, table->n_axes, 16u), segments = taken(from, table->n_segments, 16u);
    size_t i, node = 0u, points = 0u;
    int is_good = (from->is_short == 0) ? 1 : 0;

    for (i = 0u; (is_good != 0) && (i < table->n_axes); i++) {
        ampi_axis *axis = &table->axis[i];
        axis->points = word(table->blob, axes, 4u * i);
        axis->order = word(table->blob, axes, 4u * i + 1u);
        axis->circular = word(table->blob, axes, 4u * i + 2u);
        is_good = ((axis->points > 0u) && (axis->order >= (size_t)AMPI_NEAREST)
                   && (axis->order <= (size_t)AMPI_SECOND_DIFFERENCES)) ? 1 : 0;
    }
    for (i = 0u; (is_good != 0) && (i < table->n_segments); i++) {
        ampi_segment *segment = &table->segment[i];
        segment->first_node = node;
        segment->nodes = word(table->blob, segments, 4u * i);
        segment->points = word(table->blob, segments, 4u * i + 1u);
        is_good = ((segment->nodes > 1u) && (segment->nodes <= table->widest)
                   && (segment->points <= (table->n_points - points))) ? 1 : 0;
        node += segment->nodes - 1u;
        points += segment->points;
        is_good &= (node < table->n_nodes) ? 1 : 0;
    }
    return is_good & (((node + 1u) == table->n_nodes) ? 1 : 0) & ((points == table->n_points) ? 1 : 0);
}

/* Settings, axes and segments; whether their numbers are in order. */
static int read_numbers(ampi_table *table, reader *from)
{
    const size_t settings = taken(from, N_SETTINGS, 8u), edges = taken(from, table->n_axes, 24u);
    size_t times, i, j;
    int is_good = 1;

    for (i = 0u; i < table->n_axes; i++) {
        table->axis[i].place = taken(from, table->axis[i].points, 8u);
    }
    times = taken(from, table->n_segments, 32u);
    for (i = 0u; i < table->n_segments; i++) {
        ampi_segment *segment = &table->segment[i];
        segment->basis = taken(from, 2u * table->widest, 8u);
        segment->blocks = taken(from, (segment->points + AMPI_BLOCK - 1u) / AMPI_BLOCK,
                                8u * AMPI_BLOCK * segment->nodes);
    }
    table->times = taken(from, 2u * table->n_points, 8u);
    table->affine = taken(from, (table->kind == (size_t)AMPI_INT16) ? (2u * table->n_columns) : 0u, 8u);
    if (from->is_short != 0) {
        return 0;
    }
    for (i = settings; i < from->place; i += 8u) { /* all of it are numbers, finite ones */
        is_good &= (fabs(ampi_number(table, i, 0u)) < HUGE_VAL) ? 1 : 0;
    }
    table->cycle = ampi_number(table, settings, 3u);
    for (i = 0u; i < 3u; i++) {
        table->limit[i] = ampi_number(table, settings, i);
        is_good &= (table->limit[i] > 0.0) ? 1 : 0;
    }
    for (i = 0u; i < AMPI_N_STATES; i++) {
        table->middle[i] = ampi_number(table, settings, 4u + i);
        table->reach[i] = ampi_number(table, settings, 4u + AMPI_N_STATES + i);
    }
    for (i = 0u; i < AMPI_N_GAINS; i++) {
        table->gain[i] = ampi_number(table, settings, 4u + 2u * AMPI_N_STATES + i);
    }
    for (i = 0u; i < table->n_axes; i++) {
        ampi_axis *axis = &table->axis[i];
        axis->low = ampi_number(table, edges, 3u * i);
        axis->high = ampi_number(table, edges, 3u * i + 1u);
        axis->nominal = ampi_number(table, edges, 3u * i + 2u);
        is_good &= ((axis->low <= axis->nominal) && (axis->nominal <= axis->high)) ? 1 : 0;
        for (j = 1u; j < axis->points; j++) {
            const double before = ampi_number(table, axis->place, j - 1u);
            is_good &= (ampi_number(table, axis->place, j) > before) ? 1 : 0;
        }
    }
    for (i = 0u; i < table->n_segments; i++) {
        for (j = 0u; j < 2u; j++) {
            table->segment[i].start[j] = ampi_number(table, times, 4u * i + j);
            table->segment[i].half_length[j] = ampi_number(table, times, 4u * i + 2u + j);
        }
    }
    return is_good & ((table->cycle >= AMPI_SHORTEST) ? 1 : 0);
}

/* The values, and which of them are borrowed; whether they are there and finite. */
static int read_values(ampi_table *table, reader *from)
{
    static const size_t BYTES[3] = {sizeof(double), sizeof(float), sizeof(int16_t)};
    const size_t bytes = BYTES[table->kind];
    size_t i, size, vertices = 1u;
    int is_good = 1;

    for (i = table->n_axes; i > 0u; i--) {
        table->axis[i - 1u].stride = vertices;
        if (table->axis[i - 1u].points > (from->end / vertices)) { /* cannot all be there */
            return 0;
        }
        vertices *= table->axis[i - 1u].points;
    }
    table->n_vertices = vertices;
    table->values = taken(from, vertices, table->n_columns * bytes);
    table->holes = (table->holes != 0u) ? taken(from, vertices, 1u) : 0u;
    if ((from->is_short != 0) || (from->place != from->end)) {
        return 0;
    }
    size = (table->kind == (size_t)AMPI_INT16) ? 0u : (vertices * table->n_columns);
    for (i = 0u; i < size; i++) {
        float single = 0.0f;
        double value;
        if (table->kind == (size_t)AMPI_FLOAT32) {
            (void)memcpy(&single, &table->blob[table->values + i * bytes], sizeof single);
        }
        value = (table->kind == (size_t)AMPI_FLOAT32) ? (double)single
                                                      : ampi_number(table, table->values, i);
        is_good &= (fabs(value) < HUGE_VAL) ? 1 : 0;
    }
    return is_good;
}

ampi_status ampi_table_open(ampi_table *table, const unsigned char *blob, size_t size)
{
    reader from = {blob, HEADER, size, 0};
    ampi_status status = header_status(blob, size);

    (void)memset(table, 0, sizeof *table);
    table->blob = blob;
    if (status == AMPI_OK) {
        status = read_sizes(table, &from);
    }
    if ((status == AMPI_OK)
        && ((read_counts(table, &from) == 0) || (read_numbers(table, &from) == 0)
            || (read_values(table, &from) == 0))) {
        status = AMPI_INCONSISTENT;
    }
    if (status == AMPI_OK) {
        table->checksum = word(blob, 8u, 3u);
        table->is_open = AMPI_OPENED;
    }
    return status;
}
