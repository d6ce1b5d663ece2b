"""What stays double where all else is single precision: times since the beginning.

A clock that runs for days in steps of milliseconds does not fit into 24 bits; differences of times
do. So everything that is made of a time is `wide`, but for the difference of two.
"""

from collections.abc import Iterable, Sequence

from faultgauge.export.fusion import VIEWS
from faultgauge.export.program import OpBlock, Operation, Program, Value

__all__ = ["wide_values"]

CARRYING = {
    *VIEWS, "add", "add_any", "sub", "mul", "div", "neg", "max", "min", "clamp", "select_n",
    "integer_pow", "square", "convert_element_type", "dot_general", "reduce_sum", "reduce_max",
    "reduce_min", "concatenate", "stack", "pad", "scatter", "scatter-add", "dynamic_update_slice",
    "cumsum", "cummax", "cummin",
}  # fmt: skip


OPEN, NARROW, WIDE = range(3)  # a member of the state is open until something tells


def wide_values(program: Program, times: Iterable[int], states: int) -> set[int]:
    """The ids of wide values, where the inputs `times` are; the first `states` outputs come back as
    inputs with the next sample."""
    given = [NARROW] * len(program.inputs)
    given[:states] = [OPEN] * states
    for k in times:
        given[k] = WIDE
    while True:
        level = {id(v): each for v, each in zip(program.inputs, given, strict=True)}
        _spread(program.body, level)
        after = [_level(v, level) for v in program.body.outputs[:states]]
        new = [max(pair) for pair in zip(given[:states], after, strict=True)]
        if new == given[:states]:
            if OPEN not in new:
                return {key for key, each in level.items() if each == WIDE}
            new = [max(each, NARROW) for each in new]  # nothing tells: it is no time
        given[:states] = new


def _spread(block: OpBlock, level: dict[int, int]) -> None:
    for each in block.operations:
        carries = each.blocks[0].carries if each.name == "scan" else []
        level |= {id(c): _level(v, level) for c, v in zip(carries, each.inputs, strict=False)}
        while True:
            for inner in each.blocks:
                _spread(inner, level)
            new = [
                max(_level(c, level), _level(v, level))
                for c, v in zip(carries, each.blocks[0].outputs if carries else (), strict=False)
            ]
            if new == [_level(c, level) for c in carries]:
                break
            level |= {id(c): one for c, one in zip(carries, new, strict=True)}
        if each.blocks:
            for k, out in enumerate(each.outputs):
                level[id(out)] = _most([_level(inner.outputs[k], level) for inner in each.blocks])
            level |= {id(o): _level(c, level) for o, c in zip(each.outputs, carries, strict=False)}
        else:
            found = _carried(each, [_level(v, level) for v in each.inputs])
            level |= {id(o): found if o.dtype.kind == "f" else NARROW for o in each.outputs}


def _level(value: Value, level: dict[int, int]) -> int:
    return level.get(id(value), NARROW)


def _most(levels: Sequence[int]) -> int:
    return WIDE if WIDE in levels else OPEN if OPEN in levels else NARROW


def _carried(each: Operation, levels: Sequence[int]) -> int:
    if each.name not in CARRYING:
        return NARROW
    if each.name == "div":
        return levels[0]
    if each.name == "sub" and WIDE in levels:
        other = levels[1 - levels.index(WIDE)]
        return {OPEN: OPEN, NARROW: WIDE, WIDE: NARROW}[other]
    return _most(levels)
