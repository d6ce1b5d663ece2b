"""What an input does between its samples: `hold` "zero", "linear" or "band-limited"."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.signals import Signals

__all__ = ["band_limited", "intersample", "line"]

TAPS = 12  # samples either side: the pass band reaches 0.4 of the sampling rate within 1e-4
KAISER = 8.0  # the window's shape: side lobes of about -80 dB


def line(
    signals: Signals, u: Float[Array, "inputs"], u_next: Float[Array, "inputs"], substeps: int
) -> Float[Array, "stages inputs"]:
    """u at s = 0, 1/2, 1, ... substeps of a step: constant (hold "zero") or straight to `u_next`.

    A band-limited input runs straight too: its curve would need samples of the future.
    """
    moving = jnp.array([each.hold != "zero" for each in signals.inputs], bool)
    slope = jnp.where(moving, u_next - u, 0.0)
    s = jnp.arange(2 * substeps + 1) / (2 * substeps)
    return u + s[:, None] * slope


def band_limited(u: Float[Array, "samples inputs"], shift: float) -> Float[Array, "samples inputs"]:
    """u a share `shift` of a sample later, 0 <= shift < 1, by Kaiser-windowed sinc interpolation.

    u(k + shift) = sum_j u(j) sinc(k + shift - j) w(k + shift - j)      (J. F. Kaiser, 1974)

    Beyond its ends a signal keeps its first and last value.
    """
    offsets = np.arange(-TAPS + 1, TAPS + 1)
    distance = shift - offsets
    taper = np.i0(KAISER * np.sqrt(np.maximum(1 - (distance / TAPS) ** 2, 0.0))) / np.i0(KAISER)
    taps = np.sinc(distance) * taper
    taps /= taps.sum()
    padded = jnp.concatenate(
        [jnp.repeat(u[:1], TAPS - 1, axis=0), u, jnp.repeat(u[-1:], TAPS, axis=0)]
    )
    return sum(tap * padded[k : k + len(u)] for k, tap in enumerate(taps))  # type: ignore[return-value]


def intersample(
    signals: Signals, u: Float[Array, "samples inputs"], substeps: int
) -> Float[Array, "samples stages inputs"]:
    """u at s = 0, 1/2, 1, ... substeps of every step, by each input's hold; needs even sampling
    where an input is band-limited."""
    u_next = jnp.concatenate([u[1:], u[-1:]])
    stages = 2 * substeps
    zero = jnp.array([each.hold == "zero" for each in signals.inputs], bool)
    curved = jnp.array([each.hold == "band-limited" for each in signals.inputs], bool)
    columns = []
    for k in range(stages + 1):
        straight = u + (k / stages) * (u_next - u)
        if any(each.hold == "band-limited" for each in signals.inputs) and 0 < k < stages:
            straight = jnp.where(curved, band_limited(u, k / stages), straight)
        columns.append(jnp.where(zero, u, straight))
    return jnp.stack(columns, axis=1)
