"""How large noise and faults are that matter: what a figure's axes span at least."""

import numpy as np

from faultgauge.detection.answer.least import least_told
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.uncalibrated import uncalibrated
from faultgauge.plants.model import Model

__all__ = ["least_sizes", "noise_scales"]


def noise_scales(model: Model) -> dict[str, float]:
    """Standard deviation of each output's noise [its unit]; 0 where none was calibrated."""
    names = model.plant.signals.output_names
    sigma = np.zeros(len(names)) if uncalibrated(model) else noise_of(model).sigma
    return dict(zip(names, sigma.tolist(), strict=True))


def least_sizes(bank: FaultBank, decision: Decision) -> list[float]:
    """The smallest size of each fault [its unit] that would have been told of a run, or the widest
    that is expected where none would."""
    found = [least_told(bank, decision, k) for k in range(len(bank.size))]
    return [
        float(size) if least is None else least
        for size, least in zip(bank.size, found, strict=True)
    ]
