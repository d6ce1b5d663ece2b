"""Tables 1 and 2, Fig 13: every competitor beside the GBNNM on the same flights, at 1 Hz."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.schedules import truth
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import CASES, ONSET
from faultgauge_studies.paper.competitors import (
    PER_SECOND,
    Budget,
    Competitor,
    competitors,
    samples_of,
)
from faultgauge_studies.paper.excited import SWEEP, records, wheel_log
from faultgauge_studies.paper.learning import Learned, beside, fitted, rms

__all__ = ["FREE", "measure"]

QUICK = Budget(starts=2, trials=30)
FREE = "free"  # references that are given the momentum at the first sample only
UNKNOWN = 2.0  # friction's constants start off by up to this factor
SETTLED = 10.0  # s after the onset


class Beside(NamedTuple):
    """One model beside one flight, at whole seconds; `h` where it has a momentum of its own."""

    torque: Float[np.ndarray, "seconds"]
    h: Float[np.ndarray, "seconds"] | None


class Rival(NamedTuple):
    """A model to compare: it runs `beside` a flight, and knows momentum "free" or "measured"."""

    beside: Callable[[Telemetry], Beside]
    knows: str
    account: dict[str, float]


def measure(
    bench: Bench, *, quick: bool = False, progress: Callable[[str], None] = lambda text: None
) -> tuple[dict[str, Any], Traces]:
    """All competitors on the fault-free flight and in the four scenarios; `quick` trains those
    of Table 2 alone and less."""
    rivals = _rivals(bench, quick, progress)
    progress("comparing")
    healthy = bench.fly()
    wheel = _wheel(bench, healthy)
    nominal = {name: rival.beside(healthy) for name, rival in rivals.items()}
    figures, traces = _identification(rivals, wheel, nominal)
    before = {name: wheel.torque - each.torque for name, each in nominal.items()}
    for key in CASES:
        found, curves = _scenario(bench, rivals, key, before, wheel.residual)
        figures["residual"][key] = found
        traces |= curves
    return figures, traces


def _rivals(bench: Bench, quick: bool, progress: Callable[[str], None]) -> dict[str, Rival]:
    found = {
        name: Rival(_sampled(each), "measured" if _informed(each) else FREE, _spent(each))
        for name, each in competitors(
            bench, QUICK if quick else Budget(), best=not quick, progress=progress
        ).items()
    }
    if not quick:
        progress("training stribeck")
        learned = stribeck(bench)
        found["stribeck"] = Rival(_continuous(learned.model.plant), FREE, _account(learned))
    found["gbnnm"] = Rival(_continuous(bench.learned.model.plant), FREE, _account(bench.learned))
    return found


def _informed(each: Competitor) -> bool:
    """Momentum is fed to it while it runs."""
    return "hm" in each.reads or (each.online and "hm" in each.outputs)


def _spent(each: Competitor) -> dict[str, float]:
    account = {"starts": float(each.starts), "lm_trials": float(each.trials)}
    if np.isfinite(each.effective):
        account["effective_parameters"] = each.effective
    return account


def _account(learned: Learned) -> dict[str, float]:
    groups = learned.account.groups
    trials = sum(int(np.sum(group.solution.trials)) for group in groups)
    starts = max(len(group.solution.trials) for group in groups)
    return {"starts": float(starts), "lm_trials": float(trials)}


def stribeck(bench: Bench) -> Learned:
    """The wheel's own equations with friction's five constants unknown: a parametric model, which
    a sceptic asks for. Its motor and its inertia are given."""
    rng = np.random.default_rng([bench.seed, 5])
    spec = bench.wheel.spec
    parameters = tuple(
        p if p.fixed else replace(p, value=p.value * UNKNOWN ** rng.uniform(-1, 1))
        for p in spec.parameters
    )
    plant = GrayBoxPlant.untrained(replace(spec, parameters=parameters))
    given = records(bench.wheel, SWEEP, bench.seed, bench.inner)
    return fitted(plant, [given.training], [given.validation], bench.seed)


def _sampled(each: Competitor) -> Callable[[Telemetry], Beside]:
    def found(flown: Telemetry) -> Beside:
        y = each.beside(wheel_log(flown, "pitch", "flight"))
        return Beside(y[:, 0], y[:, 1] if "hm" in each.outputs else None)

    return found


def _continuous(plant: Plant) -> Callable[[Telemetry], Beside]:
    def found(flown: Telemetry) -> Beside:
        free = beside(plant, flown)
        return Beside(np.asarray(free.y)[::PER_SECOND, 0], np.asarray(free.x)[::PER_SECOND, 0])

    return found


class Wheel(NamedTuple):
    """The pitch wheel at whole seconds, and the desired model's torque by what it knows."""

    t: Float[np.ndarray, "seconds"]
    torque: Float[np.ndarray, "seconds"]
    h: Float[np.ndarray, "seconds"]
    desired: dict[str, Float[np.ndarray, "seconds"]]
    gbnnm: dict[str, Float[np.ndarray, "seconds"]]

    @property
    def residual(self) -> dict[str, Float[np.ndarray, "seconds"]]:
        """The desired ones, N*m."""
        return {knows: self.torque - desired for knows, desired in self.desired.items()}


def _wheel(bench: Bench, flown: Telemetry) -> Wheel:
    log = samples_of(wheel_log(flown, "pitch", "flight"))
    found = {
        name: {
            knows: np.asarray(beside(plant, flown, knows).y)[::PER_SECOND, 0]
            for knows in ("free", "measured")
        }
        for name, plant in bench.references.items()
    }
    return Wheel(log.t, log.columns["T"], log.columns["hm"], found["desired"], found["gbnnm"])


def _identification(
    rivals: dict[str, Rival], wheel: Wheel, nominal: dict[str, Beside]
) -> tuple[dict[str, Any], Traces]:
    """Table 1: free run (SPNN: one step ahead) on the fault-free flight."""
    scores, errors = {}, {}
    for name, run in nominal.items():
        error = wheel.torque - run.torque
        drift = np.nan if run.h is None else np.mean((wheel.h - run.h) ** 2) / np.var(wheel.h)
        scores[name] = {
            "r2": 1 - float(np.mean(error**2) / np.var(wheel.torque)),
            "rmse": rms(error),
            "r2_h": 1 - float(drift),
        }
        errors[name] = {"rmse": rms(run.torque - wheel.desired[rivals[name].knows])}
    known = rms(wheel.gbnnm["measured"] - wheel.desired["measured"])
    figures = {
        "identification": {k: v for k, v in scores.items() if k != "gbnnm"},
        "model_error": {k: v for k, v in errors.items() if k != "gbnnm"}
        | {"gbnnm_measured_state": {"rmse": known}},
        "training": {name: rival.account for name, rival in rivals.items()},
        "residual": {},
    }
    momenta = {name: run.h for name, run in nominal.items() if run.h is not None}
    traces: Traces = {
        "compared_nominal": {
            "t": wheel.t,
            **{name: wheel.torque - run.torque for name, run in nominal.items()},
        },
        "compared_momentum": {"t": wheel.t, **{k: wheel.h - h for k, h in momenta.items()}},
    }
    return figures, traces


def _scenario(
    bench: Bench,
    rivals: dict[str, Rival],
    key: str,
    nominal: dict[str, Float[np.ndarray, "seconds"]],
    ideal: dict[str, Float[np.ndarray, "seconds"]],
) -> tuple[dict[str, Any], Traces]:
    """Residuals against the desired one of the same knowledge, raw and tuned.

    Tuned is the paper's: the residual less that of the fault-free flight (`nominal`); it is held
    against the desired residual less its own there (`ideal`).
    """
    case = CASES[key]
    flown = bench.fly(case.fault)
    wheel = _wheel(bench, flown)
    r = {name: wheel.torque - rival.beside(flown).torque for name, rival in rivals.items()}
    tuned = {name: r[name] - nominal[name] for name in r}
    judged = wheel.t < case.until
    after = judged & (wheel.t >= ONSET + SETTLED)
    base = {k: rms((wheel.gbnnm[k] - wheel.desired[k])[judged]) for k in wheel.desired}
    errors, ratios, shown = {}, {}, {}
    for name, rival in rivals.items():
        desired = wheel.residual[rival.knows]
        raw = rms((r[name] - desired)[judged])
        errors[f"{name}_tuned"] = rms((tuned[name] - (desired - ideal[rival.knows]))[judged])
        shown[name] = rms(r[name][after]) / rms(desired[after])
        if name != "gbnnm":
            errors[name], ratios[name] = raw, raw / base[rival.knows]
    figures = {"rmse_to_desired": errors, "ratio_to_gbnnm": ratios, "share_shown": shown}
    curves = {
        "t": wheel.t,
        "fault": truth(case.fault, wheel.t),
        **{f"desired_{knows}": residual for knows, residual in wheel.residual.items()},
        **r,
        **{f"{name}_tuned": each for name, each in tuned.items()},
    }
    return figures, {f"compared_{key}": curves}
