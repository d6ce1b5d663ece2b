"""C text of an FMU: the printed step as a block that takes samples in time, and around it what
hosts of FMI 2.0 and 3.0 call (`fmi2_functions`, `fmi3_functions`)."""

from collections.abc import Sequence
from string import Template

from faultgauge.export.compile import Member, Printed
from faultgauge.export.fmi2_functions import FMI2
from faultgauge.export.fmi3_functions import FMI3

__all__ = ["START", "TIME", "block_sources", "fmi_source"]

TIME = 0  # value reference of the time; those of inputs and outputs follow
START = 0.0  # of an input
LONGEST = 1.5  # sample times: a longer communication step would leave samples out
HOSTS = {2: FMI2, 3: FMI3}  # by version
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
    return Template(HOSTS[version]).substitute(
        banner=banner, name=printed.name, guard=printed.name.upper(), too_long=too_long
    )
