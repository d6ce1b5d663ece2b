"""Where the model errs more than elsewhere, by what the innovation likelihood gains.

A pump that gives nothing below a volt, a motor that does not move under small ones, a bearing whose
friction turns round: in a part of the range of an input, or of a state that an output measures, the
model may err far more than elsewhere, and noise of one size would be too large elsewhere and too
small there. What acts at random is then larger there: the edge of that part and how many times as
large are two levels more, and must gain what Schwarz's criterion asks of two (G. Schwarz, Ann.
Stat. 6 (1978)).
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
MOST = 2  # inputs and states with such a part


class _Part(NamedTuple):
    """A part of the range of an input (or, behind them, a state) of that `number`, from its edge in
    the sense of `towards` (below it, above it, or 0: around zero up to it), that holds a `share` of
    the samples."""

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
    """`noise` with a part of the range of those inputs and states that gain by it while all else
    stays, the one that gains most first."""
    signals, y = model.plant.signals, np.asarray(batch.y)
    sampled = np.isfinite(y).any(axis=2)  # stretches are padded to one length
    measured = {each.measures: y[..., j] for j, each in enumerate(signals.outputs)}
    nowhere = np.full(1, np.nan)
    values = list(np.asarray(batch.u)[sampled].T)
    values += [measured.get(name, nowhere) for name in signals.state_names]
    for _ in range(MOST):
        found = _with_one(model, batch, noise, [each[np.isfinite(each)] for each in values])
        if found is None:
            break
        noise = found
    return noise


def _with_one(
    model: Model, batch: Likelihood, noise: Noise, places: Sequence[Float[np.ndarray, "_"]]
) -> Noise | None:
    """`noise` with a part for one more of the `places`, inputs and states with their values; None
    where none gains enough."""
    parts = [
        _Part(k, towards, share)
        for k, values in enumerate(places)
        if not noise.doubt[k] and len(values) and np.ptp(values) > 0
        for towards, share in product(
            (-1, 0, 1) if min(values) < 0 < max(values) else (-1, 1), SHARES
        )
    ]
    if not parts:
        return None
    # 1, where nothing is larger, so that one program looks at all these places
    looked_at = np.isin(np.arange(len(places)), [part.number for part in parts])
    alike = np.where(looked_at, 1.0, noise.doubt)

    def tried(part: _Part, times: float) -> Noise:
        one = np.arange(len(places)) == part.number
        low, high = part.ends(places[part.number])
        return noise._replace(
            doubt=np.where(one, times, alike),
            above=np.where(one, low, noise.above),
            below=np.where(one, high, noise.below),
        )

    none = noise._replace(doubt=alike)
    cost = batch.run([none, *(tried(part, FIRST) for part in parts)]).cost
    closer = [parts[k] for k in np.argsort(cost[1:])[:BEST]]
    many = [
        tried(part._replace(share=scale * part.share), times)
        for part, scale, times in product(closer, CLOSER, TIMES)
    ]
    found = batch.run(many).cost
    best = many[int(np.argmin(found))]
    if cost[0] - found.min() <= np.log(batch.count):
        return None
    return best._replace(doubt=np.where(best.doubt > 1, best.doubt, 0.0))
