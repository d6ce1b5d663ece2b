"""A first plant file, guessed from the columns of a log, for the user to edit."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from faultgauge.errors import InputError
from faultgauge.plants.plant_file import is_reserved, parse_plant
from faultgauge.telemetry.mapping import alias
from faultgauge.telemetry.runs import Run
from faultgauge.telemetry.statistics import statistics
from faultgauge.telemetry.timing import called_like_time

__all__ = ["called_like_input", "plant_skeleton"]

INPUT = re.compile(r"(?i)u(\d|_.*)?\d*|.*(cmd|command|volt|pwm|duty|throttle|valve|pump|input).*")
OUTPUT = re.compile(r"(?i)y(\d|_.*)?\d*")
SETPOINT = re.compile(r"(?i)(.*_)?((ref|reference|setpoint|sp|target|desired)(_.*)?|soll.*)")
HIDDEN = 10  # units of a network, for the user to change
NO_UNIT = '# unit = "..."\n'


@dataclass(frozen=True)
class Roles:
    inputs: list[str]
    states: list[str]
    left_out: dict[str, str]  # column -> why


def plant_skeleton(runs: Sequence[Run], name: str, units: Mapping[str, str] | None = None) -> str:
    """Text of a plant file (TOML) for the columns of `runs`; roles are guessed from names
    and units, and where those tell no input, from columns that are held between changes.

    `units` are those that the log gives, by column or its alias. Every state gets a network of all
    states and inputs for its derivative, and an output of the same name. Raises `InputError` if no
    column can be a state.
    """
    columns = list(dict.fromkeys(column for run in runs for column in run.columns))
    given = {alias(column): text for column, text in (units or {}).items()}
    roles = _roles(runs, columns, given)
    if not roles.states:
        raise InputError(
            f"{runs[0].source} has no column that could be a state "
            f"(columns: {', '.join(columns) or 'none'}); log at least one measured signal."
        )
    parts = [_head(runs, name, roles)]
    unit = {column: _unit(text) for column, text in given.items()}
    arguments = ", ".join([*roles.states, *roles.inputs])
    parts += [_state(runs, state, arguments, unit.get(state, NO_UNIT)) for state in roles.states]
    parts += [_input(runs, item, unit.get(item, NO_UNIT)) for item in roles.inputs]
    parts += [_output(state, unit.get(state, "")) for state in roles.states]
    parts += [f"[networks.{_key('NN_' + state)}]\nhidden = {HIDDEN}\n" for state in roles.states]
    parts.append(_faults(roles, given))
    parts.append(_observer(runs, roles))
    text = "\n".join(parts)
    try:
        parse_plant(text, "the draft")
    except InputError as refusal:
        raise InputError(
            f"{runs[0].source}: its columns make no legal plant file ({refusal}); draft it from a "
            "log of fewer columns, or of plainer names."
        ) from None
    return text


def _roles(runs: Sequence[Run], columns: list[str], units: Mapping[str, str]) -> Roles:
    names = Counter(alias(column) for column in columns)
    left_out: dict[str, str] = {}
    kept = []
    for column in columns:
        spelled = alias(column)
        if names[spelled] > 1:
            left_out[column] = "another column has this name too; rename one in the file"
        elif spelled.startswith("d_") and names[spelled.removeprefix("d_")]:
            left_out[column] = f"read as the derivative of {spelled.removeprefix('d_')}"
        elif is_reserved(spelled) or (spelled[:3] == "NN_" and names[spelled[3:]]):
            left_out[column] = "its name is taken in plant files; rename it with --map"
        elif called_like_time(column) and _increases(runs, column):
            left_out[column] = "runs like a clock"
        else:
            kept.append(spelled)
    inputs = [k for k in kept if _is_input(k, units.get(k, ""))]
    if not inputs:
        inputs = [k for k in kept if _is_held(runs, k)]
    rest = [k for k in kept if k not in inputs]
    setpoints = [k for k in rest if SETPOINT.fullmatch(k)]
    if inputs and len(setpoints) < len(rest):
        left_out |= dict.fromkeys(setpoints, "looks like a setpoint, which no plant knows")
        rest = [k for k in rest if k not in setpoints]
    return Roles(inputs, rest, left_out)


def called_like_input(name: str, unit: str = "") -> bool:
    """Whether a column's name and unit are usual ones for an input or a setpoint, which stay as
    set."""
    return _is_input(name, unit) or SETPOINT.fullmatch(name) is not None


def _is_input(name: str, unit: str = "") -> bool:
    volts = unit == "V" or name.endswith("_V")
    in_volts = volts and not OUTPUT.fullmatch(name) and not SETPOINT.fullmatch(name)
    return in_volts or INPUT.fullmatch(name) is not None


def _is_held(runs: Sequence[Run], name: str) -> bool:
    """Whether a column stays as set between its changes, as what is measured does not."""
    found = [(run.t, cells) for run in runs for c, cells in run.columns.items() if alias(c) == name]
    times, columns = zip(*found, strict=True)
    told = statistics(times, columns)
    return told is not None and told.held and not SETPOINT.fullmatch(name)


def _increases(runs: Sequence[Run], column: str) -> bool:
    return all(
        bool(np.all(np.diff(run.columns[column]) > 0)) for run in runs if column in run.columns
    )


def _head(runs: Sequence[Run], name: str, roles: Roles) -> str:
    sources = ", ".join(dict.fromkeys(_quoted(run.source) for run in runs))
    lines = [
        f"# Plant file, guessed from the columns of {sources}.",
        "# Edit it: what is an input and what a state was guessed. What the plant does not set",
        "# itself (a command, a flow from elsewhere, the weather) is an input: move it from",
        "# its [states] and [outputs] to [inputs.NAME]; leave out what tells nothing. Units may be",
        "# absent, and every derivative is wholly unknown (a network NN_...). Replace what you",
        '# know by physics: derivative = "v" for a position, or known terms beside a network, such',
        '# as "-k*x/m + NN_x(x, v)" with [parameters] k and m.',
    ]
    if not roles.inputs:
        lines += [
            "# No column could be taken for an input: all are written as states. If one of them",
            "# drives the plant, move it to [inputs.NAME], out of [states] and [outputs].",
        ]
    lines += [f"# Left out: {_quoted(column)} ({why})." for column, why in roles.left_out.items()]
    return "\n".join([*lines, f"name = {_quoted(name)}", ""])


def _quoted(text: str) -> str:
    """A TOML string, and one line whatever `text` holds."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", r"\u007f")


def _key(name: str) -> str:
    """A TOML key: bare keys are ASCII."""
    return name if name.isascii() else f'"{name}"'


def _unit(text: str) -> str:
    return f"unit = {_quoted(text)}\n"


def _output(state: str, unit: str) -> str:
    return f'[outputs.{_key(state)}]\n{unit}value = "{state}"\n'


def _state(runs: Sequence[Run], state: str, arguments: str, unit: str) -> str:
    # a sensor that is read seldom is held, too, so this is for its owner to say
    held = "# It stays as set between its changes: a command is an input, not a state.\n"
    return (
        f"{held if _is_held(runs, state) else ''}"
        f"[states.{_key(state)}]\n"
        f"{unit}"
        f'derivative = "NN_{state}({arguments})"           # d({state})/dt\n'
    )


def _input(runs: Sequence[Run], name: str, unit: str) -> str:
    values = np.concatenate(
        [values for run in runs for column, values in run.columns.items() if alias(column) == name]
    )
    return (
        f"[inputs.{_key(name)}]\n"
        f"{unit}"
        f"# min = {np.nanmin(values):.6g}           # limits of the actuator; these are the log's\n"
        f"# max = {np.nanmax(values):.6g}\n"
    )


def _faults(roles: Roles, units: Mapping[str, str]) -> str:
    """One may enter each state, as `check` has it; those of inputs are for who knows of one."""
    lines = ["# Faults: what may go wrong and where it enters; add what you look for."]
    for name in roles.states:
        unit = units.get(name, "")
        lines += [
            "",
            f"[faults.{_key(f'{name}_drift')}]",
            'enters = "state"',
            f"target = {_quoted(name)}",
            *([f"unit = {_quoted(f'{unit}/s')}"] if unit else []),
        ]
    for name in roles.inputs:
        lines += [
            "",
            f"# [faults.{_key(f'{name}_bias')}]",
            '# enters = "input"',
            f"# target = {_quoted(name)}",
        ]
    return "\n".join(lines) + "\n"


def _observer(runs: Sequence[Run], roles: Roles) -> str:
    bandwidth = 0.1 / max(run.step for run in runs)
    return (
        "# [observer]                  # what the fault observer reads, and how fast it is\n"
        f"# outputs = [{', '.join(map(_quoted, roles.states))}]\n"
        f"# bandwidth = {bandwidth:.2g}           # rad/s; a tenth of the sampling at most\n"
    )
