"""`check`: fit, calibrate and estimate in one, with nothing used twice."""

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgauge.detection.answer.reliance import errs_by
from faultgauge.detection.bank.bank import FaultBank, evaluated_faults
from faultgauge.detection.calibration.calibration import Calibration, calibrate
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.detection.posterior.uncalibrated import uncalibrated
from faultgauge.errors import InputError
from faultgauge.identification.fit import FitReport, fit
from faultgauge.identification.log_checks import other_units
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.signals import Fault
from faultgauge.reporting.words.answer import answers, first_screen
from faultgauge.reporting.words.reliance import doubt
from faultgauge.reporting.words.unjudged import unjudged_sentence
from faultgauge.telemetry import Run, cut, plant_skeleton

__all__ = ["Checkup", "black_box", "check", "parts", "with_some_fault"]

FIT_SHARE = 0.6  # of each healthy run; the rest validates and calibrates
LEAST_SHARE = 0.4  # where the rest would be too short otherwise
TO_CALIBRATE = 350  # samples: three blocks, and what is held off


@dataclass(frozen=True)
class Checkup:
    """Everything that a check found; no bank where none could be calibrated."""

    model: Model
    account: FitReport
    calibration: Calibration
    decisions: list[Decision]
    bank: FaultBank | None
    held_out: list[Run]

    @property
    def sentences(self) -> list[str]:
        if self.bank is None:
            return [unjudged_sentence(self.model)]
        return answers(self.bank, self.decisions)

    @property
    def first_screen(self) -> list[str]:
        if self.bank is None:
            return self.sentences
        return first_screen(self.bank, self.decisions)


def parts(runs: Sequence[Run], *shares: float) -> list[list[Run]]:
    """Each run cut at the given shares of its length: one list of runs per part."""
    edges = [0.0, *shares, 1.0]
    found: list[list[Run]] = [[] for _ in edges[1:]]
    for run in runs:
        for k, (a, b) in enumerate(itertools.pairwise(edges)):
            piece = cut(run, slice(int(a * len(run.t)), int(b * len(run.t))))
            if len(piece.t) >= 2:
                found[k].append(replace(piece, name=f"{run.name}, part {k + 1}"))
    return found


def black_box(runs: Sequence[Run], name: str) -> GrayBoxPlant:
    """A plant for logs without a plant file: a network per state.

    Raises `InputError` where no column looks like an input.
    """
    units = {column: unit for run in runs for column, unit in run.units.items()}
    text = plant_skeleton(runs, name, units)
    spec = parse_plant(text, "the plant guessed from the log")
    if not spec.signals.inputs:
        raise InputError(
            f"{runs[0].source}: no column looks like an input (names such as u, u_cmd, voltage); "
            "rename one with --map u=COLUMN, or give a plant file with --plant (draft one with "
            "`faultgauge inspect LOG --init-plant plant.toml`)."
        )
    return GrayBoxPlant.untrained(spec)


def with_some_fault(plant: GrayBoxPlant) -> GrayBoxPlant:
    """`plant`; where it declares no fault, one may enter each of its states."""
    if plant.signals.faults:
        return plant
    if not plant.spec.text:
        drifts = tuple(
            Fault(f"{s.name}_drift", "state", s.name, s.unit and f"{s.unit}/s")
            for s in plant.signals.states
        )
        signals = replace(plant.signals, faults=drifts)
        return replace(plant, signals=signals, spec=replace(plant.spec, signals=signals))
    faults = "".join(
        f"\n[faults.{json.dumps(f'{state.name}_drift', ensure_ascii=False)}]\n"
        f'enters = "state"\ntarget = "{state.name}"\n'
        + (f"unit = {json.dumps(f'{state.unit}/s', ensure_ascii=False)}\n" if state.unit else "")
        for state in plant.signals.states
    )
    text = f"{plant.spec.text}\n{faults}"
    return GrayBoxPlant.untrained(parse_plant(text, plant.spec.name))


def check(
    plant: GrayBoxPlant,
    healthy: Sequence[Run],
    suspect: Sequence[Run],
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Checkup:
    """Fit on the first 60 % of each healthy run (40 % at least, where the logs are short), validate
    and calibrate on the rest, then judge `suspect` by the bank. A plant that declares no fault gets
    one on each of its states. Raises `InputError` as its steps do, and where every fault is
    disabled."""
    plant = with_some_fault(plant)
    evaluated_faults(plant.signals)
    unlike = other_units([*healthy, *suspect])
    spare = 1 - TO_CALIBRATE / sum(len(run.t) for run in healthy)
    training, held_out = parts(healthy, float(np.clip(spare, LEAST_SHARE, FIT_SHARE)))
    model, account = fit(plant, training, held_out, seed=seed, progress=progress)
    calibration = calibrate(model, held_out, progress=progress)
    decisions, bank = decide_runs(calibration.model, suspect, progress=progress)
    account = _as_used(account, calibration.model)
    reason = doubt(calibration.model)
    doubts = [*unlike, *([reason] if reason else [])]
    account = account._replace(warnings=[*account.warnings, *doubts])
    return Checkup(calibration.model, account, calibration, decisions, bank, held_out)


def _as_used(account: FitReport, model: Model) -> FitReport:
    """`account`; where it holds the model for useless by its free run, and the calibrated one
    explains more than it errs by, its warning says so: answers come from that one."""
    if account.no_use is None or uncalibrated(model) or doubt(model) is not None:
        return account
    error, left = model.record.metrics.free_run_error, max(errs_by(model).values(), default=0.0)
    said = (
        f"on held-out data the free run is off by {100 * error:.0f} % of each output's standard "
        "deviation; faults are judged beside the sensors, where the calibrated model errs by "
        f"{100 * left:.0f} % at most of what it explains of a derivative"
    )
    warnings = [said if each == account.no_use else each for each in account.warnings]
    return account._replace(warnings=warnings, no_use=None)
