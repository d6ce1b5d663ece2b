"""The bank over a model that was not calibrated for it: rows that say so."""

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.priors import sizes_of
from faultgauge.detection.posterior.posterior import WIDE, Posterior
from faultgauge.detection.remember import once
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.plants.record import BankLevel
from faultgauge.telemetry import Run

__all__ = ["level_in", "prior_of", "uncalibrated"]


def uncalibrated(model: Model) -> str:
    """The reason of every row; empty where `model` holds all that the bank needs."""
    if model.calibration is None:
        return "not calibrated"
    return "" if model.calibration.bank is not None else "not calibrated for the bank"


def level_in(model: Model) -> BankLevel:
    """The bank's alarm level. Raises `InputError` for a model without it."""
    if model.calibration is None or model.calibration.bank is None:
        raise InputError(
            "the model is not calibrated for the bank; run `faultgauge calibrate` on healthy logs."
        )
    return model.calibration.bank


@once
def _reach(model: Model) -> Float[np.ndarray, "faults"]:
    """How far the prior of each fault reaches; a stream asks at every row."""
    return WIDE * sizes_of(model, model.plant)


def prior_of(model: Model, run: Run) -> Posterior:
    """No probabilities, and every fault as its prior has it."""
    signals, count = model.plant.signals, len(run.t)
    faults = signals.faults
    nothing = np.full((count, len(faults)), np.nan)
    reach = _reach(model)
    on = np.where([fault.monitor == "disabled" for fault in faults], np.nan, 1.0)
    lo = on * np.maximum(-reach, [fault.min for fault in faults])
    hi = on * np.minimum(reach, [fault.max for fault in faults])
    no = np.zeros(count, bool)
    return Posterior(
        p=nothing,
        f=np.tile(0.0 * on, (count, 1)),
        lo=np.tile(lo, (count, 1)),
        hi=np.tile(hi, (count, 1)),
        healthy=np.full(count, np.nan),
        unknown=np.full(count, np.nan),
        calm=np.full(count, np.nan),
        sd=nothing,
        seen=np.zeros((count, len(faults), 2), bool),
        outside=np.ones(count, int),
        x=np.full((count, len(signals.states)), np.nan),
        onset=np.zeros((count, len(faults), 2)),
        ever=np.zeros((count, len(faults))),
        held=no,
    )
