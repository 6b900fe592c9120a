/* The plant for any processor. */
#define _GNU_SOURCE /* sincos */
#define ENGINE ampi_engine_baseline
#define ENGINE_NAME "baseline"
#include "plant_lanes.h"

const ampi_engine *ampi_engine_here(void) {
#ifdef AMPI_HAS_V3
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2")) {
        return &ampi_engine_v3;
    }
#endif
    return &ampi_engine_baseline;
}
