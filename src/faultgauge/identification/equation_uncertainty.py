"""What the equation error says about the parameters that it fitted."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.constants import Information, constants, imitated
from faultgauge.identification.equation_error import (
    Group,
    equation_errors,
    groups,
    target_scales,
)
from faultgauge.identification.equation_fit import Material
from faultgauge.identification.refinement.unknowns import Unknowns, unknowns_of
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["equation_information"]


def equation_information(
    plant: GrayBoxPlant, outputs: Sequence[str], given: Material
) -> Information:
    """What the samples that `plant` was fitted to, `outputs` with telemetry among them, say about
    its parameters."""
    unknowns = unknowns_of(plant)
    theta = unknowns.vector(plant)
    parts = groups(plant.spec, outputs)
    if not unknowns.parameters or not parts:
        return Information((), np.zeros((0, 0)), (), 1.0)
    J = _linearised(plant, unknowns, parts, given.training)[1].reshape(-1, len(theta))
    count = len(unknowns.parameters)
    unknown = np.full((count, count), np.nan)
    found = constants(plant, unknowns, theta, unknown, imitated(plant, unknowns, J.T @ J))
    return Information(*found, (), 1.0)


def _linearised(
    plant: GrayBoxPlant, unknowns: Unknowns, parts: Sequence[Group], samples: Samples
) -> tuple[Float[np.ndarray, "samples equations"], Float[np.ndarray, "samples equations unknowns"]]:
    """(residuals of all equations that were fitted, each over its target's spread; Jacobian)."""
    every = Group(
        states=tuple(i for part in parts for i in part.states),
        outputs=tuple(j for part in parts for j in part.outputs),
        networks=unknowns.networks,
        parameters=unknowns.parameters,
    )
    scales = target_scales(every, samples)

    @eqx.filter_jit
    def both(theta: Array, samples: Samples) -> tuple[Array, Array]:
        def error(theta: Array, sample: Samples) -> tuple[Array, Array]:
            r = equation_errors(unknowns.assemble(plant, theta), every, sample) / scales
            return r, r

        J, r = jax.vmap(jax.jacrev(error, has_aux=True), (None, 0))(theta, samples)
        return r, J

    found = both(jnp.asarray(unknowns.vector(plant)), jax.tree.map(jnp.asarray, samples))
    return np.asarray(found[0]), np.asarray(found[1])
