"""What hosts of FMI 2.0 call, and what that version calls it."""

from faultgauge.export.fmi_functions import functions

__all__ = ["FMI2"]

TYPES = """typedef void *fmi2Component;
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

OWN = """EXPORT const char *fmi2GetTypesPlatform(void)
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

NAMES = {
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

FMI2 = functions(TYPES, NAMES, OWN)
