"""Where a model is trusted: known physics extrapolates, a network does not.

What reaches a network lies in what it was trained on (`coverage`), and what the plant file bounds
by `trusted` lies within. Both are asked of the states and of the inputs, as commanded or as applied
with the posterior means of the faults, clip((1 - f_gain) u + f_input, min, max). Either will do: a
command inside speaks for or against the healthy plant; and in a closed loop a fault moves the
command, while what is applied stays where it was.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from faultgauge.detection.coverage import Region
from faultgauge.plants.model import Model

__all__ = ["applied", "bounds_of", "outside"]


def bounds_of(model: Model) -> list[tuple[str, str, int, float, float]]:
    """(name, "state" or "input", its place, low, high) of whatever the plant file bounds."""
    signals = model.plant.signals
    kinds = (("state", signals.states), ("input", signals.inputs))
    return [
        (each.name, kind, k, *each.trusted)
        for kind, many in kinds
        for k, each in enumerate(many)
        if each.trusted is not None
    ]


def outside(
    model: Model,
    regions: Sequence[Region],
    x: Float[np.ndarray, "samples states"],
    u: Float[np.ndarray, "samples inputs"],
    acting: Float[np.ndarray, "samples inputs"],
    driven: Float[np.ndarray, "samples states"],
) -> Int[np.ndarray, "samples"]:
    """0 where the model is trusted, else 1 + the place of what was left among the networks'
    `regions` and, behind them, `bounds_of` the file."""
    found = np.zeros(len(x), int)
    for k, region in enumerate(regions, 1):
        out = np.flatnonzero(~region.holds(x, u, np.zeros_like(driven)) & (found == 0))
        if len(out):
            out = out[~region.holds(x[out], acting[out], driven[out])]
        found[out] = k
    for k, (_, kind, at, low, high) in enumerate(bounds_of(model), 1 + len(regions)):
        many = (x,) if kind == "state" else (u, acting)
        out = np.all([(each[:, at] < low) | (each[:, at] > high) for each in many], axis=0)
        found[out & (found == 0)] = k
    return found


def applied(
    model: Model,
    u: Float[np.ndarray, "samples inputs"],
    p: Float[np.ndarray, "samples sets"],
    f: Float[np.ndarray, "samples sets faults"],
) -> tuple[Float[np.ndarray, "samples inputs"], Float[np.ndarray, "samples states"]]:
    """(the inputs as they act, what is added to the states' derivatives) with the posterior means
    of the faults in every set, as `respond` has them."""
    signals = model.plant.signals
    gain, extra = np.ones(u.shape), np.zeros(u.shape)
    driven = np.zeros((len(u), len(signals.states)))
    mean = np.einsum("ts,tsf->tf", p, f)
    for k, fault in enumerate(signals.faults):
        size = np.clip(mean[:, k], fault.min, fault.max)
        match fault.enters:
            case "gain":
                gain[:, signals.input_names.index(fault.target)] *= 1 - size
            case "input":
                extra[:, signals.input_names.index(fault.target)] += size
            case "state":
                driven[:, signals.state_names.index(fault.target)] += size
            case _:
                pass
    low, high = [e.min for e in signals.inputs], [e.max for e in signals.inputs]
    return np.clip(gain * u + extra, low, high) if signals.inputs else u, driven
