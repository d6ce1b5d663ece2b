"""The measured drive (EMPS) judged: 5 V pulses hidden in its command, and a healthy stretch.

Nothing is used twice: fitted on the first half of the nominal record, stopped on the next tenth,
calibrated on the fifth after it; the last fifth is the healthy stretch that none of them has seen,
and the second record holds the pulses. The body is chosen by its healthy estimate on the stretch
that calibrates: a better free run need not give a better observer.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.answer.estimation import estimate
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.verbs.checkup import parts
from faultgauge_studies import merit
from faultgauge_studies.drive import FAULT, PULSE, DriveLogs

__all__ = ["Body", "Found", "bodies", "by_bank", "by_eso", "scored", "trained"]

BANDWIDTH = 100.0  # rad/s
SHARES = (0.5, 0.6, 0.8)  # of the nominal record
SETTLED = 0.06  # s after an edge; scored from there on
NETWORK = "positioning_drive_network"


@dataclass(frozen=True)
class Body:
    """A trained plant, calibrated for the bank (`model`) and for the ESO (`limited`): its free
    run's error on the stretch that stops the fit, as
    a share of the output's standard deviation, and the RMS [V] of its healthy estimate on the
    stretch that calibrates."""

    name: str
    model: Model
    limited: Model
    free_run: float
    healthy: float


@dataclass(frozen=True)
class Found:
    """What one observer made of the pulses: `f` [V] with its interval.

    `figures`: RMSE [V] and its share of 5 V from 60 ms after each edge, settling times [s] to 5 %,
    coverage; of the bank also half periods and how many are wrong, alarms on the healthy stretch,
    and how the onsets of the pulses were told, and what it decided of the `pulses`.
    """

    f: Float[np.ndarray, "samples"]
    lo: Float[np.ndarray, "samples"]
    hi: Float[np.ndarray, "samples"]
    figures: dict[str, float]
    pulses: Decision | None = None


def bodies() -> Mapping[str, GrayBoxPlant]:
    """Friction by physics; by networks of speed of 2 and 6 units; by one of speed and place."""
    text = read_plant_text(NETWORK)
    placed = text.replace("friction(v)", "friction(v, q)")
    texts = {
        "physics": read_plant_text("positioning_drive"),
        "network of speed, 2 units": text,
        "network of speed, 6 units": text.replace("hidden = 2", "hidden = 6"),
        "network of speed and place, 6 units": placed.replace("hidden = 2", "hidden = 6"),
    }
    return {
        name: GrayBoxPlant.untrained(parse_plant(_faster(each), name))
        for name, each in texts.items()
    }


def _faster(text: str) -> str:
    return text.replace("bandwidth = 50", f"bandwidth = {BANDWIDTH:g}")


def trained(name: str, plant: GrayBoxPlant, logs: DriveLogs, seed: int) -> Body:
    """One body, from the first four fifths of the nominal record."""
    first, stop, third, _ = parts([logs.healthy], *SHARES)
    model, _ = fit(plant, first, stop, seed=seed)
    calibrated = calibrate(model, third).model
    limited = calibrate(model, third, observer="eso").model
    quiet = estimate(limited, third)[0][0]
    healthy = merit.rms(quiet.f[FAULT][quiet.settled])
    free = model.record.metrics.validation_free_run_nrmse
    return Body(name, calibrated, limited, free, healthy)


def by_eso(body: Body, logs: DriveLogs) -> Found:
    """The extended state observer at 100 rad/s."""
    (pulses,), _ = estimate(body.limited, [logs.faulty])
    f, width = pulses.f[FAULT], pulses.half_width[FAULT]
    return scored(f, f - width, f + width, pulses.settled, logs)


def by_bank(body: Body, logs: DriveLogs) -> Found:
    """The bank."""
    last = parts([logs.healthy], *SHARES)[3]
    (quiet, pulses), _ = decide_runs(body.model, [*last, logs.faulty])
    f = pulses.posterior
    judged = np.array(pulses.status) != "NOT_JUDGED"
    found = scored(f.f[:, 0], f.lo[:, 0], f.hi[:, 0], judged, logs)
    t, places = logs.faulty.t, merit.edges_of(logs.pulse)
    after = merit.settled(t, places, SETTLED)
    right = merit.intervals_right(pulses.status, logs.pulse, places, after)
    found.figures["half_periods"] = float(len(right))
    found.figures["half_periods_wrong"] = float(np.sum(~right))
    found.figures["alarms_on_healthy_stretch"] = float(merit.alarms(quiet.status))
    edges = [float(logs.faulty.t[k]) for k in merit.edges_of(logs.pulse)]
    edges = edges if logs.pulse[0] == 0 else edges[1:]
    ends = [*edges[1::2], np.inf]  # of the last one too
    told = [
        merit.dated(pulses.events, FAULT, *each) for each in zip(edges[::2], ends, strict=False)
    ]
    dated = [each for each in told if each is not None]
    found.figures["onsets_told"] = float(len(dated))
    found.figures["onsets_inside"] = float(sum(each.inside for each in dated))
    found.figures["onset_width_median_s"] = float(np.median([each.width for each in dated]))
    return replace(found, pulses=pulses)


def scored(
    f: Float[np.ndarray, "samples"],
    lo: Float[np.ndarray, "samples"],
    hi: Float[np.ndarray, "samples"],
    judged: Bool[np.ndarray, "samples"],
    logs: DriveLogs,
) -> Found:
    """The figures of one observer's estimates; coverage where they are `judged`."""
    t, truth = logs.faulty.t, logs.pulse
    edges = merit.edges_of(truth)
    after = merit.settled(t, edges, SETTLED)
    times = merit.settling_times(t, f, truth, edges)
    error = merit.rmse(f, truth, after)
    figures = {
        "rmse_v": error,
        "rmse_share": error / PULSE,
        "settling_median_s": float(np.median(times)),
        "settling_max_s": float(np.max(times)),
        "edges_within_60_ms": float(np.sum(times <= SETTLED)),
        "coverage_settled": merit.coverage(lo, hi, truth, after & judged),
    }
    return Found(f, lo, hi, figures)
