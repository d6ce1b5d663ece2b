"""Derivatives that stay unbiased under a piecewise-constant input.

Every signal of an equation goes through one B-spline kernel (a box of `width` samples, `order`
times over). A derivative is then an exact difference of window ends, and an input's mean over
the same window is exact under its hold, so for dynamics linear in x both sides of dx = F(x, u)
are filtered alike and no bias is left:

    (x(t+W) - x(t)) / W  =  (1/W) integral of F(x, u) over [t, t+W]

The price is noise, which `noise_gain` states.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["WIDTHS", "Kernel", "choose_kernel", "noise_sd"]

TARGET_SHARE = 0.01  # noise in a derivative, as a share of its own spread, that is small enough
KEPT = 0.95  # of an input's spread is left by a kernel that still lets it excite
# half widths of kernels that are tried [samples]
WIDTHS = (1, 2, 4, 6, 10, 16, 24, 40, 64, 100, 160, 250, 400)

Signal = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Kernel:
    """A box of `width` sample intervals applied `order` times, on a uniform grid.

    `order * width` is even, so that the kernel's centre is a sample.
    """

    order: int
    width: int

    @property
    def half(self) -> int:
        """Samples lost at either end."""
        return self.order * self.width // 2

    def smooth(
        self, x: Signal, step: float, *, derivative: int = 0, held: bool = False
    ) -> Float[np.ndarray, "smoothed"]:
        """The kernel's mean of d^r x / dt^r; `held` signals are constant between samples.

        `x` in its own unit, `step` in s; the result has 2 * `half` samples fewer.
        """
        n = self.width
        for level in range(self.order):
            if level < derivative:
                x = (x[n:] - x[:-n]) / (n * step)
                continue
            area = x[:-1] if held and level == 0 else (x[1:] + x[:-1]) / 2
            total = np.concatenate([[0.0], np.cumsum(area)])
            x = (total[n:] - total[:-n]) / n
        return x

    def noise_gain(self, derivative: int, step: float) -> float:
        """Standard deviation of the result per unit of white noise in x [1/s^r]."""
        length = 2 * self.order * self.width + 1
        impulse = np.zeros(length + self.order * self.width)
        impulse[length // 2 + self.half] = 1.0
        return float(np.linalg.norm(self.smooth(impulse, step, derivative=derivative)))


def noise_sd(x: Signal, inputs: Sequence[Signal] = ()) -> float:
    """Standard deviation of white noise in a signal that is smooth but for held `inputs`.

    From its third differences, var = 20 var(noise); the median makes them blind to jumps. What a
    broad-band input does to them is no noise: the smaller of two estimates counts, before and
    after the inputs' part (linear in the four samples that a third difference spans) is taken off.
    """
    if len(x) < 8:
        return 0.0
    third = np.diff(x, 3)
    found = np.median(np.abs(third))
    if inputs and len(third) > 50 * len(inputs):
        lagged = np.stack([u[k : k + len(third)] for u in inputs for k in range(4)], axis=1)
        lagged = np.append(lagged, np.ones((len(third), 1)), axis=1)
        rest = third - lagged @ np.linalg.lstsq(lagged, third, rcond=None)[0]
        found = min(found, np.median(np.abs(rest)))
    return float(found / 0.6745 / np.sqrt(20.0))


def _spread_left(kernel: Kernel, step: float, inputs: Sequence[Float[np.ndarray, "_"]]) -> float:
    """The smallest share of an input's spread that the kernel's mean keeps."""
    usable = [u for u in inputs if len(u) > 2 * kernel.half + 1 and np.std(u) > 0]
    shares = [np.std(kernel.smooth(u, step, held=True)) / np.std(u) for u in usable]
    return float(min(shares, default=1.0))


def choose_kernel(
    signals: list[Float[np.ndarray, "_"]],
    step: float,
    derivative: int,
    noise: float,
    inputs: Sequence[Float[np.ndarray, "_"]] = (),
) -> Kernel:
    """The narrowest kernel that leaves noise below 1 % of the derivative's spread.

    Where none does, the one with the best ratio. `noise` is the signal's own noise
    (its unit); a noise-free signal gets the narrowest kernel there is. No kernel is taken that
    averages away more than 5 % of the spread of one of the held `inputs`: what they excite would
    be lost, and their range with it.
    """
    longest = max(len(x) for x in signals)
    best, best_share = None, np.inf
    for width in WIDTHS:
        order = derivative if width <= 2 else derivative + 1
        order += (order * width) % 2
        kernel = Kernel(max(order, 1), width)
        if best is not None and (
            2 * kernel.half > longest // 10 or _spread_left(kernel, step, inputs) < KEPT
        ):
            break
        usable = [x for x in signals if len(x) > 2 * kernel.half + 1]
        if not usable:
            break
        slopes = np.concatenate([kernel.smooth(x, step, derivative=derivative) for x in usable])
        spread = float(np.std(slopes))
        share = noise * kernel.noise_gain(derivative, step) / spread if spread > 0 else np.inf
        if best is None or share < best_share:
            best, best_share = kernel, share
        if share <= TARGET_SHARE:
            break
    return best or Kernel(max(derivative, 1) + max(derivative, 1) % 2, 1)
