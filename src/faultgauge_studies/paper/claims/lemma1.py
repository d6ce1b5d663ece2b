"""Lemma 1 (eqs 5 to 8) as a convergence study: hidden units, training points, horizon, limits."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.reporting.relations import relation
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.simulation.satellite.observatory import run
from faultgauge.simulation.schedules import Schedule
from faultgauge.telemetry import Run
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import SECONDS
from faultgauge_studies.paper.claims.learned import (
    medians,
    replay,
    sized,
    teach,
    unseen,
)
from faultgauge_studies.paper.claims.lemma1_horizon import (
    cycles,
    horizon_verdict,
    measure_horizon,
)
from faultgauge_studies.paper.claims.lemma1_limit import (
    floor_of,
    limit_figures,
    limit_table,
    limit_verdict,
    measure_limit,
)
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.excited import SWEEP, Records, experiment_log, records
from faultgauge_studies.paper.learning import PITCH, beside, rms
from faultgauge_studies.paper.tables import Results, milli, span

__all__ = ["measure", "section", "thinned", "verdict"]

HIDDEN = (1, 2, 5, 10, 20, 40)
PAPER = 10
POINTS = (50, 200, 1000, 4000)
NEAR_FLOOR = 1.1  # of rms f(t): what the model adds is then under half of it, in quadrature
FALL = 100.0  # times less error than one unit leaves: two decades are convergence, not chance


def measure(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Errors [N*m] of networks of 1 to 40 units, of records of 50 to 4000 samples, up to 4000 s.

    Eq (7)'s |y - yhat| is taken on torque: root mean square on the fault-free flight with f(t)
    (`rmse`, whose floor is f(t) itself) and without it, and the largest on a record of the
    experiment that no fit has seen.
    """
    figures: dict[str, Any] = {"hidden": list(HIDDEN)}
    plants: dict[str, dict[int, GrayBoxPlant]] = {}
    for name, inner in {"": bench.inner, "_without_f": ()}.items():
        given = records(bench.wheel, SWEEP, bench.seed, inner)
        plants[name] = {n: teach(sized(n), given, bench.seed)[0] for n in HIDDEN}
        flown = run(bench.wheel, SECONDS, bench.seed, inner)
        torque = np.asarray(flown.torque[:, PITCH])
        figures[f"rmse{name}"] = [
            rms(torque - beside(plant, flown).y[:, 0]) for plant in plants[name].values()
        ]
    still = unseen(bench.wheel, SWEEP, bench.seed, ())
    figures["largest_without_f"] = [
        float(np.abs(replay(plant, still).y[:, 0] - still.columns["T"]).max())
        for plant in plants["_without_f"].values()
    ]
    figures["floor"] = floor_of(bench)
    figures["points"] = _points(bench)
    figures["horizon"], traces = measure_horizon(bench, plants["_without_f"][PAPER])
    figures["limit"], more = measure_limit(bench)
    return {"lemma1": figures}, traces | more


def _points(bench: Bench) -> dict[str, Any]:
    """Error against the desired model on the flight, by the number of training samples."""
    found: dict[str, Any] = {"samples": list(POINTS)}
    for name, inner in {"with_f": bench.inner, "without_f": ()}.items():
        flown = run(bench.wheel, SECONDS, bench.seed, inner)
        desired = beside(bench.wheel, flown).y[:, 0]
        given = records(bench.wheel, SWEEP, bench.seed, inner)
        found[name] = []
        for samples in POINTS:
            training = _training(bench, given.training, samples, inner)
            plant, _ = teach(sized(PAPER), Records(training, given.validation), bench.seed)
            found[name].append(rms(beside(plant, flown).y[:, 0] - desired))
    return found


def _training(bench: Bench, log: Run, samples: int, inner: Sequence[Schedule]) -> Run:
    """`log` thinned, or a longer record with as many more cycles."""
    if samples <= len(log.t):
        return thinned(log, samples)
    longer = cycles(samples // len(log.t))
    return experiment_log(bench.wheel, longer, 2 * bench.seed, tuple(inner))


def thinned(log: Run, samples: int) -> Run:
    """So many samples of `log`, evenly over its whole length."""
    kept = slice(None, None, len(log.t) // samples)
    columns = {name: values[kept] for name, values in log.columns.items()}
    return Run(log.name, log.source, log.t[kept], columns)


def section(results: Results, traces: Traces) -> Section:
    """Lemma 1 for the report."""
    found = results["lemma1"]
    return Section(
        "Lemma 1: universal approximation",
        (
            "The paper: for an arbitrary ε > 0 there is a number N of hidden units with which "
            "max |y - ŷ| < ε on [0, T], if F is of class C1. Here N is the size of NN1 and of NN2 "
            "alike, each fitted from 3 starts to 1000 samples of the experiment.",
            verdict(results).found,
            horizon_verdict(found["horizon"]),
            limit_verdict(found["limit"]),
        ),
        (_hidden_table(found), limit_table(found["limit"])),
        (*_figures(found), *limit_figures(traces)),
    )


def verdict(results: Results) -> Verdict:
    """Does the error reach f(t), and without f(t) does it go on falling?"""
    found = results["lemma1"]
    hidden, floor = found["hidden"], found["floor"]["median"]
    with_f, without_f = medians(found["rmse"]), medians(found["rmse_without_f"])
    near = np.flatnonzero(with_f <= NEAR_FLOOR * floor)
    best = int(np.argmin(without_f))
    fall = without_f[0] / without_f[best]
    reached = (
        f"with f(t) inside the wheel {hidden[near[0]]} units come within {NEAR_FLOOR - 1:.0%} of "
        f"its {floor:.3g} N·m, which no model can know"
        if near.size
        else f"with f(t) no size comes within {NEAR_FLOOR - 1:.0%} of its {floor:.3g} N·m"
    )
    text = (
        f"{reached}; without f(t) the error on the flight falls from {without_f[0]:.3g} N·m with "
        f"{hidden[0]} unit to {without_f[best]:.3g} N·m with {hidden[best]}, {fall:.3g} times "
        f"(wanted: {FALL:g})."
    )
    holds = bool(near.size) and fall >= FALL
    later = without_f[-1] / without_f[best]
    if later > 1:
        text += (
            f" But N that exists is not N that training finds: with {hidden[-1]} units it is "
            f"{later:.3g} times larger again. More units do not help by themselves."
        )
    return Verdict(
        "A GBNNM of enough hidden units comes as close as one likes (Lemma 1)",
        ("Holds where F is smooth: " if holds else "Does not show: ") + text,
        bool(holds),
    )


def _hidden_table(found: Results) -> Table:
    columns = found["rmse"], found["rmse_without_f"], found["largest_without_f"]
    rows = tuple(
        (str(n), *(span(milli(each)) for each in row))
        for n, *row in zip(found["hidden"], *columns, strict=True)
    )
    return Table(
        ("N", "RMSE, with f(t)", "RMSE, without f(t)", "largest, without f(t)"),
        rows,
        "Free run, torque, mN·m: RMSE on the fault-free flight; the largest error on a record of "
        "the experiment that no fit has seen, which crosses zero speed.",
    )


def _figures(found: Results) -> tuple[Figure, ...]:
    """Error against hidden units, samples and horizon: medians over the seeds."""
    points, horizon = found["points"], found["horizon"]
    bound = medians(horizon["bound"])
    return (
        relation(
            np.array(found["hidden"], float),
            {
                "RMSE with f(t)": medians(found["rmse"]),
                "RMSE without f(t)": medians(found["rmse_without_f"]),
                "largest without f(t)": medians(found["largest_without_f"]),
            },
            title="Error against hidden units",
            x_name="hidden units N of each network",
            x_unit="",
            limit=found["floor"]["median"],
            limit_name="rms f(t)",
            y_name="error of torque",
            y_unit="N*m",
            logarithmic="xy",
        ),
        relation(
            np.array(points["samples"], float),
            {
                "learned with f(t)": medians(points["with_f"]),
                "learned without f(t)": medians(points["without_f"]),
            },
            title=f"Error against training samples, {PAPER} hidden units",
            x_name="training samples",
            x_unit="",
            caption="RMSE on the flight against the desired model. Up to 1000 samples the same "
            "record is thinned; beyond, it is longer.",
            y_name="error of torque",
            y_unit="N*m",
            logarithmic="xy",
        ),
        relation(
            np.array(horizon["seconds"], float),
            {
                "free run": medians(horizon["momentum"]),
                "Gronwall's bound": np.where(bound < 10.0, bound, np.nan),
            },
            title=f"Error against the horizon, {PAPER} hidden units",
            x_name="horizon T",
            x_unit="s",
            y_name="largest error of momentum up to T",
            y_unit="N*m*s",
            logarithmic="xy",
            caption="Without f(t), on four cycles of a sweep that no fit has seen.",
        ),
    )
