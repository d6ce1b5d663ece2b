"""Four wheels in a pyramid, one of them lost: the others take over."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.accommodation.allocation import NullMotion
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge.simulation.satellite.loop import Satellite, Telemetry
from faultgauge.simulation.satellite.observatory import PERIOD, SLEW, run_satellite
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.accommodating.array import HELD, held, loss, off_target, satellite
from faultgauge_studies.paper.accommodating.setting import calibrated_like
from faultgauge_studies.paper.bench import Bench, Traces, learn_from
from faultgauge_studies.paper.cases import ONSET, SECONDS, inner_disturbance
from faultgauge_studies.paper.excited import SWEEP
from faultgauge_studies.paper.tables import Results, span

__all__ = ["AXES", "WITHIN", "measure", "section"]

# Columns (+-1, 1, +-1)/sqrt(3): any torque costs the array the same, whatever its direction.
AXES = np.array([[1.0, -1.0, -1.0, 1.0], [1.0, 1.0, 1.0, 1.0], [1.0, 1.0, -1.0, -1.0]]) / 3**0.5
NULL = np.array([1.0, -1.0, 1.0, -1.0])  # momenta that cancel on the body
BIAS = 60.0 * NULL  # N*m*s
FRICTION = (1.0, 0.85, 1.15, 1.3)  # of the nominal dry friction: no two wheels are alike
DRY = ("tau_c", "tau_s")
RATE, MOST = 0.01, 0.1  # 1/s, N*m of null motion
STICKING = 5.0  # rad/s, the Stribeck speed
WITHIN = 120.0  # s
WHEELS = range(4)


class _Array(NamedTuple):
    wheels: list[GrayBoxPlant]
    models: list[Model]

    def satellite(self, moving: bool) -> Satellite:
        null = NullMotion(jnp.asarray(BIAS), RATE, MOST) if moving else None
        return satellite(self.wheels, self.models, AXES, (-1,) * 4, null)


def measure(bench: Bench, model: Model) -> tuple[dict[str, Any], Traces]:
    """Each wheel lost in turn; ranks; and what null motion spares the wheels."""
    wheels = [_wheel(bench.wheel, factor) for factor in FRICTION]
    seeds = [1000 * (k + 1) + bench.seed for k in WHEELS]
    learned = [
        learn_from(wheel, SWEEP, seed, (inner_disturbance(wheel),))
        for wheel, seed in zip(wheels, seeds, strict=True)
    ]
    models = [calibrated_like(model, each.model) for each in learned]
    array = _Array(wheels, models)
    moving, free = array.satellite(True), array.satellite(False)
    lost = [_fly(bench, array, moving, BIAS, k) for k in WHEELS]
    healthy = _fly(bench, array, moving, BIAS, None)
    # from rest: without null motion the wheels stay near it
    rest = {
        name: _fly(bench, array, each, 0.0 * BIAS, None)
        for name, each in (("with_null_motion", moving), ("without", free))
    }
    inertia = float(bench.wheel.parameters["J"])
    figures = {
        "rank": {str(k + 1): float(_rank(k)) for k in WHEELS},
        "rank_of_two_lost": float(np.linalg.matrix_rank(AXES[:, 2:])),
        "wheels": {str(k + 1): held(lost[k], ONSET) for k in WHEELS},
        "healthy": held(healthy, ONSET),
        "near_standstill_s": {name: _sticking(flown, inertia) for name, flown in rest.items()},
        "limits": {
            "momentum": inertia * float(bench.wheel.parameters["w_max"]),
            "torque": float(bench.wheel.signals.inputs[0].max),
        },
    }
    drawn = {
        "t": np.asarray(lost[0].t),
        "off": off_target(lost[0]),
        **{f"u_{k + 1}": np.asarray(lost[0].u[:, k]) for k in WHEELS},
        **{f"h_{k + 1}": np.asarray(lost[0].momentum[:, k]) for k in WHEELS},
        **{f"loss_{k + 1}": np.asarray(lost[0].info.wheels.f[:, k, 1]) for k in WHEELS},
        **{f"rest_{name}": np.asarray(flown.momentum[:, 0]) for name, flown in rest.items()},
    }
    return {"reconfiguration": figures}, {"reconfiguration": drawn}


def _wheel(nominal: GrayBoxPlant, factor: float) -> GrayBoxPlant:
    changed = {n: v * factor if n in DRY else v for n, v in nominal.parameters.items()}
    return eqx.tree_at(lambda plant: plant.parameters, nominal, changed)


def _rank(lost: int) -> int:
    return int(np.linalg.matrix_rank(np.delete(AXES, lost, axis=1)))


def _fly(
    bench: Bench, array: _Array, flying: Satellite, h: Float[np.ndarray, "4"], lost: int | None
) -> Telemetry:
    schedules: list[list[Schedule]] = [[inner_disturbance(wheel)] for wheel in array.wheels]
    if lost is not None:
        schedules[lost].append(loss(ONSET))
    return run_satellite(flying, SECONDS, bench.seed, schedules, SLEW, [float(x) for x in h])


def _sticking(flown: Telemetry, inertia: float) -> float:
    """How long the wheels together turn slower than the Stribeck speed after the slew, s."""
    slow = np.abs(np.asarray(flown.momentum)) < inertia * STICKING
    return float(slow[flown.t >= ONSET].sum() * PERIOD)


def section(results: Results, traces: Traces) -> Section:
    found = results["reconfiguration"]
    still = found["near_standstill_s"]
    worst = max(found["wheels"][str(k + 1)]["back_after_s"]["max"] for k in WHEELS)
    return Section(
        "Reconfiguration: four wheels in a pyramid",
        (
            "Four wheels whose dry friction differs by up to 50 %, each with a model learned from "
            "its own log. Torque is shared out by the weighted pseudo-inverse, a wheel's weight "
            "being the square of what is left of its effectiveness; each wheel feeds its own "
            "friction forward. A wheel that is lost gets weight 0, and the torque with which it "
            "runs down is put on the others.",
            f"Every single wheel may be lost: the axes of the other three have rank 3. Pointing is "
            f"back within {HELD:g} deg after {worst:.0f} s at the latest, over all wheels and "
            "seeds. With two wheels lost, rank "
            f"{found['rank_of_two_lost']['median']:.0f} is left.",
            "Null motion drives the momenta to ±60 N·m·s, in the pattern that cancels on the body. "
            "Started at rest, the wheels together spend "
            f"{span(still['with_null_motion'], '.0f', 's')} of the last 500 s below the Stribeck "
            f"speed with it, and {span(still['without'], '.0f', 's')} without.",
        ),
        (_table(found),),
        _figures(traces["reconfiguration"]),
    )


def _table(found: Results) -> Table:
    limits = found["limits"]
    rows = tuple(
        (
            str(k),
            span(found["rank"][str(k)], ".0f"),
            span(each["decided_after_s"], ".3g"),
            span(each["back_after_s"], ".3g"),
            span(each["peak_deg"], ".2g"),
            span(each["largest_momentum"], ".3g"),
        )
        for k, each in ((k + 1, found["wheels"][str(k + 1)]) for k in WHEELS)
    )
    header = (
        "wheel lost",
        "rank left",
        "given up after (s)",
        "back after (s)",
        "peak (deg)",
        "most momentum (N·m·s)",
    )
    note = (
        f"Limits of a wheel: {limits['momentum']['median']:.0f} N·m·s, "
        f"{limits['torque']['median']:g} N·m; commands stay inside the latter by construction."
    )
    return Table(header, rows, note)


def _figures(x: Any) -> tuple[Figure, ...]:
    near = (x["t"] >= ONSET - 20) & (x["t"] <= ONSET + 180)

    def each(what: str, chosen: np.ndarray) -> dict[str, np.ndarray]:
        return {f"wheel {k + 1}": x[f"{what}_{k + 1}"][chosen] for k in WHEELS}

    everything = np.ones(len(x["t"]), bool)
    return (
        panels(
            x["t"][near],
            [
                Panel("off target", "deg", {"attitude": x["off"][near]}),
                Panel("command u", "N*m", each("u", near)),
                Panel("estimated loss", "", each("loss", near)),
            ],
            title="Wheel 1 of the pyramid is lost at 500 s",
        ),
        panels(
            x["t"],
            [
                Panel("momentum, wheel 1 lost", "N*m*s", each("h", everything)),
                Panel(
                    "momentum of wheel 1, from rest",
                    "N*m*s",
                    {"null motion": x["rest_with_null_motion"], "without": x["rest_without"]},
                ),
            ],
            title="Momenta of the pyramid",
            caption="Above: wheel 1 runs down after its loss. Below: no wheel is lost.",
        ),
    )
