"""From logs to a refined plant, and the account of how it came about."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.identification.holdout import split_record
from faultgauge.identification.optimise.levenberg_marquardt import NOT_CONVERGED, not_converged
from faultgauge.identification.samples import Channels, Samples, slow_columns
from faultgauge.identification.simulation_error.candidate import WARM, Candidate
from faultgauge.identification.simulation_error.courses import Course, PerRun, along_runs
from faultgauge.identification.simulation_error.data import Data
from faultgauge.identification.simulation_error.records import Record, records_of
from faultgauge.identification.simulation_error.search import Search, refine
from faultgauge.identification.simulation_error.uncertainty import ConstantsInformation, information
from faultgauge.identification.sizes import chosen_sizes
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.settle import settle
from faultgauge.plants.signals import Signals
from faultgauge.progress import in_phases
from faultgauge.telemetry import Run

__all__ = ["Members", "Refinement", "refine_on_logs"]


LEARNED = ("networks", "warm start")  # how phases begin that plants without networks do not have
# of a refinement, and how long each takes, about (seconds of EMPS' training record)
PHASES = {
    "simulating the warm start": 2,
    "fitting the physics over short windows": 10,
    "fitting the physics over long windows": 30,
    "choosing the inputs' hold": 5,
    "drifting parameters": 5,
    "fitting the physics with": 5,
    "networks: how many hidden units": 10,
    "networks and physics together": 10,
    "networks: which start to take": 10,
    "networks": 40,
    "warm start, refined": 10,
    "networks: prior weights by evidence": 15,
    "fitting the best with": 10,
    "fitting the best to all samples": 10,
    "weighing the fleet": 3,
    "fitting the best to what was held out": 10,
    "standard errors": 10,
}
PARTS = 4  # of a run, from one to the next of which a constant might change


class Members(NamedTuple):
    """Plants, best first, and the points that the best was fitted to."""

    plants: list[GrayBoxPlant]
    training: Samples


@dataclass(frozen=True)
class Refinement:
    """The refined plant, best of its `members`; `error` is its free-run error on data that no fit
    has seen, a share of the outputs' spread; `tried` names every candidate with that error,
    `chosen` the one that was taken; `per_run` are the runs' own values of the parameters that
    vary, `courses` how those that drift went. `judged` is what `error` is
    of: the same, or where `refitted` the members before they were fitted to those data, too."""

    plant: GrayBoxPlant
    members: list[GrayBoxPlant]
    training: Samples
    judged: Members
    refitted: bool
    error: float
    substeps: int
    sample_time: float
    choices: dict[str, dict[str, Any]]
    tried: list[tuple[str, float]]
    chosen: str
    information: ConstantsInformation
    warnings: list[str]
    per_run: PerRun = field(default_factory=dict)
    courses: dict[str, list[Course]] = field(default_factory=dict)

    def metrics(self) -> dict[str, Any]:
        """For the model's record."""
        return {
            "substeps": self.substeps,
            "refitted": self.refitted,
            "tried": [[name, None if np.isinf(e) else e] for name, e in self.tried],
            "chosen": self.chosen,
            "per_run": self.per_run,
            "courses": {n: [c._asdict() for c in each] for n, each in self.courses.items()},
            **self.information.to_dict(),
        }


def _phases(plant: GrayBoxPlant) -> dict[str, int]:
    return {
        name: length
        for name, length in PHASES.items()
        if plant.spec.networks or not name.startswith(LEARNED)
    }


def refine_on_logs(
    plant: GrayBoxPlant,
    warm: Sequence[GrayBoxPlant],
    logs: Sequence[Run],
    validate: Sequence[Run],
    how: Channels,
    seed: int,
    restarts: int,
    robust: bool,
    progress: Callable[[str], None],
) -> Refinement:
    """Refine `plant` from the `warm` starts on `logs`; hold out parts of them unless there are
    runs to `validate` on."""
    progress = in_phases(progress, _phases(plant))
    records = records_of(plant.signals, logs, how)
    held = records_of(plant.signals, validate, how) if validate else []
    whole = [np.ones(len(record.t), bool) for record in records]
    masks = whole if held else [split_record(len(record.t)) for record in records]
    found = refine(
        plant,
        warm,
        records,
        masks,
        held,
        seed=seed,
        restarts=restarts,
        robust=robust,
        # on few samples luck would choose it, biased as it is
        warm_counts=not slow_columns(how, logs),
        progress=progress,
    )
    judged = _members(found, found.members, found.data)
    data = found.data.with_held_out() if found.refitted else found.data
    shipped = _members(found, found.refitted, data) if found.refitted else judged
    best = (found.refitted or found.members)[0]
    progress("standard errors")
    known = _information(best, data)
    per_run, courses = along_runs(best, data)
    unfinished = _unfinished(best, bool(warm) and not found.won)
    warnings = [*_unmoved(plant.signals, records), *found.notes, *known.warnings(), *unfinished]
    return Refinement(
        plant=shipped.plants[0],
        members=shipped.plants,
        training=shipped.training,
        judged=judged,
        refitted=bool(found.refitted),
        error=best.validation,
        substeps=data.substeps,
        sample_time=float(np.median([record.step for record in records])),
        choices={"hold": found.holds, "hidden": chosen_sizes(plant.spec, best.plant)},
        tried=found.tried,
        chosen=best.origin,
        information=known,
        warnings=warnings,
        per_run=per_run,
        courses=courses,
    )


def _information(best: Candidate, data: Data) -> ConstantsInformation:
    return information(
        best.plant,
        best.unknowns,
        best.fitted,
        data.windows(data.pieces),
        data.substeps,
        best.ridge,
        best.claims,
        # of whole runs; the windows of long ones are parts already
        parts=PARTS if len(data.pieces) == len({p.record for p in data.pieces}) else 1,
        weight=data.prior,
    )


def _unmoved(signals: Signals, records: Sequence[Record]) -> list[str]:
    return [
        f"input {name!r} never changes in the logs: what it does cannot be learned from them"
        for k, name in enumerate(signals.input_names)
        if all(np.ptp(record.u[:, k]) == 0 for record in records)
    ]


def _unfinished(best: Candidate, unbeaten: bool) -> list[str]:
    """What is said where the search ended early, or its warm start was `unbeaten`."""
    said = []
    if best.origin != WARM and best.fitted.status == NOT_CONVERGED:
        said.append(not_converged("refinement", best.fitted.trials))
    if unbeaten:
        said.append(
            "the refinement by simulation error did not beat the warm start on held-out data; the "
            "warm start is kept"
        )
    return said


def _members(found: Search, members: Sequence[Candidate], data: Data) -> Members:
    plants = [_settled(each, found) for each in members]
    return Members(plants, _training(plants[0], members[0], data))


def _settled(candidate: Candidate, found: Search) -> GrayBoxPlant:
    """The candidate's plant, with what the file left open decided."""
    fitted = candidate.assembled
    spec = settle(
        candidate.plant.spec, found.holds, chosen_sizes(candidate.plant.spec, candidate.plant)
    )
    networks, parameters = jax.tree.map(jnp.asarray, (fitted.networks, fitted.parameters))
    return replace(
        fitted, signals=spec.signals, spec=spec, networks=networks, parameters=parameters
    )


def _training(plant: GrayBoxPlant, best: Candidate, data: Data) -> Samples:
    """The points that the fitted windows went through, and what the log says there."""
    x, u, y = [], [], []
    for piece, path in zip(data.pieces, best.fitted.x, strict=True):
        cut = slice(piece.start, piece.stop)
        kept = data.masks[piece.record][cut]
        record = data.records[piece.record]
        x.append(path[: piece.stop - piece.start][kept])
        u.append(record.u[cut][kept])
        y.append(record.y[cut][kept])
    x, u = np.concatenate(x), np.concatenate(u)
    dx = np.asarray(jax.vmap(plant.derivative)(jnp.asarray(x), jnp.asarray(u)))
    return Samples(x, u, dx, np.concatenate(y))
