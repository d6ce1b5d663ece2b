"""A window of a log, and the posterior of every onset and cause in it.

In a window at most one fault begins and then stays constant. For a cause k and an onset at sample
n, with score r and information N of its size f ~ N(0, S^2) from `shocks`,

    ln p(y | k, n) - ln p(y | healthy) = (r^2 V - ln(1 + N S^2)) / 2,   V = 1 / (N + 1/S^2),
    f | k, n, y ~ N(r V, V),

times the mass of f within the fault's limits, posterior over prior; the prior of (k, n) is the
cause's onset rate times the step.

What healthy logs, of T s in all, show too is made up or real (`posterior.mimicked`). With its size
m at that age, which a real fault has beside its own, S^2 + m^2 stands for S^2, and the size is
known to V + m^2; that something is made up is as likely as a fault of size m that begins once in T.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr

from faultgauge.detection.bank.bank import FaultBank, unknown_shock
from faultgauge.detection.bank.extended import start_spread
from faultgauge.detection.bank.priors import ALIEN, AT_START
from faultgauge.detection.onset.shocks import KnownStretch, Shocks, shocks
from faultgauge.detection.posterior.mimicked import Mimicked
from faultgauge.detection.rows.judged import pad_stretch
from faultgauge.detection.rows.prepared import Prepared
from faultgauge.observers.branches import SCALES
from faultgauge.observers.divided_difference import Belief

__all__ = ["Causes", "Window", "causes_in", "shocks_of", "window_of"]


class Window(NamedTuple):
    """The samples `part` of a run, its arrays padded to the length of a bucket."""

    belief: Belief
    record: KnownStretch
    t: Float[np.ndarray, "samples"]
    part: slice


class Causes(NamedTuple):
    """ln of posterior weight (not normalised) of every onset and cause, declared ones first and
    then undeclared ones, and of what is `made_up`; mean and sd of a declared fault's size; the
    innovations as each declared fault is linearised, the last ones without any."""

    weight: Float[np.ndarray, "samples causes"]
    made_up: Float[np.ndarray, "samples declared"]
    mean: Float[np.ndarray, "samples declared"]
    sd: Float[np.ndarray, "samples declared"]
    seen: tuple[Shocks, ...]


def window_of(
    bank: FaultBank,
    rows: Prepared,
    part: slice,
    believed: Bool[np.ndarray, "samples"],
    mean: Float[np.ndarray, "extended"],
    least: int = 0,
) -> Window:
    """The samples `part` of `rows`, of which those are used that are `believed`; they start at
    about `mean` [states, discrepancy, directions]. Padded to the bucket of `least` samples or
    more."""
    model = bank.model
    t, y = rows.run.t[part], rows.y[part].copy()
    y[:, [n not in bank.outputs for n in model.plant.signals.output_names]] = np.nan
    y[~believed[part]] = np.nan
    u, y, dt = pad_stretch(rows.u[part], y, t, least)
    # The first sample has found the start: it is not to be believed twice, least of all where
    # a sensor's bias may have been there already.
    sd = start_spread(model, bank.noise, ())
    lane = bank.modes.filter
    faults = np.zeros((len(dt), lane.faults))
    record = KnownStretch(*(jnp.asarray(a) for a in (u, y, dt, faults, faults)))
    return Window(lane.begin(jnp.asarray(mean), jnp.asarray(sd)), record, t, part)


def shocks_of(
    bank: FaultBank,
    window: Window,
    f: jax.Array | None = None,
    span: jax.Array | None = None,
) -> Shocks:
    """What the filter says of a window, linearised around the guess `f`, or over `span`."""
    record = window.record if f is None else window.record._replace(f=f)
    noise = jax.tree.map(lambda a: a[0], bank.modes.noise)
    lane = bank.modes.filter
    if span is not None:
        lane = eqx.tree_at(lambda each: each.probe, lane, jnp.abs(span))
    return shocks(lane, noise, window.belief, record, jnp.asarray(unknown_shock(bank)))


def causes_in(bank: FaultBank, window: Window, found: Shocks) -> Causes:
    """The posterior of a window from what the filter says of it."""
    faults = bank.model.plant.signals.faults
    count, declared = len(window.t), len(faults)
    dt = np.asarray(window.record.dt)[:count, None]
    more = bank.modes.filter.faults - declared
    rate = np.concatenate([bank.onset, np.full(more + 1, ALIEN * bank.onset.max() / (more + 1))])
    prior = np.log(rate * np.maximum(dt, 1e-12))
    prior[0] = np.log(AT_START)
    size = np.asarray(bank.modes.prior.size)[: bank.modes.filter.faults]
    score, information = (np.asarray(a)[:count] for a in (found.score, found.information))
    variance = 1 / (information + size**-2.0)
    mimicked = np.zeros(score.shape)
    ages = np.broadcast_to((window.t[-1] - window.t)[:, None], (count, declared))
    mimicked[:, :declared] = Mimicked.of(bank).at(ages)
    mean = (score * variance)[:, :declared]
    sd = np.sqrt(variance + mimicked**2)[:, :declared]
    each = []
    for scale in SCALES:
        s = np.hypot(scale * size, mimicked)
        V = 1 / (information + s**-2.0)
        gain = (score**2 * V - np.log1p(information * s**2)) / 2
        for k, fault in enumerate(faults):
            gain[:, k] += _mass(fault.min, fault.max, (score * V)[:, k], np.sqrt(V)[:, k])
            gain[:, k] -= _mass(fault.min, fault.max, np.zeros(count), s[:, k])
        each.append(gain)
    gain = np.logaddexp.reduce(each, axis=0) - np.log(len(SCALES))
    often = np.minimum(np.log(np.maximum(dt, 1e-12) / bank.healthy), 0.0)
    often[0] = 0.0
    made_up = often + _made_up(*(a[:, :declared] for a in (score, information, mimicked)))
    gain = np.concatenate([gain, np.asarray(found.unknown)[:count, None]], axis=1)
    return Causes(prior + gain, made_up, mean, sd, (found,))


def _made_up(
    score: Float[np.ndarray, "samples declared"],
    information: Float[np.ndarray, "samples declared"],
    mimicked: Float[np.ndarray, "samples declared"],
) -> Float[np.ndarray, "samples declared"]:
    """By how much (ln) what healthy logs show too is likelier than nothing."""
    with np.errstate(divide="ignore"):
        V = 1 / (information + mimicked**-2.0)
    shown = (score**2 * V - np.log1p(information * mimicked**2)) / 2
    return np.where(mimicked > 0, shown, -np.inf)


def _mass(
    low: float, high: float, mean: Float[np.ndarray, "n"], sd: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """ln of the probability of N(mean, sd^2) between two limits, 0 of which lies between."""
    below, above = log_ndtr((low - mean) / sd), log_ndtr((mean - high) / sd)
    inside = -np.expm1(np.logaddexp(below, above))
    near = np.where(below > above, log_ndtr((mean - low) / sd), log_ndtr((high - mean) / sd))
    return np.where(inside > 1e-3, np.log(np.maximum(inside, 1e-3)), near)
