"""One seed of the paper's study: noise, restarts, selection, faults, estimates."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.excitation import coverage
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.plant import Plant
from faultgauge.simulation.satellite.observatory import HOLD, PERIOD, run
from faultgauge.simulation.schedules import grid, truth
from faultgauge_studies.paper import comparison, estimating, severity
from faultgauge_studies.paper.accommodating.measured import measured
from faultgauge_studies.paper.bench import Bench, Traces, learn_from, set_up
from faultgauge_studies.paper.cases import (
    CASES,
    MODE_1,
    ONSET,
    PHYSICAL,
    SECONDS,
)
from faultgauge_studies.paper.claims.registry import CLAIMS
from faultgauge_studies.paper.excited import NOISE_ALONE, SWEEP, wheel_log
from faultgauge_studies.paper.learning import PITCH, Learned, beside, learn, rms, scores
from faultgauge_studies.paper.torque_form import torque_form

__all__ = ["Outcome", "core", "experiment"]

SIGMA_H = 0.05  # N*m*s
NORMAL = {"normal_10min": 600.0, "normal_1h": 3600.0, "normal_1day": 86400.0}  # s
SETTLED = 400.0  # s: the slew is over
OFFSET = 0.1  # N*m
U_MAX = 0.82  # N*m
REACH = 150.0  # N*m*s: the range of momentum that the experiment is to cover


class Outcome(NamedTuple):
    """`figures`: nested names to numbers, as in results.json; `traces`: curves by figure."""

    figures: dict[str, Any]
    traces: Traces


def core(seed: int, progress: Callable[[str], None] = lambda text: None) -> Outcome:
    """The heart of it: learn, run beside, inject, estimate."""
    progress("learning from the experiment")
    return _core(set_up(seed), progress)


def experiment(
    seed: int, *, quick: bool = False, progress: Callable[[str], None] = lambda text: None
) -> Outcome:
    """Everything that the study measures for one seed; `quick` leaves out the slow comparisons
    (gradient descent, normal operation, baselines beyond Table 1's, margins and lost wheels, the
    other claims)."""
    progress("learning from the experiment")
    bench = set_up(seed)
    figures, traces = _core(bench, progress)
    progress("other experiments")
    for more, curves in (
        _still(bench),
        _severity(bench),
        _physical(bench),
        _other_logs(bench, quick),
        torque_form(),
        comparison.measure(bench, quick=quick, progress=progress),
    ):
        _merge(figures, more)
        traces |= curves
    progress("accommodating")
    for more, curves in measured(bench, quick=quick):
        _merge(figures, more)
        traces |= curves
    for claim in () if quick else CLAIMS:
        progress(claim.name)
        more, curves = claim.measure(bench)
        _merge(figures, more)
        traces |= curves
    return Outcome(figures, traces)


def _core(bench: Bench, progress: Callable[[str], None]) -> Outcome:
    progress("flying with faults")
    figures, traces = _identification(bench)
    for more, curves in (_faults(bench), _estimates(bench)):
        _merge(figures, more)
        traces |= curves
    return Outcome(figures, traces)


def _identification(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Free run beside the fault-free flight, against the wheel and against the desired model."""
    flown = bench.fly()
    runs = {name: beside(plant, flown) for name, plant in bench.references.items()}
    f = bench.inner[0].profile.sizes(np.asarray(flown.t))
    samples = bench.learned.account.training
    figures = {
        "identification": {name: scores(each, flown)._asdict() for name, each in runs.items()},
        "model_error": {"gbnnm": {"rmse": rms(runs["gbnnm"].y[:, 0] - runs["desired"].y[:, 0])}},
        "floor": {"rms_f": rms(f)},
        "flight": {"torque_sd": float(np.std(flown.torque[:, PITCH]))},
        "coverage": {"noise_with_sweep": _covered(samples.x[:, 0], samples.u[:, 0])},
    }
    traces = {
        "nominal": {
            "t": np.asarray(flown.t),
            "T": np.asarray(flown.torque[:, PITCH]),
            "h": np.asarray(flown.momentum[:, PITCH]),
            "u": np.asarray(flown.u[:, PITCH]),
            "attitude": np.rad2deg(np.asarray(flown.attitude)),
            "attitude_error": np.rad2deg(np.asarray(flown.estimated - flown.attitude)),
            "sunlit": np.asarray(flown.sunlit, float),
            **{f"yhat_{name}": each.y[:, 0] for name, each in runs.items()},
            **{f"hhat_{name}": each.x[:, 0] for name, each in runs.items()},
        },
        "training": {"h": samples.x[:, 0], "u": samples.u[:, 0], "T": samples.dx[:, 0]},
        "friction": _friction(bench),
    }
    return figures, traces


def _friction(bench: Bench) -> dict[str, Any]:
    """xi(h) = -F(h, 0), true and learned, over the momenta of the training log."""
    h = bench.learned.account.training.x[:, 0]
    grid = np.linspace(h.min(), h.max(), 1200)
    curves = {}
    for name, plant in bench.references.items():
        curves[name] = -_at_rest(plant, grid)
    return {"h": grid, **curves}


def _at_rest(plant: Plant, h: Float[np.ndarray, "grid"]) -> Float[np.ndarray, "grid"]:
    rates = jax.vmap(plant.derivative)(jnp.asarray(h[:, None]), jnp.zeros((len(h), 1)))
    return np.asarray(rates)[:, 0]


def _covered(h: Float[np.ndarray, "n"], u: Float[np.ndarray, "n"]) -> dict[str, float]:
    """Shares of |h| <= 150, of |u| <= 0.82, and of the cells of both."""
    reach = np.array([REACH, U_MAX])
    found = coverage(np.stack([h, u], axis=1), -reach, reach)
    return {
        "h_share": float(found.share[0]),
        "u_share": float(found.share[1]),
        "cells": float(found.occupied),
    }


def _still(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """The same without f(t), which no model can know: what is left is the model's own error."""
    learned = learn_from(bench.wheel, SWEEP, bench.seed, ())
    flown = run(bench.wheel, SECONDS, bench.seed)
    free, desired = beside(learned.model.plant, flown), beside(bench.wheel, flown)
    error = rms(free.y[:, 0] - desired.y[:, 0])
    return {
        "without_f": {
            "identification": {"gbnnm": scores(free, flown)._asdict()},
            "model_error": {"gbnnm": {"rmse": error}},
        }
    }, {}


def _faults(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """The residual of both references in all four scenarios."""
    residual: dict[str, Any] = {}
    traces: Traces = {}
    for key, case in CASES.items():
        flown = bench.fly(case.fault)
        t, torque = np.asarray(flown.t), np.asarray(flown.torque[:, PITCH])
        free = {name: beside(plant, flown) for name, plant in bench.references.items()}
        r = {name: torque - each.y[:, 0] for name, each in free.items()}
        known = beside(bench.learned.model.plant, flown, "measured")
        ideal = beside(bench.wheel, flown, "measured")
        judged = t < case.until
        desired = r["desired"]
        residual[key] = {
            "rmse_to_desired": {"gbnnm": rms((r["gbnnm"] - desired)[judged])},
            "rmse_to_desired_whole_run": {"gbnnm": rms(r["gbnnm"] - desired)},
            "rmse_to_desired_measured_state": {"gbnnm": rms((known.y - ideal.y)[judged, 0])},
            "desired_rms": rms(desired[judged]),
            "jump": severity.jumps(case, r["gbnnm"]),
            "growth_in_100s": severity.growth(r["gbnnm"]),
            "largest_step": {
                "u": _largest_step(flown.u[:, PITCH], judged),
                "yhat": _largest_step(free["gbnnm"].y[:, 0], judged),
                "y": _largest_step(torque, judged),
            },
        }
        traces[key] = {
            "t": t,
            "y": torque,
            "u": np.asarray(flown.u[:, PITCH]),
            "h": np.asarray(flown.momentum[:, PITCH]),
            "pitch": np.rad2deg(np.asarray(flown.attitude[:, 1])),
            "fault": truth(case.fault, t),
            "r_measured": torque - known.y[:, 0],
            **{f"yhat_{name}": each.y[:, 0] for name, each in free.items()},
            **{f"r_{name}": each for name, each in r.items()},
        }
    return {"residual": residual}, traces


def _largest_step(x: Any, judged: np.ndarray) -> float:
    """The largest change from one control period to the next after the slew, N*m."""
    return float(np.abs(np.diff(np.asarray(x)[judged][round(SETTLED / PERIOD) :])).max())


def _observers(bench: Bench) -> dict[str, Any]:
    samples = bench.learned.account.training
    points = OperatingPoints(samples.x, samples.u)
    return {
        "eso": estimating.design(bench.wheel, points),
        "iesonn": estimating.design(bench.learned.model.plant, points),
    }


def _estimates(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """ESO, IESONN and the residuals as estimators of d1, without and with noise in h."""
    observers = _observers(bench)
    kalman = estimating.kalman_at_equal_noise(observers["eso"], SIGMA_H)
    found: dict[str, Any] = {}
    noisy: dict[str, Any] = {"cramer_rao_50s": estimating.cramer_rao(SIGMA_H)}
    traces: Traces = {}
    for number, key in enumerate(MODE_1):
        case = CASES[key]
        flown = bench.fly(case.fault)
        t = np.asarray(flown.t)
        d, torque = truth(case.fault, t), np.asarray(flown.torque[:, PITCH])
        plant = bench.learned.model.plant
        f = {name: estimating.estimate(each, flown) for name, each in observers.items()}
        f["kalman"] = estimating.estimate(kalman, flown)
        f["residual"] = torque - beside(plant, flown).y[:, 0]
        f["residual_measured_state"] = torque - beside(plant, flown, "measured").y[:, 0]
        found[key] = {
            name: estimating.quality(case, t, each, d)._asdict() for name, each in f.items()
        }
        gap = (f["iesonn"] - f["eso"])[estimating.scored(case, t)]
        found[key]["iesonn_minus_eso"] = {"rmse": rms(gap)}
        rng = np.random.default_rng([bench.seed, 2, number])
        noise = SIGMA_H * rng.standard_normal(len(t))
        noises = {
            name: estimating.estimate(each, flown, noise)
            for name, each in {**observers, "kalman": kalman}.items()
        }
        noisy[key] = {
            name: {"rmse": rms((each - d)[estimating.scored(case, t)])}
            for name, each in noises.items()
        }
        traces[f"estimate_{key}"] = {"t": t, "fault": d, **f}
        traces[f"noisy_{key}"] = {"t": t, "fault": d, **noises}
    return {"fault_estimate": found, "fault_estimate_noisy": noisy}, traces


def _severity(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """m1 and m2 of eq (9): what the residual is for faults of several sizes."""
    plant = bench.learned.model.plant
    curves = severity.severities(bench.wheel, plant, bench.seed, bench.inner)
    offset = severity.output_offset(bench.wheel, plant, bench.seed, bench.inner, OFFSET)
    t = grid(len(offset), PERIOD)[:, 0]
    after = t >= ONSET
    figures = {
        "severity": {
            "output_fault_rmse": rms(offset[after] - OFFSET),
            "input_fault": {
                f"{size:g}": {
                    "at_onset": severity.mean(r, ONSET),
                    "after_400s": severity.mean(r, ONSET + 400.0),
                }
                for size, r in curves.items()
            },
        }
    }
    traces = {f"{size:g}": r for size, r in curves.items()}
    return figures, {"severity": {"t": t, "output": offset, **traces}}


def _physical(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Mode 2 as eq (18) writes it and as the text says it: what each channel shows."""
    iesonn = _observers(bench)["iesonn"]
    plant = bench.learned.model.plant
    seen: dict[str, Any] = {}
    traces: Traces = {}
    for name, case in {"as_written": CASES["mode2_sustained"], "as_said": PHYSICAL}.items():
        flown = bench.fly(case.fault)
        free = beside(plant, flown)
        channels = {
            "torque_residual": np.asarray(flown.torque[:, PITCH]) - free.y[:, 0],
            "momentum_residual": np.asarray(flown.momentum[:, PITCH]) - free.x[:, 0],
            "iesonn": estimating.estimate(iesonn, flown),
        }
        seen[name] = severity.channels_at(channels)
        traces[f"mode2_{name}"] = {"t": np.asarray(flown.t), **channels}
    return {"mode2_channels": seen}, traces


def _other_logs(bench: Bench, quick: bool) -> tuple[dict[str, Any], Traces]:
    """What other healthy logs, and the paper's other algorithm, would have taught."""
    wheel, seed, inner = bench.wheel, bench.seed, bench.inner
    flown = bench.fly()
    found: dict[str, Learned] = {
        "gbnnm_noise_alone": learn_from(wheel, NOISE_ALONE, seed, inner),
        "gbnnm_multisine_with_sweep": learn_from(
            wheel, replace(SWEEP, kind="multisine_with_sweep"), seed, inner
        ),
    }
    if not quick:
        found["gbnnm_gradient_descent"] = learn_from(wheel, SWEEP, seed, inner, algorithm="gdm")
        for name, seconds in NORMAL.items():
            held = run(wheel, seconds, seed + 1000, inner, angles=HOLD)
            found[f"gbnnm_{name}"] = learn([wheel_log(held, "pitch", name)], [], seed)
    figures: dict[str, Any] = {"identification": {}, "coverage": {}}
    for name, learned in found.items():
        samples = learned.account.training
        free = beside(learned.model.plant, flown)
        figures["identification"][name] = scores(free, flown)._asdict()
        figures["coverage"][name.removeprefix("gbnnm_")] = _covered(
            samples.x[:, 0], samples.u[:, 0]
        )
    alone = found["gbnnm_noise_alone"].account.training
    return figures, {"training_noise_alone": {"h": alone.x[:, 0], "u": alone.u[:, 0]}}


def _merge(into: dict[str, Any], more: dict[str, Any]) -> None:
    for key, value in more.items():
        if isinstance(value, dict) and key in into:
            _merge(into[key], value)
        else:
            into[key] = value
