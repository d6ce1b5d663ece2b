"""What is known of faults before any data: how large, how often, and what nobody declared.

- `size`, the widest standard deviation of a step: half of the fault's own larger limit, or a
  quarter of the range of what it enters: an input's limits, else what the training envelope holds.
  A state's rate is near 0 wherever a plant is held, and its terms are not: it has the range that it
  would have were the inputs, or the states, to move alone. A network, or a parameter that is 0 and
  has no limits, may at least change so far that a rate or an output moves by such a range.
  Decades below are as likely (`branches.SCALES`), so it matters little.
- a growth is as fast as `rate` says.
- `onset`: `prior_per_hour`, or once in a thousand records as long as the healthy ones.
- an output that has no bias of its own may be off undeclared, as far as its range.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr

from faultgauge.detection.bank.large_faults import LargeFaults
from faultgauge.detection.rows.judged import operating_points
from faultgauge.observers.branches import SCALES, Prior
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant, respond, responses
from faultgauge.plants.signals import LOSSES, Fault
from faultgauge.programs import program

__all__ = [
    "ALIEN",
    "AT_START",
    "RARE",
    "onsets_of",
    "prior_of_faults",
    "ranges",
    "sizes_of",
    "stated_size",
    "undeclared_faults",
]

RARE = 1e-3  # faults in as much time as the healthy logs have
ALIEN = 0.01  # of the largest onset rate: how often something undeclared happens
RECOVERY = 10.0  # times the onset rate; times AT_START, well below what hinders a name
CHANGED = 0.01  # times that: how often a fault changes its size, a tenth as often as faults begin
COMMON = 1e-3  # of onsets: one in a thousand brings two faults at once, by a common cause
AT_START = 1e-3  # probability that a given fault is there when a log begins


def ranges(model: Model, plant: GrayBoxPlant) -> Float[np.ndarray, "faults"]:
    """Range over the training envelope of what each fault enters, in the fault's unit."""
    points, signals = operating_points(model), plant.signals
    x, u = map(jax.device_put, points)
    still = (np.broadcast_to(np.median(each, axis=0), each.shape) for each in points)
    still_x, still_u = map(jax.device_put, still)
    rates, outputs = responses(plant, x, u)
    at_rest, held = responses(plant, still_x, u), responses(plant, x, still_u)
    moved, shown = (
        np.max([_range(each) for each in some], axis=0)
        for some in zip((rates, outputs), at_rest, held, strict=True)
    )
    reach = _reach(plant, x, u, np.concatenate([moved, shown]))
    found = []
    for k, fault in enumerate(signals.faults):
        values, alone = np.zeros(0), 0.0
        match fault.enters:
            case _ if fault.relative or fault.enters in LOSSES:
                found.append(2.0)
                continue
            case "parameter":
                found.append(_parameter_range(model.plant, fault.target) or reach[k])
                continue
            case "network":
                values = _network_values(plant, fault.target, points.x, points.u)
                found.append(max(float(_range(values[:, None])[0]), reach[k]))
                continue
            case "state":
                at = signals.state_names.index(fault.target)
                values, alone = np.asarray(rates)[:, at], float(moved[at])
            case "output":
                values = np.asarray(outputs)[:, signals.output_names.index(fault.target)]
            case "input":
                at = signals.input_names.index(fault.target)
                limits = signals.inputs[at]
                if np.isfinite(limits.max - limits.min):
                    found.append(limits.max - limits.min)
                    continue
                values = points.u[:, at]
        values = values[np.isfinite(values)]
        width = float(np.ptp(values)) if len(values) else 0.0
        # a signal that stands still in training says how large it is, not how far it moves
        found.append(max(width, alone, 0.1 * float(np.abs(values).max(initial=0.0)), 1e-9))
    return np.array(found)


def _range(values: Any) -> Float[np.ndarray, "channels"]:
    """Of every channel over the points at which it is a number."""
    held = np.asarray(values)
    return np.array(
        [np.ptp(each[np.isfinite(each)]) if np.isfinite(each).any() else 0.0 for each in held.T]
    )


def _reach(
    plant: GrayBoxPlant,
    x: Float[Array, "points states"],
    u: Float[Array, "points inputs"],
    moves: Float[np.ndarray, "channels"],
) -> Float[np.ndarray, "faults"]:
    """How large a fault makes one of the rates and outputs differ by as much as it `moves`."""
    slopes = np.asarray(_slopes(plant, x, u))
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    typical = np.sqrt(np.mean(slopes**2, axis=0))
    widths = np.divide(
        moves[:, None], typical, out=np.full_like(typical, np.inf), where=typical > 0
    )
    widths = np.where(widths > 0, widths, np.inf).min(axis=0)
    return np.where(np.isfinite(widths), widths, 0.0)


@program
def _slopes(plant: Plant, x: Array, u: Array) -> Float[Array, "points channels faults"]:
    """By how much a unit of each fault moves rates and outputs."""

    def channels(f: Array, x: Array, u: Array) -> Array:
        return jnp.concatenate(respond(plant, x, u, f))

    none = jnp.zeros(len(plant.signals.faults))
    return jax.vmap(jax.jacfwd(channels), (None, 0, 0))(none, x, u)


def _parameter_range(plant: GrayBoxPlant, name: str) -> float:
    """From minus to plus its own size, or from its min to its max where that is less."""
    declared = next(each for each in plant.spec.parameters if each.name == name)
    widths = [2 * abs(float(plant.parameters[name])), declared.max - declared.min]
    return min((each for each in widths if 0 < each < np.inf), default=0.0)


def _network_values(
    plant: GrayBoxPlant,
    name: str,
    x: Float[np.ndarray, "points states"],
    u: Float[np.ndarray, "points inputs"],
) -> Float[np.ndarray, "values"]:
    at = jax.jit(jax.vmap(lambda x, u: plant.network_values(name, x, u)))
    return np.asarray(at(jnp.asarray(x), jnp.asarray(u))).ravel()


def sizes_of(model: Model, plant: GrayBoxPlant) -> Float[np.ndarray, "faults"]:
    """Widest standard deviation of each fault of `plant`."""
    size = ranges(model, plant) / 4
    for k, fault in enumerate(plant.signals.faults):
        said = stated_size(fault)
        size[k] = size[k] if said is None else said
    return size


def stated_size(fault: Fault) -> float | None:
    """The widest standard deviation of `fault` by its own limits, if it has any."""
    widest = max(abs(fault.min), abs(fault.max))
    return widest / 2 if np.isfinite(widest) else None


def undeclared_faults(model: Model, columns: tuple[str, ...]) -> tuple[Fault, ...]:
    """A bias of every output that has none of its own."""
    signals = model.plant.signals
    own = {f.target for f in signals.faults if f.enters == "output"}
    return tuple(
        Fault(f"undeclared {n}", "output", n)
        for n in signals.output_names
        if n in columns and n not in own
    )


def onsets_of(model: Model, healthy: float) -> Float[np.ndarray, "faults"]:
    """Rates [1/s] of the declared faults; `healthy` [s] is how long the healthy logs are."""
    given = [fault.prior_per_hour for fault in model.plant.signals.faults]
    return np.array([RARE / healthy if p is None else p / 3600 for p in given])


def _within(
    size: Float[np.ndarray, "many"], low: Float[np.ndarray, "many"], high: Float[np.ndarray, "many"]
) -> Float[np.ndarray, "many"]:
    """How likely a fault of widest `size` lies between two limits, every decade being as likely."""
    wide = np.array(SCALES)[:, None] * size
    return np.mean(ndtr(high / wide) - ndtr(low / wide), axis=0)


def prior_of_faults(
    model: Model,
    size: Float[np.ndarray, "faults"],
    onset: Float[np.ndarray, "declared"],
    growing: tuple[int, ...],
    large: LargeFaults,
    gain: float,
) -> Prior:
    """`size` of all faults, the undeclared ones last. Steps to sizes that are `large` are as likely
    as such sizes are. `gain` is the share by which the model's answers are off in size."""
    faults = model.plant.signals.faults
    more = len(size) - len(faults)
    largest = float(onset.max())
    rate = np.concatenate([onset, np.full(more, ALIEN * largest / max(more, 1))])
    low = np.array([*(f.min for f in faults), *[-np.inf] * more])
    high = np.array([*(f.max for f in faults), *[np.inf] * more])
    grow, far = list(growing), list(large.faults)
    shares = _within(size[far], large.low, large.high) / _within(size[far], low[far], high[far])
    share = 1 - np.bincount(np.array(far, int), shares, len(size))
    slopes = np.array([float(faults[k].rate or 0.0) for k in growing])
    wide = np.full(len(grow), np.inf)
    at_start = np.full(len(size) + len(grow), np.log(AT_START))
    at_start[len(faults) : len(size)] += np.log(ALIEN)
    at_start[: len(size)] += np.log(share)
    at_start = np.concatenate([at_start, np.log(AT_START * shares)])
    shown = np.array([f.monitor != "disabled" for f in faults] + [True] * more)
    never = np.where(shown, 1.0, 1e-300)
    begins = np.concatenate([rate * share, rate[grow], rate[far] * shares])
    limits = np.concatenate([[low, high], [-wide, wide], [large.low, large.high]], axis=1)
    return Prior(
        size=jax.device_put(np.concatenate([size, slopes, size[far]])),
        low=jax.device_put(limits[0]),
        high=jax.device_put(limits[1]),
        soft=jax.device_put(gain * np.where(np.isfinite(limits), np.abs(limits), 0.0)),
        onset=jax.device_put(begins * np.concatenate([never, never[grow], never[far]])),
        recovery=jax.device_put(RECOVERY * rate),
        common=jax.device_put(COMMON),
        unknown=jax.device_put(ALIEN * largest),
        first=jax.device_put(at_start),
        changed=jax.device_put(RECOVERY * CHANGED),
    )
