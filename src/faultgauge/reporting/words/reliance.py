"""That answers are little to rely on, where a model does not follow its own healthy logs."""

from faultgauge.detection.answer.reliance import worst_error
from faultgauge.detection.words import number
from faultgauge.plants.model import Model

__all__ = ["doubt", "headed"]

HEAD = "Little to rely on: "


def doubt(model: Model) -> str | None:
    """That answers of a calibrated `model` are little to rely on, and why; None where they may be
    relied on."""
    worst = worst_error(model)
    if worst is None:
        return None
    state, times = worst
    return (
        "little to rely on, as the model does not follow its own healthy logs: its free run is "
        f"{100 * model.record.metrics.free_run_error:.0f} % off, and its error is "
        f"{number(times, 2)} times what it explains of d({state})"
    )


def headed(model: Model, sentence: str) -> str:
    """`sentence`, behind a word of doubt where that is due to all that `model` says; why, is said
    once beside its answers."""
    if doubt(model) is None:
        return sentence
    first = sentence.partition(" ")[0]
    named = first in model.plant.signals.fault_names  # which stays as it is written
    return f"{HEAD}{sentence if named else sentence[0].lower() + sentence[1:]}"
