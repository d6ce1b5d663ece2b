"""From a plant's signals and a few wishes to what a closed loop is fed with."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.excitation.band import MOST_SAMPLES
from faultgauge.excitation.multisine import multisine
from faultgauge.excitation.noise import band_limited_noise
from faultgauge.excitation.sweep import triangles
from faultgauge.plants.expression import unknown
from faultgauge.plants.signals import Input, Signals, State

__all__ = ["Excitation", "Experiment", "Sweep", "design"]

SHARE = 0.5  # of half an input's range, as standard deviation: Gaussian noise is clipped for 5 %
ROOM = 2.0  # standard deviations between an offset and a limit that stands alone
REACH = 0.9  # of a state's range


@dataclass(frozen=True)
class Sweep:
    """Triangles for the state that `output` measures, by feedback: u = u_f + gain (r - y).

    `gain` is in the input's unit per unit of the output. `amplitude` and `centre` are in the
    output's unit; by default the middle of the state's limits (or its initial value) and 90 % of
    the way from there to the nearer limit. `input` may be left out where there is only one.
    The state lags 1/gain behind on an integrator, and the reference moves
    4 cycles amplitude/seconds per second: faster than the actuator can is not reached.
    """

    output: str
    gain: float
    amplitude: float | None = None
    centre: float | None = None
    cycles: int = 2
    input: str | None = None


@dataclass(frozen=True)
class Experiment:
    """What to do to a plant for `seconds`, sampled every `dt` [s].

    Every input gets its own signal from `low` to `high` [Hz], with a standard deviation of half
    its half-range (or `sigma`, by its name) around the middle of its limits (or `offset`). An
    input with one limit or none needs a `sigma`; its offset is then 0, or 2 sigma inside the
    limit if 0 is not.
    """

    kind: Literal["noise", "noise_with_sweep", "multisine", "multisine_with_sweep"]
    seconds: float
    dt: float
    low: float = 0.005
    high: float = 0.4
    sigma: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)
    sweep: Sweep | None = None


class Excitation(NamedTuple):
    """An experiment at its samples, for u = clip(feedforward + kp (reference - y))."""

    t: Float[np.ndarray, "samples"]
    feedforward: Float[np.ndarray, "samples inputs"]
    reference: Float[np.ndarray, "samples outputs"]
    kp: Float[np.ndarray, "inputs outputs"]


def design(experiment: Experiment, signals: Signals, seed: int) -> Excitation:
    """Draw the signals of `experiment` for a plant with these `signals`.

    The same seed gives the same bits. Raises `InputError` where the experiment does not fit the
    plant, and says which input, output or key of the experiment to change.
    """
    _check(experiment, signals)
    samples = round(experiment.seconds / experiment.dt)
    draw = multisine if experiment.kind.startswith("multisine") else band_limited_noise
    children = np.random.SeedSequence(seed).spawn(len(signals.inputs))
    feedforward = np.empty((samples, len(signals.inputs)))
    for k, (each, child) in enumerate(zip(signals.inputs, children, strict=True)):
        sigma, rng = _sigma(experiment, each), np.random.default_rng(child)
        x = draw(rng, samples, experiment.dt, experiment.low, experiment.high, sigma)
        feedforward[:, k] = np.clip(_offset(experiment, each, sigma) + x, each.min, each.max)
    reference = np.zeros((samples, len(signals.outputs)))
    kp = np.zeros((len(signals.inputs), len(signals.outputs)))
    if experiment.sweep is not None:
        sweep = experiment.sweep
        centre, amplitude = _range(sweep, _swept(sweep, signals))
        output = signals.output_names.index(sweep.output)
        reference[:, output] = centre + triangles(samples, amplitude, sweep.cycles)
        kp[_driver(sweep, signals), output] = sweep.gain
    return Excitation(np.arange(samples) * experiment.dt, feedforward, reference, kp)


def _check(experiment: Experiment, signals: Signals) -> None:
    """What does not depend on one input or output."""
    if not signals.inputs:
        raise InputError("The plant has no input, so there is nothing to excite; give it one.")
    possible = experiment.seconds > 0 and experiment.dt > 0  # False for NaN, too
    if not (possible and 1 <= round(min(experiment.seconds / experiment.dt, 1e9)) <= MOST_SAMPLES):
        raise InputError(
            f"An experiment of seconds = {experiment.seconds:g} with dt = {experiment.dt:g} s is "
            f"not possible; both are positive, and seconds/dt is at most {MOST_SAMPLES}."
        )
    for key in ("sigma", "offset"):
        for name in getattr(experiment, key):
            if name not in signals.input_names:
                reason = unknown("input", name, signals.input_names)
                raise InputError(f"The experiment's {key} names an {reason}.")
    if experiment.kind.endswith("_with_sweep") != (experiment.sweep is not None):
        other = "needs a" if experiment.sweep is None else "does not take a"
        raise InputError(
            f"An experiment of kind {experiment.kind!r} {other} sweep; change the kind or the "
            "sweep (which output is driven, and by which gain)."
        )


def _sigma(experiment: Experiment, each: Input) -> float:
    if each.name in experiment.sigma:
        sigma = experiment.sigma[each.name]
        if not 0 < sigma < math.inf:
            raise InputError(
                f"Input {each.name!r} has sigma = {sigma:g}; write a positive standard deviation"
                f"{_in(each.unit)}."
            )
        return sigma
    half = (each.max - each.min) / 2
    if not math.isfinite(half):
        raise InputError(
            f"Input {each.name!r} has the limits [{each.min:g}, {each.max:g}], which do not say how"
            f" large a signal may be; write min and max in [inputs.{each.name}] of the plant file, "
            f"or sigma = {{{each.name} = ...}} in the experiment{_in(each.unit)}."
        )
    return SHARE * half


def _offset(experiment: Experiment, each: Input, sigma: float) -> float:
    if each.name in experiment.offset:
        offset = experiment.offset[each.name]
        if not (each.min <= offset <= each.max and math.isfinite(offset)):
            raise InputError(
                f"Input {each.name!r} has offset = {offset:g}, outside its limits [{each.min:g}, "
                f"{each.max:g}]; write one inside them."
            )
        return offset
    if math.isfinite(each.max - each.min):
        return (each.min + each.max) / 2
    return min(max(0.0, each.min + ROOM * sigma), each.max - ROOM * sigma)


def _swept(sweep: Sweep, signals: Signals) -> State:
    """The state that the sweep's output measures."""
    if sweep.output not in signals.output_names:
        reason = unknown("output", sweep.output, signals.output_names)
        raise InputError(f"The sweep names an {reason}.")
    measures = {output.name: output.measures for output in signals.outputs}
    state = measures[sweep.output]
    if state is None:
        legal = ", ".join(name for name, found in measures.items() if found is not None)
        raise InputError(
            f"The sweep cannot drive output {sweep.output!r}, whose value is not simply a state; "
            f"outputs that are: {legal or 'none'}."
        )
    return signals.states[signals.state_names.index(state)]


def _range(sweep: Sweep, state: State) -> tuple[float, float]:
    """Centre and amplitude, inside the limits of the state."""
    limits = f"the limits [{state.min:g}, {state.max:g}] of state {state.name!r}"
    centre, amplitude = sweep.centre, sweep.amplitude
    if centre is None:
        both = math.isfinite(state.max - state.min)
        centre = (state.min + state.max) / 2 if both else state.initial
    room = min(state.max - centre, centre - state.min)
    if amplitude is None:
        if not 0 < room < math.inf:
            raise InputError(
                f"The sweep of output {sweep.output!r} around {centre:g} has no amplitude, and "
                f"{limits} give none; write amplitude and, if need be, centre{_in(state.unit)}."
            )
        amplitude = REACH * room
    if not (0 < amplitude < math.inf and amplitude <= room):
        raise InputError(
            f"The sweep of output {sweep.output!r} goes to {centre:g} +- {amplitude:g}, but must "
            f"move and stay inside {limits}; change its amplitude or centre."
        )
    return centre, amplitude


def _driver(sweep: Sweep, signals: Signals) -> int:
    """Which input the feedback acts on."""
    names = signals.input_names
    if not (math.isfinite(sweep.gain) and sweep.gain != 0):
        raise InputError(
            f"The sweep of output {sweep.output!r} has gain = {sweep.gain:g}; write a finite one "
            "other than 0, in the input's unit per unit of the output."
        )
    if sweep.input is None and len(names) > 1:
        raise InputError(
            f"The sweep of output {sweep.output!r} does not say which input drives it; write "
            f"input = one of {', '.join(names)}."
        )
    name = signals.inputs[0].name if sweep.input is None else sweep.input
    if name not in names:
        raise InputError(f"The sweep names an {unknown('input', name, names)}.")
    hold = signals.inputs[names.index(name)].hold
    if hold != "zero":
        raise InputError(
            f"The sweep of output {sweep.output!r} cannot act on input {name!r}, which runs to its "
            f'next value in advance (hold = "{hold}"); name an input that is held, or hold it.'
        )
    return names.index(name)


def _in(unit: str) -> str:
    return f", in {unit}" if unit else ""
