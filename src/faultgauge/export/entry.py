"""What of a model is exported: its `Watch`, sample by sample, with names for all that comes and
goes."""

from collections import OrderedDict
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.verdicts import PLACES, STATUS, Reason
from faultgauge.detection.rows.judged import operating_points
from faultgauge.detection.watch import Row, Watch, WatchState
from faultgauge.errors import InputError
from faultgauge.export.compile import ExportedStep
from faultgauge.export.ongoing import EventPhase, Ongoing, OngoingState
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Signals
from faultgauge.simulation.free_run import simulate
from faultgauge.telemetry import Run

__all__ = ["UNNAMED", "bank_of", "step_of"]

HOLD = 20  # samples of an example for which an input stays
TIMES = ("t", "bank_t")
UNSAMPLED = 0.02  # of the outputs of an example
UNNAMED = "unnamed_event"  # no fault's, whatever it is called


class _State(NamedTuple):
    """`WatchState`, and which events go on."""

    intake: Any
    bank: Any
    fits: Any
    rules: Any
    running: Array
    begun: Array
    rows: Array
    last: Array
    ongoing: OngoingState


def bank_of(model: Model) -> FaultBank:
    """The bank of a calibrated model at the rate that it was fitted at. Raises `InputError` for a
    model without a calibration of the bank."""
    if model.calibration is None or model.calibration.bank is None:
        raise InputError(
            "the model is not calibrated for the bank, whose posterior is what is exported; run "
            "`faultgauge calibrate` on healthy logs first."
        )
    step = 1 / model.resample if model.resample else float(model.record.sample_time)
    columns = {name: np.zeros(2) for name in _columns(model)}
    run = Run("export", "the model", step * np.arange(2), columns, step)
    return build_fault_bank(model, [run], noise_of(model))


def step_of(bank: FaultBank) -> ExportedStep:
    """The step of `Watch` from one named sample to named answers."""
    signals = bank.model.plant.signals
    watch = Watch(bank.model, _columns(bank.model), bank.step, bank=bank)
    ongoing = Ongoing.of(bank)

    def step(state: _State, sample: dict[str, Any]) -> tuple[_State, dict[str, Any]]:
        u = _stacked([sample[name] for name in signals.input_names])
        y = _stacked([sample.get(name, jnp.nan) for name in signals.output_names])
        after, row = watch.step(WatchState(*state[:-1]), sample["t"], u, y)
        told, events = ongoing.step(state.ongoing, row)
        said = _said(signals, row)
        names = [f"event_{name}" for name in (*signals.fault_names, "unknown")]
        said |= {name: events[k] for k, name in enumerate([*names, UNNAMED])}
        return _State(*after, told), said

    sample = OrderedDict((name, jnp.zeros(())) for name in ("t", *_read(bank)))
    codes = {
        "": STATUS,
        "reason": tuple(each.name for each in Reason),
        "event": tuple(each.name for each in EventPhase),
    }
    start = _State(*watch.init(), ongoing.init())
    return ExportedStep(
        *(step, start, sample, _comments(bank), partial(_examples, bank), codes, TIMES),
        _units(signals),
    )


def _said(signals: Signals, row: Row) -> dict[str, Any]:
    """What is told of a row, by name."""
    found, said = row.posterior, OrderedDict()
    for k, name in enumerate(signals.fault_names):
        said[f"f_{name}"] = found.f[k]
        said[f"f_{name}_lo"], said[f"f_{name}_hi"] = found.lo[k], found.hi[k]
        said[f"p_{name}"] = found.p[k]
    said["p_healthy"], said["p_unknown"] = found.healthy, found.unknown
    for k, name in enumerate(signals.state_names):
        said[f"x_{name}"] = found.x[k]
    why, first, second = _taken_apart(row.verdict.reason)
    codes = {"status": row.verdict.status, "reason": why, "about": first, "or_about": second}
    said |= {name: code.astype(jnp.int32) for name, code in codes.items()}
    for k, name in enumerate(signals.fault_names):
        said[f"named_{name}"] = row.verdict.named[k]
    return said


def _taken_apart(reason: Int[Array, ""]) -> list[Int[Array, ""]]:
    """(why, whom it is about, whom else)."""
    places = jax.lax.div(reason, len(Reason))
    whole = jax.lax.rem(reason, len(Reason))
    return [whole, jax.lax.rem(places, PLACES), jax.lax.div(places, PLACES)]


def _columns(model: Model) -> list[str]:
    """Of the log that the model was fitted to."""
    known = model.record.columns
    states = [name for name, _ in known.states if name]
    return list(dict.fromkeys([*model.plant.signals.input_names, *known.outputs, *states]))


def _read(bank: FaultBank) -> tuple[str, ...]:
    return (*bank.model.plant.signals.input_names, *bank.outputs)


def _comments(bank: FaultBank) -> dict[str, str]:
    signals = bank.model.plant.signals
    found = {"t": f"s, about {bank.step:g} more with every sample"}
    for kind, many in (("input", signals.inputs), ("output", signals.outputs)):
        for each in many:
            found[each.name] = f"{kind} [{each.unit or '-'}]"
    for fault in signals.faults:
        name, unit = fault.name, fault.unit or "-"
        found[f"f_{name}"] = f"{name} [{unit}]: mean over all hypotheses"
        found[f"f_{name}_lo"] = f"its 2.5 % quantile [{unit}]"
        found[f"f_{name}_hi"] = f"its 97.5 % quantile [{unit}]"
        found[f"p_{name}"] = f"probability of {name}, alone or with others"
        found[f"named_{name}"] = f"whether {name} is named as a cause"
        found[f"event_{name}"] = f"event of {name}: see the enumeration"
    for state in signals.states:
        found[f"x_{state.name}"] = f"state {state.name} [{state.unit or '-'}]"
    found["event_unknown"] = "event of something undeclared"
    found[UNNAMED] = "event of an alarm that began before anything could be named"
    found["p_healthy"] = "probability that there is no fault"
    found["p_unknown"] = "probability of something undeclared"
    found["status"] = "see the enumeration"
    found["reason"] = "why: see the enumeration"
    found["about"] = "whom the reason is about: its place among outputs, faults or networks"
    found["or_about"] = "or whom else (reason EITHER: 0 undeclared, 1 the first fault, ...)"
    return found


def _units(signals: Signals) -> dict[str, str]:
    found = {each.name: each.unit for each in (*signals.inputs, *signals.outputs)}
    found |= {f"x_{each.name}": each.unit for each in signals.states}
    for fault in signals.faults:
        found |= dict.fromkeys((f"f_{fault.name}{end}" for end in ("", "_lo", "_hi")), fault.unit)
    return {"t": "s", **found}


def _examples(bank: FaultBank, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The model's own plant with noise, its inputs drawn from the training envelope, healthy first
    and then with every fault in turn."""
    plant, signals = bank.model.plant, bank.model.plant.signals
    points = operating_points(bank.model)
    u = points.u[np.repeat(rng.integers(0, len(points.u), count // HOLD + 1), HOLD)[:count]]
    part = np.arange(count) * (len(signals.faults) + 1) // count - 1
    sizes = np.clip(bank.size, [f.min for f in signals.faults], [f.max for f in signals.faults])
    f = np.where(part[:, None] == np.arange(len(sizes)), sizes, 0.0)
    start = jnp.asarray(np.median(points.x, axis=0))
    held, dt, acts = (jnp.asarray(each) for each in (u, np.full(count, bank.step), f))
    y = np.asarray(simulate(plant, start, held, dt, acts, bank.modes.filter.substeps).y)
    y = y + bank.noise.sigma * rng.standard_normal(y.shape)
    y = np.where(rng.random(y.shape) < UNSAMPLED, np.nan, y)
    named = [*zip(signals.input_names, u.T, strict=True)]
    named += [*zip(signals.output_names, y.T, strict=True)]
    read = {name: values for name, values in named if name in _read(bank)}
    return {"t": bank.step * np.arange(count), **read}


def _stacked(values: list[Any]) -> Float[Array, "values"]:
    return jnp.stack([jnp.asarray(v, float) for v in values]) if values else jnp.zeros(0)
