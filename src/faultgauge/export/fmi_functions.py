"""What hosts of every version of FMI call: C text around the block of an FMU (`fmu_sources`).

It stands once, with the names of each version (`fmi2_functions`, `fmi3_functions`): `@fmi` is the
prefix, `@handle` the instance's argument and `@one` its name. Names and order of arguments are the
standard's.
"""

from collections.abc import Mapping

__all__ = ["functions"]

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


def functions(types: str, names: Mapping[str, str], own: str) -> str:
    """The C text of a version: its `types`, what is shared by its `names`, what is its `own`."""
    text = SHARED
    for name, given in names.items():
        text = text.replace(f"@{name}", given)
    return BEGINNING + types + text + own
