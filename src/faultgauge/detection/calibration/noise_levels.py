"""The levels of noise that are searched: their first guesses, and how far they may lie from them.

What one log cannot tell is held by weak priors: constants differ by a percent or so from run to
run, and a discrepancy is some percent of what its state does, and lasts a tenth of a log or so.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import comb

from faultgauge.detection.bank.extended import rates_of, width_of
from faultgauge.detection.bank.noise import GRIP, USUAL_SHARE, Noise
from faultgauge.detection.bank.uncertain_constants import constants_of, drifting_of, usual_spread
from faultgauge.detection.calibration.innovation_likelihood import StretchPiece
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.statistics import MAD_TO_STD

__all__ = [
    "LAG",
    "LEAST_LAG",
    "Bounds",
    "Spans",
    "as_fitted",
    "bounds_of",
    "first_guess",
    "levels_of",
    "logs_of",
    "names_of",
    "spans_of",
]

# the constants' mean and spread are told in another way
SEARCHED = (
    *("sigma", "process", "drift", "size", "lasting", "share", "settling"),
    *("wander", "wandering", "late", "lag", "stray", "straying", "doubt", "trail"),
    *("leaning", "lean", "zero", "bend", "grip", "gripping", "slip", "travel", "varying", "jitter"),
)
SIGNED = ("lean", "bend")  # of these: numbers of either sign, and no logarithms
ORDERS = 8  # of differences: beyond, next to nothing fades that has not
REACH = np.log(1e4)  # a level is looked for within this factor of its first guess
USUAL_SIZE = 0.03  # of a state's rate: the discrepancy
QUICK = 10.0  # samples in which that settles
LONGEST = 100.0  # times the longest stretch: as good as a walk without end
SETTLED = 0.25  # of it: within that, what an input's change does has settled
SLOWER = 0.1  # of it: what lasts longer, parameters that drift follow
EQUAL = 1e-9  # of the largest: values that are nearer are one, but for rounding
LEAST_LAG = 0.25  # times the shortest time: a sensor's lag, which shows beside other outputs
LAG = -1.0  # of an input's change: all of it comes late
TRACE = 1e-9  # of it: next to nothing
WIDER = 4.0  # times the first guess of what a grip lets go in: beyond, it is none
BENT = 0.24  # of an input's range: beyond a quarter its curve would fall at an end
UNSURE = 1.5  # standard deviation of the logarithms of these


class Bounds(NamedTuple):
    """Of the logarithms of all levels: the lowest and highest, where they are likely, and how far
    from there (infinite: all are alike)."""

    low: Float[np.ndarray, "levels"]
    high: Float[np.ndarray, "levels"]
    center: Float[np.ndarray, "levels"]
    pull: Float[np.ndarray, "levels"]

    def unlikely(self, logs: Float[np.ndarray, "*many levels"]) -> Float[np.ndarray, "*many"]:
        """-ln of their prior."""
        told = np.isfinite(self.pull)
        off = (logs[..., told] - self.center[told]) / self.pull[told]
        return 0.5 * np.sum(off**2, axis=-1)


def logs_of(noise: Noise) -> Float[np.ndarray, "levels"]:
    """The logarithms of all levels but the constants'; of what is not there minus infinity, and
    what may have either sign as it is."""
    levels = [(name, getattr(noise, name)) for name in SEARCHED]
    with np.errstate(divide="ignore"):
        logs = [np.where(a, a, -np.inf) if name in SIGNED else np.log(a) for name, a in levels]
    return np.concatenate(logs)


def names_of(noise: Noise) -> list[str]:
    """Which field each of `logs_of` belongs to."""
    return [name for name in SEARCHED for _ in getattr(noise, name)]


def levels_of(logs: Float[np.ndarray, "levels"], noise: Noise) -> Noise:
    """The levels whose logarithms these are, and the constants of `noise`."""
    sizes = np.cumsum([len(getattr(noise, name)) for name in SEARCHED])[:-1]
    parts = zip(SEARCHED, np.split(logs, sizes), strict=True)
    return noise._replace(
        **{n: np.where(np.isfinite(a), a, 0.0) if n in SIGNED else np.exp(a) for n, a in parts}
    )


def first_guess(model: Model, runs: Sequence[Run], stretches: Sequence[StretchPiece]) -> Noise:
    """First guesses: sigma by what is white in an output's own samples, a state as unsure as a
    tenth of its own output's noise in one sample, or a thousandth of its range where it is
    hidden."""
    signals, step = model.plant.signals, runs[0].step
    sigma = np.ones(len(signals.outputs))
    for j, output in enumerate(signals.outputs):
        own = [s.y[np.isfinite(s.y[:, j]), j] for s in stretches]
        sigma[j] = output.sigma or max(_white(own), _rounding(own)) or sigma[j]
    process = 1e-3 * np.ptp(operating_points(model).x, axis=0) + 1e-12
    for j, output in enumerate(signals.outputs):
        if output.measures is not None:
            process[signals.state_names.index(output.measures)] = 0.1 * sigma[j]
    process = process / np.sqrt(step)
    values = {p.name: p for p in model.plant.spec.parameters}
    length = float(np.mean([np.sum(s.dt) for s in stretches]))
    drift = [
        (0.1 * abs(values[n].value) or width_of(values[n].min, values[n].max) / 10) / length**0.5
        for n in drifting_of(model)
    ]
    driven = list(dynamic_states(model.plant))
    size = USUAL_SIZE * rates_of(model)[driven]
    unknown = np.zeros(len(constants_of(model).names))
    lasting = np.full(len(driven), max(length / 10, 20 * step))
    following = len(following_inputs(model.plant))
    share = np.full(following, USUAL_SHARE)
    settling = np.full(following, QUICK * step)
    nothing = np.zeros(len(signals.inputs))
    places = np.zeros(len(signals.inputs) + len(signals.states))
    found = Noise(
        sigma, process, np.array(drift, float), size, lasting, share, settling,
        *[unknown] * 3,
        *[np.zeros(len(sigma))] * 4,
        stray=nothing, straying=nothing,
        doubt=places, above=places - np.inf, below=places + np.inf, lean=nothing,
        leaning=nothing, trail=np.zeros(len(sigma)), zero=np.zeros(len(sigma)), bend=nothing,
        varying=unknown, jitter=np.zeros(len(sigma)), **dict.fromkeys(GRIP, np.zeros(len(process))),
    )  # fmt: skip
    return as_fitted(model, found)


def as_fitted(model: Model, noise: Noise) -> Noise:
    """`noise` with the constants of the fit, as unsure as that has them and by the usual spread."""
    known = constants_of(model)
    usual = [usual_spread(float(model.plant.values()[n]), 0.0) for n in known.names]
    own = noise._replace(shift=np.zeros(len(usual)))
    return own.with_between(known.covariance + np.diag(usual) ** 2)


def _rounding(parts: Sequence[Float[np.ndarray, "_"]]) -> float:
    """Standard deviation of what a sensor's steps leave out, step / sqrt(12) (W. R. Bennett, Bell
    Syst. Tech. J. 27 (1948)), of a signal of which these are parts: no sample tells more. 0 where
    it never moves."""
    values = np.unique(np.concatenate(parts)) if len(parts) else np.zeros(0)
    steps = np.diff(values)
    steps = steps[steps > EQUAL * np.abs(values).max(initial=0.0)]
    return float(steps.min() / np.sqrt(12)) if len(steps) else 0.0


def _white(parts: Sequence[Float[np.ndarray, "_"]]) -> float:
    """Standard deviation of what is white in a signal, of which these are parts; 0 where they are
    too short. White noise alone outlasts differences of all orders d,

        sigma_d^2 = var(diff^d y) / binom(2d, d)

    (P. Hall, J. W. Kay and D. M. Titterington, Biometrika 77 (1990)); motion fades the more, the
    higher the order, so the least is taken, by medians, which a few jumps do not move."""
    found = []
    for order in range(2, ORDERS + 1):
        differences = np.concatenate([np.diff(y, order) for y in parts])
        if len(differences):
            typical = MAD_TO_STD * np.median(np.abs(differences))
            found.append(max(typical, 1e-2 * np.std(differences)) / np.sqrt(comb(2 * order, order)))
    return max(min(found), 1e-12) if found else 0.0


class Spans(NamedTuple):
    """Times [s]: the shortest that an error can last and be told from another, the longest in which
    what an input's change does has settled, as good as a walk without end."""

    shortest: float
    settled: float
    longest: float


def spans_of(step: float, stretches: Sequence[StretchPiece]) -> Spans:
    """Of `stretches` with `step` [s]."""
    length = float(max(np.sum(s.dt) for s in stretches))
    return Spans(2 * step, SETTLED * length, LONGEST * length)


def bounds_of(guess: Noise, step: float, stretches: Sequence[StretchPiece]) -> Bounds:
    """Within what the levels are looked for around `guess`, in logs that have `step` [s]."""
    spans = spans_of(step, stretches)
    sizes = {name: len(getattr(guess, name)) for name in SEARCHED}
    center = logs_of(guess)
    named = dict(zip(SEARCHED, np.split(center, np.cumsum([*sizes.values()])[:-1]), strict=True))
    low, high = ({name: a + r for name, a in named.items()} for r in (-REACH, REACH))
    most = dict.fromkeys(("lasting", "wandering", "straying", "varying"), spans.longest)
    most |= dict.fromkeys(("settling", "lag", "leaning", "trail", "gripping"), spans.settled)
    if len(guess.drift):
        most["lasting"] = max(SLOWER * spans.longest / LONGEST, 20 * step)
    for name, time in most.items():
        low[name] = np.full(sizes[name], np.log(spans.shortest))
        high[name] = np.full(sizes[name], np.log(time))
    for name in ("share", "late"):
        high[name][:] = 0.0
    # no noise is less than what the steps of a sensor leave out, unless the file says so
    for j, sigma in enumerate(guess.sigma):
        least = min(_rounding([s.y[np.isfinite(s.y[:, j]), j] for s in stretches]), float(sigma))
        if least > 0:
            low["sigma"][j] = max(low["sigma"][j], np.log(least))
    low["trail"] += np.log(LEAST_LAG)
    low["doubt"][:] = 0.0
    high["jitter"][:] = np.log(step)  # beyond, a sample would be another row's
    high["slip"] = named["slip"] + np.log(WIDER)
    low["lean"], high["lean"] = np.full(sizes["lean"], LAG), np.full(sizes["lean"], -TRACE)
    low["bend"], high["bend"] = np.full(sizes["bend"], -BENT), np.full(sizes["bend"], BENT)
    pull = {name: np.full(count, np.inf) for name, count in sizes.items()}
    for name in ("sigma", "size", "share", "lasting"):
        pull[name][:] = UNSURE
    low, high, pull = (np.concatenate([each[n] for n in SEARCHED]) for each in (low, high, pull))
    return Bounds(low, high, center, pull)
