"""The weak form of the equation error: F averaged over the kernel, not F of averages.

The kernel phi that smooths the samples is a test function with compact support, and integration by
parts takes the derivative off the state (J. Loeb and G. Cahen, "More about process identification",
IEEE Trans. Automatic Control 10, 1965; D. A. Messenger and D. M. Bortz, "Weak SINDy", Multiscale
Modeling and Simulation 19, 2021):

    integral phi(t - s) F(x(s), u(s)) ds = integral phi'(t - s) x(s) ds

The right side is the smoothed derivative. The filtered form writes F(mean x, mean u) on the left,
which is the same for F linear in x and u; for any other F it is wrong wherever x moves within the
kernel. The weak form takes F at the samples as measured, and their noise with it: where F bends
within the noise, mean F is biased.

Equations that read a d(state), or a state that is itself the derivative of a column, stay filtered.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.identification.equation.groups import (
    Group,
    crowds,
    equation_errors,
    fit_group,
    scale_networks,
    target_scales,
)
from faultgauge.identification.optimise.algorithms import AlgorithmName
from faultgauge.identification.optimise.levenberg_marquardt import Solution
from faultgauge.identification.samples import Channels, Samples, Stretch
from faultgauge.plants.expression import derivatives_used, names_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Signals
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry.derivatives import Kernel

__all__ = ["WeakErrors", "WeakSamples", "fit_weak", "gap", "weak_samples", "weak_states"]


class WeakSamples(NamedTuple):
    """`at`: smoothed samples; `x`, `u`: the points as measured under the kernel at each of them,
    which `weights` average."""

    at: Samples
    x: Float[np.ndarray, "samples points states"]
    u: Float[np.ndarray, "samples points inputs"]
    weights: Float[np.ndarray, "samples points"]

    @property
    def dx(self) -> Float[np.ndarray, "samples states"]:
        return self.at.dx

    @property
    def y(self) -> Float[np.ndarray, "samples outputs"]:
        return self.at.y


class WeakErrors(eqx.Module):
    """`equation_errors`, with the equations of `states` in the weak form, at one weak sample."""

    states: tuple[int, ...] = eqx.field(static=True)

    def __call__(
        self, plant: GrayBoxPlant, group: Group, sample: WeakSamples
    ) -> Float[Array, "equations"]:
        def rates(x: Array, u: Array) -> Array:
            return jnp.stack(plant.equations(x, u, None, self.states))

        means = sample.weights @ jax.vmap(rates)(jnp.asarray(sample.x), jnp.asarray(sample.u))
        places = np.array([group.states.index(i) for i in self.states])
        weak = means - sample.at.dx[np.array(self.states)]
        return equation_errors(plant, group, sample.at).at[places].set(weak)


def weak_states(spec: PlantSpec, how: Channels, group: Group) -> tuple[int, ...]:
    """States of `group` whose equations read states as measured and no d(state)."""
    names = zip(spec.signals.state_names, how.states, strict=True)
    derived = {name for name, source in names if source is None or source[1] > 0}
    return tuple(
        i
        for i in group.states
        if not derivatives_used(spec.derivatives[i])
        and not names_used(spec.derivatives[i]) & derived
    )


def interval_weights(kernel: Kernel) -> Float[np.ndarray, "intervals"]:
    """The weights of the kernel's mean over the intervals between its samples, from the left."""
    count = 2 * kernel.half
    impulse = np.zeros(2 * count + 1)
    impulse[count] = 1.0  # an input held over one interval: every mean holds one weight of it
    return kernel.smooth(impulse, 1.0, held=True)[:0:-1]


def weak_samples(
    signals: Signals,
    stretches: Sequence[Stretch],
    places: Int[np.ndarray, "samples"],
    at: Samples,
) -> WeakSamples:
    """The points under the kernel of the samples `at`, the `places`-th of all stretches'.

    Over the interval [k, k+1) held inputs stay at u_k while x goes from x_k to x_(k+1); the
    trapezoid takes F at both ends.
    """
    parts = [s.unsmoothed for s in stretches if s.unsmoothed]
    kernel = parts[0].kernel
    x, u = (np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "u"))
    stretch = np.searchsorted(np.cumsum([len(s.t) for s in stretches]), places, side="right")
    first = places + 2 * kernel.half * stretch
    left = first[:, None] + np.arange(2 * kernel.half)
    held = np.array([each.hold == "zero" for each in signals.inputs], bool)
    weights = interval_weights(kernel)
    weights = np.tile(np.concatenate([weights, weights]) / 2, (len(places), 1))
    return WeakSamples(
        at,
        np.concatenate([x[left], x[left + 1]], axis=1),
        np.concatenate([u[left], np.where(held, u[left], u[left + 1])], axis=1),
        weights,
    )


def gap(plant: GrayBoxPlant, group: Group, states: tuple[int, ...], samples: WeakSamples) -> float:
    """rms of mean F - F(mean), as a share of the derivative's spread: the largest of `states`; NaN
    where F is not defined at every sample as measured."""

    @eqx.filter_jit
    def differences(plant: GrayBoxPlant, samples: WeakSamples) -> Array:
        def one(sample: WeakSamples) -> Array:
            return WeakErrors(states)(plant, group, sample) - equation_errors(
                plant, group, sample.at
            )

        return jax.vmap(one)(samples)

    found = np.asarray(differences(plant, jax.tree.map(jnp.asarray, samples)))
    shares = np.sqrt(np.mean(found**2, axis=0)) / target_scales(group, samples)
    return float(np.max(shares))


def fit_weak(
    plant: GrayBoxPlant,
    group: Group,
    states: tuple[int, ...],
    training: WeakSamples,
    validation: WeakSamples,
    rngs: Sequence[np.random.Generator],
    algorithm: AlgorithmName,
) -> tuple[list[GrayBoxPlant], Solution]:
    """`fit_group` with the equations of `states` in the weak form."""
    reached = _reached(training)
    scaled = scale_networks(plant, group, reached)
    return fit_group(
        scaled,
        group,
        training,
        validation,
        rngs,
        algorithm=algorithm,
        errors=WeakErrors(states),
        crowded=crowds(scaled, group, reached),
    )


def _reached(samples: WeakSamples) -> Samples:
    """Every point, smoothed and as measured: networks are to span them all."""
    x, u = (a.reshape(-1, a.shape[2]) for a in (samples.x, samples.u))
    apart = (np.full((len(x), a.shape[1]), np.nan) for a in (samples.dx, samples.y))
    parts = zip(samples.at, (x, u, *apart), strict=True)
    return Samples(*(np.concatenate(pair) for pair in parts))
