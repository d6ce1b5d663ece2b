"""What the accommodated loop bears: gain and lag that nothing in it knows of, and a false alarm."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.perturbed import Perturbed
from faultgauge.plants.model import Model
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.observatory import INERTIA, PERIOD
from faultgauge.simulation.schedules import Ramp, Schedule
from faultgauge_studies.paper.accommodating.policies import CASE, NAMES, pitch
from faultgauge_studies.paper.accommodating.setting import adrc, beneath, by_posterior, fly
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import ONSET
from faultgauge_studies.paper.learning import PITCH
from faultgauge_studies.paper.tables import Results, span

__all__ = ["CORNERS", "crossover", "lag", "measure", "section"]

GAIN, ANGLE = 2.0, np.pi / 6  # 6 dB, 30 deg
CORNERS: dict[str, tuple[float, float]] = {
    "gain_up": (GAIN, 0.0),
    "gain_down": (1 / GAIN, 0.0),
    "lag": (1.0, ANGLE),
    "gain_up_and_lag": (GAIN, ANGLE),
    "gain_down_and_lag": (1 / GAIN, ANGLE),
}
LABELS = {
    "gain_up": "+6 dB",
    "gain_down": "-6 dB",
    "lag": "30 deg",
    "gain_up_and_lag": "+6 dB and 30 deg",
    "gain_down_and_lag": "-6 dB and 30 deg",
}
# Beyond the corners: the lag of the nominal loop, which is 58 degrees where the gain is doubled.
BEYOND = "gain_up_and_nominal_lag"
JUDGED = ("none", "estimate_and_friction", "adrc")
LONG, END = 2000.0, 100.0  # s: flown, and judged at the end
STILL = 0.02  # deg: what is left to swing, at most
DEPTH = 32  # samples of lag that the compiled program has room for
# A tachometer that drifts by 3 N*m*s in a minute looks like 0.05 N*m of friction.
DRIFT = Schedule("tachometer", "output", "hm", Ramp(3.0, ONSET, ONSET + 60.0), "add", "N*m*s")


def crossover(gain: float) -> float:
    """rad/s at which |gain (2 zeta w_n s + w_n^2) / s^2| = 1: the attitude loop's, on one axis."""
    controller = AttitudeController(jnp.array(INERTIA))
    w, zeta = controller.bandwidth, controller.damping
    b, c = (gain * 2 * zeta * w) ** 2, (gain * w**2) ** 2
    return float(np.sqrt((b + np.sqrt(b**2 + 4 * c)) / 2))


def lag(gain: float, angle: float) -> int:
    """Control periods that turn the loop by `angle` [rad] where it crosses over under `gain`."""
    return round(angle / (crossover(gain) * PERIOD))


def measure(bench: Bench, model: Model) -> tuple[dict[str, Any], Traces]:
    figures: dict[str, Any] = {}
    drawn: dict[str, Any] = {}
    for name in JUDGED:
        figures[name] = {}
        put_in = {corner: (gain, lag(gain, angle)) for corner, (gain, angle) in CORNERS.items()}
        for corner, (gain, delay) in {**put_in, BEYOND: (GAIN, lag(1.0, ANGLE))}.items():
            inner = adrc(bench) if name == "adrc" else by_posterior(model, name)
            policy = Perturbed(beneath(inner), jnp.asarray(gain), jnp.asarray(delay), DEPTH)
            flown = fly(bench, policy, CASE.fault, seconds=LONG)
            angles = pitch(flown)
            end = angles[flown.t >= LONG - END]
            figures[name][corner] = {
                "peak_deg": float(np.abs(angles[flown.t >= ONSET]).max()),
                "left_deg": float(np.ptp(end) / 2),
            }
            if name == "estimate_and_friction" and corner != BEYOND:
                drawn |= {"t": np.asarray(flown.t), corner: angles}
    alarm, curves = _false_alarm(bench, model)
    return (
        {"accommodation": {"margins": figures, "false_alarm": alarm}},
        {"accommodation_margins": drawn, "accommodation_false_alarm": curves},
    )


def _false_alarm(bench: Bench, model: Model) -> tuple[dict[str, float], dict[str, Any]]:
    """The tachometer drifts, the wheel is sound: what an alarm for nothing does."""
    policy = beneath(by_posterior(model, "estimate_and_friction"))
    calm, fooled = fly(bench, policy), fly(bench, policy, DRIFT)
    t, angle, usual = np.asarray(calm.t), pitch(fooled), pitch(calm)
    after, end = t >= ONSET, t >= t[-1] - END
    acted = np.asarray(fooled.info.engaged[:, PITCH, 0])
    figures = {
        "peak_deg": float(np.abs(angle[after]).max()),
        "left_deg": float(np.abs(angle - usual)[end].max()),
        "acted_s": float(acted.sum() * PERIOD),
        "reverted": float(not acted[-1]),
        "largest_compensation_step": float(np.abs(np.diff(fooled.info.c[:, PITCH, 0])).max()),
        "largest_step": float(np.abs(np.diff(fooled.u[after, PITCH])).max()),
    }
    return figures, {
        "t": t[after],
        "pitch": angle[after],
        "calm": usual[after],
        "f": np.asarray(fooled.info.f[after, PITCH, 0]),
        "c": np.asarray(fooled.info.c[after, PITCH, 0] - calm.info.c[after, PITCH, 0]),
        "acted": acted[after].astype(float),
    }


def section(results: Results, traces: Traces) -> Section:
    found, alarm = results["accommodation"]["margins"], results["accommodation"]["false_alarm"]
    worst = max(found[name][corner]["left_deg"]["max"] for name in JUDGED[1:] for corner in CORNERS)
    verdict = "All come to rest" if worst <= STILL else "Not all come to rest"
    beyond = {name: span(found[name][BEYOND]["left_deg"], ".2g", "deg") for name in JUDGED[1:]}
    return Section(
        "Accommodation: margins and a false alarm",
        (
            "Between the policies and the wheels the command is multiplied and delayed, which "
            "neither controller nor estimator knows: the delay is 30 deg at the frequency where "
            f"the attitude loop crosses over under that gain. {verdict}: the largest swing left "
            f"in the last {END:g} of {LONG:g} s is {worst:.2g} deg. Beyond these corners, with "
            "the gain doubled and the delay that is 30 deg in the nominal loop (and 58 deg in "
            f"this one), {beyond['estimate_and_friction']} are left by the posterior and "
            f"{beyond['adrc']} by ADRC, whose estimate closes a loop of its own.",
            "The posterior knows of a loss of effectiveness, and so a gain that is off is named "
            "and made up for. A delay it does not know: what it sees is something undeclared, on "
            "which nothing is done, and the friction stays as long as it lasts. ADRC asks for no "
            "cause.",
            "A tachometer that drifts by 3 N·m·s in a minute looks like 0.05 N·m of friction. The "
            f"posterior falls for it for {span(alarm['acted_s'], '.3g', 's')}; pitch leaves by "
            f"{span(alarm['peak_deg'], '.2g', 'deg')} at most, the compensation comes and goes "
            f"in steps of {span(alarm['largest_compensation_step'], '.2g', 'N·m')} at most, and "
            f"{span(alarm['left_deg'], '.1g', 'deg')} are left of it.",
        ),
        tuple(_table(found, name) for name in JUDGED[1:]),
        _figures(traces),
    )


def _table(found: Results, name: str) -> Table:
    rows = [
        (
            LABELS[corner],
            span(found[name][corner]["peak_deg"], ".2f"),
            span(found[name][corner]["left_deg"], ".1g"),
            span(found["none"][corner]["peak_deg"], ".2f"),
        )
        for corner in CORNERS
    ]
    header = (NAMES[name], "peak (deg)", "left (deg)", "peak, none (deg)")
    return Table(header, tuple(rows), "Peak from 500 s on; left: half of the swing at the end.")


def _figures(traces: Traces) -> tuple[Figure, ...]:
    x, y = traces["accommodation_margins"], traces["accommodation_false_alarm"]
    late = x["t"] >= ONSET - 50
    swings = [
        Panel("pitch", "deg", {LABELS[each]: x[each][late] for each in corners})
        for corners in (list(CORNERS)[:3], list(CORNERS)[3:])
    ]
    return (
        panels(
            x["t"][late],
            swings,
            title="-fhat and friction under gain and lag at the actuators",
            caption="The fault is eq (17), which ends at 800 s.",
        ),
        panels(
            y["t"],
            [
                Panel("pitch", "deg", {"false alarm": y["pitch"], "without": y["calm"]}),
                Panel("torque", "N*m", {"estimate": y["f"], "added compensation": y["c"]}),
                Panel("decision", "", {"acted upon": y["acted"]}),
            ],
            title="A drifting tachometer: accommodation of nothing, and its end",
        ),
    )
