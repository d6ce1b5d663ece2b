"""What calibration found, in words."""

from collections.abc import Mapping

import numpy as np

from faultgauge.detection.bank.noise import USUAL_SHARE, Noise, noise_of
from faultgauge.detection.bank.uncertain_constants import (
    USUAL_SPREAD,
    constants_of,
    drifting_of,
    parameters_of,
)
from faultgauge.detection.posterior.uncalibrated import level_in
from faultgauge.detection.words import duration, listed, number, would_not_show
from faultgauge.plants.disturbed import dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.plants.record import Interval
from faultgauge.plants.signals import State, spoken

__all__ = ["doubted", "errors", "summary", "telling"]

FAR = 3.0  # times by how much healthy runs differ


def summary(model: Model) -> list[str]:
    """A line for each thing that a user should know of a calibrated `model`."""
    known = model.calibration
    if known is not None and known.channels is not None:
        return _intervals(known.channels, _units(model))
    return [*errors(model), *_answers(model), *_priors(model), _level(model)]


def telling(model: Model, smallest: Mapping[str, float | None]) -> list[str]:
    """What of each fault would not have shown in the longest healthy log, `smallest` being what
    would."""
    units = _units(model)
    known = {
        name: (size, units.get(name, ""))
        for name, size in smallest.items()
        if model.plant.signals.faults[model.plant.signals.fault_names.index(name)].monitor
        != "disabled"
    }
    if not known:
        return []
    told = f"had a fault begun in the middle of the longest log, {would_not_show(known)}"
    slow, blind = drifting_of(model), [name for name, (size, _) in known.items() if size is None]
    if slow and blind:
        told += (
            f'. {listed(slow)} may drift (vary = "slow") and take up what {listed(blind, "or")} '
            'would do; of what does not drift within a log, say vary = "run"'
        )
    return [told]


def _intervals(channels: Mapping[str, Interval], units: Mapping[str, str]) -> list[str]:
    return [
        f"{name}: 95 % of the healthy estimates lie within +-"
        f"{number(each.interval)} {units.get(name, '')}".rstrip()
        for name, each in channels.items()
    ]


def errors(model: Model) -> list[str]:
    """How far the plant is from its model, and for how long."""
    signals, noise = model.plant.signals, noise_of(model)
    lines, seen = [], level_in(model).healthy_s
    for k, state in enumerate(dynamic_states(model.plant)):
        size, lasts = float(noise.size[k]), float(noise.lasting[k])
        lines.append(_discrepancy(signals.states[state], size, lasts, seen))
    for j in noise.wanders:
        each = signals.outputs[j]
        by, long = _at_a_time(each.unit, noise.wander[j], noise.wandering[j], seen)
        lines.append(f"{each.name} wanders by {by} beside what the model says, {long}")
    for j in noise.zeros:
        each = signals.outputs[j]
        by = f"{number(float(noise.zero[j]), 2)} {spoken(each.unit)}".rstrip()
        lines.append(f"the zero of {each.name} is off by about {by}, another way in each run")
    lines += [
        f"samples of {signals.outputs[j].name} come too early or too late, by about "
        f"{duration(float(noise.jitter[j]))}, and are off by what it moves meanwhile"
        for j in noise.jitters
    ]
    for j in noise.strays:
        each = signals.inputs[j]
        by, long = _at_a_time(each.unit, noise.stray[j], noise.straying[j], seen)
        lines.append(f"{each.name} strays by {by} from what the log says, {long}")
    lines += _beside_a_change(model, noise)
    lines += _sticking(model, noise)
    lines += _leaning(model, noise)
    for j in noise.lags:
        lines.append(
            f"what an input's change does to {signals.outputs[j].name} is off by about "
            f"{100 * noise.late[j]:.0f} % of it, for about {duration(float(noise.lag[j]))}"
        )
    lines += [
        f"where {where}, the model errs about {number(times, 2)} times as much as elsewhere"
        for where, times in doubted(model, noise)
    ]
    spread = [
        _differs(model, name, s)
        for name, s in zip(constants_of(model).names, noise.spread.tolist(), strict=True)
    ]
    if spread:
        lines.append(f"what was fitted differs from run to run by about {', '.join(spread)}")
    lines += [
        f"{constants_of(model).names[k]} varies within a run, too, over about "
        f"{duration(float(noise.varying[k]))}"
        for k in noise.varies
    ]
    lines += _elsewhere(model, noise)
    slow = drifting_of(model)
    if slow:
        lines.append(f"tracked as it drifts: {', '.join(slow)}")
    return lines


def _differs(model: Model, name: str, spread: float) -> str:
    """By how much a constant, or a network as a whole, is another one in each run: with the share
    of its value, where that is less than all of it."""
    if name in (each.name for each in model.plant.gains):
        return f"all of {name} {number(100 * spread, 2)} %"
    value = abs(float(model.plant.values()[name]))
    unit = spoken(parameters_of(model)[name].unit)
    share = f" ({number(100 * spread / value, 2)} %)" if spread < value else ""
    return f"{name} {number(spread, 2)} {unit}".rstrip() + share


def _discrepancy(state: State, size: float, lasts: float, seen: float) -> str:
    """Of a state's derivative, by logs of `seen` [s] in all."""
    by, long = _at_a_time(_per_second(state), size, lasts, seen)
    return f"the model is off by about {by} in d({state.name}), {long}"


def _at_a_time(unit: str, size: float, lasts: float, seen: float) -> tuple[str, str]:
    """(By how much, for how long) something is off that has that `size` and `lasts`; logs of `seen`
    [s] in all show of what lasts for longer only how far it moves in them."""
    if lasts <= seen:
        return (
            f"{number(size, 2)} {spoken(unit)}".rstrip(),
            f"for about {duration(lasts)} at a time",
        )
    moves = f"{number(size * np.sqrt(2 * seen / lasts), 2)} {spoken(unit)}".rstrip()
    return f"{moves} in {duration(seen)}", "and for longer than these logs last"


def _beside_a_change(model: Model, noise: Noise) -> list[str]:
    """What of an input's change is left to chance, where that is more than usual."""
    inputs = model.plant.signals.inputs
    return [
        f"what a change of {inputs[place].name} does is off by about {100 * noise.share[k]:.0f} % "
        f"of it, for about {duration(float(noise.settling[k]))}"
        for k, place in enumerate(following_inputs(model.plant))
        if noise.share[k] > USUAL_SHARE
    ]


def _sticking(model: Model, noise: Noise) -> list[str]:
    """States that something holds at rest."""
    lines = []
    for k in noise.grips:
        state = model.plant.signals.states[k]
        held = f"{number(noise.grip[k], 2)} {_per_second(state)}"
        speed = f"{number(noise.slip[k], 2)} {spoken(state.unit)}".rstrip()
        lines.append(
            f"{state.name} sticks: near rest something that the file lacks holds it by about "
            f"{held}, for about {duration(float(noise.gripping[k]))} at a time, and lets go from "
            f"{speed} on. What is smaller shows only while it moves"
        )
    return lines


def _leaning(model: Model, noise: Noise) -> list[str]:
    """Inputs and outputs that come later than the model has it, and curves that it has straight."""
    signals = model.plant.signals
    mends = "The bank goes by it; in the plant file it would mend the fit, too"
    lines = [
        f"{number(-100 * noise.lean[j], 2)} % of a change of {signals.inputs[j].name} comes late, "
        f"within about {duration(float(noise.leaning[j]))}: the plant, or a sensor, has a lag that "
        f"the file lacks. {mends}"
        for j in noise.leans
    ]
    lines += [
        f"{signals.outputs[j].name} follows what it measures within about "
        f"{duration(float(noise.trail[j]))}: its sensor, or the plant, has a lag that the file "
        f"lacks. {mends}"
        for j in noise.trails
    ]
    for j in noise.bends:
        side = "above" if noise.bend[j] > 0 else "below"
        lines.append(
            f"{signals.inputs[j].name} acts along a curve that the file lacks: in the middle of "
            f"its range {number(100 * abs(noise.bend[j]), 2)} % of that {side} a straight line. "
            f"{mends}"
        )
    return lines


def _answers(model: Model) -> list[str]:
    """By how much the answer to what acts on the plant is off."""
    level = level_in(model)
    if not level.gain:
        return []
    size, shape = (number(100 * each, 2) for each in (level.gain, level.shape))
    return [
        f"the model answers what acts on the plant {size} % too much or too little, and the size "
        f"of a fault may be off by as much; with its course over time the answer is off by "
        f"{shape} %, and of two faults the smaller one is not told where that error explains it"
    ]


def _elsewhere(model: Model, noise: Noise) -> list[str]:
    """Constants that healthy logs have elsewhere than the fit, beyond how they differ."""
    names, here = constants_of(model).names, model.plant.values()
    units = {name: spoken(p.unit) for name, p in parameters_of(model).items()}
    gains, found = [each.name for each in model.plant.gains], []
    for name, shift, spread in zip(names, noise.shift, noise.spread, strict=True):
        value = float(here[name])
        if abs(shift) > max(FAR * spread, USUAL_SPREAD * abs(value)):
            there = f"{name} = {number(value + shift)} {units[name]}".rstrip()
            there += " times what was fitted" if name in gains else f" (fit: {number(value)})"
            found.append(there)
    return [f"the healthy logs say {', '.join(found)}, and the bank goes by them"] if found else []


def doubted(model: Model, noise: Noise) -> list[tuple[str, float]]:
    """Where the model errs more than elsewhere, and how many times as much: ("u is below 0.8 V",
    4.0)."""
    signals, found = model.plant.signals, []
    places = (*signals.inputs, *signals.states)
    for k in noise.doubts:
        low, high = float(noise.above[k]), float(noise.below[k])
        if np.isfinite(low) and np.isfinite(high):
            within = f"between {number(low)} and {number(high)}"
        else:
            within = f"below {number(high)}" if np.isfinite(high) else f"above {number(low)}"
        where = f"{places[k].name} is {within} {spoken(places[k].unit)}".rstrip()
        found.append((where, float(noise.doubt[k])))
    return found


def _priors(model: Model) -> list[str]:
    found, units = level_in(model).size, _units(model)
    # the widest prior is half of what a fault is at most
    sizes = [f"{name} {number(2 * size, 2)} {units[name]}".rstrip() for name, size in found.items()]
    return [f"faults are looked for up to about: {', '.join(sizes)}"]


def _level(model: Model) -> str:
    bank = level_in(model)
    alarms = bank.alarms
    told = f"{alarms} alarm{'' if alarms == 1 else 's'}" if alarms else "no alarm"
    return (
        f"an alarm begins where a fault is {number(np.exp(min(bank.level, 100.0)))} times as "
        f"likely as none; {told} in {bank.blocks} healthy blocks ({duration(bank.judged_s)} in "
        f"all) proves no more than that false alarms come at most once in "
        f"{duration(bank.mtbfa_s)}, with 95 % confidence"
    )


def _units(model: Model) -> dict[str, str]:
    faults = model.plant.signals.faults
    return {fault.name: spoken(fault.unit) for fault in faults}


def _per_second(state: State) -> str:
    """The unit of its derivative, behind a number."""
    unit = spoken(state.unit)
    return f"{unit}/s" if unit else "per second"
