"""C text of an FMU: the printed step as a block that takes samples in time, and around it the
functions that hosts of FMI 2.0 and 3.0 call. Names and order of arguments are the standard's."""

from collections.abc import Sequence
from string import Template

from faultgauge.export.compile import Member, Printed

__all__ = ["START", "TIME", "block_sources", "fmi_source"]

TIME = 0  # value reference of the time; those of inputs and outputs follow
START = 0.0  # of an input
LONGEST = 1.5  # sample times: a longer communication step would leave samples out
# what is said before the first sample, beside no number
BEFORE = {"status": "NOT_JUDGED", "reason": "REASON_NOT_SAMPLED"}

BLOCK_H = """$banner
#ifndef ${guard}_BLOCK_H
#define ${guard}_BLOCK_H

#include "$name.h"

/* The step with what it was given last and what it said, in time. */
typedef struct {
    double now; /* s, where the last communication step ended */
    double due; /* s, of the next sample */
    ${name}_input in;
    ${name}_output out;
    ${name}_state state;
} ${name}_block;

#define ${guard}_TOKEN "$token"

void ${name}_block_begin(${name}_block *block);
void ${name}_block_start(${name}_block *block, double t);

/* One communication step of `h` from `t` on: a sample is taken where one is due. 0: `h` is too
   long, and nothing was done. */
int ${name}_block_do(${name}_block *block, double t, double h);

/* By value reference; 0: there is none of that type, or it cannot be set. */
int ${name}_block_get_real(const ${name}_block *block, uint32_t which, double *value);
int ${name}_block_set_real(${name}_block *block, uint32_t which, double value);
int ${name}_block_get_whole(const ${name}_block *block, uint32_t which, int32_t *value);
int ${name}_block_get_bool(const ${name}_block *block, uint32_t which, int *value);

/* As bytes, which no other FMU takes. `load` 0: they are not of this one. */
size_t ${name}_block_size(void);
void ${name}_block_save(const ${name}_block *block, unsigned char *bytes);
int ${name}_block_load(${name}_block *block, const unsigned char *bytes, size_t size);

#endif
"""

BLOCK_C = """$banner
#include "${name}_block.h"

#include <math.h>
#include <string.h>

#define PERIOD $period /* s, between samples */
#define EARLY (0.01 * PERIOD) /* a sample may be, for times that are sums */

enum { NONE, REAL, WHOLE, BOOL };

static const struct {
    int type;
    int input;
    size_t at;
} variables[] = {
$table
};

static int is(uint32_t which, int type)
{
    return which < sizeof variables / sizeof *variables && variables[which].type == type;
}

static const void *place(const ${name}_block *block, uint32_t which)
{
    const void *from = variables[which].input ? (const void *)&block->in : &block->out;
    return (const char *)from + variables[which].at;
}

void ${name}_block_begin(${name}_block *block)
{
    memset(block, 0, sizeof *block);
    ${name}_init(&block->state);
$before
}

void ${name}_block_start(${name}_block *block, double t)
{
    block->now = block->due = t;
}

int ${name}_block_do(${name}_block *block, double t, double h)
{
    if (!(h <= $longest * PERIOD)) {
        return 0;
    }
    if (t >= block->due - EARLY) {
        block->in.t = t;
        ${name}_step(&block->in, &block->out, &block->state);
        block->due = (t < block->due + PERIOD - EARLY ? block->due : t) + PERIOD;
    }
    block->now = t + h;
    return 1;
}

int ${name}_block_get_real(const ${name}_block *block, uint32_t which, double *value)
{
    $real found;
    if (which == $time) {
        *value = block->now;
        return 1;
    }
    if (!is(which, REAL)) {
        return 0;
    }
    memcpy(&found, place(block, which), sizeof found);
    *value = found;
    return 1;
}

int ${name}_block_set_real(${name}_block *block, uint32_t which, double value)
{
    const $real given = ($real)value;
    if (!is(which, REAL) || !variables[which].input) {
        return 0;
    }
    memcpy((char *)&block->in + variables[which].at, &given, sizeof given);
    return 1;
}

int ${name}_block_get_whole(const ${name}_block *block, uint32_t which, int32_t *value)
{
    if (!is(which, WHOLE)) {
        return 0;
    }
    memcpy(value, place(block, which), sizeof *value);
    return 1;
}

int ${name}_block_get_bool(const ${name}_block *block, uint32_t which, int *value)
{
    if (!is(which, BOOL)) {
        return 0;
    }
    *value = *(const _Bool *)place(block, which);
    return 1;
}

/* each part goes to, or comes from, the place in the bytes that follows the part before */
#define PARTS(MOVE) \\
    MOVE(&block->now, sizeof block->now); \\
    MOVE(&block->due, sizeof block->due); \\
    MOVE(&block->in, sizeof block->in); \\
    MOVE(&block->out, sizeof block->out); \\
    MOVE(&block->state, ${guard}_SAVED)

size_t ${name}_block_size(void)
{
    return sizeof ${guard}_TOKEN + 2 * sizeof(double) + sizeof(${name}_input)
        + sizeof(${name}_output) + ${guard}_SAVED;
}

void ${name}_block_save(const ${name}_block *block, unsigned char *bytes)
{
    memcpy(bytes, ${guard}_TOKEN, sizeof ${guard}_TOKEN);
    bytes += sizeof ${guard}_TOKEN;
#define OUT(part, size) memcpy(bytes, part, size), bytes += size
    PARTS(OUT);
}

int ${name}_block_load(${name}_block *block, const unsigned char *bytes, size_t size)
{
    if (size != ${name}_block_size() || memcmp(bytes, ${guard}_TOKEN, sizeof ${guard}_TOKEN)) {
        return 0;
    }
    bytes += sizeof ${guard}_TOKEN;
#define IN(part, size) memcpy(part, bytes, size), bytes += size
    PARTS(IN);
    return 1;
}
"""

COMMON = """$banner
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

KEPT = """EXPORT @fmiStatus @fmiGet@State(@handle, @fmi@State *kept)
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

"""


def _kept(handle: str, back: str, state: str) -> str:
    """Getting, setting and keeping as bytes of an FMU's state, with the names that a version of
    FMI has for the instance's argument, for "deserialize" and for the state."""
    names = {"handle": handle, "one": handle.split()[1], "back": back, "State": state}
    text = KEPT
    for name, given in {**names, "fmi": handle[:4]}.items():
        text = text.replace(f"@{name}", given)
    return text


FMI2 = (
    COMMON
    + """typedef void *fmi2Component;
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

/* Begin a function of `it`, which is legal in `phases` alone. */
#define ENTER(phases) \\
    Instance *const it = component; \\
    if (!it) { \\
        return fmi2Error; \\
    } \\
    if (!(it->phase & (phases))) { \\
        return fails(it, "a function was called out of turn"); \\
    }

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT fmi2Status fmi2SetDebugLogging(
    fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    (void)component, (void)on, (void)count, (void)categories;
    return fmi2OK; /* nothing but errors is ever said */
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

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    ENTER(BEGINNING)
    it->phase = STEPPING;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component component)
{
    ENTER(STEPPING)
    it->phase = ENDED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component component)
{
    ENTER(ANY)
    ${name}_block_begin(&it->block);
    it->phase = MADE;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(
    fmi2Component component, const fmi2ValueReference which[], size_t count, fmi2Real value[])
{
    ENTER(ANY)
    for (size_t k = 0; k < count; k++) {
        if (!${name}_block_get_real(&it->block, which[k], value + k)) {
            return fails(it, "fmi2GetReal: no real variable has that value reference");
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetInteger(
    fmi2Component component, const fmi2ValueReference which[], size_t count, fmi2Integer value[])
{
    ENTER(ANY)
    for (size_t k = 0; k < count; k++) {
        int32_t found;
        if (!${name}_block_get_whole(&it->block, which[k], &found)) {
            return fails(it, "fmi2GetInteger: no whole variable has that value reference");
        }
        value[k] = found;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(
    fmi2Component component, const fmi2ValueReference which[], size_t count, fmi2Boolean value[])
{
    ENTER(ANY)
    for (size_t k = 0; k < count; k++) {
        if (!${name}_block_get_bool(&it->block, which[k], value + k)) {
            return fails(it, "fmi2GetBoolean: no boolean variable has that value reference");
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(
    fmi2Component component, const fmi2ValueReference which[], size_t count,
    const fmi2Real value[])
{
    ENTER(MADE | BEGINNING | STEPPING)
    for (size_t k = 0; k < count; k++) {
        if (!${name}_block_set_real(&it->block, which[k], value[k])) {
            return fails(it, "fmi2SetReal: no input has that value reference");
        }
    }
    return fmi2OK;
}

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

"""
    + _kept("fmi2Component component", "DeSerialize", "FMUstate")
    + """/* What this FMU says it does not have. */
#define NONE(name, arguments) \\
    EXPORT fmi2Status name arguments \\
    { \\
        ENTER(ANY) \\
        return fails(it, #name ": this FMU has none of that"); \\
    }
#define LIST fmi2Component component, const fmi2ValueReference which[], size_t count

NONE(fmi2GetString, (LIST, fmi2String value[]))
NONE(fmi2SetInteger, (LIST, const fmi2Integer value[]))
NONE(fmi2SetBoolean, (LIST, const fmi2Boolean value[]))
NONE(fmi2SetString, (LIST, const fmi2String value[]))
NONE(fmi2SetRealInputDerivatives, (LIST, const fmi2Integer order[], const fmi2Real value[]))
NONE(fmi2GetRealOutputDerivatives, (LIST, const fmi2Integer order[], fmi2Real value[]))
NONE(fmi2GetDirectionalDerivative,
    (LIST, const fmi2ValueReference known[], size_t knowns, const fmi2Real dv[], fmi2Real dz[]))
NONE(fmi2CancelStep, (fmi2Component component))
NONE(fmi2GetStatus, (fmi2Component component, fmi2StatusKind kind, fmi2Status *value))
NONE(fmi2GetRealStatus, (fmi2Component component, fmi2StatusKind kind, fmi2Real *value))
NONE(fmi2GetIntegerStatus, (fmi2Component component, fmi2StatusKind kind, fmi2Integer *value))
NONE(fmi2GetBooleanStatus, (fmi2Component component, fmi2StatusKind kind, fmi2Boolean *value))
NONE(fmi2GetStringStatus, (fmi2Component component, fmi2StatusKind kind, fmi2String *value))
"""
)

FMI3 = (
    COMMON
    + """typedef void *fmi3Instance;
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

/* Begin a function of `it`, which is legal in `phases` alone. */
#define ENTER(phases) \\
    Instance *const it = instance; \\
    if (!it) { \\
        return fmi3Error; \\
    } \\
    if (!(it->phase & (phases))) { \\
        return fails(it, "a function was called out of turn"); \\
    }

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(
    fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    (void)instance, (void)on, (void)count, (void)categories;
    return fmi3OK; /* nothing but errors is ever said */
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
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

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    ENTER(BEGINNING)
    it->phase = STEPPING;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ENTER(STEPPING)
    it->phase = ENDED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    ENTER(ANY)
    ${name}_block_begin(&it->block);
    it->phase = MADE;
    return fmi3OK;
}

/* Values of one type, each of which `found` is for a moment. */
#define GET(name, type, whole, get) \\
    EXPORT fmi3Status name( \\
        fmi3Instance instance, const fmi3ValueReference which[], size_t count, type value[], \\
        size_t values) \\
    { \\
        ENTER(ANY) \\
        for (size_t k = 0; k < count; k++) { \\
            whole found; \\
            if (k >= values || !get(&it->block, which[k], &found)) { \\
                return fails(it, #name ": no variable of that type has that value reference"); \\
            } \\
            value[k] = (type)found; \\
        } \\
        return fmi3OK; \\
    }

GET(fmi3GetFloat64, fmi3Float64, double, ${name}_block_get_real)
GET(fmi3GetInt32, fmi3Int32, int32_t, ${name}_block_get_whole)
GET(fmi3GetInt64, fmi3Int64, int32_t, ${name}_block_get_whole) /* enumerations */
GET(fmi3GetBoolean, fmi3Boolean, int, ${name}_block_get_bool)

EXPORT fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference which[], size_t count,
    const fmi3Float64 value[], size_t values)
{
    ENTER(MADE | BEGINNING | STEPPING)
    for (size_t k = 0; k < count; k++) {
        if (k >= values || !${name}_block_set_real(&it->block, which[k], value[k])) {
            return fails(it, "fmi3SetFloat64: no input has that value reference");
        }
    }
    return fmi3OK;
}

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

"""
    + _kept("fmi3Instance instance", "Deserialize", "FMUState")
    + """EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    ENTER(MADE | STEPPING)
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    ENTER(MADE | STEPPING)
    return fmi3OK;
}

/* What this FMU says it does not have. */
#define NONE(name, arguments) \\
    EXPORT fmi3Status name arguments \\
    { \\
        ENTER(ANY) \\
        return fails(it, #name ": this FMU has none of that"); \\
    }
#define OWN fmi3Instance instance
#define LIST OWN, const fmi3ValueReference which[], size_t count
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
)


def block_sources(
    printed: Printed, inputs: Sequence[Member], period: float, token: str, banner: str
) -> dict[str, str]:
    """The block's files by name; `inputs` are those that a host sets, samples come every `period`
    [s], and `token` tells this FMU from others."""
    name = printed.name
    guard = name.upper()
    many = [("input", each) for each in inputs] + [("output", each) for each in printed.outputs]
    rows = ["    {NONE, 0, 0}, /* time */"]
    for which, each in many:
        kind = {"real": "REAL", "wide": "REAL", "bool": "BOOL"}.get(each.kind, "WHOLE")
        place = f"offsetof({name}_{which}, {each.name})"
        rows.append(f"    {{{kind}, {int(which == 'input')}, {place}}},")
    before = [f"    block->in.{each.name} = {START};" for each in inputs]
    before += [f"    block->out.{m.name} = NAN;" for m in printed.outputs if m.kind == "real"]
    before += [
        f"    block->out.{m.name} = {guard}_{BEFORE[m.name]};"
        for m in printed.outputs
        if m.name in BEFORE
    ]
    given = {
        "banner": banner,
        "name": name,
        "guard": guard,
        "token": token,
        "period": repr(period),
        "longest": LONGEST,
        "time": TIME,
        "real": printed.real,
        "table": "\n".join(rows),
        "before": "\n".join(before),
    }
    return {
        f"{name}_block.h": Template(BLOCK_H).substitute(given),
        f"{name}_block.c": Template(BLOCK_C).substitute(given),
    }


def fmi_source(printed: Printed, version: int, period: float, banner: str) -> str:
    """What a host of FMI `version` calls."""
    too_long = (
        f"the communication step is longer than the time between samples, {period:g} s; take that "
        "or a whole part of it"
    )
    return Template(FMI2 if version == 2 else FMI3).substitute(
        banner=banner, name=printed.name, guard=printed.name.upper(), too_long=too_long
    )
