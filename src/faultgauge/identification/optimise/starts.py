"""Where training starts: Nguyen-Widrow networks and scattered parameters."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.plants.network import Network
from faultgauge.plants.shape import FREE, Shape

__all__ = ["Box", "nguyen_widrow", "scattered", "spread_over"]

SOFTPLUS_ONE = float(np.log(np.expm1(1.0)))  # softplus of it is 1


class Box(NamedTuple):
    """Where arguments lie: centers and half widths."""

    center: Float[np.ndarray, "arguments"]
    half: Float[np.ndarray, "arguments"]


def nguyen_widrow(
    hidden: int,
    arity: int,
    rng: np.random.Generator,
    shape: Shape = FREE,
    box: Box | None = None,
) -> dict[str, Float[np.ndarray, "..."]]:
    """Weights that spread the active regions of the hidden units over inputs in [-1, 1], or `box`.

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
        weights, outer = np.abs(weights), np.sqrt(np.abs(outer))
    bias = length * spread * np.sign(weights[:, 0])
    if box is not None:  # W (p - center) / half + theta
        weights = weights / box.half
        bias = bias - weights @ box.center
    return {
        "weights_out": outer,
        "weights_in": np.sqrt(weights) if shape.monotone else weights,
        "bias": bias,
        "bias_out": np.asarray(SOFTPLUS_ONE if shape.positive else 0.0),
    }


def spread_over(
    network: Network, rng: np.random.Generator, crowd: Box | None = None
) -> dict[str, Float[np.ndarray, "..."]]:
    """Nguyen-Widrow's weights for `network`, over its arguments' range or where they `crowd`."""
    box = None
    if crowd is not None:
        center, scale = np.asarray(network.input_center), np.asarray(network.input_scale)
        box = Box((crowd.center - center) / scale, crowd.half / scale)
    hidden, arity = network.weights_in.shape
    return nguyen_widrow(hidden, arity, rng, network.shape, box)


def scattered(
    value: float, low: float, high: float, rng: np.random.Generator
) -> Float[np.ndarray, ""]:
    """A parameter's start: up to 3 times its stated value either way, inside its bounds."""
    factor = 3.0 ** rng.uniform(-1, 1)
    start = value * factor if value else rng.uniform(-1, 1)
    return np.asarray(np.clip(start, low, high))
