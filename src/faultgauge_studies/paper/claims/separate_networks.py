"""Do separate networks decrease the complexity of identification? An ablation of NN1 and NN2."""

from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.identification.fit import FitReport
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.reporting.relations import relation
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.claims.learned import (
    RESTARTS,
    medians,
    sized,
    teach,
)
from faultgauge_studies.paper.claims.one_network import teach_one
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.excited import SWEEP, Records, records
from faultgauge_studies.paper.learning import GRAY_BOX, PITCH, beside, rms
from faultgauge_studies.paper.tables import Results, milli, span

__all__ = ["measure", "section", "verdict"]

TOTALS = (4, 10, 20)  # hidden units in all
LABELS = {
    "separate": "separate NN1 and NN2",
    "joint": "NN2(NN1(h, u), h) as one problem",
    "shared": "one network of two outputs",
}
OTHERS = ("joint", "shared")
EASIER = 2.0  # times less work: below that, one start more or less decides
AS_GOOD = 1.25  # times the other's error: seeds differ by more


def measure(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Parameters, work of the fit and free-run error [N*m] at equal total hidden units.

    Work is counted, not timed: the multiplications of J J^T,
    trials * equations * samples * parameters^2, over all starts.
    """
    given = records(bench.wheel, SWEEP, bench.seed, bench.inner)
    flown = bench.fly()
    torque = np.asarray(flown.torque[:, PITCH])
    desired = beside(bench.wheel, flown).y[:, 0]
    samples = len(given.training.t)
    figures: dict[str, Any] = {"hidden": list(TOTALS)}
    for name in LABELS:
        entry: dict[str, list[Any]] = {
            key: [] for key in ("parameters", "trials", "work", "rmse", "model_error")
        }
        for hidden in TOTALS:
            plant, fits = _teach(bench, name, hidden, given)
            free = beside(plant, flown).y[:, 0]
            entry["parameters"].append(sum(parameters for parameters, _, _ in fits))
            entry["trials"].append(float(sum(trials for *_, trials in fits)))
            entry["work"].append(work(fits, samples))
            entry["rmse"].append(rms(torque - free))
            entry["model_error"].append(rms(free - desired))
        figures[name] = entry
    return {"separate_networks": figures}, {}


Fit = tuple[int, int, int]  # parameters, equations, trials of all starts


def work(fits: list[Fit], samples: int) -> float:
    """Multiplications in the normal equations of all fits."""
    return float(sum(trials * equations * samples * p**2 for p, equations, trials in fits))


def joint(hidden: int) -> GrayBoxPlant:
    """The gray-box wheel whose torque reads NN1 again: one problem of two equations."""
    text = read_plant_text(GRAY_BOX).replace("NN2(d(h), h)", "NN2(NN1(h, u), h)")
    text = text.replace("hidden = 10", f"hidden = {hidden}")
    return GrayBoxPlant.untrained(parse_plant(text, f"joint, {hidden} units"))


def _teach(bench: Bench, name: str, hidden: int, given: Records) -> tuple[Plant, list[Fit]]:
    if name == "shared":
        signals = sized(hidden).signals
        plant, solution = teach_one(signals, hidden, given, bench.seed, RESTARTS)
        return plant, [(solution.theta.shape[1], 2, int(solution.trials.sum()))]
    untrained = sized(hidden // 2) if name == "separate" else joint(hidden // 2)
    plant, account = teach(untrained, given, bench.seed)
    return plant, _fits(account)


def _fits(account: FitReport) -> list[Fit]:
    return [
        (
            each.solution.theta.shape[1],
            len(each.group.states) + len(each.group.outputs),
            int(each.solution.trials.sum()),
        )
        for each in account.groups
    ]


def section(results: Results, traces: Traces) -> Section:
    """The ablation for the report."""
    found = results["separate_networks"]
    return Section(
        "Separate networks",
        (
            "The paper: multiple static networks approximate the nonlinearities separately, “to "
            "decrease the complexity of identification”; the model “is thus easy to implement”. "
            "Here the same number of hidden units is spent in three ways, each fitted from "
            f"{RESTARTS} starts to the same record and selected by free run on the same other one.",
            verdict(results).found,
            "On this wheel T is dh itself: NN2 has next to nothing to learn, and one network "
            "serves two equal targets, which is the best that can happen to it.",
        ),
        (_table(found),),
        _figures(found),
    )


def verdict(results: Results) -> Verdict:
    """Against both alternatives, at every size: less work, and an error as good?"""
    sentences, good = zip(*(_against(results["separate_networks"], o) for o in OTHERS), strict=True)
    return Verdict(
        "Separate networks decrease the complexity of identification",
        " ".join(sentences),
        all(good),
    )


def _against(found: Results, other: str) -> tuple[str, bool]:
    """The sentence on one alternative, and whether it is met at every size."""
    cheaper = medians(found[other]["work"]) / medians(found["separate"]["work"])
    worse = medians(found["separate"]["model_error"]) / medians(found[other]["model_error"])
    good = (cheaper >= EASIER) & (worse <= AS_GOOD)
    sizes = ", ".join(str(n) for n, ok in zip(found["hidden"], good, strict=True) if ok)
    word = "holds" if good.all() else f"holds only with {sizes}" if sizes else "does not hold"
    return (
        f"Against {LABELS[other]} the claim {word}{'' if good.all() or not sizes else ' units'}: "
        f"separate networks take {_range(cheaper)} times less work, and their error is "
        f"{_range(worse)} times the other's (wanted: at least {EASIER:g}, at most {AS_GOOD:g}).",
        bool(good.all()),
    )


def _range(x: Float[np.ndarray, "sizes"]) -> str:
    return f"{x.min():.2g} to {x.max():.2g}"


def _table(found: Results) -> Table:
    rows = []
    for name, label in LABELS.items():
        entry = found[name]
        for k, hidden in enumerate(found["hidden"]):
            rows.append(
                (
                    f"{label}, {hidden} units",
                    str(entry["parameters"][k]),
                    f"{entry['trials'][k]['median']:.0f}",
                    f"{entry['work'][k]['median']:.2g}",
                    span(milli(entry["rmse"][k])),
                    span(milli(entry["model_error"][k]), ".2g"),
                )
            )
    return Table(
        ("", "parameters", "trials", "work", "RMSE (mN·m)", "model error (mN·m)"),
        tuple(rows),
        "Trials of Levenberg-Marquardt over all starts; work: multiplications in J Jᵀ. RMSE on "
        "the fault-free flight; model error: the same against the desired model, without f(t).",
    )


def _figures(found: Results) -> tuple[Figure, ...]:
    hidden = np.array(found["hidden"], float)
    kinds = {
        "model_error": ("Free-run error by how the networks are cut", "model error", "N*m"),
        "work": ("Work of the fit by how the networks are cut", "multiplications", "1"),
    }
    return tuple(
        relation(
            hidden,
            {label: medians(found[name][key]) for name, label in LABELS.items()},
            title=title,
            x_name="hidden units in all",
            x_unit="",
            y_name=y_name,
            y_unit=y_unit,
            logarithmic="xy",
        )
        for key, (title, y_name, y_unit) in kinds.items()
    )
