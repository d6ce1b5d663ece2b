"""Fault commands while a simulation runs: a line of text or of NDJSON in, a change of faults out.

    inject [state|input|output] NAME [bias|gain|stuck|dropout] [SIZE] [ramp SECONDS]
    clear NAME|all
    stop

The same as JSON: {"do": "inject", "name": "u", "kind": "bias", "size": 0.2, "ramp": 5}. NAME is a
fault that the scenario or the plant declares, or a state, input or output with the kind of what
happens to it; the latter is then a fault called NAME_kind.
"""

import json
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pydantic

from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.signals import LOSSES, Entry, Signals
from faultgauge.plants.toml_file import Positive, SchemaTable, typed
from faultgauge.simulation.fault_tables import entry, unfit
from faultgauge.simulation.scenario import TRUTH, Scenario
from faultgauge.simulation.schedules import Constant, Ramp, Schedule, truth

__all__ = ["Commanded", "Commands"]

Effect = Literal["add", "stuck", "dropout"]

EFFECTS: dict[str, Effect] = {"bias": "add", "gain": "add", "stuck": "stuck", "dropout": "dropout"}
ENTRIES: tuple[Entry, ...] = ("state", "input", "output")
GAINS: dict[Entry, Entry] = {"input": "gain", "output": "output_gain"}
FORMS = (
    "inject NAME SIZE, inject TARGET bias|gain|stuck|dropout SIZE, each with [ramp SECONDS], "
    "clear NAME, clear all or stop"
)


class Commanded(NamedTuple):
    """What a command has changed: `did` (inject, clear, stop), the schedule injected with its size
    (None: a dropout) and ramp [s], or the names cleared."""

    did: Literal["inject", "clear", "stop"]
    schedule: Schedule | None = None
    size: float | None = None
    ramp: float = 0.0
    cleared: tuple[str, ...] = ()


class _Meant(NamedTuple):
    name: str
    enters: Entry
    target: str
    effect: Effect


Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]


class _Inject(SchemaTable):
    name: str
    enters: Literal["state", "input", "output"] | None = None
    kind: Literal["bias", "gain", "stuck", "dropout"] | None = None
    size: Finite | None = None
    ramp: Positive | None = None


class _Clear(SchemaTable):
    name: str


class _Stop(SchemaTable):
    pass


TABLES: dict[str, type[SchemaTable]] = {"inject": _Inject, "clear": _Clear, "stop": _Stop}


class Commands:
    """The faults that act now, and how commands change them. `schedules` begin as the scenario's;
    an injection takes the place of what bore its name."""

    def __init__(self, scenario: Scenario) -> None:
        self.signals: Signals = scenario.plant.signals
        self.schedules = {each.name: each for each in scenario.faults}
        self.known: dict[str, tuple[Entry, str]] = {
            fault.name: (fault.enters, fault.target) for fault in self.signals.faults
        }
        self.known |= {each.name: (each.enters, each.target) for each in scenario.faults}
        self.ever = dict(self.schedules)  # the first schedule of every name
        self.effects: dict[str, Effect] = {each.name: each.effect for each in scenario.faults}

    def obey(self, line: str, t: float) -> Commanded:
        """Carry out one command at time `t` [s]. Raises `InputError`, and then nothing changed."""
        where = f"command {line.strip()[:80]!r}"
        do, given = _parsed(line.strip(), where)
        table = typed(TABLES[do], given, where, also=("do",))
        if isinstance(table, _Inject):
            schedule = self._schedule(table, t, where)
            self.schedules[schedule.name] = schedule
            self.ever.setdefault(schedule.name, schedule)
            self.known[schedule.name] = (schedule.enters, schedule.target)
            self.effects[schedule.name] = schedule.effect
            return Commanded("inject", schedule, table.size, table.ramp or 0.0)
        if isinstance(table, _Clear):
            names = tuple(self.schedules) if table.name == "all" else (table.name,)
            if not set(names) <= set(self.schedules):
                legal = [*self.schedules, "all"]
                raise InputError(f"{where}: {unknown('injected fault', table.name, legal)}.")
            for name in names:
                del self.schedules[name]
            return Commanded("clear", cleared=names)
        return Commanded("stop")

    def _schedule(self, table: _Inject, t: float, where: str) -> Schedule:
        if table.name in self.known and table.enters is None:
            meant = self._declared(table, where)
        else:
            meant = self._channel(table, where)
        name, enters, target, effect = meant
        problem = unfit(enters, effect)
        if problem:
            size = "a SIZE from 0 to 1" if enters in LOSSES else "its SIZE alone"
            raise InputError(f"{where}: {problem}; write {size}.")
        size, begin = self._sizes(table, name, effect, t, where)
        profile = Constant(size, t)
        if table.ramp is not None:
            profile = Ramp(size, t, t + table.ramp, begin)
        place = entry(where, name, enters, target, self.signals)
        return Schedule(name, enters, target, profile, effect, place.unit, place.relative)

    def _declared(self, table: _Inject, where: str) -> _Meant:
        """A fault of the scenario, of the plant, or injected before."""
        name, (enters, target) = table.name, self.known[table.name]
        if table.kind == "gain" and enters not in LOSSES:
            raise InputError(
                f"{where}: fault {name!r} enters the {enters} {target!r} and is no gain loss; "
                "write `inject INPUT gain SIZE` or `inject OUTPUT gain SIZE` for one."
            )
        effect = EFFECTS[table.kind] if table.kind else self.effects.get(name, "add")
        return _Meant(name, enters, target, effect)

    def _sizes(
        self, table: _Inject, name: str, effect: str, t: float, where: str
    ) -> tuple[float, float]:
        """(size, size that a ramp begins at: what the fault has now)."""
        if effect == "dropout":
            if table.size is not None or table.ramp is not None:
                raise InputError(f"{where}: a dropout has neither size nor ramp; leave them out.")
            return 1.0, 0.0
        if table.size is None:
            raise InputError(f"{where}: the size is missing; write {FORMS}.")
        if effect == "stuck" and table.ramp is not None:
            raise InputError(f"{where}: what is stuck has no ramp; leave it out.")
        before = self.schedules.get(name)
        if before is None or before.effect != "add":
            return table.size, 0.0
        return table.size, float(truth(before, np.array([t]))[0])

    def _channel(self, table: _Inject, where: str) -> _Meant:
        """A state, an input or an output, and what happens to it."""
        signals, target, kind = self.signals, table.name, table.kind
        places: dict[Entry, tuple[str, ...]] = {
            "state": signals.state_names,
            "input": signals.input_names,
            "output": signals.output_names,
        }
        found: list[Entry] = [each for each in places if target in places[each]]
        may: list[Entry] = list(GAINS if kind == "gain" else places)
        wanted: list[Entry] = [each for each in may if table.enters in (None, each)]
        if not wanted:
            raise InputError(
                f"{where}: a {table.enters} has no gain to lose; name an input or an output."
            )
        meant: list[Entry] = [each for each in found if each in wanted]
        if not meant:
            legal = [name for each in wanted for name in places[each]]
            what = " or ".join(wanted)
            if len(wanted) == len(places):
                legal, what = [*self.known, *legal], "fault, state, input or output"
            legal = list(dict.fromkeys(legal))
            raise InputError(f"{where}: {unknown(what, target, legal)}.")
        if kind is None:
            raise InputError(
                f"{where}: what happens to {meant[0]} {target!r} is missing; write one of "
                f"{', '.join(EFFECTS)} after it."
            )
        if len(meant) > 1:
            raise InputError(
                f"{where}: {target!r} is a {' and an '.join(meant)}; write "
                f"`inject {meant[0]} {target} ...` or `inject {meant[1]} {target} ...`."
            )
        name = f"{target}_{kind}" if len(found) == 1 else f"{meant[0]}_{target}_{kind}"
        if TRUTH + name in {*signals.state_names, *signals.input_names, *signals.output_names}:
            raise InputError(
                f"{where}: its truth, {TRUTH}{name}, is a signal of the plant; declare the fault "
                "in the scenario under another name."
            )
        enters: Entry = GAINS[meant[0]] if kind == "gain" else meant[0]
        return _Meant(name, enters, target, EFFECTS[kind])


def _parsed(line: str, where: str) -> tuple[str, dict[str, Any]]:
    """(what to do, its keys) of a command in either form."""
    given = _object(line, where) if line.startswith("{") else _words(line, where)
    do = given.pop("do", None)
    if do not in TABLES:
        raise InputError(f"{where}: is no command; write {FORMS}.")
    return do, given


def _object(line: str, where: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(
            f'{where}: is not a JSON object; write one as {{"do": "clear", "name": "all"}}.'
        )
    return found


def _words(line: str, where: str) -> dict[str, Any]:
    do, *words = line.split() or [""]
    given: dict[str, Any] = {"do": do}
    if do == "inject":
        if len(words) > 2 and words[-2] == "ramp":
            given["ramp"] = _number(words.pop(), "ramp", where)
            words.pop()
        if len(words) > 1 and words[0] in ENTRIES:
            given["enters"] = words.pop(0)
    if words:
        given["name"] = words.pop(0)
    if do == "inject":
        if words and words[0] in EFFECTS:
            given["kind"] = words.pop(0)
        if words:
            given["size"] = _number(words.pop(0), "size", where)
    if words:
        raise InputError(f"{where}: {words[0]!r} is one word too many; write {FORMS}.")
    return given


def _number(word: str, what: str, where: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{where}: {what} {word!r} is not a number; write {FORMS}.") from None
