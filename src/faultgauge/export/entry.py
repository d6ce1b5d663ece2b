"""What of a model is exported: its bank, sample by sample, with names for all that comes and goes."""

from collections import OrderedDict
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank import FaultBank, build_fault_bank
from faultgauge.detection.judged import operating_points
from faultgauge.detection.noise import noise_of, start_spread
from faultgauge.detection.posterior import members
from faultgauge.errors import InputError
from faultgauge.export.compile import Step
from faultgauge.observers.branching import BranchState
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import simulate
from faultgauge.telemetry import Run

__all__ = ["bank_of", "step_of"]

HOLD = 20  # samples of an example for which an input stays
UNSAMPLED = 0.02  # of the outputs of an example
ROWS = 100  # of the stand-in log, which says which columns there are and how far apart


def bank_of(model: Model) -> FaultBank:
    """The bank of a calibrated model at the rate that it was fitted at. Raises `InputError` for a
    model without a calibration of the bank."""
    if "bank" not in (model.calibration or {}):
        raise InputError(
            "the model is not calibrated for the bank, whose posterior is what is exported; run "
            "`faultgauge calibrate` on healthy logs first."
        )
    step = 1 / model.resample if model.resample else float(model.record["sample_time"])
    names = (*model.plant.signals.input_names, *model.record["columns"]["outputs"])
    columns = {name: np.zeros(ROWS) for name in names}
    run = Run("export", "the model", step * np.arange(ROWS), columns, step)
    return build_fault_bank(model, [run], noise_of(model))


def step_of(bank: FaultBank) -> Step:
    """The bank's step from one named sample to named answers; it begins anywhere in the training
    envelope, and the first samples say where."""
    signals, modes = bank.model.plant.signals, bank.modes
    sets = [np.array([k in members(bank, f) for k in range(len(bank.sets) + 1)], float)
            for f in range(len(signals.faults))]  # fmt: skip

    def step(state: BranchState, sample: dict[str, Any]) -> tuple[BranchState, dict[str, Any]]:
        u = _stacked([sample[name] for name in signals.input_names])
        y = _stacked(
            [
                sample[name] if name in bank.outputs else jnp.nan
                for name in signals.output_names
            ]
        )
        state, info = modes.step(state, u, y, sample["dt"])
        said = OrderedDict()
        for k, name in enumerate(signals.fault_names):
            said[f"f_{name}"] = jnp.sum(info.p * sets[k] * info.f[:, k])
            said[f"p_{name}"] = jnp.sum(info.p * sets[k])
        said["p_healthy"], said["p_unknown"] = info.p[0], info.p[-1]
        return state, said

    sample = OrderedDict((name, jnp.zeros(())) for name in ("dt", *_read(bank)))
    return Step(step, _start(bank), sample, _comments(bank), partial(_examples, bank))


def _read(bank: FaultBank) -> tuple[str, ...]:
    return (*bank.model.plant.signals.input_names, *bank.outputs)


def _start(bank: FaultBank) -> BranchState:
    sd = start_spread(bank.model, bank.noise, ())
    points = operating_points(bank.model)
    x = np.zeros(len(sd))
    x[: points.x.shape[1]] = np.median(points.x, axis=0)
    u = np.median(points.u, axis=0)
    return bank.modes.init(*(jnp.asarray(each) for each in (x, sd, u)))


def _comments(bank: FaultBank) -> dict[str, str]:
    signals = bank.model.plant.signals
    found = {"dt": "s since the sample before; 0 for the first"}
    for kind, many in (("input", signals.inputs), ("output", signals.outputs)):
        for each in many:
            found[each.name] = f"{kind} [{each.unit or '-'}]"
    for fault in signals.faults:
        unit = fault.unit or "-"
        found[f"f_{fault.name}"] = f"mean of {fault.name} over all hypotheses [{unit}]"
        found[f"p_{fault.name}"] = f"probability that {fault.name} is there"
    found["p_healthy"] = "probability that there is no fault"
    found["p_unknown"] = "probability of something that no declared fault is"
    return found


def _examples(bank: FaultBank, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The model's own plant with noise, its inputs drawn from the training envelope, healthy first
    and then with every fault in turn."""
    plant, signals = bank.model.plant, bank.model.plant.signals
    points = operating_points(bank.model)
    u = points.u[np.repeat(rng.integers(0, len(points.u), count // HOLD + 1), HOLD)[:count]]
    part = np.arange(count) * (len(signals.faults) + 1) // count - 1
    sizes = np.clip(bank.size, [f.min for f in signals.faults], [f.max for f in signals.faults])
    f = np.where(part[:, None] == np.arange(len(sizes)), sizes, 0.0)
    dt = np.full(count, bank.step)
    dt[0] = 0.0
    start = jnp.asarray(np.median(points.x, axis=0))
    given = (jnp.asarray(each) for each in (u, dt, f))
    y = np.asarray(simulate(plant, start, *given, bank.modes.filter.substeps).y)
    y = y + bank.noise.sigma * rng.standard_normal(y.shape)
    y = np.where(rng.random(y.shape) < UNSAMPLED, np.nan, y)
    named = [*zip(signals.input_names, u.T, strict=True)]
    named += [*zip(signals.output_names, y.T, strict=True)]
    return {"dt": dt, **{name: values for name, values in named if name in _read(bank)}}


def _stacked(values: list[Any]) -> Float[Array, "values"]:
    return jnp.stack([jnp.asarray(v, float) for v in values]) if values else jnp.zeros(0)
