"""What hosts of FMI 2.0 and 3.0 call: C text around the block of an FMU (`fmu_sources`).

What the versions share stands once, with the names of each: `@fmi` is the prefix, `@handle` the
instance's argument and `@one` its name. Names and order of arguments are the standard's.
"""

from collections.abc import Mapping

__all__ = ["FMI"]

BEGINNING = """$banner
#include "${name}_block.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

enum { MADE = 1, BEGINNING = 2, STEPPING = 4, ENDED = 8, ANY = 15 };

"""

SHARED = """/* Begin a function of `it`, which is legal in `phases` alone. */
#define ENTER(phases) \\
    Instance *const it = @one; \\
    if (!it) { \\
        return @fmiError; \\
    } \\
    if (!(it->phase & (phases))) { \\
        return fails(it, "a function was called out of turn"); \\
    }

EXPORT const char *@fmiGetVersion(void)
{
    return "@version";
}

EXPORT @fmiStatus @fmiSetDebugLogging(
    @handle, @fmiBoolean on, size_t count, const @fmiString categories[])
{
    (void)@one, (void)on, (void)count, (void)categories;
    return @fmiOK; /* nothing but errors is ever said */
}

EXPORT @fmiStatus @fmiExitInitializationMode(@handle)
{
    ENTER(BEGINNING)
    it->phase = STEPPING;
    return @fmiOK;
}

EXPORT @fmiStatus @fmiTerminate(@handle)
{
    ENTER(STEPPING)
    it->phase = ENDED;
    return @fmiOK;
}

EXPORT @fmiStatus @fmiReset(@handle)
{
    ENTER(ANY)
    ${name}_block_begin(&it->block);
    it->phase = MADE;
    return @fmiOK;
}

EXPORT @fmiStatus @fmiSet@Real(
    @handle, const @fmiValueReference which[], size_t count,
    const @fmi@Real value[]@values)
{
    ENTER(MADE | BEGINNING | STEPPING)
    for (size_t k = 0; k < count; k++) {
        if (@beyond!${name}_block_set_real(&it->block, which[k], value[k])) {
            return fails(it, "@fmiSet@Real: no input has that value reference");
        }
    }
    return @fmiOK;
}

/* Values of one type, each of which `found` is for a moment. */
#define GET(name, type, whole, get) \\
    EXPORT @fmiStatus name( \\
        @handle, const @fmiValueReference which[], size_t count, type value[]@values) \\
    { \\
        ENTER(ANY) \\
        for (size_t k = 0; k < count; k++) { \\
            whole found; \\
            if (@beyond!get(&it->block, which[k], &found)) { \\
                return fails(it, #name ": no variable of that type has that value reference"); \\
            } \\
            value[k] = (type)found; \\
        } \\
        return @fmiOK; \\
    }

EXPORT @fmiStatus @fmiGet@State(@handle, @fmi@State *kept)
{
    ENTER(ANY)
    if (!*kept && !(*kept = malloc(sizeof(Instance)))) {
        return fails(it, "there is no memory for a state");
    }
    memcpy(*kept, it, sizeof *it);
    return @fmiOK;
}

EXPORT @fmiStatus @fmiSet@State(@handle, @fmi@State kept)
{
    ENTER(ANY)
    if (!kept) {
        return fails(it, "@fmiSet@State: there is no state");
    }
    it->block = ((const Instance *)kept)->block;
    it->phase = ((const Instance *)kept)->phase;
    return @fmiOK;
}

EXPORT @fmiStatus @fmiFree@State(@handle, @fmi@State *kept)
{
    (void)@one;
    if (kept) {
        free(*kept);
        *kept = NULL;
    }
    return @fmiOK;
}

EXPORT @fmiStatus @fmiSerialized@StateSize(
    @handle, @fmi@State kept, size_t *size)
{
    ENTER(ANY)
    (void)kept;
    *size = ${name}_block_size() + sizeof it->phase;
    return @fmiOK;
}

EXPORT @fmiStatus @fmiSerialize@State(
    @handle, @fmi@State kept, @fmiByte bytes[], size_t size)
{
    ENTER(ANY)
    if (!kept || size < ${name}_block_size() + sizeof it->phase) {
        return fails(it, "@fmiSerialize@State: there is no state, or no room for it");
    }
    ${name}_block_save(&((const Instance *)kept)->block, (unsigned char *)bytes);
    memcpy(bytes + ${name}_block_size(), &((const Instance *)kept)->phase, sizeof it->phase);
    return @fmiOK;
}

EXPORT @fmiStatus @fmi@back@State(
    @handle, const @fmiByte bytes[], size_t size, @fmi@State *kept)
{
    Instance *made;
    ENTER(ANY)
    made = *kept ? *kept : malloc(sizeof *made);
    if (!made) {
        return fails(it, "there is no memory for a state");
    }
    memcpy(made, it, sizeof *made);
    if (size < sizeof it->phase
        || !${name}_block_load(
            &made->block, (const unsigned char *)bytes, size - sizeof it->phase)) {
        if (!*kept) {
            free(made);
        }
        return fails(it, "@fmi@back@State: the bytes are those of another FMU");
    }
    memcpy(&made->phase, bytes + ${name}_block_size(), sizeof made->phase);
    *kept = made;
    return @fmiOK;
}

/* What this FMU says it does not have. */
#define NONE(name, arguments) \\
    EXPORT @fmiStatus name arguments \\
    { \\
        ENTER(ANY) \\
        return fails(it, #name ": this FMU has none of that"); \\
    }
#define OWN @handle
#define LIST OWN, const @fmiValueReference which[], size_t count

"""

FMI2_TYPES = """typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated }
    fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    ${name}_block block;
    int phase;
    fmi2CallbackFunctions host;
    char *title;
} Instance;

static fmi2Status fails(const Instance *it, fmi2String why)
{
    if (it->host.logger) {
        it->host.logger(
            it->host.componentEnvironment, it->title, fmi2Error, "logStatusError", "%s", why);
    }
    return fmi2Error;
}

"""

FMI2_OWN = """EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT fmi2Component fmi2Instantiate(
    fmi2String title, fmi2Type type, fmi2String token, fmi2String resources,
    const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *it;
    const size_t length = title ? strlen(title) + 1 : 0;
    (void)resources, (void)visible, (void)logging;
    if (!length || !host || type != fmi2CoSimulation) {
        return NULL;
    }
    if (!token || strcmp(token, ${guard}_TOKEN)) {
        if (host->logger) {
            host->logger(host->componentEnvironment, title, fmi2Error, "logStatusError", "%s",
                "the guid is that of another FMU");
        }
        return NULL;
    }
    it = calloc(1, sizeof *it);
    if (!it) {
        return NULL;
    }
    it->title = malloc(length);
    if (!it->title) {
        free(it);
        return NULL;
    }
    memcpy(it->title, title, length);
    it->host = *host;
    it->phase = MADE;
    ${name}_block_begin(&it->block);
    return it;
}

EXPORT void fmi2FreeInstance(fmi2Component component)
{
    Instance *const it = component;
    if (it) {
        free(it->title);
        free(it);
    }
}

EXPORT fmi2Status fmi2SetupExperiment(
    fmi2Component component, fmi2Boolean bounded, fmi2Real tolerance, fmi2Real start,
    fmi2Boolean ends, fmi2Real stop)
{
    ENTER(MADE)
    (void)bounded, (void)tolerance, (void)ends, (void)stop;
    ${name}_block_start(&it->block, start);
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    ENTER(MADE)
    it->phase = BEGINNING;
    return fmi2OK;
}

GET(fmi2GetReal, fmi2Real, double, ${name}_block_get_real)
GET(fmi2GetInteger, fmi2Integer, int32_t, ${name}_block_get_whole)
GET(fmi2GetBoolean, fmi2Boolean, int, ${name}_block_get_bool)

EXPORT fmi2Status fmi2DoStep(
    fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean final)
{
    ENTER(STEPPING)
    (void)final;
    if (!${name}_block_do(&it->block, t, h)) {
        return fails(it, "$too_long");
    }
    return fmi2OK;
}

NONE(fmi2GetString, (LIST, fmi2String value[]))
NONE(fmi2SetInteger, (LIST, const fmi2Integer value[]))
NONE(fmi2SetBoolean, (LIST, const fmi2Boolean value[]))
NONE(fmi2SetString, (LIST, const fmi2String value[]))
NONE(fmi2SetRealInputDerivatives, (LIST, const fmi2Integer order[], const fmi2Real value[]))
NONE(fmi2GetRealOutputDerivatives, (LIST, const fmi2Integer order[], fmi2Real value[]))
NONE(fmi2GetDirectionalDerivative,
    (LIST, const fmi2ValueReference known[], size_t knowns, const fmi2Real dv[], fmi2Real dz[]))
NONE(fmi2CancelStep, (OWN))
NONE(fmi2GetStatus, (OWN, fmi2StatusKind kind, fmi2Status *value))
NONE(fmi2GetRealStatus, (OWN, fmi2StatusKind kind, fmi2Real *value))
NONE(fmi2GetIntegerStatus, (OWN, fmi2StatusKind kind, fmi2Integer *value))
NONE(fmi2GetBooleanStatus, (OWN, fmi2StatusKind kind, fmi2Boolean *value))
NONE(fmi2GetStringStatus, (OWN, fmi2StatusKind kind, fmi2String *value))
"""

FMI3_TYPES = """typedef void *fmi3Instance;
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

FMI3_OWN = """EXPORT fmi3Instance fmi3InstantiateCoSimulation(
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

NAMES2 = {
    "fmi": "fmi2",
    "handle": "fmi2Component component",
    "one": "component",
    "version": "2.0",
    "back": "DeSerialize",
    "State": "FMUstate",
    "Real": "Real",
    "values": "",
    "beyond": "",
}
NAMES3 = {
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


def _named(names: Mapping[str, str]) -> str:
    text = SHARED
    for name, given in names.items():
        text = text.replace(f"@{name}", given)
    return text


FMI = {
    2: BEGINNING + FMI2_TYPES + _named(NAMES2) + FMI2_OWN,
    3: BEGINNING + FMI3_TYPES + _named(NAMES3) + FMI3_OWN,
}
