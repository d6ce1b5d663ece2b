"""`check`: fit, calibrate and estimate in one, with nothing used twice."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from faultgauge.detection.calibration import Calibration, calibrate
from faultgauge.detection.estimation import Event, Judgement, estimate, sentences
from faultgauge.detection.judged import Bank
from faultgauge.errors import InputError
from faultgauge.identification.fit import FitReport, fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run, cut, plant_skeleton

__all__ = ["Checkup", "black_box", "check", "parts"]

FIT_SHARE = 0.6  # of each healthy run; the rest validates and calibrates


@dataclass(frozen=True)
class Checkup:
    """Everything that a check found."""

    model: Model
    account: FitReport
    calibration: Calibration
    judgements: list[Judgement]
    bank: Bank
    held_out: list[Run]

    @property
    def events(self) -> list[Event]:
        return [event for judgement in self.judgements for event in judgement.events]

    @property
    def sentences(self) -> list[str]:
        return sentences(self.model, self.events)


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
    """A plant for logs without a plant file: a network per state, a fault on each state.

    Raises `InputError` where no column looks like an input.
    """
    text = plant_skeleton(runs, name)
    spec = parse_plant(text, "the plant guessed from the log")
    if not spec.signals.inputs:
        raise InputError(
            f"{runs[0].source}: no column looks like an input (names such as u, u_cmd, voltage); "
            "rename one with --map u=COLUMN, or give a plant file with --plant (draft one with "
            "`faultgauge inspect LOG --init-plant plant.toml`)."
        )
    faults = "".join(
        f'\n[faults.{state.name}_drift]\nenters = "state"\ntarget = "{state.name}"\n'
        for state in spec.signals.states
    )
    return GrayBoxPlant.untrained(parse_plant(text + faults, "the plant guessed from the log"))


def check(
    plant: GrayBoxPlant,
    healthy: Sequence[Run],
    suspect: Sequence[Run],
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Checkup:
    """Fit on the first 60 % of each healthy run, validate and calibrate on the rest, then judge
    `suspect`. Raises `InputError` as its steps do."""
    training, held_out = parts(healthy, FIT_SHARE)
    model, account = fit(plant, training, held_out, seed=seed, progress=progress)
    calibration = calibrate(model, held_out, progress=progress)
    judgements, bank = estimate(calibration.model, suspect)
    return Checkup(calibration.model, account, calibration, judgements, bank, held_out)
