"""How far a model is off its own healthy logs, and what heads its answers where that is far.

Noise and model error that are found on healthy logs keep false alarms rare there. They say nothing
of which fault it is where the model explains little of how the plant moves: its own error then
looks like one fault at one operating point, and like another one elsewhere.
"""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.misfit import typical_errors
from faultgauge.identification.fit import POOR
from faultgauge.identification.noise_floor import noise_floor
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["doubt", "headed", "missed"]

MOST = 100.0  # times the spread: what diverges


def missed(model: Model, runs: Sequence[Run]) -> dict[str, float]:
    """By how much the free run is off each output in healthy `runs`, beyond its noise and as a
    share of its standard deviation, in parts as long as what a fit holds out of a run; outputs that
    could be scored."""
    noise = noise_floor(model.plant.signals, runs)
    found = dict[str, list[float]]()
    for each in typical_errors(model, runs):
        sd = noise[each.output]["sd"] or 0.0
        off = np.sqrt(max(each.error**2 - sd**2, 0.0)) / each.spread
        found.setdefault(each.output, []).append(min(float(off), MOST))
    return {name: float(np.sqrt(np.mean(np.square(parts)))) for name, parts in found.items()}


def doubt(model: Model) -> str | None:
    """What a calibrated `model` misses of its own healthy logs, where that is so much that its
    answers are little to rely on; None where it follows them."""
    known = model.calibration
    shares = {} if known is None or known.missed is None else known.missed
    if not shares:
        return None
    off = float(np.sqrt(np.mean(np.square(list(shares.values())))))
    if off < POOR:
        return None
    worst = max(shares, key=lambda name: shares[name])
    if off < 1:
        return (
            f"Little to rely on, as the model is {100 * off:.0f} % off on its own healthy logs "
            f"(most in {worst})"
        )
    return (
        "Not to be relied on, as on its own healthy logs the model is worse than each output's "
        f"mean (most in {worst})"
    )


def headed(model: Model, sentence: str) -> str:
    """`sentence`, behind what is to be doubted of all that `model` says."""
    reason = doubt(model)
    return sentence if reason is None else f"{reason}: {sentence}"
