"""Condition (13), beta_1^2 > 4 beta_2 delta^(kappa-1): what it is worth for a sampled observer."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

from faultgauge.reporting.report import Section, Table
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.claims.condition_13_drawn import KINDS, damping, where, zone
from faultgauge_studies.paper.claims.condition_13_error import (
    FORMS,
    condition_13,
    injection,
    responses,
)
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.estimating import BANDWIDTH, DELTA, KAPPA, ZETA, noise_gain
from faultgauge_studies.paper.tables import Results

__all__ = ["measure", "section", "verdict"]

STEP, ZETAS = np.geomspace(0.05, 2.5, 25), np.geomspace(0.3, 3.0, 25)  # omega_o T_s, zeta
KAPPAS, DELTAS = (0.25, 0.5, 0.75), (0.005, 0.02, 0.1, 0.4)  # delta in N*m*s
JUMPS = (0.1, 0.2)  # N*m: the sustained fault and the greatest jump of eq (17)
SWEEP = np.round(np.arange(0.41, 2.0, 0.02), 2)  # zeta of the curves, 0.99 and 1.01 among them
ZONES = np.geomspace(0.005, 1.0, 30)  # delta of the curves, N*m*s
OVERSHOOT = 0.01  # of a jump: well inside the 5 % of settling
PAPER = ("euler", "held")  # sampled forms with the paper's own beta_1 and beta_2


def measure() -> tuple[dict[str, Any], Traces]:
    """Maps over (omega_o T_s, zeta, kappa, delta, jump) of three forms, and curves beside them."""
    cells = np.meshgrid(STEP / PERIOD, ZETAS, np.array(DELTAS), np.array(JUMPS), indexing="ij")
    omega, zeta, delta, jump = cells
    holds = np.stack([condition_13(omega, zeta, kappa, delta) for kappa in KAPPAS])
    step = np.broadcast_to(omega * PERIOD, holds.shape)
    short = step * zeta < 1
    figures: dict[str, Any] = {}
    maps: dict[str, Any] = {"omega_T": STEP, "zeta": ZETAS}
    for form in FORMS:
        runs = [responses(form, omega, zeta, kappa, delta, jump) for kappa in KAPPAS]
        fine = np.stack([run.converges for run in runs])
        over = np.stack([run.overshoot for run in runs])
        figures[form] = {
            "diverges_where_it_holds": float(np.mean(~fine[holds])),
            "converges_where_it_fails": float(np.mean(fine[~holds])),
            "least_step_where_it_holds": float(step[holds & ~fine].min(initial=np.inf)),
            "least_step_where_it_fails": float(step[~holds & ~fine].min(initial=np.inf)),
            "overshoot_where_it_holds": float(over[holds & fine].max()),
            "converges_below_1_over_zeta": float(np.mean(fine[holds & short])),
            "converges_beyond_1_over_zeta": float(np.mean(fine[holds & ~short])),
        }
        maps[form] = fine.mean(axis=(0, 3, 4))
    figures["fastest"], sweep = _over_zeta()
    return {"condition_13": figures}, {
        "condition_13_map": maps,
        "condition_13_zeta": sweep,
        "condition_13_zone": _over_zone(),
    }


def _over_zeta() -> tuple[dict[str, Any], dict[str, Any]]:
    """Settling and overshoot over zeta, at one bandwidth and at one gain of noise; the fastest
    settling without overshoot inside and outside (13)."""
    width = np.full(SWEEP.shape, DELTA)
    found: dict[str, Any] = {}
    curves: dict[str, Any] = {"zeta": SWEEP}
    for name, omega in {
        "bandwidth": np.full(SWEEP.shape, BANDWIDTH),
        "noise": np.array([at_equal_noise(float(zeta)) for zeta in SWEEP]),
    }.items():
        holds = condition_13(omega, SWEEP, KAPPA, width)
        found[name] = {}
        for jump in JUMPS:
            run = responses("placed", omega, SWEEP, KAPPA, width, np.full(SWEEP.shape, jump))
            usable = np.where(run.overshoot <= OVERSHOOT, run.settling, np.inf)
            found[name][f"{jump:g}"] = {
                "inside": float(usable[holds].min()),
                "outside": float(usable[~holds].min()),
                "zeta_outside": float(SWEEP[~holds][np.argmin(usable[~holds])]),
            }
            curves[f"settling_{name}_{jump:g}"] = run.settling
            curves[f"overshoot_{name}_{jump:g}"] = run.overshoot
    return found, curves


def at_equal_noise(zeta: float) -> float:
    """omega_o [rad/s] at which noise in h reaches fhat as in the study's own observer."""

    def gain(omega: float, zeta: float) -> float:
        gain_x, _, gain_f = injection("placed", omega, zeta)
        return noise_gain(gain_x, gain_f, PERIOD)

    wanted = gain(BANDWIDTH, ZETA)
    found: Any = brentq(lambda w: gain(w, zeta) - wanted, BANDWIDTH / 3, 3 * BANDWIDTH)
    return float(found)


def _over_zone() -> dict[str, Any]:
    """Settling [s] over delta for several kappa and both jumps."""
    curves: dict[str, Any] = {"delta": ZONES}
    omega, zeta = np.full(ZONES.shape, BANDWIDTH), np.full(ZONES.shape, ZETA)
    for kappa, jump in (*((kappa, JUMPS[1]) for kappa in (*KAPPAS, 1.0)), (KAPPA, JUMPS[0])):
        run = responses("placed", omega, zeta, kappa, ZONES, np.full(ZONES.shape, jump))
        curves[f"κ = {kappa:g}, {jump} N·m"] = run.settling
    return curves


def verdict(results: Results) -> Verdict:
    """Sufficient: no cell of the paper's own gains where (13) holds diverges."""
    found = {form: results["condition_13"][form] for form in FORMS}
    lost = {form: found[form]["diverges_where_it_holds"]["median"] for form in FORMS}
    kept = {form: found[form]["converges_where_it_fails"]["median"] for form in FORMS}
    enough = all(lost[form] == 0 for form in PAPER)
    needed = all(share == 0 for share in kept.values())
    least = [found[form]["least_step_where_it_holds"]["median"] for form in PAPER]
    first = min((x for x in least if x is not None), default=None)
    since = "" if first is None else f", from ω_o T_s = {first:.2g} on"
    own = " and ".join(f"{lost[form]:.0%} ({FORMS[form]})" for form in PAPER)
    others = ", ".join(f"{kept[form]:.0%} ({label})" for form, label in FORMS.items())
    return Verdict(
        "Condition (13) makes the observer converge (Lemma 2)",
        f"(13) is {'' if enough else 'not '}sufficient for a sampled observer: with the paper's "
        f"gains {own} of the cells in which it holds do not converge{since}; with "
        f"{FORMS['placed']} {lost['placed']:.0%}. It is {'' if needed else 'not '}necessary: "
        f"of the cells in which it fails {others} converge.",
        enough,
    )


def section(results: Results, traces: Traces) -> Section:
    """Condition (13) for the report."""
    found = results["condition_13"]
    judged = verdict(results)
    cells = STEP.size * ZETAS.size * len(KAPPAS) * len(DELTAS) * len(JUMPS)
    return Section(
        "Condition (13): gains and convergence",
        (
            "The paper: if β1² > 4 β2 δ^(κ-1), the observer estimates states and fault "
            "asymptotically. With β1 = 2ζω_o and β2 = ω_o² δ^(1-κ) this is ζ > 1, whatever ω_o, κ "
            "and δ: real poles in the linear zone of eq (12). In continuous time it is not needed "
            "for a constant fault: φ²/2 + β2 ∫g, with φ the error of the fault, falls for any "
            "positive β1 and β2.",
            f"Here the observer is sampled at T_s = {PERIOD} s over an integrator that it knows "
            f"exactly, {cells} cells of (ω_o T_s, ζ, κ, δ, jump of the fault) per form: κ "
            f"{_listed(KAPPAS)}; δ {_listed(DELTAS)} N·m·s; jumps {_listed(JUMPS)} N·m. A cell "
            "does not converge if an oscillation or growth is left after 1500 s.",
            f"Verdict: {'holds' if judged.holds else 'does not hold'}. {judged.found}",
            _law(found),
            _speed(found),
        ),
        (_share_table(found), _speed_table(found)),
        (where(traces), *damping(traces, JUMPS, 100 * OVERSHOOT), zone(traces)),
    )


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{x:g}" for x in values)


def _law(found: Results) -> str:
    below, beyond = (
        found["held"][f"converges_{side}_1_over_zeta"]["median"] for side in ("below", "beyond")
    )
    return (
        "Inside (13) the determinant of the linear error limits the held form to ω_o T_s < 1/ζ: "
        f"{below:.1%} of its cells below converge, {beyond:.1%} of those beyond. So more of what "
        "(13) asks for, a larger ζ, leaves less bandwidth at a given sample time."
    )


def _speed(found: Results) -> str:
    entry = found["fastest"]["noise"][f"{JUMPS[0]:g}"]
    inside, outside = (entry[key]["median"] for key in ("inside", "outside"))
    most = found["placed"]["overshoot_where_it_holds"]["median"]
    which = "outside" if outside < inside else "inside"
    return (
        f"(13) is a condition of over-damping: where it holds no cell of the placed form "
        f"overshoots by more than {most:.1%}. Of designs with equal gain of noise and at most "
        f"{OVERSHOOT:.0%} of overshoot the fastest lies {which} it: {inside:.1f} s inside, "
        f"{outside:.1f} s outside (ζ = {entry['zeta_outside']['median']:.2f}) for a jump of "
        f"{JUMPS[0]} N·m. A small δ leaves the linear zone sooner; there the gain falls with the "
        "error, so the estimate settles later, and later the larger the jump: (13) does not see it."
    )


def _share_table(found: Results) -> Table:
    def step(form: str, side: str) -> str:
        value = found[form][f"least_step_where_it_{side}"]["median"]
        return "none" if value is None else f"{value:.2g}"

    return Table(
        (
            "form",
            "(13) holds: diverges",
            "from ω_o T_s",
            "(13) fails: converges",
            "diverges from ω_o T_s",
        ),
        tuple(
            (
                label,
                f"{found[form]['diverges_where_it_holds']['median']:.1%}",
                step(form, "holds"),
                f"{found[form]['converges_where_it_fails']['median']:.1%}",
                step(form, "fails"),
            )
            for form, label in FORMS.items()
        ),
        "Shares of the cells, and the least ω_o T_s of a cell that does not converge.",
    )


def _speed_table(found: Results) -> Table:
    rows = []
    for name, label in KINDS.items():
        for jump, entry in found["fastest"][name].items():
            inside, outside, zeta = (
                entry[key]["median"] for key in ("inside", "outside", "zeta_outside")
            )
            rows.append((label, jump, f"{inside:.2f}", f"{outside:.2f}", f"{zeta:.2f}"))
    return Table(
        ("compared at", "jump (N·m)", "inside (13) (s)", "outside (s)", "ζ outside"),
        tuple(rows),
        f"Fastest settling to 5 % with at most {OVERSHOOT:.0%} of overshoot; poles placed in "
        f"discrete time, κ = {KAPPA}, δ = {DELTA} N·m·s; noise as at ω_o = {BANDWIDTH} rad/s, "
        f"ζ = {ZETA}.",
    )
