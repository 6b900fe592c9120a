/* libFuzzer's target: any bytes as a table, its size and checksum made right so that what lies behind is
   reached too; flown if it opens. `fuzz DIRECTORY`, seeded with blobs; ASan and UBSan end it. */
#include <stdlib.h>

#include "ampi_parts.h"

int LLVMFuzzerTestOneInput(const unsigned char *bytes, size_t size);

static ampi_table table;
static ampi_reference reference;
static ampi_guidance guidance;
static double times[AMPI_MAX_POINTS], rows[AMPI_MAX_ROWS * AMPI_MAX_POINTS];

static uint32_t crc_32(const unsigned char *bytes, size_t size)
{
    static uint32_t of_byte[256];
    uint32_t crc = 0xFFFFFFFFu, i, bit;
    for (i = 0u; (of_byte[255] == 0u) && (i < 256u); i++) {
        of_byte[i] = i;
        for (bit = 0u; bit < 8u; bit++) {
            of_byte[i] = (of_byte[i] >> 1) ^ (0xEDB88320u & (0u - (of_byte[i] & 1u)));
        }
    }
    for (; size > 0u; size--) { crc = (crc >> 8) ^ of_byte[(crc ^ *bytes++) & 255u]; }
    return ~crc;
}

static void fly(const double *numbers)
{
    size_t i;
    ampi_reference_at(&table, numbers, &reference);
    ampi_reference_high_density(&table, &reference, times, rows);
    ampi_guidance_begin(&guidance, &table, numbers);
    for (i = 0u; i < 4u; i++) { /* the blob's own first numbers are as good as any */
        (void)ampi_guidance_step(&guidance, &table, (i == 2u) ? numbers[0] : (double)i, &numbers[i],
                                 ((i % 2u) == 0u) ? numbers : NULL);
    }
}

int LLVMFuzzerTestOneInput(const unsigned char *bytes, size_t size)
{
    unsigned char *blob = malloc(size + 1u); /* of its own, so that a byte too far is found */
    double numbers[32] = {0.0};
    if (blob == NULL) {
        return 0;
    }
    (void)memcpy(blob, bytes, size);
    if ((size > 32u) && (bytes[31] == 0u)) { /* one byte decides whether the header is left alone */
        const uint32_t left = (uint32_t)size - 32u, crc = crc_32(&blob[32], size - 32u);
        (void)memcpy(&blob[16], &left, sizeof left);
        (void)memcpy(&blob[20], &crc, sizeof crc);
    }
    (void)memcpy(numbers, bytes, (size < sizeof numbers) ? size : sizeof numbers);
    if ((ampi_table_open(&table, blob, size) == AMPI_OK) && (size > (table.values + sizeof numbers))) {
        (void)memcpy(numbers, &bytes[table.values], sizeof numbers);
    }
    fly(numbers);
    free(blob);
    return 0;
}
