/* The plant for processors with AVX2: twice as fast, the same bits (no fused multiply-add). */
#define _GNU_SOURCE /* sincos */
/* before the switch: what the system's headers define is not for this instruction set */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "plant.h"

#ifdef AMPI_HAS_V3

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#define ENGINE ampi_engine_v3
#define ENGINE_NAME "x86-64-v3"
#include "plant_lanes.h"
#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
