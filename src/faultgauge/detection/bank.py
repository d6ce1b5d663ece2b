"""The bank of a calibrated model: its modes, its noise, and what calibration says of both."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.coverage import Region, regions_of
from faultgauge.detection.envelope import read
from faultgauge.detection.judged import measured_outputs, rows_between
from faultgauge.detection.levels import MEMORY, driven, levels_of, probes_of
from faultgauge.detection.noise import Noise, drifting_of
from faultgauge.errors import InputError
from faultgauge.observers.interacting import InteractingModes
from faultgauge.observers.modes import Levels, Set, hypotheses, links, mode_sets
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Signals
from faultgauge.simulation.free_run import substeps_for
from faultgauge.telemetry import Run

__all__ = [
    "CERTAIN",
    "FaultBank",
    "alone_error",
    "build_fault_bank",
    "evaluated_faults",
    "set_names",
]

CERTAIN = float(np.log(0.95 / 0.05))  # log-odds below which nothing is ever told or named
HOLD_OFF = 10  # samples


@dataclass(frozen=True)
class FaultBank:
    """The modes of a model's faults, and the levels behind them; `known` is sd(n) of `levels`.

    `level` are the log-odds of a fault from which on there is an alarm, `error` the standard
    deviation that the model's own error adds to each fault of a set, and last to what drives the
    states undeclared; `hold_off` in s; the model depends on the states `read`, and `regions` are
    what its networks were trained on.
    """

    model: Model
    modes: InteractingModes
    sets: tuple[Set, ...]
    levels: Levels
    noise: Noise
    outputs: tuple[str, ...]
    step: float
    known: Float[np.ndarray, "times faults"]
    level: float
    error: Float[np.ndarray, "some slots"]
    hold_off: float
    read: Bool[np.ndarray, "states"]
    regions: tuple[Region, ...]

    def with_monitor(self, which: str) -> Bool[np.ndarray, "faults"]:
        """The declared faults that are `which`: active, passive or disabled."""
        return np.array([f.monitor == which for f in self.model.plant.signals.faults])


def set_names(model: Model, sets: Sequence[Set]) -> list[str]:
    """Names of the sets of faults in a model file; the agile ones come after their like, and last
    what drives the states undeclared."""
    names = model.plant.signals.fault_names
    labels = ["+".join(names[k] for k in each) for each in sets]
    named = [f"{x} (changing)" if x in labels[:k] else x for k, x in enumerate(labels)]
    return [*named, "(undeclared)"]


def alone_error(bank: FaultBank, fault: int) -> float:
    """The standard deviation that the model's own error adds to `fault` by itself; 0 where it is
    disabled."""
    return float(bank.error[bank.sets.index((fault,)), 0]) if (fault,) in bank.sets else 0.0


def evaluated_faults(signals: Signals) -> list[int]:
    """The declared faults that are not disabled. Raises `InputError` where there is none."""
    faults = signals.faults
    evaluated = [k for k, fault in enumerate(faults) if fault.monitor != "disabled"]
    if not evaluated:
        what = "disables all its [faults]" if faults else "declares no [faults]"
        raise InputError(
            f"the plant file {what}, so the bank has nothing to tell apart; declare "
            "what may go wrong, or use `faultgauge estimate --observer eso`."
        )
    return evaluated


def build_fault_bank(model: Model, runs: Sequence[Run], noise: Noise) -> FaultBank:
    """The bank for `runs`, with alarm level and model error where `model` is calibrated for it.

    Raises `InputError` where the plant file declares no fault that is not disabled.
    """
    signals = model.plant.signals
    evaluated = evaluated_faults(signals)
    step = float(np.median([run.step for run in runs]))
    outputs = measured_outputs(model, runs)
    # White noise as strong as sigma at one sample in n is sigma sqrt(n) at every row.
    rows = [rows_between(runs, name) for name in signals.output_names]
    levels, known = levels_of(
        model, noise._replace(sigma=noise.sigma * np.sqrt(rows)), step, outputs
    )
    levels = levels._replace(sigma=noise.sigma, noisier=noise.sigma)
    sets = mode_sets(evaluated, signals.max_simultaneous)
    probes = probes_of(model, levels)
    modes = InteractingModes(
        plant=driven(model),
        hypothesis=hypotheses(sets, levels),
        links=links(sets, len(signals.states), levels),
        probes=jnp.asarray(probes),
        memory=jnp.asarray(MEMORY * step),
        enough=jnp.asarray(-2 * np.log(levels.onset.min() * step)),
        drifting=drifting_of(model),
        substeps=substeps_for(step, model.max_step),
    )
    found = (model.calibration or {}).get("bank", {})
    error = np.zeros((len(sets) + 1, modes.hypothesis.select.shape[-1]))
    for row, name in zip(error, set_names(model, sets), strict=True):
        sizes = found.get("error", {}).get(name, [])
        row[: len(sizes)] = sizes
    wait = signals.detection.hold_off
    return FaultBank(
        model, modes, sets, levels, noise, outputs, step, known,
        float(found.get("level", CERTAIN)), error, HOLD_OFF * step if wait is None else wait,
        read(model), regions_of(model, outputs),
    )  # fmt: skip
