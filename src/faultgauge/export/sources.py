"""The three C files of a printed step: header, step and tables."""

import re
from collections.abc import Sequence

from faultgauge.export.compile import Member, Printed

__all__ = ["header", "step_source", "table_source"]


def _struct(name: str, members: Sequence[Member], about: str) -> str:
    lines = [f"    {each.line}" for each in members if each.size] or ["    char none;"]
    return "\n".join([f"/* {about} */", "typedef struct {", *lines, f"}} {name};", ""])


def _codes(printed: Printed) -> str:
    found = ""
    for start, names in printed.codes.items():
        each = [f"{printed.name}_{start}_" if start else f"{printed.name}_"] * len(names)
        words = [
            f"    {a.upper()}{b} = {k}" for k, (a, b) in enumerate(zip(each, names, strict=True))
        ]
        found += "enum {\n" + ",\n".join(words) + "\n};\n\n"
    return found


def header(printed: Printed, banner: str) -> str:
    """`NAME.h`; `banner` says what it was made from."""
    name, real = printed.name, printed.real
    guard = f"{name.upper()}_H"
    state = [each.line for each in printed.state if each.size]
    work = [each.line for each in printed.work]
    kept = "\n".join(f"    {line}" for line in state)
    scratch = "\n".join(f"        {line}" for line in work or ["char none;"])
    inputs = _struct(f"{name}_input", printed.inputs, "One sample; NAN is a signal not sampled.")
    outputs = _struct(f"{name}_output", printed.outputs, "What one step says.")
    lines = "\n".join(printed.externals)
    tables = f"/* Of the step, for nobody else. */\n{lines}\n\n" if lines else ""
    # `real` is a name of this header alone
    text = f"""{banner}
#ifndef {guard}
#define {guard}

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

{_codes(printed)}{inputs}
{outputs}
/* Plain data: copy it, save it, restore it. Only what stands before `work` lasts from step to step:
   its size is {name.upper()}_SAVED bytes; `work` may hold anything before a step. */
typedef struct {{
{kept}
    struct {name}_work {{
{scratch}
    }} work;
}} {name}_state;

#define {name.upper()}_SAVED offsetof({name}_state, work)

/* Begin anew. */
void {name}_init({name}_state *state);

/* Take one sample: `out` is what it says, `state` goes on. The longest time is bounded: no loop
   depends on data but for sorting, and nothing waits. */
void {name}_step(const {name}_input *in, {name}_output *out, {name}_state *state);

{tables}#ifdef __cplusplus
}}
#endif

#endif
"""
    return _real(text, real)


def step_source(printed: Printed, banner: str) -> str:
    """`NAME.c`."""
    name = printed.name
    unused = [
        f"    (void){argument};\n"
        for argument in ("in", "out")
        if not re.search(rf"\b{argument}\b", printed.step)
    ]
    # the compiler may then not assume that no NAN occurs, which is how "not sampled" is said
    text = f"""{banner}
#include "{name}.h"

#include <math.h>

#ifdef __FAST_MATH__
#error "NAN says what was not sampled: compile without -ffast-math"
#endif

{printed.helpers}
{printed.parts}
void {name}_init({name}_state *state)
{{
{_work(printed.init, name)}{printed.init}}}

void {name}_step(const {name}_input *in, {name}_output *out, {name}_state *state)
{{
{_work(printed.step, name)}{"".join(unused)}{printed.step}}}
"""
    return _real(text, printed.real)


def _work(body: str, name: str) -> str:
    return f"    struct {name}_work *const work = &state->work;\n" if "work->" in body else ""


def table_source(printed: Printed, banner: str) -> str:
    """`NAME_tables.c`."""
    text = f'{banner}\n#include "{printed.name}.h"\n\n#include <math.h>\n\n'
    return _real(text + printed.tables, printed.real)


def _real(text: str, real: str) -> str:
    return re.sub(r"\bwide\b", "double", re.sub(r"\breal\b", real, text))
