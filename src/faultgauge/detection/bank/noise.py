"""How far the plant is from its model: the levels that calibration finds."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.uncertain_constants import constants_of, drifting_of
from faultgauge.errors import InputError
from faultgauge.plants.disturbed import dynamic_states, following_inputs
from faultgauge.plants.model import Model

__all__ = [
    "BEND",
    "DOUBT",
    "GRIP",
    "JITTER",
    "LATE",
    "LEAN",
    "OPTIONAL",
    "STRAY",
    "TRAIL",
    "USUAL_SHARE",
    "VARY",
    "WANDER",
    "ZERO",
    "Noise",
    "noise_of",
]

WANDER = ("wander", "wandering")  # absent where no output does
LATE = ("late", "lag")
STRAY = ("stray", "straying")  # absent where no input does
DOUBT = ("doubt", "above", "below")  # absent where the model is as good everywhere
LEAN = ("lean", "leaning")  # absent where no input comes late
TRAIL = ("trail",)  # absent where no output does
BEND = ("bend",)  # absent where no input's curve is bent
ZERO = ("zero",)  # absent where no output's is off
GRIP = ("grip", "gripping", "slip", "travel")  # absent where no state sticks
JITTER = ("jitter",)  # absent where no output is sampled at another time
VARY = ("varying",)  # absent where no constant does within a run
USUAL_SHARE = 0.1  # of an input's effect: what a change of it is off by
NARROWEST = 1e-15  # of a constant between runs: rounding
OPTIONAL = (*WANDER, *LATE, *STRAY, *DOUBT, *LEAN, *TRAIL, *ZERO, *BEND, *GRIP, *VARY, *JITTER)
NOWHERE = {"doubt": 0.0, "above": -np.inf, "below": np.inf, "travel": np.inf}  # what is absent


class Noise(NamedTuple):
    """Standard deviations: `sigma` of a sample, `process` and `drift` per sqrt(s), `size` of the
    discrepancy beside the dynamic states [its state's unit per s], which lasts for `lasting` [s];
    an input that changes is off by a random `share` of that, which settles in `settling` [s];
    `spread` of the constants between runs, and how they go `together` there, a correlation (none:
    each its own way), by how much `shift` their mean is off the fitted
    value, which an error of the model may have biased, and what share of their variance a gap
    within a run makes anew (`renewed`); `wander` of an output, which lasts for `wandering` [s], and
    the share of what an input's change does to it that comes `late`, within `lag` [s]; by what an
    input strays (`stray`), which lasts for `straying` [s]; by which share of its change an input is
    off at first, in the mean (`lean`, -1 for a lag), and within which time (`leaning` [s]); within
    which time an output follows what it measures, a lag of its sensor (`trail` [s]); by what its
    `zero` is off, another way in each run; by how much of
    its range the curve of an input is off a straight line in the middle (`bend`); what holds a
    state at rest (`grip`, its unit per s), for how long (`gripping` [s]), until it moves by `slip`,
    where half of that is left, and on which `travel` (its unit times s) it becomes another;
    how long a constant keeps its value in a run (`varying` [s]); by
    what the time of an output's sample errs (`jitter` [s]); how
    many times as large all this is (`doubt`) where an input, or a state, lies between `above` and
    `below`; 0, or nothing at all, where nothing of that kind is."""

    sigma: Float[np.ndarray, "outputs"]
    process: Float[np.ndarray, "states"]
    drift: Float[np.ndarray, "drifting"]
    size: Float[np.ndarray, "driven"]
    lasting: Float[np.ndarray, "driven"]
    share: Float[np.ndarray, "following"]
    settling: Float[np.ndarray, "following"]
    spread: Float[np.ndarray, "constants"]
    shift: Float[np.ndarray, "constants"]
    renewed: Float[np.ndarray, "constants"] = np.zeros(0)
    wander: Float[np.ndarray, "outputs"] = np.zeros(0)
    wandering: Float[np.ndarray, "outputs"] = np.zeros(0)
    late: Float[np.ndarray, "outputs"] = np.zeros(0)
    lag: Float[np.ndarray, "outputs"] = np.zeros(0)
    stray: Float[np.ndarray, "inputs"] = np.zeros(0)
    straying: Float[np.ndarray, "inputs"] = np.zeros(0)
    doubt: Float[np.ndarray, "places"] = np.zeros(0)
    above: Float[np.ndarray, "places"] = np.zeros(0)
    below: Float[np.ndarray, "places"] = np.zeros(0)
    lean: Float[np.ndarray, "inputs"] = np.zeros(0)
    leaning: Float[np.ndarray, "inputs"] = np.zeros(0)
    trail: Float[np.ndarray, "outputs"] = np.zeros(0)
    zero: Float[np.ndarray, "outputs"] = np.zeros(0)
    bend: Float[np.ndarray, "inputs"] = np.zeros(0)
    grip: Float[np.ndarray, "states"] = np.zeros(0)
    gripping: Float[np.ndarray, "states"] = np.zeros(0)
    slip: Float[np.ndarray, "states"] = np.zeros(0)
    travel: Float[np.ndarray, "states"] = np.zeros(0)
    varying: Float[np.ndarray, "constants"] = np.zeros(0)
    jitter: Float[np.ndarray, "outputs"] = np.zeros(0)
    together: Float[np.ndarray, "constants constants"] = np.zeros((0, 0))

    @property
    def between(self) -> Float[np.ndarray, "constants constants"]:
        """The covariance of the constants between runs."""
        together = self.together if self.together.size else np.eye(len(self.spread))
        return together * np.outer(self.spread, self.spread)

    def with_between(self, covariance: Float[np.ndarray, "constants constants"]) -> "Noise":
        """With this `covariance` of the constants between runs."""
        spread = np.sqrt(np.diag(covariance) + NARROWEST**2)
        together = covariance / np.outer(spread, spread)
        np.fill_diagonal(together, 1.0)
        return self._replace(spread=spread, together=together)

    @property
    def wanders(self) -> tuple[int, ...]:
        """The outputs that wander."""
        return tuple(np.flatnonzero(self.wander).tolist())

    @property
    def lags(self) -> tuple[int, ...]:
        """The outputs of which a share comes late."""
        return tuple(np.flatnonzero(self.late).tolist())

    @property
    def strays(self) -> tuple[int, ...]:
        """The inputs that stray."""
        return tuple(np.flatnonzero(self.stray).tolist())

    @property
    def leans(self) -> tuple[int, ...]:
        """The inputs that come late."""
        return tuple(np.flatnonzero(self.lean).tolist())

    @property
    def trails(self) -> tuple[int, ...]:
        """The outputs that trail what they measure."""
        return tuple(np.flatnonzero(self.trail).tolist())

    @property
    def zeros(self) -> tuple[int, ...]:
        """The outputs whose zero is off."""
        return tuple(np.flatnonzero(self.zero).tolist())

    @property
    def bends(self) -> tuple[int, ...]:
        """The inputs whose curve is bent."""
        return tuple(np.flatnonzero(self.bend).tolist())

    @property
    def grips(self) -> tuple[int, ...]:
        """The states that stick."""
        return tuple(np.flatnonzero(self.grip).tolist())

    @property
    def jitters(self) -> tuple[int, ...]:
        """The outputs that are sampled too early or too late."""
        return tuple(np.flatnonzero(self.jitter).tolist())

    @property
    def varies(self) -> tuple[int, ...]:
        """The constants that vary within a run."""
        return tuple(np.flatnonzero(self.varying).tolist())

    @property
    def fading(self) -> Float[np.ndarray, "constants"]:
        """By which rate what each constant is off its mean fades [1/s]; 0 where it keeps it."""
        rates = np.zeros(len(self.spread))
        rates[list(self.varies)] = 1 / self.varying[list(self.varies)]
        return rates

    @property
    def doubts(self) -> tuple[int, ...]:
        """The inputs, and behind them the states, for which the model errs more somewhere."""
        return tuple(np.flatnonzero(self.doubt).tolist())

    @property
    def beside(self) -> int:
        """How many inputs, outputs, states and constants err on their own, and for how many inputs
        and states the model errs more somewhere."""
        inputs = self.strays + self.leans + self.bends
        outputs = self.wanders + self.lags + self.trails + self.zeros + self.jitters
        return len(inputs + outputs + self.grips + self.varies + self.doubts)

    def widened(self, factor: float) -> "Noise":
        """What acts within a run `factor` times as large, which changes no gain of a filter; how
        constants differ between runs is no error of it."""
        own = ("sigma", "process", "drift", "size", "share", "wander", "late", "stray", "grip")
        own = *own, "jitter"
        return self._replace(**{name: factor * getattr(self, name) for name in own})

    def as_dict(self, model: Model) -> dict[str, dict[str, float]]:
        """For the calibration block of a model file."""
        block = {
            key: dict(zip(each, values.tolist(), strict=True))
            for key, each, values in zip(self._fields, _names(model), self, strict=False)
        }
        for keys, names, there in _beside(model, self):
            for key in keys:
                told = {names[j]: float(getattr(self, key)[j]) for j in there}
                block[key] = {name: a for name, a in told.items() if np.isfinite(a)}
        pairs = combinations(enumerate(constants_of(model).names), 2)
        block["together"] = {
            f"{a}, {b}": float(self.together[i, j])
            for (i, a), (j, b) in pairs
            if self.together.size
        }
        return block


def _names(model: Model) -> tuple[Sequence[str], ...]:
    signals = model.plant.signals
    driven = [signals.state_names[k] for k in dynamic_states(model.plant)]
    following = [signals.input_names[k] for k in following_inputs(model.plant)]
    known = constants_of(model).names
    measured = signals.output_names, signals.state_names, drifting_of(model)
    return (*measured, driven, driven, following, following, known, known, known)


def _beside(
    model: Model, noise: Noise
) -> Iterator[tuple[tuple[str, ...], tuple[str, ...], tuple[int, ...]]]:
    """What need not be there: the levels, the names of what may have them, which do."""
    signals = model.plant.signals
    yield WANDER, signals.output_names, noise.wanders
    yield LATE, signals.output_names, noise.lags
    yield STRAY, signals.input_names, noise.strays
    yield DOUBT, (*signals.input_names, *signals.state_names), noise.doubts
    yield LEAN, signals.input_names, noise.leans
    yield TRAIL, signals.output_names, noise.trails
    yield ZERO, signals.output_names, noise.zeros
    yield BEND, signals.input_names, noise.bends
    yield GRIP, signals.state_names, noise.grips
    yield VARY, constants_of(model).names, noise.varies
    yield JITTER, signals.output_names, noise.jitters


def noise_of(model: Model) -> Noise:
    """What `calibrate` found. Raises `InputError` for a model without it."""
    found = model.calibration and model.calibration.noise
    block = found.as_dict() if found else None
    if block is None or {*block, *OPTIONAL, "together"} != set(Noise._fields):
        raise InputError(
            "the model holds no noise levels, which the bank needs; run `faultgauge "
            "calibrate` on healthy logs, or use --observer eso."
        )
    try:
        levels = [
            np.array([float(block[key][name]) for name in each])
            for key, each in zip(Noise._fields, _names(model), strict=False)
        ]
        signals = model.plant.signals
        inputs, outputs = signals.input_names, signals.output_names
        states, known = signals.state_names, constants_of(model).names
        named = [outputs] * 4 + [inputs] * 2 + [(*inputs, *states)] * 3 + [inputs] * 2
        named += [outputs] * 2 + [inputs] + [states] * 4 + [known] + [outputs]
        more = [
            [block.get(key, {}).get(name, NOWHERE.get(key, 0.0)) for name in names]
            for key, names in zip(OPTIONAL, named, strict=True)
        ]
    except KeyError as missing:
        raise InputError(
            f"the model's noise levels say nothing of {missing}; run `faultgauge calibrate` anew."
        ) from None
    noise = Noise(*levels, *(np.array(each, float) for each in more))
    known = constants_of(model)
    if "together" in block:
        return noise._replace(together=_together(known.names, block["together"]))
    # before it was told, what the fit says stood beside a spread of each its own way
    return noise.with_between(known.covariance + noise.between)


def _together(
    names: Sequence[str], told: Mapping[str, float]
) -> Float[np.ndarray, "constants constants"]:
    """The correlation of constants of which each pair is `told`."""
    found = np.eye(len(names))
    for (i, a), (j, b) in combinations(enumerate(names), 2):
        found[i, j] = found[j, i] = told.get(f"{a}, {b}", 0.0)
    return found
