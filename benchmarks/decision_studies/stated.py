"""Models that nobody fitted: a plant as its file has it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.record import FitRecord

__all__ = ["as_stated"]


def as_stated(
    plant: GrayBoxPlant,
    points: Float[np.ndarray, "points names"],
    states: Sequence[str],
    outputs: Sequence[str],
    max_step: float,
) -> Model:
    """`plant` with its own values, the `points` (states, then inputs) being what training covered;
    `states` and `outputs` are columns, `max_step` [s] the longest step of a free run."""
    record = FitRecord(
        max_step=max_step,
        sample_time=max_step,
        envelope={},
        envelope_points=points.tolist(),
        columns={"states": [(name, 0) for name in states], "outputs": list(outputs)},
        data={"fit": [], "validate": []},
        derivatives={},
        metrics={"validation_free_run_nrmse": None},
    )
    return Model(plant, record)
