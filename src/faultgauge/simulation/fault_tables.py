"""Tables of a scenario file that become schedules: its faults and disturbances."""

from collections.abc import Mapping
from typing import Any, Literal

from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.signals import Signals
from faultgauge.plants.toml_file import Table, typed
from faultgauge.simulation.schedules import Profile, Schedule
from faultgauge.simulation.sources import PROFILES

__all__ = ["Entry", "entry", "schedules"]

Entry = Literal["state", "input", "output", "gain"]


class _Schedule(Table):
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
    enters, target, unit = entry(where, name, head.enters, head.target, signals)
    if head.effect == "stuck" and enters == "gain":
        raise InputError(f"{where} a gain is not stuck but lost; remove `effect`.")
    body = {key: value for key, value in data.items() if key not in keys}
    return Schedule(name, enters, target, _profile(where, head, body), head.effect, unit)


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
) -> tuple[Entry, str, str]:
    """Where it enters, its target and its unit: as written, or as the plant declares `name`."""
    declared = next((fault for fault in signals.faults if fault.name == name), None)
    enters = enters or (declared.enters if declared else None)
    target = target or (declared.target if declared else None)
    if enters is None or target is None:
        missing = "enters" if enters is None else "target"
        raise InputError(
            f"{where} key {missing!r} is missing, and the plant declares no fault {name!r} to take "
            "it from; add it."
        )
    channels = {"state": signals.states, "output": signals.outputs}.get(enters, signals.inputs)
    units = {channel.name: channel.unit for channel in channels}
    if target not in units:
        problem = unknown("input" if enters == "gain" else enters, target, units)
        raise InputError(f"{where} target: {problem}.")
    if declared and (declared.enters, declared.target) == (enters, target):
        return enters, target, declared.unit
    if enters == "state":
        return enters, target, f"({units[target]})/s" if units[target] else ""
    return enters, target, "" if enters == "gain" else units[target]
