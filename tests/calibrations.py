"""Calibrations made by hand."""

from faultgauge.plants.record import BankLevel, CalibrationRecord, NoiseLevels

LEVEL = {
    "level": 3.0, "widened": 1.0, "mtbfa_s": 3e3, "confidence": 0.95, "judged_s": 1e4,
    "healthy_s": 1e4, "memory_s": 20.0, "alarms": 0, "blocks": 20, "block_s": 500.0,
    "samples": 10**5, "size": {}, "suspects": [],
}  # fmt: skip


def for_bank(model, noise, repeats=None, **level):
    """`model` with `noise` (or its levels by name), and an alarm `level` like any other where
    nothing else is given."""
    levels = noise if isinstance(noise, dict) else noise.as_dict(model)
    told = for_observer(model, repeats).calibration.as_dict() | {"observer": "bank"}
    bank = BankLevel(**LEVEL | level)
    return model.with_calibration(CalibrationRecord(**told, noise=NoiseLevels(**levels), bank=bank))


def for_observer(model, repeats=None):
    """`model` as calibrated for an observer alone, of which nothing is told but what `repeats`."""
    return model.with_calibration(CalibrationRecord(observer="eso", data=[], repeats=repeats or {}))
