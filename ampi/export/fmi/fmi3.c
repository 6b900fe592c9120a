/* The guidance through FMI 3.0 for co-simulation, without event mode. */
#include "fmi3_types.h"

static void tell(const fmu *unit, const char *sentence)
{
    const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)unit->logger;
    if (logger != NULL) {
        logger(unit->environment, fmi3Error, "logStatusError", sentence);
    }
}

static fmi3Status status_of(fmu_status status)
{
    return (status == FMU_OK) ? fmi3OK : fmi3Error;
}

FMU_EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

FMU_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                                          const fmi3String categories[])
{
    (void)on; /* errors alone are told, and always */
    (void)n;
    (void)categories;
    return (instance != NULL) ? fmi3OK : fmi3Error;
}

FMU_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logs,
    fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed,
    const fmi3ValueReference intermediate[], size_t n_intermediate, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log_message, fmi3IntermediateUpdateCallback intermediate_update)
{
    (void)visible;
    (void)logs;
    (void)event_mode_used; /* what a simulator can do beyond what is asked of it here */
    (void)early_return_allowed;
    (void)intermediate;
    (void)n_intermediate;
    (void)intermediate_update;
    return fmu_opened(fmu_new(tell, (fmu_function *)log_message, environment, name), token, resources);
}

static fmi3Instance refused(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message)
{
    fmu *unit = fmu_new(tell, (fmu_function *)log_message, environment, NULL);
    (void)fmu_fail(unit, "Instantiate", "expected co-simulation, this FMU has no other interface");
    fmu_free(unit);
    return NULL;
}

FMU_EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token,
                                                     fmi3String resources, fmi3Boolean visible,
                                                     fmi3Boolean logs,
                                                     fmi3InstanceEnvironment environment,
                                                     fmi3LogMessageCallback log_message)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logs;
    return refused(environment, log_message);
}

FMU_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logs,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
    fmi3ClockUpdateCallback clock_update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logs;
    (void)clock_update;
    (void)lock;
    (void)unlock;
    return refused(environment, log_message);
}

FMU_EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    fmu_free(instance);
}

FMU_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                                  fmi3Float64 tolerance, fmi3Float64 start,
                                                  fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    if (fmu_set_start_time(instance, start) != FMU_OK) {
        return fmi3Error;
    }
    return status_of(fmu_enter_initialization(instance));
}

FMU_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return status_of(fmu_exit_initialization(instance));
}

FMU_EXPORT fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return status_of(fmu_terminate(instance));
}

FMU_EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    return status_of(fmu_reset(instance));
}

FMU_EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                                     size_t n, fmi3Float64 values[], size_t n_values)
{
    if (n != n_values) {
        return status_of(fmu_fail(instance, "GetFloat64", "expected a value for each reference"));
    }
    return status_of(fmu_get(instance, references, n, values));
}

FMU_EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                                     size_t n, const fmi3Float64 values[], size_t n_values)
{
    if (n != n_values) {
        return status_of(fmu_fail(instance, "SetFloat64", "expected a value for each reference"));
    }
    return status_of(fmu_set(instance, references, n, values));
}

/* Enumerations are of this type. */
FMU_EXPORT fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference references[],
                                   size_t n, fmi3Int64 values[], size_t n_values)
{
    fmu_status status = (instance != NULL) ? FMU_OK : FMU_ERROR;
    size_t i;
    if (n != n_values) {
        return status_of(fmu_fail(instance, "GetInt64", "expected a value for each reference"));
    }
    for (i = 0u; (i < n) && (status == FMU_OK); i++) {
        int32_t value = 0;
        status = fmu_get_enumeration(instance, references[i], &value);
        values[i] = value;
    }
    return status_of(status);
}

FMU_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    return status_of(fmu_get_state(instance, state));
}

FMU_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return status_of(fmu_set_state(instance, state));
}

FMU_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    return status_of(fmu_free_state(state));
}

FMU_EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step,
                                 fmi3Boolean no_state_is_set_before, fmi3Boolean *event_needed,
                                 fmi3Boolean *terminate, fmi3Boolean *early_return,
                                 fmi3Float64 *last_time)
{
    const fmu_status status = fmu_step(instance, time, step);
    (void)no_state_is_set_before;
    *event_needed = false;
    *terminate = false;
    *early_return = false;
    *last_time = (status == FMU_OK) ? (time + step) : time;
    return status_of(status);
}
