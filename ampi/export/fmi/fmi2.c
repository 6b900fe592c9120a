/* The guidance through FMI 2.0 for co-simulation. Types and functions are declared here as the standard
   has them; with its own fmi2Functions.h before this file the compiler compares the two. */
#include <stdlib.h>
#include <string.h>

#include "fmu.h"

#ifndef fmi2Functions_h
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus,
    fmi2PendingStatus,
    fmi2LastSuccessfulTime,
    fmi2Terminated
} fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment environment, fmi2String instance,
                                   fmi2Status status, fmi2String category, fmi2String message, ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t n, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(fmi2ComponentEnvironment environment, fmi2Status status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
#endif

static void tell(const fmu *unit, const char *sentence)
{
    const fmi2CallbackLogger logger = (fmi2CallbackLogger)unit->logger;
    if (logger != NULL) {
        logger(unit->environment, unit->name, fmi2Error, "logStatusError", "%s", sentence);
    }
}

static fmi2Status status_of(fmu_status status)
{
    return (status == FMU_OK) ? fmi2OK : fmi2Error;
}

static fmi2Status absent(fmi2Component c, const char *call)
{
    return status_of(fmu_fail(c, call, "this FMU cannot do that"));
}

/* Of a type that none of the variables has: fine for none of them. */
static fmi2Status none_of(fmi2Component c, size_t n, const char *call)
{
    return ((n == 0u) && (c != NULL)) ? fmi2OK
                                      : status_of(fmu_fail(c, call, "no variable has this type"));
}

static int digit(char c)
{
    const char *digits = "0123456789abcdef";
    const char lower = ((c >= 'A') && (c <= 'F')) ? (char)(c - 'A' + 'a') : c;
    const char *found = (c != '\0') ? strchr(digits, lower) : NULL;
    return (found != NULL) ? (int)(found - digits) : -1;
}

/* The path of a URI file:/path or file://host/path, a path itself as it is; to be freed. */
static char *path_of(const char *uri)
{
    const char *from = uri;
    char *path, *to;
    if (strncmp(from, "file:", 5u) == 0) {
        from += 5;
        if (strncmp(from, "//", 2u) == 0) {
            const char *slash = strchr(from + 2, '/');
            from = (slash != NULL) ? slash : (from + 2);
        }
    }
    path = malloc(strlen(from) + 1u);
    if (path == NULL) {
        return NULL;
    }
    for (to = path; *from != '\0'; to++) {
        if ((from != uri) && (*from == '%') && (digit(from[1]) >= 0) && (digit(from[2]) >= 0)) {
            *to = (char)(16 * digit(from[1]) + digit(from[2]));
            from += 3;
        } else {
            *to = *from++;
        }
    }
    *to = '\0';
    return path;
}

FMU_EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

FMU_EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

FMU_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                                          const fmi2String categories[])
{
    (void)on; /* errors alone are told, and always */
    (void)n;
    (void)categories;
    return (c != NULL) ? fmi2OK : fmi2Error;
}

FMU_EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                         fmi2String location, const fmi2CallbackFunctions *functions,
                                         fmi2Boolean visible, fmi2Boolean logs)
{
    char *folder = (location != NULL) ? path_of(location) : NULL;
    fmu *unit = (functions != NULL) ? fmu_new(tell, (fmu_function *)functions->logger,
                                              functions->componentEnvironment, name)
                                    : NULL;
    (void)visible;
    (void)logs;
    if ((unit != NULL) && (type != fmi2CoSimulation)) {
        (void)fmu_fail(unit, "Instantiate", "expected co-simulation, got model exchange");
        fmu_free(unit);
        unit = NULL;
    }
    unit = fmu_opened(unit, guid, folder);
    free(folder);
    return unit;
}

FMU_EXPORT void fmi2FreeInstance(fmi2Component c)
{
    fmu_free(c);
}

FMU_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined,
                                          fmi2Real tolerance, fmi2Real start,
                                          fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    return status_of(fmu_set_start_time(c, start));
}

FMU_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return status_of(fmu_enter_initialization(c));
}

FMU_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return status_of(fmu_exit_initialization(c));
}

FMU_EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    return status_of(fmu_terminate(c));
}

FMU_EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    return status_of(fmu_reset(c));
}

FMU_EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                  fmi2Real values[])
{
    return status_of(fmu_get(c, references, n, values));
}

FMU_EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                  const fmi2Real values[])
{
    return status_of(fmu_set(c, references, n, values));
}

FMU_EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                     fmi2Integer values[])
{
    fmu_status status = (c != NULL) ? FMU_OK : FMU_ERROR;
    size_t i;
    for (i = 0u; (i < n) && (status == FMU_OK); i++) {
        int32_t value = 0;
        status = fmu_get_enumeration(c, references[i], &value);
        values[i] = value;
    }
    return status_of(status);
}

FMU_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return status_of(fmu_get_state(c, state));
}

FMU_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return status_of(fmu_set_state(c, state));
}

FMU_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    return status_of(fmu_free_state(state));
}

FMU_EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step,
                                 fmi2Boolean no_state_is_set_before)
{
    (void)no_state_is_set_before;
    return status_of(fmu_step(c, time, step));
}

/* No step is ever pending or discarded: there is no status to ask for but the last time. */
FMU_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const fmi2ValueReference time = FMU_TIME;
    return (kind == fmi2LastSuccessfulTime) ? status_of(fmu_get(c, &time, 1u, value))
                                            : absent(c, "GetRealStatus");
}

FMU_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind,
                                           fmi2Boolean *value)
{
    if ((c == NULL) || (kind != fmi2Terminated)) {
        return absent(c, "GetBooleanStatus");
    }
    *value = 0;
    return fmi2OK;
}

/* What the standard names and this FMU does not have; its arguments are not looked at. */
#if defined __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define ABSENT(Name, ...)                                                                              \
    FMU_EXPORT fmi2Status fmi2##Name(fmi2Component c, __VA_ARGS__)                                     \
    {                                                                                                  \
        return absent(c, #Name);                                                                       \
    }
#define REFERENCES const fmi2ValueReference references[], size_t n

ABSENT(SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
ABSENT(SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
ABSENT(DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
ABSENT(GetDirectionalDerivative, const fmi2ValueReference unknowns[], size_t n_unknowns,
       const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[], fmi2Real derivative[])
ABSENT(SetRealInputDerivatives, REFERENCES, const fmi2Integer orders[], const fmi2Real values[])
ABSENT(GetRealOutputDerivatives, REFERENCES, const fmi2Integer orders[], fmi2Real values[])
ABSENT(GetStatus, const fmi2StatusKind kind, fmi2Status *value)
ABSENT(GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *value)
ABSENT(GetStringStatus, const fmi2StatusKind kind, fmi2String *value)

FMU_EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    return absent(c, "CancelStep");
}

#define NONE(Name, ...)                                                                                \
    FMU_EXPORT fmi2Status fmi2##Name(fmi2Component c, REFERENCES, __VA_ARGS__)                         \
    {                                                                                                  \
        return none_of(c, n, #Name);                                                                   \
    }
NONE(GetBoolean, fmi2Boolean values[])
NONE(GetString, fmi2String values[])
NONE(SetInteger, const fmi2Integer values[])
NONE(SetBoolean, const fmi2Boolean values[])
NONE(SetString, const fmi2String values[])
