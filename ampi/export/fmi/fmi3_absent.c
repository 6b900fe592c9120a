/* What FMI 3.0 names and this FMU does not have: the standard wants the functions all the same. */
#include "fmi3_types.h"

/* Arguments of what is not there are not looked at. */
#if defined __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define ABSENT(Name, ...)                                                                              \
    FMU_EXPORT fmi3Status fmi3##Name(fmi3Instance instance, __VA_ARGS__)                               \
    {                                                                                                  \
        (void)fmu_fail(instance, #Name, "this FMU cannot do that");                                    \
        return fmi3Error;                                                                              \
    }
#define ABSENT_MODE(Name)                                                                              \
    FMU_EXPORT fmi3Status fmi3##Name(fmi3Instance instance)                                            \
    {                                                                                                  \
        (void)fmu_fail(instance, #Name, "this FMU has no such mode");                                  \
        return fmi3Error;                                                                              \
    }

/* No variable has the type: none can be read or set. */
static fmi3Status none_of(fmi3Instance instance, size_t n, const char *call)
{
    if ((instance == NULL) || (n > 0u)) {
        (void)fmu_fail(instance, call, "no variable that can be read or set so has this type");
        return fmi3Error;
    }
    return fmi3OK;
}

#define REFERENCES const fmi3ValueReference references[], size_t n
#define NONE(Name, ...)                                                                                \
    FMU_EXPORT fmi3Status fmi3##Name(fmi3Instance instance, REFERENCES, __VA_ARGS__)                   \
    {                                                                                                  \
        return none_of(instance, n, #Name);                                                            \
    }

NONE(GetFloat32, fmi3Float32 values[], size_t n_values)
NONE(GetInt8, fmi3Int8 values[], size_t n_values)
NONE(GetUInt8, fmi3UInt8 values[], size_t n_values)
NONE(GetInt16, fmi3Int16 values[], size_t n_values)
NONE(GetUInt16, fmi3UInt16 values[], size_t n_values)
NONE(GetInt32, fmi3Int32 values[], size_t n_values)
NONE(GetUInt32, fmi3UInt32 values[], size_t n_values)
NONE(GetUInt64, fmi3UInt64 values[], size_t n_values)
NONE(GetBoolean, fmi3Boolean values[], size_t n_values)
NONE(GetString, fmi3String values[], size_t n_values)
NONE(GetBinary, size_t sizes[], fmi3Binary values[], size_t n_values)
NONE(GetClock, fmi3Clock values[])
NONE(SetFloat32, const fmi3Float32 values[], size_t n_values)
NONE(SetInt8, const fmi3Int8 values[], size_t n_values)
NONE(SetUInt8, const fmi3UInt8 values[], size_t n_values)
NONE(SetInt16, const fmi3Int16 values[], size_t n_values)
NONE(SetUInt16, const fmi3UInt16 values[], size_t n_values)
NONE(SetInt32, const fmi3Int32 values[], size_t n_values)
NONE(SetUInt32, const fmi3UInt32 values[], size_t n_values)
NONE(SetInt64, const fmi3Int64 values[], size_t n_values)
NONE(SetUInt64, const fmi3UInt64 values[], size_t n_values)
NONE(SetBoolean, const fmi3Boolean values[], size_t n_values)
NONE(SetString, const fmi3String values[], size_t n_values)
NONE(SetBinary, const size_t sizes[], const fmi3Binary values[], size_t n_values)
NONE(SetClock, const fmi3Clock values[])
NONE(GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NONE(GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
     fmi3IntervalQualifier qualifiers[])
NONE(GetShiftDecimal, fmi3Float64 shifts[])
NONE(GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NONE(SetIntervalDecimal, const fmi3Float64 intervals[])
NONE(SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NONE(SetShiftDecimal, const fmi3Float64 shifts[])
NONE(SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

ABSENT(GetNumberOfVariableDependencies, fmi3ValueReference reference, size_t *n)
ABSENT(GetVariableDependencies, fmi3ValueReference dependent, size_t elements[],
       fmi3ValueReference independents[], size_t independent_elements[], fmi3DependencyKind kinds[],
       size_t n)
ABSENT(SerializedFMUStateSize, fmi3FMUState state, size_t *size)
ABSENT(SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
ABSENT(DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
ABSENT(GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t n_unknowns,
       const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
       fmi3Float64 sensitivity[], size_t n_sensitivity)
ABSENT(GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t n_unknowns,
       const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
       fmi3Float64 sensitivity[], size_t n_sensitivity)
ABSENT(GetOutputDerivatives, const fmi3ValueReference references[], size_t n, const fmi3Int32 orders[],
       fmi3Float64 values[], size_t n_values)

ABSENT_MODE(EnterEventMode)
ABSENT_MODE(EnterStepMode)
ABSENT_MODE(EnterConfigurationMode)
ABSENT_MODE(ExitConfigurationMode)
ABSENT_MODE(EnterContinuousTimeMode)
ABSENT_MODE(EvaluateDiscreteStates)

/* Of model exchange and scheduled execution. */
ABSENT(UpdateDiscreteStates, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
       fmi3Boolean *values_changed, fmi3Boolean *next_defined, fmi3Float64 *next)
ABSENT(CompletedIntegratorStep, fmi3Boolean no_state_is_set_before, fmi3Boolean *enter_event_mode,
       fmi3Boolean *terminate)
ABSENT(SetTime, fmi3Float64 time)
ABSENT(SetContinuousStates, const fmi3Float64 states[], size_t n)
ABSENT(GetContinuousStateDerivatives, fmi3Float64 derivatives[], size_t n)
ABSENT(GetEventIndicators, fmi3Float64 indicators[], size_t n)
ABSENT(GetContinuousStates, fmi3Float64 states[], size_t n)
ABSENT(GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t n)
ABSENT(GetNumberOfEventIndicators, size_t *n)
ABSENT(GetNumberOfContinuousStates, size_t *n)
ABSENT(ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
