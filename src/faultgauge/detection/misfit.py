"""Logs that the model does not follow: a fault all over them, or the model of another plant.

An alarm level that is found on such logs hides faults, and an alarm over such a log says little of
which fault it is; both answers look sound.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.evaluation import evaluate
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run, cut

__all__ = ["alarmed_throughout", "not_followed"]

LONGEST = 20_000  # samples of a free run
WORSE = 10.0  # times the free run's error on the data that the fit was validated on
NOTABLE = 0.1  # of an output's standard deviation
ALMOST_ALL = 0.8  # of the judged samples of a run
AT_ONCE = 0.05  # of them, within which the alarm begins


def not_followed(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for every one of the healthy `runs` that the model's free run does not follow as
    it followed the data it was validated on."""
    usual = model.record.get("metrics", {}).get("validation_free_run_nrmse")
    if usual is None:
        return []
    found = []
    for run in [cut(run, slice(0, LONGEST)) for run in runs]:
        try:
            scores = evaluate(model.plant, [run], model.max_step)[0]["outputs"]
        except InputError:  # nowhere two samples in a row: nothing to follow
            continue
        for name, score in scores.items():
            error = np.inf if score["nrmse"] is None else score["nrmse"]  # it blew up
            if np.nanstd(run.columns[name]) > 0 and error > max(WORSE * usual, NOTABLE):
                found.append(
                    f"run {run.name}: the model's free run errs by {error:.2g} of {name}'s "
                    f"standard deviation, where it was validated by {usual:.2g}: a fault all over "
                    "this log, or the model of another plant; smaller faults than this error will "
                    "not be told"
                )
    return found


def alarmed_throughout(statuses: Mapping[str, Sequence[str]]) -> list[str]:
    """A sentence for every run whose status is FAULT from its beginning on and nearly always."""
    found = []
    for run, status in statuses.items():
        judged = np.array([each for each in status if each in ("HEALTHY", "FAULT")])
        alarm = judged == "FAULT"
        if len(alarm) and alarm.mean() >= ALMOST_ALL and np.argmax(alarm) <= AT_ONCE * len(alarm):
            found.append(
                f"run {run}: alarm in {alarm.mean():.0%} of what could be judged, from the "
                "beginning on: a fault older than the log, or the model of another plant; "
                "`faultgauge evaluate` on a healthy log of this plant tells"
            )
    return found
