"""Instrumental variables for closed-loop logs: the equations fitted by two-stage least squares.

In a closed loop u answers to noise and disturbances, so that x and u correlate with the error of
the equations, and least squares is biased, the more the higher the loop's gain. A reference from
outside the loop correlates with neither. Stage one projects all signals on the references and
their past; stage two minimises

    || Q^T r(theta) ||^2,   r(theta) = F(x, u; theta) - dx,   Q a basis of dr/dtheta

with dr/dtheta taken at the projected, noise-free signals: the non-linear two-stage least squares
of T. Amemiya (J. Econometrics 2, 1974). For equations linear in x, u and theta it is the estimator
of T. Soderstrom and P. Stoica (System Identification, 1989, ch. 8 and 10); that the best
instruments are the loop's noise-free signals, see M. Gilson and P. Van den Hof, "Instrumental
variable methods for closed-loop system identification" (Automatica 41, 2005).
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.optimise.levenberg_marquardt import Options, levenberg_marquardt
from faultgauge.identification.samples import Samples, Stretch
from faultgauge.plants.signals import Signals
from faultgauge.programs import program
from faultgauge.telemetry import Run

__all__ = ["project", "reference_columns", "refit"]

MEMORY = 1 / 8  # of the longest stretch: how much of a reference's past can matter
PER_OCTAVE = 4  # boxes into which each doubling of the age of the past is cut
BLOCKS = 10  # of the log, each predicted from the others
TINY = 1e-9  # of the largest component: rounding
FEWEST = 0.01  # share of u that its instrument must explain
KNOWN = 0.5  # a direction of theta with a larger standard error stays where it was
PASSES = 3  # dr/dtheta moves with theta where the equations are not linear in it
OPTIONS = Options(max_trials=50)


def reference_columns(signals: Signals, runs: Sequence[Run]) -> tuple[str, ...]:
    """The instruments' columns. Raises `InputError` for one that is missing or never changes."""
    for each in signals.inputs:
        column = each.instrument
        if column is None:
            continue
        for run in runs:
            if column not in run.columns:
                raise InputError(
                    f"{run.source} has no column {column!r}, the instrument of input "
                    f'{each.name!r}; name one with --map "{column}=EXPRESSION", or remove '
                    f"instrument from [inputs.{each.name}]."
                )
        values = np.concatenate([run.columns[column] for run in runs])
        if np.nanmin(values) == np.nanmax(values):
            raise InputError(
                f"{runs[0].source}: column {column!r}, the instrument of input {each.name!r}, "
                "never changes, so it explains nothing; give a log in which the reference moves, "
                f"or remove instrument from [inputs.{each.name}]."
            )
    return signals.instruments


def project(
    signals: Signals, stretches: Sequence[Stretch], masks: Sequence[Bool[np.ndarray, "_"]]
) -> tuple[Samples, dict[str, float]]:
    """Stage one: what of the samples that `masks` keep, joined, comes from the references, and the
    share of its variance that they explain of every input with an instrument.

    Inputs without one are taken for exogenous. Every block of the log is predicted from a fit to
    the others (J. D. Angrist, G. W. Imbens and A. B. Krueger, J. Applied Econometrics 14, 1999):
    a fit to itself would follow its noise, and bias stage two. Raises `InputError` for an
    instrument that explains less than 1 % of its input.
    """
    free = [k for k, each in enumerate(signals.inputs) if each.instrument is None]
    outside = [np.concatenate([s.references, s.samples.u[:, free]], axis=1) for s in stretches]
    edges = _ages(stretches)
    features = _joined([_past(signal, edges) for signal in outside], masks)
    x, u, dx, y = (
        _joined(arrays, masks) for arrays in zip(*(s.samples for s in stretches), strict=True)
    )
    targets = np.concatenate([x, u, dx], axis=1)
    part_x, part_u, part_dx = np.split(
        _crossed(features, targets), [x.shape[1], x.shape[1] + u.shape[1]], axis=1
    )
    part_u[:, free] = u[:, free]
    explained = {}
    for k, each in enumerate(signals.inputs):
        if each.instrument is not None:
            left = np.mean((u[:, k] - part_u[:, k]) ** 2)
            share = explained[each.name] = float(1 - left / max(np.var(u[:, k]), 1e-300))
            if share < FEWEST:
                raise InputError(
                    f"column {each.instrument!r}, the instrument of input {each.name!r}, explains "
                    f"{100 * max(share, 0.0):.1f} % of it in the logs, too little to fit with; "
                    "name the reference that the controller follows, or remove instrument from "
                    f"[inputs.{each.name}]."
                )
    return Samples(part_x, part_u, part_dx, y), explained


def _joined(parts: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([part[mask] for part, mask in zip(parts, masks, strict=True)])


def _ages(stretches: Sequence[Stretch]) -> list[int]:
    """Edges [samples] of the boxes into which the past is cut: finer where it is recent."""
    memory = max(2.0, max(len(s.t) for s in stretches) * MEMORY)
    ages = np.geomspace(1, memory, max(2, int(PER_OCTAVE * np.log2(memory))))
    return [0, *np.unique(np.round(ages).astype(int)).tolist()]


def _past(
    signal: Float[np.ndarray, "samples signals"], edges: Sequence[int]
) -> Float[np.ndarray, "samples features"]:
    """The means of `signal` over every box of its past; before its start, its first value."""
    longest = edges[-1]
    before = np.repeat(signal[:1], longest, axis=0)
    total = np.cumsum(np.concatenate([np.zeros_like(signal[:1]), before, signal]), axis=0)
    end = longest + 1 + np.arange(len(signal))  # total[end] sums up to and with the sample itself
    boxes = [(total[end - a] - total[end - b]) / (b - a) for a, b in itertools.pairwise(edges)]
    return np.concatenate(boxes, axis=1)


def _crossed(
    features: Float[np.ndarray, "samples features"], targets: Float[np.ndarray, "samples signals"]
) -> Float[np.ndarray, "samples signals"]:
    """Every block of `targets` from the features, by least squares on the other blocks.

    Of the features' principal components as many are used, for each target, as predict it best.
    """
    block = np.arange(len(targets)) * BLOCKS // len(targets)
    spread = features.std(axis=0)
    features = features / np.where(spread > 0, spread, 1.0)
    count = features.shape[1]
    ranks = [*(2**k for k in range(count.bit_length()) if 2**k < count), count]
    predicted = np.empty((len(ranks), *targets.shape))
    for number in range(BLOCKS):
        own = block == number
        center, mean = features[~own].mean(axis=0), targets[~own].mean(axis=0)
        left, size, axes = np.linalg.svd(features[~own] - center, full_matrices=False)
        scores = left.T @ (targets[~own] - mean) / np.maximum(size, TINY * size[0])[:, None]
        along = (features[own] - center) @ axes.T
        for k, rank in enumerate(ranks):
            predicted[k, own] = along[:, :rank] @ scores[:rank] + mean
    best = np.argmin(np.sum((predicted - targets) ** 2, axis=1), axis=0)
    return predicted[best, :, np.arange(targets.shape[1])].T


class _Correlation(eqx.Module):
    """Q^T r(theta), for all samples at once."""

    residual: Callable[[Array, Any], Array]

    def __call__(
        self, theta: Float[Array, "unknowns"], given: tuple[Samples, Array]
    ) -> Float[Array, "unknowns"]:
        samples, basis = given
        r = jax.vmap(self.residual, (None, 0))(theta, samples)
        return basis.T @ r.ravel()


def refit(
    residual: Callable[[Array, Any], Array],
    theta: Float[np.ndarray, "unknowns"],
    samples: Samples,
    exogenous: Samples,
    bounds: tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]],
) -> Float[np.ndarray, "unknowns"]:
    """Stage two from the least-squares fit `theta`: `residual(theta, sample)` as it was fitted,
    `exogenous` the samples' projections. Directions that the references do not determine stay."""
    lower, upper = map(jnp.asarray, bounds)
    given, projected = jax.tree.map(jnp.asarray, (samples, exogenous))
    for _ in range(PASSES):
        basis = _basis(residual, jnp.asarray(theta), given, projected)
        solution = levenberg_marquardt(
            _Correlation(residual),
            jnp.asarray(theta)[None],
            jax.tree.map(lambda a: a[None], (given, basis)),
            None,
            lower,
            upper,
            OPTIONS,
        )
        theta = np.asarray(solution.theta[0])
    return theta


@program
def _basis(
    residual: Callable[[Array, Any], Array], theta: Array, samples: Samples, exogenous: Samples
) -> Float[Array, "equations unknowns"]:
    """Orthonormal columns that span dr/dtheta at the projections; zero where not determined."""
    slopes = jax.vmap(jax.jacrev(residual), (None, 0))(theta, exogenous)
    error = jnp.sqrt(jnp.mean(jax.vmap(residual, (None, 0))(theta, samples) ** 2))
    rows = slopes.reshape(-1, theta.size)
    rows = jnp.where(jnp.isfinite(rows), rows, 0.0)  # LAPACK may not end on what is infinite
    left, size, _ = jnp.linalg.svd(rows, full_matrices=False)
    return jnp.where(error < KNOWN * size, left, 0.0)
