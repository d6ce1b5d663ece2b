"""Where a model is trusted: what acts in it lies in the training envelope.

What acts are the states and the inputs: as commanded, or as applied with the posterior means of the
faults,  clip((1 - f_gain) u + f_input, min, max).  Either will do: a command inside speaks for or
against the healthy plant; and in a closed loop a fault moves the command, while what is applied
stays where it was. A state that no derivative depends on and no output but its own reads, as the
place of a cart, may be anywhere.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.coverage import MARGIN
from faultgauge.detection.judged import operating_points
from faultgauge.observers.modes import Set
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond

__all__ = ["applied", "inside", "read"]


def read(model: Model) -> Bool[np.ndarray, "states"]:
    """The states that the model's derivatives, or outputs that are more than one state, depend on
    anywhere in the training envelope."""
    plant, points = model.plant, operating_points(model)
    dx, dy = jax.vmap(jax.jacfwd(lambda x, u: respond(plant, x, u)))(
        jnp.asarray(points.x), jnp.asarray(points.u)
    )
    more = [j for j, output in enumerate(plant.signals.outputs) if output.measures is None]
    slopes = np.concatenate([np.asarray(dx), np.asarray(dy)[:, more]], axis=1)
    return np.any(slopes != 0.0, axis=(0, 1))


def applied(
    model: Model,
    sets: Sequence[Set],
    u: Float[np.ndarray, "samples inputs"],
    p: Float[np.ndarray, "samples modes"],
    f: Float[np.ndarray, "samples modes slots"],
) -> tuple[Float[np.ndarray, "samples inputs"], Float[np.ndarray, "samples states"]]:
    """(the inputs as they act, what is added to the states' derivatives) with the posterior means
    of the faults in `sets`, as `respond` has them."""
    signals = model.plant.signals
    gain, extra = np.ones(u.shape), np.zeros(u.shape)
    driven = np.zeros((len(u), len(signals.states)))
    for k, fault in enumerate(signals.faults):
        if fault.enters == "output":
            continue
        names = signals.state_names if fault.enters == "state" else signals.input_names
        at = names.index(fault.target)
        mean = np.zeros(len(u))
        for m, each in enumerate(sets):
            if k in each:
                mean += p[:, m] * np.clip(f[:, m, each.index(k)], fault.min, fault.max)
        if fault.enters == "gain":
            gain[:, at] *= 1 - mean
        else:
            (driven if fault.enters == "state" else extra)[:, at] += mean
    low, high = [e.min for e in signals.inputs], [e.max for e in signals.inputs]
    return np.clip(gain * u + extra, low, high) if signals.inputs else u, driven


def inside(
    points: Float[np.ndarray, "points n"], values: Float[np.ndarray, "samples n"]
) -> Bool[np.ndarray, "samples"]:
    """Whether every one of `values` is within a tenth of the range of `points`."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = MARGIN * (high - low) + 1e-9 * np.maximum(np.abs(low), np.abs(high))
    return np.all((values >= low - room) & (values <= high + room), axis=1)
