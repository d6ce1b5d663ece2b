"""Where the model errs more than elsewhere, by what the innovation likelihood gains.

A pump that gives nothing below a volt, a motor that does not move under small ones: in a part of
the range of an input the model may err far more than elsewhere, and noise of one size would be too
large elsewhere and too small there. What acts at random is then larger there: the edge of that
part and how many times as large are two levels more, and must gain what Schwarz's criterion asks
of two (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.plants.model import Model

__all__ = ["with_doubted_regions"]

SHARES = (1 / 4, 1 / 16, 1 / 64, 1 / 256)  # of the samples that such a part holds
CLOSER = (0.5, 1.0, 2.0)  # times that
TIMES = (2.0, 4.0, 8.0, 16.0)  # as large there
FIRST = 4.0  # of these, by which the parts are told apart
BEST = 3  # parts that are looked at more closely
MOST = 2  # inputs with such a part


class _Part(NamedTuple):
    """A part of the range of input number `number`, from its edge in the sense of `towards` (below
    it, above it, or 0: around zero up to it), that holds a `share` of the samples."""

    number: int
    towards: int
    share: float

    def ends(self, values: Float[np.ndarray, "samples"]) -> tuple[float, float]:
        """(lower, upper) end of it."""
        if self.towards < 0:
            return -np.inf, float(np.quantile(values, self.share))
        if self.towards > 0:
            return float(np.quantile(values, 1 - self.share)), np.inf
        edge = float(np.quantile(np.abs(values), self.share))
        return -edge, edge


def with_doubted_regions(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with a part of the range of those inputs that gain by it while all else stays, the
    one that gains most first."""
    sampled = np.isfinite(np.asarray(batch.y)).any(axis=2)  # stretches are padded to one length
    inputs = list(np.asarray(batch.u)[sampled].T)
    for _ in range(MOST):
        found = _with_one(model, batch, noise, inputs)
        if found is None:
            break
        noise = found
    return noise


def _with_one(
    model: Model, batch: Likelihood, noise: Noise, inputs: Sequence[Float[np.ndarray, "_"]]
) -> Noise | None:
    """`noise` with a part for one more input; None where none gains enough."""

    def tried(part: _Part, times: float) -> Noise:
        one = np.arange(len(inputs)) == part.number
        low, high = part.ends(inputs[part.number])
        return noise._replace(
            doubt=np.where(one, times, noise.doubt),
            above=np.where(one, low, noise.above),
            below=np.where(one, high, noise.below),
        )

    parts = [
        _Part(k, towards, share)
        for k, values in enumerate(inputs)
        if not noise.doubt[k] and np.ptp(values) > 0
        for towards, share in product(
            (-1, 0, 1) if min(values) < 0 < max(values) else (-1, 1), SHARES
        )
    ]
    if not parts:
        return None
    # a part in which nothing is larger has the program of the others
    none = tried(parts[0], 1.0)
    cost = batch.run(model, [none, *(tried(part, FIRST) for part in parts)]).cost
    closer = [parts[k] for k in np.argsort(cost[1:])[:BEST]]
    many = [
        tried(part._replace(share=scale * part.share), times)
        for part, scale, times in product(closer, CLOSER, TIMES)
    ]
    found = batch.run(model, many).cost
    best = int(np.argmin(found))
    return many[best] if cost[0] - found[best] > np.log(batch.count) else None
