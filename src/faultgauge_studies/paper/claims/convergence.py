"""What a ramp and a step leave of "asymptotic" estimates (Lemma 2 and Corollary 2).

Lemma 2 wants a bounded derivative of the fault; eq (17) steps, which has none. With a double pole,
s^2 + 2 zeta omega_o s + omega_o^2, a ramp of slope c leaves fhat - f = -2 zeta c/omega_o for ever.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.observers.eso import ExtendedStateObserver
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.plant import Plant
from faultgauge.reporting.relations import relation
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge.simulation.schedules import Constant, Ramp, Schedule, truth
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import ONSET
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.estimating import AFTER, ZETA, design, estimate
from faultgauge_studies.paper.learning import rms
from faultgauge_studies.paper.tables import Results, milli, span

__all__ = ["lag", "measure", "section", "verdict"]

SIZE, UNTIL = 0.2, 900.0  # N*m and s: a ramp of 5e-4 N*m/s from 500 s on
SLOPE = SIZE / (UNTIL - ONSET)
BANDWIDTHS = (0.05, 0.1, 0.2, 0.4, 0.8)  # rad/s
SHOWN = 0.2
DIED = 12.0  # omega_o t: (1 + x) e^-x leaves 8e-5 of a step
LITTLE = 0.05  # of the ramp's own lag: what else there is must be small beside it
RAMP = Schedule("d1", "state", "h", Ramp(SIZE, ONSET, UNTIL), unit="N*m")
STEP = Schedule("d1", "state", "h", Constant(0.1, ONSET), unit="N*m")


def lag(bandwidth: float) -> float:
    """2 zeta c/omega_o [N*m]: what a ramp leaves."""
    return 2 * ZETA * SLOPE / bandwidth


def measure(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """ESO and IESONN on a ramp and on a step, for several bandwidths, with f(t) and without."""
    samples = bench.learned.account.training
    points = OperatingPoints(samples.x, samples.u)
    plants = {"eso": bench.wheel, "iesonn": bench.learned.model.plant}
    flights = {"ramp": bench.fly(RAMP), "step": bench.fly(STEP)}
    still = bench._replace(inner=()).fly(RAMP)
    t = np.asarray(still.t)
    d = {"ramp": truth(RAMP, t), "step": truth(STEP, t)}
    late = (t >= ONSET + (UNTIL - ONSET) / 2) & (t < UNTIL)
    figures: dict[str, Any] = {"ramp": {}, "ramp_without_f": {}, "step": {}}
    traces: dict[str, Any] = {"t": t, "ramp": d["ramp"], "step": d["step"]}
    for omega in BANDWIDTHS:
        key = f"{omega:g}"
        observers = {name: _designed(plant, points, omega) for name, plant in plants.items()}
        f = {k: {n: estimate(o, x) for n, o in observers.items()} for k, x in flights.items()}
        figures["ramp"][key] = {n: _mean(x - d["ramp"], late) for n, x in f["ramp"].items()}
        clean = estimate(observers["eso"], still) - d["ramp"]
        figures["ramp_without_f"][key] = {
            "eso": _mean(clean, late),
            "share_of_lag": -_mean(clean, late) / lag(omega),
        }
        rest = t >= ONSET + max(AFTER, DIED / omega)
        figures["step"][key] = {n: rms((x - d["step"])[rest]) for n, x in f["step"].items()}
        if omega == SHOWN:
            for kind, each in f.items():
                traces |= {f"{kind}_{name}": x - d[kind] for name, x in each.items()}
    return {"convergence": figures}, {"convergence": traces}


def _designed(plant: Plant, points: OperatingPoints, omega: float) -> ExtendedStateObserver:
    return design(plant, points, omega)


def _mean(x: Float[np.ndarray, "samples"], chosen: np.ndarray) -> float:
    return float(x[chosen].mean())


def section(results: Results, traces: Traces) -> Section:
    """The claim, its verdict, and the errors against bandwidth and time."""
    found = results["convergence"]
    return Section(
        "Asymptotic convergence",
        (
            "The paper: with a bounded derivative of the fault the observer estimates it "
            "asymptotically. Its own eq (17) steps, and has no bounded derivative.",
            verdict(results).found,
        ),
        (_table(found),),
        _figures(found, traces["convergence"]),
    )


def _table(found: Results) -> Table:
    rows = tuple(
        (
            key,
            f"{-1e3 * lag(float(key)):.3g}",
            span(milli(found["ramp_without_f"][key]["eso"])),
            span(milli(found["ramp"][key]["iesonn"])),
            span(milli(found["step"][key]["iesonn"])),
        )
        for key in (f"{omega:g}" for omega in BANDWIDTHS)
    )
    return Table(
        (
            "omega_o (rad/s)",
            "-2 zeta c/omega_o",
            "ramp: ESO, no f(t)",
            "ramp: IESONN",
            "step: IESONN",
        ),
        rows,
        f"mN·m. Ramp of {1e3 * SLOPE:g} mN·m/s: mean error over its second half. Step of 0.1 N·m: "
        "RMSE from 50 s after it, or 12/omega_o where that is later.",
    )


def _figures(found: Results, x: Mapping[str, Any]) -> tuple[Figure, ...]:
    over_time = panels(
        x["t"],
        [
            Panel(f"{kind}: error", "N*m", {"ESO": x[f"{kind}_eso"], "IESONN": x[f"{kind}_iesonn"]})
            for kind in ("ramp", "step")
        ],
        title=f"What a ramp and a step leave, omega_o = {SHOWN:g} rad/s",
        caption="(a) A ramp from 500 s to 900 s leaves a constant lag while it lasts. (b) A step "
        "leaves nothing but f(t), which the observer follows as a fault.",
    )
    omegas = np.array(BANDWIDTHS)
    medians = {
        "ramp: ESO, no f(t)": [found["ramp_without_f"][f"{w:g}"]["eso"] for w in BANDWIDTHS],
        "step: IESONN": [found["step"][f"{w:g}"]["iesonn"] for w in BANDWIDTHS],
    }
    against = relation(
        omegas,
        {"2 zeta c/omega_o": np.array([lag(float(w)) for w in omegas])},
        title="Error left against bandwidth",
        caption="Points: measured, median over seeds. A wide bandwidth shortens the lag and lets "
        "more of f(t) through.",
        x_name="omega_o",
        x_unit="rad/s",
        y_name="error left",
        y_unit="N*m",
        logarithmic="xy",
        measured={k: np.array([abs(v["median"]) for v in each]) for k, each in medians.items()},
    )
    return over_time, against


def verdict(results: Results) -> Verdict:
    found = results["convergence"]
    shares = [found["ramp_without_f"][f"{w:g}"]["share_of_lag"]["median"] for w in BANDWIDTHS]
    nothing = max(abs(share) for share in shares) <= LITTLE
    key = f"{SHOWN:g}"
    ramp, step = found["ramp"][key]["iesonn"]["median"], found["step"][key]["iesonn"]["median"]
    agrees = all(abs(share - 1) <= LITTLE for share in shares)
    return Verdict(
        "With a bounded derivative the fault is estimated asymptotically (Lemma 2, Corollary 2)",
        f"A ramp, whose derivative is bounded, leaves {min(shares):.2f} to {max(shares):.2f} times "
        f"2 zeta c/omega_o for as long as it lasts{', as the closed form says' * agrees}: "
        f"{1e3 * ramp:+.2f} mN·m at omega_o = {key} rad/s. A step, which has no bounded "
        f"derivative, is the case that converges, to {1e3 * step:.2f} mN·m RMSE, the observer's "
        "answer to f(t).",
        nothing,
    )
