"""Lemma 1 asks for a C1 system; a wheel at its torque-speed limit is none. What that costs."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.excitation import Sweep
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.reporting.relations import relation
from faultgauge.reporting.report import Table
from faultgauge.reporting.svg import Figure
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import SECONDS
from faultgauge_studies.paper.claims.learned import rates, sized, teach
from faultgauge_studies.paper.excited import SWEEP, records
from faultgauge_studies.paper.learning import rms
from faultgauge_studies.paper.tables import Results, milli, span

__all__ = ["binned", "floor_of", "limit_figures", "limit_table", "limit_verdict", "measure_limit"]

HIDDEN = (2, 5, 10, 20)
# 2000 samples each, 1 Hz: 1000 N*m*s of travel at 0.5 N*m leaves the motor room for the noise.
INSIDE = replace(SWEEP, seconds=2000.0)
REACHING = replace(INSIDE, sweep=Sweep("hm", gain=0.03, amplitude=250.0, cycles=1))
HIGH_VOLTAGE = 40.0  # V: full torque up to 390 rad/s, beyond all that the records reach
BINS = np.linspace(-0.3, 1.5, 37)  # N*m, of the distance from the limit
FULL = 0.82  # N*m
LINE = np.linspace(-250.0, 250.0, 1001)  # N*m*s
NEAR, FAR = 0.1, 0.3  # N*m from the limit
PAPER = 10  # hidden units of the paper's networks
APART = 3.0  # times: more than one choice of 3 starts differs from another at one size
CASES = {
    "reaching": "reaching the limit",
    "limit_removed": "same sweep, limit removed",
    "inside": "staying inside the limit",
}


def speed_limit(wheel: GrayBoxPlant, h: Float[np.ndarray, "points"]) -> Float[np.ndarray, "points"]:
    """K (V - K |Omega|)/R [N*m]: the most that drives the wheel faster, Omega = h/J."""
    k, v, r, j = (float(wheel.parameters[name]) for name in ("K", "V", "R", "J"))
    return k * (v - k * np.abs(h) / j) / r


def without_limit(wheel: GrayBoxPlant) -> GrayBoxPlant:
    """The same wheel on so high a voltage that the limit is never met: C1 as far as it goes."""
    parameters = {**wheel.parameters, "V": jnp.asarray(HIGH_VOLTAGE)}
    return GrayBoxPlant(wheel.signals, wheel.spec, wheel.networks, parameters)


def order(hidden: Float[np.ndarray, "sizes"], error: Float[np.ndarray, "sizes"]) -> float:
    """p of error ~ hidden^-p, by least squares of the logarithms."""
    return -float(np.polyfit(np.log(hidden), np.log(error), 1)[0])


def measure_limit(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Error of dh over the training range against hidden units: with, without, inside the limit.

    Without f(t), so that nothing but the shape of F is left to be learned.
    """
    cases = {
        "reaching": (bench.wheel, REACHING),
        "limit_removed": (without_limit(bench.wheel), REACHING),
        "inside": (bench.wheel, INSIDE),
    }
    floor = floor_of(bench)
    figures: dict[str, Any] = {"hidden": list(HIDDEN), "floor": floor}
    beside: dict[str, Any] = {"margin": (BINS[1:] + BINS[:-1]) / 2}
    full: dict[str, Any] = {"h": LINE}
    for name, (wheel, experiment) in cases.items():
        given = records(wheel, experiment, bench.seed, ())
        momentum, command = given.training.columns["hm"], given.training.columns["u"]
        learned = {n: teach(sized(n), given, bench.seed)[0] for n in HIDDEN}
        h, u = _box(momentum)
        error = {n: rates(plant, h, u) - rates(wheel, h, u) for n, plant in learned.items()}
        size = [rms(each) for each in error.values()]
        figures[name] = {
            "rms": size,
            "largest": [float(np.abs(each).max()) for each in error.values()],
            "units_to_floor": units_to(HIDDEN, size, floor),
            "order": order(np.array(HIDDEN, float), np.array(size)),
            "share_beyond_limit": float(np.mean(margin(bench.wheel, momentum, command) < 0)),
        }
        if name == "inside":
            continue
        distance = margin(bench.wheel, h, u)
        figures[name]["rms_near_limit"] = rms(error[PAPER][np.abs(distance) < NEAR])
        figures[name]["rms_far_from_limit"] = rms(error[PAPER][distance > FAR])
        beside[name] = binned(distance, error[PAPER], BINS)
        commands = np.full(len(LINE), FULL)
        seen = (momentum.min() <= LINE) & (momentum.max() >= LINE)
        full[name] = np.where(
            seen, rates(learned[PAPER], LINE, commands) - rates(wheel, LINE, commands), np.nan
        )
    return figures, {"lemma1_margin": beside, "lemma1_full_torque": full}


def floor_of(bench: Bench) -> float:
    """rms f(t) [N*m] over a flight: what is inside the wheel and known to no model."""
    return rms(bench.inner[0].profile.sizes(np.arange(0.0, SECONDS, PERIOD)))


def margin(
    wheel: GrayBoxPlant, h: Float[np.ndarray, "points"], u: Float[np.ndarray, "points"]
) -> Float[np.ndarray, "points"]:
    """What the command leaves to the torque-speed limit, N*m: 0 at the kink, negative beyond."""
    return speed_limit(wheel, h) - np.sign(h) * u


def binned(
    at: Float[np.ndarray, "points"],
    error: Float[np.ndarray, "points"],
    edges: Float[np.ndarray, "edges"],
) -> Float[np.ndarray, "bins"]:
    """Root mean square of `error` between neighbouring `edges` of `at`; NaN where nothing is."""
    place = np.digitize(at, edges)
    return np.array(
        [rms(error[place == k]) if np.any(place == k) else np.nan for k in range(1, len(edges))]
    )


def units_to(hidden: Sequence[int], error: Sequence[float], floor: float) -> float:
    """The fewest hidden units with which the error is at most `floor`; inf: none of these."""
    return min((float(n) for n, e in zip(hidden, error, strict=True) if e <= floor), default=np.inf)


def _box(h: Float[np.ndarray, "samples"]) -> tuple[np.ndarray, np.ndarray]:
    """(h, u) on a grid over the momenta of a record and all commands."""
    grid = np.meshgrid(np.linspace(h.min(), h.max(), 241), np.linspace(-FULL, FULL, 101))
    return grid[0].ravel(), grid[1].ravel()


def limit_verdict(found: Results) -> str:
    """What the kink costs: error at equal size, where it lies, and the rate of convergence."""
    hard, smooth = found["reaching"], found["limit_removed"]
    largest = [found[name]["rms"][-1]["median"] for name in ("reaching", "limit_removed")]
    ratio = largest[0] / largest[1]
    close = hard["rms_near_limit"]["median"] / hard["rms_far_from_limit"]["median"]
    rates_ = hard["order"]["median"], smooth["order"]["median"]
    costly = (
        f"Where the limit is reached ({hard['share_beyond_limit']['median']:.1%} of the samples) "
        f"the premise of a C1 system is broken, and it matters: at {found['hidden'][-1]} units the "
        f"error is {ratio:.3g} times that of the same wheel without its limit"
        if ratio > APART
        else f"Reaching the limit breaks the premise of a C1 system, but at {found['hidden'][-1]} "
        f"units the error is only {ratio:.3g} times that of the same wheel without its limit"
    )
    where = (
        f"; within {NEAR} N·m of the kink it is {close:.3g} times that beyond {FAR} N·m from it. "
    )
    slower = "slower" if rates_[0] < rates_[1] else "not slower: it starts higher and stays higher"
    return (
        costly
        + where
        + f"The rate itself, error ~ N^-p with p = {rates_[0]:.2f} against {rates_[1]:.2f}, is "
        + f"{slower}."
    )


def limit_table(found: Results) -> Table:
    """Error of dh over (h, u) by hidden units, for the three experiments."""
    rows = []
    for name, label in CASES.items():
        entry = found[name]
        units = entry["units_to_floor"]["median"]
        rows.append(
            (
                label,
                *(span(milli(each), ".2g") for each in entry["rms"]),
                "none of these" if units is None else f"{units:g}",
                f"{entry['order']['median']:.2f}",
            )
        )
    sizes = tuple(f"N = {n}" for n in found["hidden"])
    return Table(
        ("experiment", *sizes, "N to below f(t)", "p of N^-p"),
        tuple(rows),
        "Root mean square error of dh in mN·m over the box of momenta and commands that the record "
        f"spans, learned without f(t). Below f(t): at most {found['floor']['median']:.3g} N·m.",
    )


def limit_figures(traces: Traces) -> tuple[Figure, ...]:
    """Error against the distance from the kink, and along h at full torque."""
    near, full = traces["lemma1_margin"], traces["lemma1_full_torque"]
    names = {"reaching": "with the limit", "limit_removed": "limit removed"}
    return (
        relation(
            near["margin"],
            {label: near[name] for name, label in names.items()},
            title=f"Error beside the torque-speed limit, {PAPER} hidden units",
            x_name="limit less command",
            x_unit="N*m",
            y_name="RMS error of dh",
            y_unit="N*m",
            logarithmic="y",
            caption="At 0 the command meets the limit: F has a kink there and is no C1 function.",
        ),
        relation(
            full["h"],
            {label: full[name] for name, label in names.items()},
            title=f"Error at full torque u = {FULL} N·m, {PAPER} hidden units",
            x_name="momentum h",
            x_unit="N*m*s",
            y_name="dh learned less true",
            y_unit="N*m",
            caption="The limit binds from h = 210 N·m·s on; with it the error oscillates there.",
        ),
    )
