"""How a declared fault is put into a recorded log without simulating the plant.

The plant did what the input that acted made it do. A fault at an input is therefore exact where the
estimator is told another command, so that command and fault together are what acted:

    input   u_told = u - f          since u_told + f = u
    gain    u_told = u / (1 - f)    since (1 - f) u_told = u

and a fault at an output is exact in its column: y + f, or y (1 - f). A fault f of a state is put in
exactly where an input enters that derivative with a constant gain b and nothing else reads it: the
fault has the effect of f / b at the input.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Fault

__all__ = ["Way", "way_of"]

CONSTANT = 0.01  # share by which a gain may differ between operating points


class Way(NamedTuple):
    """The `column` that a fault of size f changes, by `scale` f: an input's command so that it
    makes up for the fault, or an output; added, or as a share of it that is lost."""

    column: str
    is_input: bool
    is_loss: bool
    scale: float = 1.0


KINDS = {  # enters: (is_input, is_loss)
    "input": (True, False),
    "gain": (True, True),
    "output": (False, False),
    "output_gain": (False, True),
}


def way_of(model: Model, fault: Fault) -> Way | None:
    """How `fault` gets into a log; None where no recorded log can have it."""
    if fault.enters in KINDS:
        return Way(fault.target, *KINDS[fault.enters])
    if fault.enters == "state":
        return _through_an_input(model, fault.target)
    return None


def _through_an_input(model: Model, state: str) -> Way | None:
    """The input that acts on the derivative of `state` alone, with one gain b = dF/du at all
    operating points."""
    signals, points = model.plant.signals, operating_points(model)
    x, u = jnp.asarray(points.x), jnp.asarray(points.u)
    dx = jax.vmap(model.plant.derivative)(x, u)
    in_rates = np.asarray(jax.vmap(jax.jacfwd(model.plant.derivative, argnums=1))(x, u))
    in_outputs = np.asarray(jax.vmap(jax.jacfwd(model.plant.output, argnums=2))(dx, x, u))
    i = signals.state_names.index(state)
    for j, each in enumerate(signals.inputs):
        gain = in_rates[:, i, j]
        b = float(np.median(gain))
        constant = b != 0 and bool(np.all(np.abs(gain - b) <= CONSTANT * abs(b)))
        alone = not np.any(np.delete(in_rates[:, :, j], i, axis=1))
        if constant and alone and not np.any(in_outputs[:, :, j]):
            return Way(each.name, is_input=True, is_loss=False, scale=1 / b)
    return None
