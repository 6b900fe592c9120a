/* libFuzzer's target: any bytes as a model, its checksum made right so that what lies behind is reached too;
   what opens is estimated and predicted with. `fuzz_model DIRECTORY`, seeded with models. */
#include <stdlib.h>

#include "ampi_correction_parts.h"

int LLVMFuzzerTestOneInput(const unsigned char *bytes, size_t size);

static ampi_model model;
static ampi_corrector corrector;
static ampi_table none; /* not opened */

int LLVMFuzzerTestOneInput(const unsigned char *bytes, size_t size)
{
    unsigned char *blob = malloc(size + 1u); /* of its own, so that a byte too far is found */
    const double limit[3] = {1.0, 0.1, 0.1}, sensed[3] = {-20.0, 8.0, 1.0};
    const double state[8] = {50e3, 0.1, 0.5, 4000.0, -0.1, 1.0, 0.3, 0.0};
    if (blob == NULL) {
        return 0;
    }
    (void)memcpy(blob, bytes, size);
    if ((size > 32u) && ((bytes[31] & 1u) == 0u)) { /* one bit decides whether it is left alone */
        const uint32_t crc = ampi_crc_32(blob, 32u, size);
        (void)memcpy(&blob[20], &crc, sizeof crc);
    }
    if (ampi_model_open(&model, blob, size) == AMPI_OK) {
        model.of.corrector.iterations = least(model.of.corrector.iterations, 1.0); /* more of the same */
        model.of.corrector.propagations = least(model.of.corrector.propagations, 22.0);
        model.of.corrector.step = most(model.of.corrector.step, 0.1 * model.of.corrector.longest);
        ampi_corrector_begin(&corrector, &model, &none, NULL);
        ampi_estimate_update(&corrector.estimate, &model.of, 10.0, state, sensed, 0.0, 0.0);
        (void)memcpy(corrector.state, state, sizeof state);
        corrector.time = 10.0;
        (void)ampi_correct(&corrector, &model.of, limit);
    }
    free(blob);
    return 0;
}
