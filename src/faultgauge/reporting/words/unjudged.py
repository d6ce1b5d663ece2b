"""Why nothing is decided: a model that is not calibrated, an observer alone."""

from faultgauge.detection.answer.estimation import ALONE, intervals_in
from faultgauge.plants.model import Model

__all__ = ["observer_sentence", "unjudged_sentence"]


def unjudged_sentence(model: Model) -> str:
    """What the silence means, and what to do."""
    if model.calibration is None:
        return "Not calibrated, so nothing was judged: run `faultgauge calibrate` on healthy logs."
    why = model.calibration.no_bank or "run `faultgauge calibrate` on healthy logs again."
    return (
        f"Calibrated without noise and alarm level of the bank, so nothing was judged: {why} "
        "Until then `faultgauge estimate --observer eso` gives estimates."
    )


def observer_sentence(model: Model) -> str:
    """What the rows are, and what to do for more."""
    how = (
        "without `--observer` the bank decides"
        if intervals_in(model)
        else "`faultgauge calibrate --observer eso --out OTHER_MODEL` on healthy logs adds "
        "intervals, and without `--observer` the bank decides"
    )
    return f"{ALONE[0].upper()}{ALONE[1:]}: {how}."
