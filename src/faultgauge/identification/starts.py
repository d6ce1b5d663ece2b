"""Where training starts: Nguyen-Widrow networks and scattered parameters."""

import numpy as np
from jaxtyping import Float

from faultgauge.plants.shape import FREE, Shape

__all__ = ["nguyen_widrow", "scattered"]

SOFTPLUS_ONE = float(np.log(np.expm1(1.0)))  # softplus of it is 1


def nguyen_widrow(
    hidden: int, arity: int, rng: np.random.Generator, shape: Shape = FREE
) -> dict[str, Float[np.ndarray, "..."]]:
    """Weights that spread the active regions of the hidden units over inputs in [-1, 1].

        |W2_i| = 0.7 H^(1/n),   theta_i spaced evenly over [-|W2|, |W2|]

    D. Nguyen and B. Widrow, "Improving the learning speed of 2-layer neural networks by choosing
    initial values of the adaptive weights", IJCNN 1990. For a `shape`: the units of an odd
    network stand on one side, as each has its mirror image; the weights of a monotone one are
    the roots of such weights; a positive one starts around its output scale.
    """
    length = 0.7 * hidden ** (1 / arity)
    direction = rng.uniform(-1, 1, (hidden, arity))
    weights = length * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    spread = np.linspace(-1, 1, hidden) if hidden > 1 else np.zeros(1)
    if shape.odd:
        spread = (np.arange(hidden) + 0.5) / hidden
    outer = 0.5 * rng.uniform(-1, 1, hidden)
    if shape.monotone:
        weights, outer = np.sqrt(np.abs(weights)), np.sqrt(np.abs(outer))
    return {
        "weights_out": outer,
        "weights_in": weights,
        "bias": length * spread * np.sign(weights[:, 0]),
        "bias_out": np.asarray(SOFTPLUS_ONE if shape.positive else 0.0),
    }


def scattered(
    value: float, low: float, high: float, rng: np.random.Generator
) -> Float[np.ndarray, ""]:
    """A parameter's start: up to 3 times its stated value either way, inside its bounds."""
    factor = 3.0 ** rng.uniform(-1, 1)
    start = value * factor if value else rng.uniform(-1, 1)
    return np.asarray(np.clip(start, low, high))
