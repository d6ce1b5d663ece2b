"""How far the plant is from its model: what calibration finds, and the plant that it makes."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.remember import once
from faultgauge.detection.rows.judged import operating_points
from faultgauge.errors import InputError
from faultgauge.plants.disturbed import Disturbed, Error, dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond
from faultgauge.plants.signals import Fault

__all__ = [
    "BEND",
    "DOUBT",
    "GRIP",
    "LATE",
    "LEAN",
    "STRAY",
    "TRAIL",
    "USUAL_SPREAD",
    "WANDER",
    "Constants",
    "Noise",
    "constants_of",
    "directions_of",
    "disturbed",
    "drifting_of",
    "error_of",
    "noise_of",
    "offset_of",
    "process_of",
    "rates_of",
    "retold",
    "scale_of",
    "spread_of_start",
    "start_spread",
    "usual_spread",
    "width_of",
]

WANDER = ("wander", "wandering")  # absent where no output does
LATE = ("late", "lag")
STRAY = ("stray", "straying")  # absent where no input does
DOUBT = ("doubt", "above", "below")  # absent where the model is as good everywhere
LEAN = ("lean", "leaning")  # absent where no input comes late
TRAIL = ("trail",)  # absent where no output does
BEND = ("bend",)  # absent where no input's curve is bent
GRIP = ("grip", "gripping", "slip")  # absent where no state sticks
NOWHERE = {"doubt": 0.0, "above": -np.inf, "below": np.inf}  # what of these is absent
LOW = 2.0  # standard deviations below what a constant is: it may well lie there
MOST_CONSTANTS = 6  # that are tracked: those that matter most
USUAL_SPREAD = 0.01  # of a constant, from run to run


class Noise(NamedTuple):
    """Standard deviations: `sigma` of a sample, `process` and `drift` per sqrt(s), `size` of the
    discrepancy beside the dynamic states [its state's unit per s], which lasts for `lasting` [s];
    an input that changes is off by a random `share` of that, which settles in `settling` [s];
    `spread` of the constants between runs, by how much `shift` their mean is off the fitted
    value, which an error of the model may have biased, and what share of their variance a gap
    within a run makes anew (`renewed`); `wander` of an output, which lasts for `wandering` [s], and
    the share of what an input's change does to it that comes `late`, within `lag` [s]; by what an
    input strays (`stray`), which lasts for `straying` [s]; by which share of its change an input is
    off at first, in the mean (`lean`, -1 for a lag), and within which time (`leaning` [s]); within
    which time an output follows what it measures, a lag of its sensor (`trail` [s]); by how much of
    its range the curve of an input is off a straight line in the middle (`bend`); what holds a
    state at rest (`grip`, its unit per s), for how long (`gripping` [s]), until it moves by `slip`,
    where half of that is left; how
    many times as large all this is (`doubt`) where an input lies between `above` and `below`; 0, or
    nothing at all, where nothing of that kind is."""

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
    doubt: Float[np.ndarray, "inputs"] = np.zeros(0)
    above: Float[np.ndarray, "inputs"] = np.zeros(0)
    below: Float[np.ndarray, "inputs"] = np.zeros(0)
    lean: Float[np.ndarray, "inputs"] = np.zeros(0)
    leaning: Float[np.ndarray, "inputs"] = np.zeros(0)
    trail: Float[np.ndarray, "outputs"] = np.zeros(0)
    bend: Float[np.ndarray, "inputs"] = np.zeros(0)
    grip: Float[np.ndarray, "states"] = np.zeros(0)
    gripping: Float[np.ndarray, "states"] = np.zeros(0)
    slip: Float[np.ndarray, "states"] = np.zeros(0)

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
    def bends(self) -> tuple[int, ...]:
        """The inputs whose curve is bent."""
        return tuple(np.flatnonzero(self.bend).tolist())

    @property
    def grips(self) -> tuple[int, ...]:
        """The states that stick."""
        return tuple(np.flatnonzero(self.grip).tolist())

    @property
    def doubts(self) -> tuple[int, ...]:
        """The inputs for which the model errs more somewhere."""
        return tuple(np.flatnonzero(self.doubt).tolist())

    @property
    def beside(self) -> int:
        """How many inputs, outputs and states err on their own, and inputs somewhere more."""
        inputs = self.strays + self.leans + self.bends + self.doubts
        return len(self.wanders + self.lags + self.trails + self.grips + inputs)

    def widened(self, factor: float) -> "Noise":
        """What acts within a run `factor` times as large, which changes no gain of a filter; how
        constants differ between runs is no error of it."""
        own = ("sigma", "process", "drift", "size", "share", "wander", "late", "stray", "grip")
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
    yield DOUBT, signals.input_names, noise.doubts
    yield LEAN, signals.input_names, noise.leans
    yield TRAIL, signals.output_names, noise.trails
    yield BEND, signals.input_names, noise.bends
    yield GRIP, signals.state_names, noise.grips


def drifting_of(model: Model) -> tuple[str, ...]:
    """Parameters with `vary = "slow"`."""
    return tuple(p.name for p in model.plant.spec.parameters if p.vary == "slow")


def noise_of(model: Model) -> Noise:
    """What `calibrate` found. Raises `InputError` for a model without it."""
    found = model.calibration and model.calibration.noise
    block = found.as_dict() if found else None
    optional = (*WANDER, *LATE, *STRAY, *DOUBT, *LEAN, *TRAIL, *BEND, *GRIP)
    if block is None or {*block, *optional} != set(Noise._fields):
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
        named = [outputs] * 4 + [inputs] * 7 + [outputs, inputs] + [signals.state_names] * 3
        more = [
            [block.get(key, {}).get(name, NOWHERE.get(key, 0.0)) for name in names]
            for key, names in zip(optional, named, strict=True)
        ]
    except KeyError as missing:
        raise InputError(
            f"the model's noise levels say nothing of {missing}; run `faultgauge calibrate` anew."
        ) from None
    return Noise(*levels, *(np.array(each, float) for each in more))


class Constants(NamedTuple):
    """The constants that are uncertain, with the covariance that the fit gives them; which of them
    are `positive` and so uncertain that a normal distribution would not know it."""

    names: tuple[str, ...]
    covariance: Float[np.ndarray, "constants constants"]
    positive: tuple[int, ...]


def constants_of(model: Model) -> Constants:
    """Those that a calibration tells of; before one, those that move the states' rates and outputs
    most, by their standard errors and the usual spread, and those that a fault changes: how much of
    that there is in healthy plants, nothing else can tell."""
    known, free = model.record.constants, _free(model)
    if not free:
        return Constants((), np.zeros((0, 0)), ())
    se = _errors(model)
    told = model.calibration and model.calibration.noise
    if told:
        kept = [k for k, name in enumerate(free) if name in told.spread]
    else:
        kept = _most_moving(model)
    place = {name: k for k, name in enumerate(known.names)}
    correlation = np.eye(len(kept))
    for a, i in enumerate(kept):
        for b, j in enumerate(kept):
            if a != b and free[i] in place and free[j] in place:
                found = known.correlation[place[free[i]]][place[free[j]]]
                correlation[a, b] = found or 0.0
    covariance = correlation * np.outer(se[kept], se[kept])
    w, v = np.linalg.eigh(covariance)
    spec, values = {p.name: p for p in model.plant.spec.parameters}, model.plant.parameters
    positive = tuple(
        place
        for place, k in enumerate(kept)
        if spec[free[k]].positive and LOW * se[k] >= float(values[free[k]])
    )
    names = tuple(free[k] for k in kept)
    return Constants(names, (v * np.maximum(w, 0.0)) @ v.T, positive)


def _free(model: Model) -> list[str]:
    slow = drifting_of(model)
    return [p.name for p in model.plant.spec.parameters if not p.fixed and p.name not in slow]


def _errors(model: Model) -> Float[np.ndarray, "free"]:
    known = model.record.constants
    error = dict(zip(known.names, known.errors, strict=True))
    return np.array([_spread_in_a_run(model, n, error.get(n) or 0.0) for n in _free(model)])


def _spread_in_a_run(model: Model, name: str, error: float) -> float:
    """How far a run's own value lies from the model's: the standard `error`, or, of a parameter
    that each run has its own of, how far runs lie apart."""
    parameter = next(p for p in model.plant.spec.parameters if p.name == name)
    if parameter.vary is None or model.record.between is None:
        return float(error)
    apart = model.record.between.apart[name]
    return apart * float(model.plant.parameters[name]) if parameter.positive else apart


def usual_spread(value: float, se: float) -> float:
    """By how much a constant of `value` and standard error `se` may differ from run to run where
    no log tells."""
    return max(USUAL_SPREAD * abs(value), se, 1e-9)


@once
def rates_of(model: Model) -> Float[np.ndarray, "states"]:
    """Standard deviation of the states' derivatives over the training envelope."""
    found = _rates(model)
    return np.std(found, axis=0) + 1e-9 * np.abs(found).max(axis=0, initial=0.0) + 1e-12


@once
def ranges_of(model: Model) -> Float[np.ndarray, "outputs"]:
    """Of the outputs over the training envelope."""
    points = operating_points(model)
    shown = jax.jit(jax.vmap(lambda x, u: respond(model.plant, x, u)[1]))
    outputs = np.asarray(shown(*map(jnp.asarray, points)))
    return np.ptp(outputs[np.isfinite(outputs).all(axis=1)], axis=0) + 1e-12


@once
def output_rates_of(model: Model) -> Float[np.ndarray, "outputs"]:
    """Standard deviation of the outputs' derivatives over the training envelope, their inputs and
    what they read of derivatives held."""
    points = operating_points(model)

    def moves(x: Array, u: Array) -> Array:
        dx, _ = respond(model.plant, x, u)
        return jax.jvp(lambda x: model.plant.output(dx, x, u), (x,), (dx,))[1]

    found = np.asarray(jax.jit(jax.vmap(moves))(*map(jnp.asarray, points)))
    return np.std(found[np.isfinite(found).all(axis=1)], axis=0) + 1e-12


def _rates(model: Model) -> Float[np.ndarray, "points states"]:
    points = operating_points(model)
    rates = jax.jit(jax.vmap(lambda x, u: respond(model.plant, x, u)[0]))
    found = np.asarray(rates(*map(jnp.asarray, points)))
    return found[np.isfinite(found).all(axis=1)]


@once
def _most_moving(model: Model) -> list[int]:
    """The places of these among the free ones, whatever a calibration says."""
    values, free, se = model.plant.parameters, _free(model), _errors(model)
    usual = np.array([usual_spread(float(values[n]), s) for n, s in zip(free, se, strict=True)])
    order = np.argsort(-_effects(model, tuple(free)) * np.hypot(se, usual), kind="stable")
    changed = {fault.target for fault in model.plant.signals.faults if fault.enters == "parameter"}
    changing = np.flatnonzero(np.isin(free, [*changed])).tolist()
    return sorted({*order[:MOST_CONSTANTS].tolist(), *changing})


def _effects(model: Model, names: tuple[str, ...]) -> Float[np.ndarray, "constants"]:
    """How far a unit of each constant moves rates and outputs, in units of their spread."""
    points = operating_points(model)
    nothing = Error(*[jnp.zeros(0)] * 3)
    plant = Disturbed.of(
        model.plant, (), (), nothing, names, jnp.zeros(len(names)), jnp.eye(len(names))
    )
    count = len(model.plant.signals.states)

    def both(xi: Array, x: Array, u: Array) -> Array:
        dx, y = respond(plant, jnp.concatenate([x, xi]), u)
        return jnp.concatenate([dx[:count], y])

    @jax.jit  # a program of one piece costs a tenth of one for each operation
    def along(x: Array, u: Array) -> tuple[Array, Array]:
        none, over = jnp.zeros(len(names)), (None, 0, 0)
        return jax.vmap(jax.jacfwd(both), over)(none, x, u), jax.vmap(both, over)(none, x, u)

    slopes, usual = map(np.asarray, along(*map(jnp.asarray, points)))
    usual = np.nanstd(np.where(np.isfinite(usual), usual, np.nan), axis=0) + 1e-12
    slopes = np.where(np.isfinite(slopes), slopes, 0.0) / usual[:, None]
    return np.sqrt(np.mean(np.sum(slopes**2, axis=1), axis=0))


def directions_of(
    model: Model, known: Constants, spread: Float[np.ndarray, "constants"]
) -> Float[np.ndarray, "parameters directions"]:
    """W: what a unit of each xi does to the parameters, drifting ones first."""
    _, drifted = spread_of_start(model, np.ones(len(model.plant.signals.outputs)), ())
    k = len(drifted)
    W = np.zeros((k + len(spread), k + len(spread)))
    W[:k, :k] = np.diag(drifted)
    W[k:, k:] = np.linalg.cholesky(known.covariance + np.diag(spread**2 + 1e-30))
    return W


def retold(model: Model, noise: Noise) -> Model:
    """`model` with its constants as healthy logs have them."""
    values, names = model.plant.values(), constants_of(model).names
    mean = {n: values[n] + shift for n, shift in zip(names, noise.shift, strict=True)}
    return replace(model, plant=model.plant.with_constants(mean))


def disturbed(model: Model, noise: Noise, undeclared: tuple[Fault, ...] = ()) -> Disturbed:
    """The plant with the discrepancy and the uncertain constants that `noise` says."""
    known = constants_of(model)
    return Disturbed.of(
        model.plant,
        dynamic_states(model.plant),
        following_inputs(model.plant),
        error_of(model, noise),
        (*drifting_of(model), *known.names),
        jnp.asarray(offset_of(model, noise)),
        jnp.asarray(directions_of(model, known, noise.spread)),
        undeclared,
        noise.wanders,
        noise.lags,
        noise.strays,
        noise.doubts,
        noise.leans,
        noise.trails,
        noise.bends,
        noise.grips,
        tuple(len(drifting_of(model)) + k for k in known.positive),
    )


def offset_of(model: Model, noise: Noise) -> Float[np.ndarray, "parameters"]:
    """What the mean of each parameter of `Disturbed` is off the fitted value."""
    return np.concatenate([np.zeros(len(drifting_of(model))), noise.shift])


def error_of(model: Model, noise: Noise) -> Error:
    """What of `noise` the plant itself has."""
    wanders, lags, strays = list(noise.wanders), list(noise.lags), list(noise.strays)
    own = (noise.lasting, noise.settling, noise.share)
    beside = (noise.wandering[wanders], noise.lag[lags], noise.late[lags], noise.straying[strays])
    doubts = list(noise.doubts)
    leans, trails, bends = list(noise.leans), list(noise.trails), list(noise.bends)
    doubt = (getattr(noise, name)[doubts] for name in DOUBT)
    # an input may have changed by all it can just before a log
    u = operating_points(model).u
    before = np.ptp(u, axis=0)[list(following_inputs(model.plant))]
    late = noise.leaning[leans], noise.lean[leans], noise.trail[trails]
    bend = noise.bend[bends], u.min(axis=0)[bends], u.max(axis=0)[bends]
    grips = list(noise.grips)
    grip = noise.gripping[grips], noise.slip[grips]
    parts = (*own, *beside, *doubt, *late, *bend, *grip, before)
    return Error(*(jnp.asarray(each) for each in parts))


def process_of(
    noise: Noise, drifted: Float[np.ndarray, "drifting"]
) -> Float[np.ndarray, "extended"]:
    """Per sqrt(s), of the states of `Disturbed`."""
    wanders, strays, grips = list(noise.wanders), list(noise.strays), list(noise.grips)
    return np.concatenate(
        [
            noise.process,
            noise.size * np.sqrt(2 / noise.lasting),
            np.sqrt(2 / noise.settling),
            noise.wander[wanders] * np.sqrt(2 / noise.wandering[wanders]),
            np.zeros(len(noise.lags)),
            noise.stray[strays] * np.sqrt(2 / noise.straying[strays]),
            np.zeros(len(noise.leans + noise.trails)),
            noise.grip[grips] * np.sqrt(2 / noise.gripping[grips]),
            np.zeros(len(noise.share)),
            noise.drift / np.maximum(drifted, 1e-300),
            np.zeros(len(noise.spread)),
        ]
    )


def spread_of_start(
    model: Model, sigma: Float[np.ndarray, "outputs"], columns: Sequence[str]
) -> tuple[Float[np.ndarray, "states"], Float[np.ndarray, "drifting"]]:
    """How uncertain the state and the drifting parameters of a first sample are.

    A measured state is known as well as its output, a hidden one lies somewhere in the training
    envelope, and so does a parameter: within its own size of its value.
    """
    signals = model.plant.signals
    sd = np.std(operating_points(model).x, axis=0) + 1e-9
    for output, noise in zip(signals.outputs, sigma, strict=True):
        if output.measures is not None and output.name in columns:
            state = signals.state_names.index(output.measures)
            sd[state] = max(2 * noise, 1e-12)
    values = {p.name: p for p in model.plant.spec.parameters}
    drifted = [
        0.1 * abs(values[name].value) or (width_of(values[name].min, values[name].max) / 10)
        for name in drifting_of(model)
    ]
    return sd, np.array(drifted, float)


def start_spread(
    model: Model, noise: Noise, columns: Sequence[str]
) -> Float[np.ndarray, "extended"]:
    """Of the states of `Disturbed` when a log begins."""
    sd, drifted = spread_of_start(model, noise.sigma, columns)
    width = np.ptp(operating_points(model).u, axis=0)
    follows, leans = np.ones(len(noise.share)), list(noise.leans)
    wanders, lags = list(noise.wanders), list(noise.lags)
    late = noise.late[lags] * ranges_of(model)[lags]
    stray = noise.stray[list(noise.strays)], np.abs(noise.lean[leans]) * width[leans]
    trails = list(noise.trails)
    trail = noise.trail[trails] * output_rates_of(model)[trails]
    # of a state only what its sensor trailed says how it begins
    for j, behind in zip(trails, trail, strict=True):
        measures = model.plant.signals.outputs[j].measures
        if measures is not None:
            k = model.plant.signals.state_names.index(measures)
            sd[k] = np.hypot(sd[k], behind)
    rest = noise.wander[wanders], late, *stray, trail, noise.grip[list(noise.grips)], 0 * follows
    directions = np.ones(len(drifted) + len(noise.spread))
    return np.concatenate([sd, noise.size, follows, *rest, directions])


def scale_of(model: Model, noise: Noise) -> Float[np.ndarray, "extended"]:
    """How large the states of `Disturbed` are."""
    x = np.std(operating_points(model).x, axis=0) + 1e-9
    rest = np.ones(len(drifting_of(model)) + len(noise.spread))
    u = np.std(operating_points(model).u, axis=0) + 1e-9
    follows = u[list(following_inputs(model.plant))]
    own = noise.wander[list(noise.wanders)], ranges_of(model)[list(noise.lags)]
    stray = noise.stray[list(noise.strays)], u[list(noise.leans)]
    trails = list(noise.trails)
    stray = *stray, noise.trail[trails] * output_rates_of(model)[trails]
    stray = *stray, noise.grip[list(noise.grips)]
    return np.concatenate([x, noise.size, np.ones(len(follows)), *own, *stray, follows, rest])


def width_of(low: float, high: float) -> float:
    """The width of a range; 1 where it is open."""
    return high - low if np.isfinite(high - low) else 1.0
