"""`export --to c`: the C files of a model, a test of theirs, and how to build them."""

import platform
import re
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from string import Template
from typing import Any

import jax
import numpy as np

from faultgauge.export.compile import ExportedStep, Member, Printed, print_step
from faultgauge.export.elementwise import TANH_ERROR, literal
from faultgauge.export.native import Native, compiler
from faultgauge.export.request import Request
from faultgauge.export.sources import header, step_source, table_source

__all__ = ["c_project", "plain"]

SAMPLES = 240  # that the test of the C files runs over
SEED = 0  # of the inputs of the test and of the timing
TIMED = 2000  # steps
# Of a signal's largest value in the vectors: rounding adds up differently under other compilers
# and libraries. With float or the fast tanh evidence that is on its way up or down is off by as
# much as a few samples make of it, so that some numbers may be further off.
EXACT, ROUGH, SOME = 1e-8, 2e-2, 0.25


def c_project(request: Request) -> dict[str, bytes]:
    """The files by name. Raises `InputError` where C cannot carry the model."""
    step, name = request.step, request.name
    printed = print_step(step, name, single=request.single, fast_tanh=request.fast_tanh)
    version = metadata.version("faultgauge")
    banner = (
        f"/* Made by faultgauge {version} from the model of {plain(request.title)} with SHA-256\n"
        f"   {request.digest}. Export again rather than edit. */\n"
    )
    files = {
        f"{name}.h": header(printed, banner),
        f"{name}.c": step_source(printed, banner),
        f"{name}_tables.c": table_source(printed, banner),
        f"{name}_test.c": _test(printed, step, banner),
        "README.md": _readme(printed, request, version),
        "CMakeLists.txt": Template(CMAKE).substitute(name=name),
        "Makefile": Template(MAKE).substitute(name=name),
    }
    return {key: text.encode() for key, text in files.items()}


def plain(text: str) -> str:
    """As it may stand in a comment of C."""
    return text.encode("ascii", "replace").decode().replace("*/", "* /")


# -- the test


def vectors(
    printed: Printed, step: ExportedStep, count: int = SAMPLES
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """(samples, what Python says of them), by the names that they have in C."""
    assert step.examples is not None
    samples = step.examples(count, np.random.default_rng(SEED))

    @jax.jit
    def walk(state: Any, given: Any) -> Any:
        return jax.lax.scan(step.step, state, given)[1]

    given = type(step.sample)((k, jax.numpy.asarray(samples[k])) for k in step.sample)
    return _by_name(printed.inputs, given), _by_name(printed.outputs, walk(step.state, given))


def _by_name(members: Sequence[Member], tree: Any) -> dict[str, np.ndarray]:
    leaves = jax.tree.leaves(tree)
    return {each.name: np.asarray(leaf) for each, leaf in zip(members, leaves, strict=True)}


def _test(printed: Printed, step: ExportedStep, banner: str) -> str:
    samples, said = vectors(printed, step)
    exact = not printed.single and not printed.fast_tanh
    tolerance = EXACT if exact else ROUGH
    checks = []
    reals = [m for m in printed.outputs if m.kind == "real"]
    for k, member in enumerate(reals):
        scale = float(np.nanmax(np.abs(said[member.name]), initial=0.0))
        limit = literal(tolerance * max(scale, 1e-9), "real", printed.single)
        checks.append(f"        wrong += differs(out.{member.name}, expected[k][{k}], {limit});")
    whole = [m for m in printed.outputs if m.kind != "real"] if exact else []
    for k, member in enumerate(whole):
        checks.append(f"        wrong += (int)out.{member.name} != codes[k][{k}];")
    given = [[samples[m.name][k] for m in printed.inputs] for k in range(SAMPLES)]
    fields = [f"        in.{m.name} = samples[k][{k}];" for k, m in enumerate(printed.inputs)]
    return Template(TEST).substitute(
        banner=banner,
        name=printed.name,
        real=printed.real,
        count=len(given),
        inputs=len(printed.inputs),
        outputs=max(len(reals), 1),
        samples=_rows(given, printed.single),
        expected=_rows(
            [[said[m.name][k] for m in reals] for k in range(len(given))], printed.single
        ),
        codes=_codes(whole, said, len(given)),
        fields="\n".join(fields),
        checks="\n".join(checks),
        allowed=0 if exact else int(SOME * SAMPLES * len(reals)),
    )


def _rows(rows: Sequence[Sequence[float]], single: bool) -> str:
    return "\n".join(
        f"    {{{', '.join(literal(float(v), 'real', single) for v in row) or '0'}}},"
        for row in rows
    )


def _codes(whole: Sequence[Member], said: dict[str, Any], count: int) -> str:
    if not whole:
        return ""
    rows = [", ".join(str(int(said[m.name][k])) for m in whole) for k in range(count)]
    lines = "\n".join(f"    {{{row}}}," for row in rows)
    return f"static const int codes[{count}][{len(whole)}] = {{\n{lines}\n}};\n"


TEST = """$banner
/* Runs the step over samples and compares it with what Python said: 0 if it agrees, else 1. Link it
   on the target and call ${name}_test there, or build it as a program. */
#include "$name.h"

#include <math.h>

int ${name}_test(void);

static const $real samples[$count][$inputs] = {
$samples
};
static const $real expected[$count][$outputs] = {
$expected
};
$codes
static int differs($real a, $real b, $real limit)
{
    if (b != b) {
        return a == a;
    }
    return !(a - b <= limit && b - a <= limit);
}

int ${name}_test(void)
{
    static ${name}_state state;
    ${name}_input in;
    ${name}_output out;
    int wrong = 0;
    ${name}_init(&state);
    for (int k = 0; k < $count; k++) {
$fields
        ${name}_step(&in, &out, &state);
$checks
    }
    return wrong > $allowed;
}

#ifndef NO_MAIN
int main(void)
{
    return ${name}_test();
}
#endif
"""

# -- how to build it

CMAKE = """cmake_minimum_required(VERSION 3.10)
project($name C)
set(CMAKE_C_STANDARD 99)

add_library($name STATIC $name.c ${name}_tables.c)
target_include_directories($name PUBLIC $${CMAKE_CURRENT_SOURCE_DIR})
if(UNIX)
  target_link_libraries($name PUBLIC m)
endif()

enable_testing()
add_executable(${name}_test ${name}_test.c)
target_link_libraries(${name}_test PRIVATE $name)
add_test(NAME ${name} COMMAND ${name}_test)
"""

MAKE = """# make: the library; make test: build the test and run it
CC ?= cc
CFLAGS ?= -O3
ALL = -std=c99 $$(CFLAGS)

lib$name.a: $name.o ${name}_tables.o
	$$(AR) rcs $$@ $$^

%.o: %.c $name.h
	$$(CC) $$(ALL) -c $$< -o $$@

${name}_test: ${name}_test.o lib$name.a
	$$(CC) $$^ -lm -o $$@

.PHONY: test clean
test: ${name}_test
	./${name}_test && echo agrees

clean:
	rm -f *.o lib$name.a ${name}_test
"""

# -- the readme

README = """# $title

$files

What one step takes and says ($precision):

| Member of `${name}_input` | |
|---|---|
$inputs

| Member of `${name}_output` | |
|---|---|
$outputs

```c
static ${name}_state state;
${name}_init(&state);
for (;;) {
    /* fill `in`; NAN where a signal was not sampled */
    ${name}_step(&in, &out, &state);
}
```

`make test`, or `cmake -B build && cmake --build build && ctest --test-dir build`, compares the code
with what Python said of $samples samples.

| | |
|---|---|
| what lasts from step to step | $saved bytes (`${upper}_SAVED`, the members before `work`) |
| working memory, also in the state | $work bytes |
| constant tables | $tables bytes |
| operations of one step, at most | $operations |
| longest of $timed steps here | $measured |

The operations are counted from the printed loops, the dearer branch wherever there are two. The
time was measured on the machine that made these files, so it is no bound for another (no WCET); the
C files do not depend on it. All memory is the caller's; there is no allocation, no recursion, no
global that changes, and every loop has a fixed number of turns. Only `<math.h>` is called. A state
can be copied, saved and restored: with the same samples the same numbers follow to the bit. Compile
without `-ffast-math`, which drops NAN.$tanh

## MISRA C:2012

cppcheck's addon finds these deviations and no others in the library's three files (the test is not
part of it); rules that it cannot check were not reviewed:

$deviations

Made by faultgauge $version from the model with SHA-256 `$digest`.
"""


# from rules of MISRA C:2012 (cppcheck's addon tells where: tests/export/test_machines.py)
DEVIATIONS = {
    "2.4": "the enumerations' tags are names for the caller, and for debuggers.",
    "2.5": "the size of what lasts from step to step is a macro for the caller.",
    "10.3": "truth values are integers as wide as the numbers, so that both fit one vector.",
    "10.6": "the same, and places within arrays, which are bounded where they are found.",
    "12.1": "operands of the conditional operator that are sums; they stand in parentheses.",
}


def _readme(printed: Printed, request: Request, version: str) -> str:
    name = printed.name
    operations = ", ".join(f"{n:,} {kind}" for kind, n in printed.operations.items())
    tanh = (
        f"\nThe tanh of the networks is a rational function, off by less than {TANH_ERROR:g}."
        if printed.fast_tanh
        else ""
    )
    return Template(README).substitute(
        title=request.title,
        files=request.about,
        name=name,
        upper=name.upper(),
        precision=f"`{printed.real}`",
        inputs=_members(printed.inputs),
        outputs=_members(printed.outputs),
        samples=SAMPLES,
        saved=f"{printed.saved_bytes:,}",
        work=f"{printed.bytes_of(printed.work):,}",
        tables=f"{printed.table_bytes:,}",
        operations=operations,
        timed=f"{TIMED:,}",
        measured=_measured(printed, request.step),
        tanh=tanh,
        deviations="\n".join(f"- {rule}: {why}" for rule, why in DEVIATIONS.items()),
        version=version,
        digest=request.digest,
    )


def _members(members: Sequence[Member]) -> str:
    return "\n".join(f"| `{m.name}` | {m.comment} |" for m in members)


def _measured(printed: Printed, step: ExportedStep) -> str:
    if compiler() is None:
        return "not measured: no C compiler was there"
    assert step.examples is not None
    samples = step.examples(TIMED, np.random.default_rng(SEED))
    with Native(printed) as native:
        longest = native.longest(samples)
    return f"{1e6 * longest:.0f} us, measured on {plain(_host())}"


def _host() -> str:
    """The machine at hand: its processor, as far as the system names it, and the system."""
    listed = Path("/proc/cpuinfo")
    text = listed.read_text(errors="replace") if listed.exists() else ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    name = found[1] if found else platform.processor() or "an unnamed processor"
    return f"{name}, {platform.system()} on {platform.machine()}"
