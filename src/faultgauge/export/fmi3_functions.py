"""What hosts of FMI 3.0 call, and what that version calls it."""

from faultgauge.export.fmi_functions import functions

__all__ = ["FMI3"]

TYPES = """typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef char fmi3Char;
typedef const fmi3Char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent }
    fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged }
    fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(
    fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(
    fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean,
    fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

typedef struct {
    ${name}_block block;
    int phase;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment host;
} Instance;

static fmi3Status fails(const Instance *it, fmi3String why)
{
    if (it->log) {
        it->log(it->host, fmi3Error, "logStatusError", why);
    }
    return fmi3Error;
}

"""

OWN = """EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String title, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference intermediate[], size_t intermediates, fmi3InstanceEnvironment host,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    Instance *it;
    (void)title, (void)resources, (void)visible, (void)logging, (void)early;
    (void)intermediate, (void)intermediates, (void)update;
    if (events || !token || strcmp(token, ${guard}_TOKEN)) {
        if (log) {
            log(host, fmi3Error, "logStatusError",
                events ? "this FMU has no event mode" : "the token is that of another FMU");
        }
        return NULL;
    }
    it = calloc(1, sizeof *it);
    if (it) {
        it->host = host;
        it->log = log;
        it->phase = MADE;
        ${name}_block_begin(&it->block);
    }
    return it;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String title, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment host, fmi3LogMessageCallback log)
{
    (void)title, (void)token, (void)resources, (void)visible, (void)logging, (void)host, (void)log;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String title, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment host, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)title, (void)token, (void)resources, (void)visible, (void)logging, (void)host, (void)log;
    (void)clock, (void)lock, (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

EXPORT fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean bounded, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean ends, fmi3Float64 stop)
{
    ENTER(MADE)
    (void)bounded, (void)tolerance, (void)ends, (void)stop;
    ${name}_block_start(&it->block, start);
    it->phase = BEGINNING;
    return fmi3OK;
}

GET(fmi3GetFloat64, fmi3Float64, double, ${name}_block_get_real)
GET(fmi3GetInt32, fmi3Int32, int32_t, ${name}_block_get_whole)
GET(fmi3GetInt64, fmi3Int64, int32_t, ${name}_block_get_whole) /* enumerations */
GET(fmi3GetBoolean, fmi3Boolean, int, ${name}_block_get_bool)

EXPORT fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean final, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    ENTER(STEPPING)
    (void)final;
    *event = *terminate = *early = false;
    *reached = t;
    if (!${name}_block_do(&it->block, t, h)) {
        return fails(it, "$too_long");
    }
    *reached = it->block.now;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    ENTER(MADE | STEPPING)
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    ENTER(MADE | STEPPING)
    return fmi3OK;
}

#define VALUES(type) \\
    NONE(fmi3Get##type, (LIST, fmi3##type value[], size_t values)) \\
    NONE(fmi3Set##type, (LIST, const fmi3##type value[], size_t values))

VALUES(Float32)
VALUES(Int8)
VALUES(UInt8)
VALUES(Int16)
VALUES(UInt16)
VALUES(UInt32)
VALUES(UInt64)
VALUES(String)
NONE(fmi3SetInt32, (LIST, const fmi3Int32 value[], size_t values))
NONE(fmi3SetInt64, (LIST, const fmi3Int64 value[], size_t values))
NONE(fmi3SetBoolean, (LIST, const fmi3Boolean value[], size_t values))
NONE(fmi3GetBinary, (LIST, size_t size[], fmi3Binary value[], size_t values))
NONE(fmi3SetBinary, (LIST, const size_t size[], const fmi3Binary value[], size_t values))
NONE(fmi3GetClock, (LIST, fmi3Clock value[]))
NONE(fmi3SetClock, (LIST, const fmi3Clock value[]))
NONE(fmi3GetNumberOfVariableDependencies, (OWN, fmi3ValueReference of, size_t *count))
NONE(fmi3GetVariableDependencies,
    (OWN, fmi3ValueReference of, size_t here[], fmi3ValueReference on[], size_t there[],
        fmi3DependencyKind kind[], size_t count))
NONE(fmi3GetDirectionalDerivative,
    (LIST, const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
        fmi3Float64 value[], size_t values))
NONE(fmi3GetAdjointDerivative,
    (LIST, const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
        fmi3Float64 value[], size_t values))
NONE(fmi3EnterEventMode, (OWN))
NONE(fmi3EnterStepMode, (OWN))
NONE(fmi3EnterContinuousTimeMode, (OWN))
NONE(fmi3GetIntervalDecimal, (LIST, fmi3Float64 value[], fmi3IntervalQualifier how[]))
NONE(fmi3GetIntervalFraction,
    (LIST, fmi3UInt64 value[], fmi3UInt64 resolution[], fmi3IntervalQualifier how[]))
NONE(fmi3GetShiftDecimal, (LIST, fmi3Float64 value[]))
NONE(fmi3GetShiftFraction, (LIST, fmi3UInt64 value[], fmi3UInt64 resolution[]))
NONE(fmi3SetIntervalDecimal, (LIST, const fmi3Float64 value[]))
NONE(fmi3SetIntervalFraction, (LIST, const fmi3UInt64 value[], const fmi3UInt64 resolution[]))
NONE(fmi3SetShiftDecimal, (LIST, const fmi3Float64 value[]))
NONE(fmi3SetShiftFraction, (LIST, const fmi3UInt64 value[], const fmi3UInt64 resolution[]))
NONE(fmi3EvaluateDiscreteStates, (OWN))
NONE(fmi3UpdateDiscreteStates,
    (OWN, fmi3Boolean *more, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,
        fmi3Boolean *defined, fmi3Float64 *next))
NONE(fmi3CompletedIntegratorStep,
    (OWN, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *terminate))
NONE(fmi3SetTime, (OWN, fmi3Float64 t))
NONE(fmi3SetContinuousStates, (OWN, const fmi3Float64 value[], size_t count))
NONE(fmi3GetContinuousStateDerivatives, (OWN, fmi3Float64 value[], size_t count))
NONE(fmi3GetEventIndicators, (OWN, fmi3Float64 value[], size_t count))
NONE(fmi3GetContinuousStates, (OWN, fmi3Float64 value[], size_t count))
NONE(fmi3GetNominalsOfContinuousStates, (OWN, fmi3Float64 value[], size_t count))
NONE(fmi3GetNumberOfEventIndicators, (OWN, size_t *count))
NONE(fmi3GetNumberOfContinuousStates, (OWN, size_t *count))
NONE(fmi3GetOutputDerivatives,
    (LIST, const fmi3Int32 order[], fmi3Float64 value[], size_t values))
NONE(fmi3ActivateModelPartition, (OWN, fmi3ValueReference clock, fmi3Float64 t))
"""

NAMES = {
    "fmi": "fmi3",
    "handle": "fmi3Instance instance",
    "one": "instance",
    "version": "3.0",
    "back": "Deserialize",
    "State": "FMUState",
    "Real": "Float64",
    "values": ", size_t values",
    "beyond": "k >= values || ",
}

FMI3 = functions(TYPES, NAMES, OWN)
