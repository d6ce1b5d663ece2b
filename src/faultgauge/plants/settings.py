"""What of a plant file no weight depends on: its faults, and what judges them.

`[faults]`, `[detection]`, `[observer]` and the keys `exact` and `trusted` may change without a new
fit; all else may not.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.plants.schema import FileTable
from faultgauge.plants.spec import PlantSpec
from faultgauge.plants.toml_file import parse_toml, typed

__all__ = ["with_settings"]

FREE = {"faults", "detection", "observer"}
FREE_KEYS = {"exact", "trusted"}  # of states, inputs and outputs
KINDS = ("states", "inputs", "outputs", "parameters", "networks")


def with_settings(model: Model, source: str | Path) -> Model:
    """`model` with `[faults]`, `[detection]`, `[observer]`, `exact` and `trusted` as in the plant
    file (or preset) `source`, which its own text becomes.

    Raises `InputError` that names the first key in which they differ otherwise.
    """
    if not model.plant.spec.text:
        raise InputError(
            f"{source}: the model's plant, {model.plant.spec.name!r}, is written in Python; give "
            "its class the other signals, and fit anew."
        )
    spec = parse_plant(read_plant_text(source), str(source))
    difference = _difference(model.plant.spec, spec, str(source))
    if difference:
        raise InputError(
            f"{source}: {difference}; only [faults], [detection], [observer] and the keys `exact` "
            "and `trusted` may differ from the plant file that the model was fitted with, so "
            f"restore it, or fit anew with `faultgauge fit {source} LOG... --out MODEL`."
        )
    members = tuple(_set(member, spec) for member in model.members)
    return replace(model, plant=_set(model.plant, spec), members=members)


def _set(plant: GrayBoxPlant, spec: PlantSpec) -> GrayBoxPlant:
    own, given = plant.signals, spec.signals
    signals = replace(
        own,
        states=tuple(
            replace(s, exact=new.exact, trusted=new.trusted)
            for s, new in zip(own.states, given.states, strict=True)
        ),
        inputs=tuple(
            replace(i, trusted=new.trusted) for i, new in zip(own.inputs, given.inputs, strict=True)
        ),
        outputs=tuple(
            replace(o, trusted=new.trusted)
            for o, new in zip(own.outputs, given.outputs, strict=True)
        ),
        faults=given.faults,
        observation=given.observation,
        max_simultaneous=given.max_simultaneous,
        detection=given.detection,
    )
    changed = replace(plant.spec, text=spec.text, signals=signals, warnings=spec.warnings)
    return replace(plant, signals=signals, spec=changed)


def _difference(own: PlantSpec, given: PlantSpec, source: str) -> str:
    """The first key of `given` that is not as in `own`, in words; empty where there is none."""
    ours, theirs = _tables(own, "the model"), _tables(given, source)
    if ours["name"] != theirs["name"]:
        return f"name = {theirs['name']!r} is not the model's {ours['name']!r}"
    for kind in KINDS:
        mine, other = list(ours[kind]), list(theirs[kind])
        for name in other:
            if name not in mine:
                return f"[{kind}.{name}] is not in the model"
        for name in mine:
            if name not in other:
                return f"[{kind}.{name}] of the model is missing"
        if mine != other:
            return f"[{kind}] {', '.join(other)} stand in the model as {', '.join(mine)}"
    trees, new = _trees(own), _trees(given)
    for kind in KINDS:
        for name, table in theirs[kind].items():
            for key, value in table.items():
                if key in FREE_KEYS:
                    continue
                was, place = ours[kind][name][key], (kind, name, key)
                if (value != was) if place not in new else (new[place] != trees[place]):
                    return f"[{kind}.{name}] {key} = {_said(value)} is {_said(was)} in the model"
    return ""


def _tables(spec: PlantSpec, source: str) -> dict[str, Any]:
    """The keys as the file has them, with the defaults of those left out."""
    return typed(FileTable, parse_toml(spec.text, source), source).model_dump(exclude=FREE)


def _trees(spec: PlantSpec) -> Mapping[tuple[str, str, str], Any]:
    """What the expressions mean, so that a space more makes no difference."""
    signals = spec.signals
    states = zip(signals.state_names, spec.derivatives, strict=True)
    outputs = zip(signals.output_names, spec.values, strict=True)
    found = {("states", name, "derivative"): each.tree for name, each in states}
    return found | {("outputs", name, "value"): each.tree for name, each in outputs}


def _said(value: Any) -> str:
    return "left out" if value is None else repr(value)
