/* One instance of the guidance as a functional mock-up unit: what FMI 2.0 (fmi2.c) and FMI 3.0 (fmi3.c)
   share. A simulator calls in this order:

       open  [set values]  enter initialization  [set values]  exit  { set inputs, step, get outputs }

   The flight code (ampi.h) allocates nothing and reads no file; this does both, when it is opened. */
#ifndef FMU_H
#define FMU_H

#include <stddef.h>
#include <stdint.h>

#include "ampi.h"
#include "fmu_config.h" /* FMU_TOKEN, FMU_N_PARAMETERS, FMU_START: written with the model description */

#if defined _WIN32
#define FMU_EXPORT __declspec(dllexport)
#else
#define FMU_EXPORT __attribute__((visibility("default")))
#endif

/* Value references. */
enum {
    FMU_TIME = 0,
    FMU_NAVIGATION = 1, /* eight inputs */
    FMU_SENSED = 9,     /* three */
    FMU_BANK_RATE = 12,
    FMU_BANK_ANGLE = 13,
    FMU_ANGLE_OF_ATTACK = 14,
    FMU_STEERING = 15, /* ampi_steering */
    FMU_HEALTH = 16,   /* ampi_health */
    FMU_PARAMETERS = 17,
    FMU_N_VALUES = FMU_PARAMETERS + FMU_N_PARAMETERS
};

typedef enum { FMU_OK = 0, FMU_ERROR = 3 } fmu_status; /* the numbers of both FMI */

typedef enum { FMU_INSTANTIATED, FMU_INITIALIZATION, FMU_STEPPING, FMU_TERMINATED } fmu_phase;

/* All that changes: a state that is got is a copy of it. */
typedef struct {
    fmu_phase phase;
    uint32_t is_begun; /* the reference is that of the parameters */
    double value[FMU_N_VALUES];
    ampi_guidance guidance;
} fmu_flight;

typedef struct fmu fmu;
typedef void fmu_function(void); /* of any type; whoever calls it knows which */

struct fmu {
    fmu_flight flight;
    ampi_table table;
    unsigned char *blob; /* what the table reads; owned */
    void (*tell)(const fmu *unit, const char *sentence); /* an error, to the simulator */
    fmu_function *logger;
    void *environment;
    char *name;
};

/* An instance that tells its errors by `tell`; NULL if there is no memory. */
fmu *fmu_new(void (*tell)(const fmu *unit, const char *sentence), fmu_function *logger,
             void *environment, const char *name);

/* Reads and checks the table in a folder of resources. On failure the unit has told why, and is freed:
   NULL. */
fmu *fmu_opened(fmu *unit, const char *token, const char *folder);

void fmu_free(fmu *unit);

/* Tells that `call` failed because of `why`. */
fmu_status fmu_fail(const fmu *unit, const char *call, const char *why);

fmu_status fmu_get(fmu *unit, const uint32_t *references, size_t n, double *values);
fmu_status fmu_set(fmu *unit, const uint32_t *references, size_t n, const double *values);
fmu_status fmu_get_enumeration(fmu *unit, uint32_t reference, int32_t *value);

fmu_status fmu_set_start_time(fmu *unit, double time);
fmu_status fmu_enter_initialization(fmu *unit);
fmu_status fmu_exit_initialization(fmu *unit);

/* One guidance cycle at `time` with the inputs that are set; the commands are those for its end. */
fmu_status fmu_step(fmu *unit, double time, double step);

fmu_status fmu_terminate(fmu *unit);
fmu_status fmu_reset(fmu *unit);

/* Into `*state`, allocated if it is NULL. */
fmu_status fmu_get_state(const fmu *unit, void **state);
fmu_status fmu_set_state(fmu *unit, const void *state);
fmu_status fmu_free_state(void **state);

#endif
