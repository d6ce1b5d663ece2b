"""Tables of a scenario file that become schedules: its faults and disturbances."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.signals import INNER, LOSSES, Entry, Signals
from faultgauge.plants.toml_file import SchemaTable, typed
from faultgauge.simulation.schedules import Profile, Schedule
from faultgauge.simulation.sources import PROFILES

__all__ = ["Entrance", "entry", "schedules", "unfit"]


class Entrance(NamedTuple):
    """Where a fault enters, and what it is measured in: `unit`, or a share where `relative`."""

    enters: Entry
    target: str
    unit: str
    relative: bool = False


class _Schedule(SchemaTable):
    enters: Entry | None = None
    target: str | None = None
    effect: Literal["add", "stuck", "dropout"] = "add"
    profile: str


def schedules(
    kind: str, tables: Mapping[str, dict[str, Any]], signals: Signals, source: str
) -> tuple[Schedule, ...]:
    """The tables `[kind.NAME]` of file `source`, checked against the plant's `signals`."""
    return tuple(
        _schedule(f"{source}: [{kind}.{name}]", name, data, signals)
        for name, data in tables.items()
    )


def _schedule(where: str, name: str, data: dict[str, Any], signals: Signals) -> Schedule:
    keys = list(_Schedule.model_fields)
    head = typed(_Schedule, {key: value for key, value in data.items() if key in keys}, where)
    place = entry(where, name, head.enters, head.target, signals)
    problem = unfit(place.enters, head.effect)
    if problem:
        raise InputError(f"{where} {problem}; remove `effect`.")
    body = {key: value for key, value in data.items() if key not in keys}
    profile = _profile(where, head, body)
    return Schedule(
        name, place.enters, place.target, profile, head.effect, place.unit, place.relative
    )


def unfit(enters: Entry, effect: str) -> str:
    """Why what enters so cannot have this effect; empty where it can."""
    if enters in LOSSES and effect == "stuck":
        return "a gain is not stuck but lost"
    if enters in INNER and effect != "add":
        return f"what enters a {enters} changes its value and is neither stuck nor dropped out"
    return ""


def _profile(where: str, head: _Schedule, body: dict[str, Any]) -> Profile:
    if head.profile not in PROFILES:
        raise InputError(f"{where} profile: {unknown('profile', head.profile, PROFILES)}.")
    if head.effect == "dropout":
        if head.profile not in ("constant", "intermittent"):
            raise InputError(
                f"{where} profile = {head.profile!r}: a dropout is constant or intermittent."
            )
        if "size" in body:
            raise InputError(f"{where} a dropout has no size; remove `size`.")
        body = {**body, "size": 1.0}
    keys = list(_Schedule.model_fields)
    return typed(PROFILES[head.profile], body, where, also=keys).profile()


def entry(
    where: str, name: str, enters: Entry | None, target: str | None, signals: Signals
) -> Entrance:
    """As written, or as the plant declares `name`; what enters a parameter or a network has to be
    a fault that the plant declares."""
    declared = next((fault for fault in signals.faults if fault.name == name), None)
    enters = enters or (declared.enters if declared else None)
    target = target or (declared.target if declared else None)
    if enters is None or target is None:
        missing = "enters" if enters is None else "target"
        raise InputError(
            f"{where} key {missing!r} is missing, and the plant declares no fault {name!r} to take "
            "it from; add it."
        )
    if declared and (declared.enters, declared.target) == (enters, target):
        return Entrance(enters, target, declared.unit, declared.relative)
    if enters in INNER:
        legal = ", ".join(fault.name for fault in signals.faults if fault.enters == enters)
        raise InputError(
            f"{where} the plant declares no fault {name!r} of {enters} {target!r}; declare it in "
            f"the plant file, or take one that it declares: {legal or 'none'}."
        )
    kind = {"gain": "input", "output_gain": "output"}.get(enters, enters)
    channels = {"state": signals.states, "output": signals.outputs}.get(kind, signals.inputs)
    units = {channel.name: channel.unit for channel in channels}
    if target not in units:
        raise InputError(f"{where} target: {unknown(kind, target, units)}.")
    if enters == "state":
        return Entrance(enters, target, f"({units[target]})/s" if units[target] else "")
    return Entrance(enters, target, "" if enters in LOSSES else units[target])
