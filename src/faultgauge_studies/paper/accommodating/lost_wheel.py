"""Part of the pitch wheel's effectiveness lost, and all of it: rescaling, and the spare wheel."""

from typing import Any

import numpy as np

from faultgauge.plants.model import Model
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge.simulation.satellite.loop import Satellite, Telemetry
from faultgauge.simulation.satellite.observatory import MOMENTA, SLEW, run_satellite
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.accommodating.array import held, loss, off_target, satellite
from faultgauge_studies.paper.accommodating.policies import NAMES, pitch
from faultgauge_studies.paper.accommodating.setting import beneath, by_posterior, fly
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import ONSET, SECONDS
from faultgauge_studies.paper.learning import PITCH, rms
from faultgauge_studies.paper.tables import Results, span

__all__ = ["AXES", "SPARE_OF", "measure", "section"]

PART, EARLY = 0.5, 5.0  # lost in the slew, where the loss shows; s
RESCALED = ("none", "estimate", "estimate_and_friction")
AXES = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]])
SPARE_OF = (-1, -1, -1, PITCH)  # a second pitch wheel, at rest
LABELS = {
    "healthy": "nothing lost",
    "part": "half of the pitch wheel",
    "all": "the pitch wheel",
    "spare_too": "the pitch wheel, and the spare is dead",
}


def measure(bench: Bench, model: Model) -> tuple[dict[str, Any], Traces]:
    rescaled = {}
    for name in RESCALED:
        flown = fly(bench, beneath(by_posterior(model, name)), loss(EARLY, PART))
        rescaled[name] = {
            "rms_deg": rms(pitch(flown)[flown.t >= ONSET]),
            "loss": float(flown.info.f[-1, PITCH, 1]),
        }
    array = satellite([bench.wheel] * 4, [model] * 4, AXES, SPARE_OF)
    cases: dict[str, tuple[list[Schedule], list[Schedule]]] = {
        "healthy": ([], []),
        "part": ([loss(ONSET, PART)], []),
        "all": ([loss(ONSET)], []),
        "spare_too": ([loss(ONSET)], [loss(0.0)]),
    }
    flights = {name: _fly(bench, array, *faults) for name, faults in cases.items()}
    figures = {name: held(flown, ONSET) for name, flown in flights.items()}
    for name, flown in flights.items():
        changes = np.abs(np.diff(np.asarray(flown.info.used).astype(int), axis=0))
        figures[name]["switchings"] = float(np.any(changes, axis=1).sum())
    drawn = {"t": np.asarray(flights["all"].t)}
    for name in ("all", "spare_too"):
        drawn |= _drawn(name, flights[name])
    found = {"accommodation": {"rescaling": rescaled, "spare_wheel": figures}}
    return found, {"spare_wheel": drawn}


def _fly(bench: Bench, array: Satellite, prime: list[Schedule], spare: list[Schedule]) -> Telemetry:
    inner = [*bench.inner]
    wheels = [inner, [*inner, *prime], inner, [*inner, *spare]]
    return run_satellite(array, SECONDS, bench.seed, wheels, SLEW, (*MOMENTA, 0.0))


def _drawn(name: str, flown: Telemetry) -> dict[str, Any]:
    return {
        f"off_{name}": off_target(flown),
        f"u_prime_{name}": np.asarray(flown.u[:, PITCH]),
        f"u_spare_{name}": np.asarray(flown.u[:, 3]),
        f"loss_{name}": np.asarray(flown.info.wheels.f[:, PITCH, 1]),
        f"prime_{name}": np.asarray(flown.info.used[:, PITCH], float),
        f"spare_{name}": np.asarray(flown.info.used[:, 3], float),
    }


def section(results: Results, traces: Traces) -> Section:
    rescaled = results["accommodation"]["rescaling"]
    spare = results["accommodation"]["spare_wheel"]
    kept = ", ".join(
        f"{NAMES[name]} {span(rescaled[name]['rms_deg'], '.3f', 'deg')}" for name in RESCALED
    )
    return Section(
        "Loss of effectiveness: rescaling and the spare wheel",
        (
            "Friction and loss of effectiveness are estimated together. Half of the pitch "
            "wheel is lost at the beginning of the slew; the command is divided by what is left, "
            f"a fifth at least. RMS of pitch from 500 s on: {kept}. The loss is found to be "
            f"{span(rescaled['estimate']['loss'], '.2f')}. In the slew itself the wheel is at its "
            "limit, and no policy makes up for torque that is not there.",
            "Beyond that floor the wheel is given up and a second pitch wheel takes over, from "
            "rest. The decision needs an engaged loss for 2 s on end and is final: a wheel without "
            "commands could not show that it has recovered. If the spare fails too, the array has "
            "rank 2, and that is said; pitch is then lost.",
        ),
        (_table(spare),),
        _figures(traces["spare_wheel"]),
    )


def _table(found: Results) -> Table:
    rows = tuple(
        (
            label,
            span(found[name]["decided_after_s"], ".3g"),
            span(found[name]["back_after_s"], ".3g"),
            span(found[name]["peak_deg"], ".3g"),
            span(found[name]["switchings"], ".0f"),
            span(found[name]["rank"], ".0f"),
        )
        for name, label in LABELS.items()
    )
    header = ("lost at 500 s", "given up after (s)", "back in 0.05 deg after (s)", "peak (deg)")
    return Table((*header, "switchings", "rank at the end"), rows)


def _figures(x: Any) -> tuple[Figure, ...]:
    late = (x["t"] >= ONSET - 20) & (x["t"] <= ONSET + 180)
    t = x["t"][late]

    def drawn(name: str, title: str) -> Figure:
        y = {key: x[f"{key}_{name}"][late] for key in ("off", "u_prime", "u_spare", "loss")}
        used = {"prime": x[f"prime_{name}"][late], "spare": x[f"spare_{name}"][late]}
        return panels(
            t,
            [
                Panel("off target", "deg", {"attitude": y["off"]}),
                Panel("command u", "N*m", {"prime": y["u_prime"], "spare": y["u_spare"]}),
                Panel("loss of the prime", "", {"estimate": y["loss"]}),
                Panel("in use", "", used),
            ],
            title=title,
        )

    return (
        drawn("all", "The pitch wheel is lost: the spare takes over"),
        drawn("spare_too", "The pitch wheel is lost and the spare is dead"),
    )
