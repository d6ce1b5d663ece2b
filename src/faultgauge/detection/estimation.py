"""`estimate`: a row per sample, a status that can say "not judged", and events."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.calibration import channels_of, score
from faultgauge.detection.flat_line import standing_still
from faultgauge.detection.judged import Bank, Estimates, build_bank, estimate_run
from faultgauge.detection.residual import Reference, residuals
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import paced

__all__ = [
    "Event",
    "Judgement",
    "Limits",
    "as_dicts",
    "estimate",
    "events",
    "judged",
    "limits_in",
    "pause",
    "sentence",
    "sentences",
    "table",
]

HEALTHY, FAULT, NOT_JUDGED = "HEALTHY", "FAULT", "NOT_JUDGED"
MERGE = 2.0  # pauses shorter than this many 1 / omega_o do not end an event
SETTLING = 5.0  # of an event, in 1 / omega_o, left out of its size where it lasts longer


@dataclass(frozen=True)
class Event:
    """A stretch above the limit. Times in s, size in the fault's unit with its 95 % interval.

    `fault` is the hypothesis whose estimate stands highest above its limit. `p` stays None: one
    observer gives no probability.
    """

    run: str
    fault: str
    start: float
    end: float
    size: float
    lo: float
    hi: float
    p: float | None = None


@dataclass(frozen=True)
class Judgement:
    """One run judged: everything that `estimate` writes, one row per sample."""

    run: Run
    residuals: dict[str, Float[np.ndarray, "samples"]]
    f: dict[str, Float[np.ndarray, "samples"]]
    half_width: dict[str, float]
    status: list[str]
    reason: list[str]
    events: list[Event]


def estimate(
    model: Model,
    runs: Sequence[Run],
    *,
    observer: str = "eso",
    reference: Reference = "free",
) -> tuple[list[Judgement], Bank]:
    """Judge `runs` with the model's calibration; without one every row is NOT_JUDGED.

    `reference` chooses the healthy reference of the residual columns. Raises `InputError`
    where no declared fault can be estimated from the columns at hand.
    """
    runs = [paced(run) for run in runs]
    bank = build_bank(model, runs, observer)
    return [_judge(bank, run, reference) for run in runs], bank


def limits_in(model: Model) -> dict[str, Any] | None:
    """The calibration block of `model`; None where it holds no limits of an observer."""
    block = model.calibration
    return block if block is not None and "channels" in block else None


def _judge(bank: Bank, run: Run, reference: Reference) -> Judgement:
    estimates = estimate_run(bank, run)
    values = {} if limits_in(bank.model) is None else channels_of(bank, estimates)
    return judged(bank, estimates, values, residuals(bank.model, run, reference))


@dataclass(frozen=True)
class Limits:
    """What the calibration says of the channels that are judged, and of `passive` ones."""

    scales: dict[str, float]
    half_width: dict[str, float]
    limit: float
    passive: dict[str, float]

    @staticmethod
    def of(bank: Bank, names: Collection[str]) -> "Limits":
        """Of the channels `names`; an uncalibrated model has no limit."""
        calibration = limits_in(bank.model) or {"channels": {}, "limit": np.inf}
        known = calibration["channels"]
        passive = {f.name for f in bank.model.plant.signals.faults if f.monitor == "passive"}
        scales = {name: known[name]["scale"] for name in names if name in known}
        return Limits(
            {name: scale for name, scale in scales.items() if name not in passive},
            {name: known[name]["interval"] for name in scales},
            float(calibration["limit"]),
            {name: scale for name, scale in scales.items() if name in passive},
        )


def judged(
    bank: Bank,
    estimates: Estimates,
    values: dict[str, Float[np.ndarray, "samples"]],
    r: dict[str, Float[np.ndarray, "samples"]],
) -> Judgement:
    """What `estimates` and the channels' `values` mean, beside the residuals `r`."""
    run, uncalibrated = estimates.run, _uncalibrated(bank.model)
    nothing = np.full(len(run.t), np.nan)
    f = {n: estimates.f.get(n, nothing) for n in bank.model.plant.signals.fault_names}
    limits = Limits.of(bank, values)
    above = np.zeros(len(run.t), bool)
    if limits.scales:
        above = (score(values, limits.scales) > limits.limit) & estimates.settled
    found = events(bank, run, values, limits, above)
    quiet = [
        f"{name}, which is passive" if beyond else ""
        for name, beyond in _passive(values, limits, len(run.t))
    ]
    status, reason = [], []
    for still, sampled, settled, alarm, beyond in zip(
        estimates.standing, estimates.sampled, estimates.settled, above, quiet, strict=True
    ):
        why = (
            standing_still(still)
            if still
            else "not sampled"
            if not sampled
            else uncalibrated
            if uncalibrated
            else "settling after a start or a gap"
            if not settled
            else ""
            if alarm
            else beyond
        )
        status.append(NOT_JUDGED if why else FAULT if alarm else HEALTHY)
        reason.append(why)
    return Judgement(run, r, f, limits.half_width, status, reason, found)


def _uncalibrated(model: Model) -> str:
    """Why nothing is judged; empty where there are limits."""
    if model.calibration is None:
        return "not calibrated"
    return "not calibrated for this observer" if limits_in(model) is None else ""


def _passive(
    values: dict[str, Float[np.ndarray, "samples"]], limits: Limits, count: int
) -> list[tuple[str, bool]]:
    """(the passive fault that stands highest above its limit, whether one does) per sample."""
    if not limits.passive:
        return [("", False)] * count
    names = list(limits.passive)
    heights = np.stack([np.abs(values[n]) / limits.passive[n] for n in names])
    heights = np.nan_to_num(heights)
    highest = heights.argmax(axis=0)
    return [(names[k], bool(heights[k, j] > limits.limit)) for j, k in enumerate(highest)]


def events(
    bank: Bank,
    run: Run,
    values: dict[str, Float[np.ndarray, "samples"]],
    limits: Limits,
    above: Bool[np.ndarray, "samples"],
) -> list[Event]:
    """Stretches of `above`; pauses shorter than `pause(bank)` are bridged."""
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False)).reshape(-1, 2)
    merged: list[list[int]] = []
    for start, stop in edges:
        if merged and run.t[start] - run.t[merged[-1][1] - 1] < pause(bank):
            merged[-1][1] = int(stop)
        else:
            merged.append([int(start), int(stop)])
    found = []
    for start, stop in merged:
        t = run.t[start:stop]
        late = t - t[0] >= min(SETTLING / bank.bandwidth, (t[-1] - t[0]) / 2)
        sizes = {name: values[name][start:stop][late] for name in limits.scales}
        name = max(sizes, key=lambda n: float(np.nanmedian(np.abs(sizes[n])) / limits.scales[n]))
        size = float(np.nanmedian(sizes[name]))
        spread = limits.half_width[name]
        found.append(
            Event(run.name, name, float(t[0]), float(t[-1]), size, size - spread, size + spread)
        )
    return found


def pause(bank: Bank) -> float:
    """The shortest pause [s] that ends an event."""
    return MERGE / bank.bandwidth


def table(judgements: Sequence[Judgement], faults: Sequence[str]) -> dict[str, list[Any]]:
    """The columns that `estimate` writes, in order; None is an empty cell."""
    columns: dict[str, list[Any]] = {"run": [], "t": []}
    outputs = list(dict.fromkeys(name for j in judgements for name in j.residuals))
    for each in judgements:
        count = len(each.run.t)
        nothing = np.full(count, np.nan)
        rows: dict[str, Any] = {"run": [each.run.name] * count, "t": each.run.t}
        for name in outputs:
            rows[f"r_{name}"] = each.residuals.get(name, nothing)
        for name in faults:
            width = each.half_width.get(name, np.nan)
            rows |= {
                f"f_{name}": each.f[name],
                f"f_{name}_lo": each.f[name] - width,
                f"f_{name}_hi": each.f[name] + width,
                f"p_{name}": nothing,
            }
        rows |= {"p_healthy": nothing, "p_unknown": nothing}
        rows |= {"status": each.status, "reason": each.reason}
        for name, values in rows.items():
            cells = values
            if isinstance(values, np.ndarray):
                cells = [None if value != value else value for value in values.tolist()]
            columns.setdefault(name, []).extend(cells)
    return columns


def sentence(event: Event, unit: str) -> str:
    """ "pulse +5.02 +- 0.1 V from 0.36 s to 0.85 s (run test)" """
    width = (event.hi - event.lo) / 2
    digits = max(0, int(np.ceil(-np.log10(width))) + 1) if width > 0 else 6
    size = f"{event.size:+.{min(digits, 12)}f} +- {width:.2g} {unit}".rstrip()
    return f"{event.fault} {size} from {event.start:.6g} s to {event.end:.6g} s (run {event.run})"


def sentences(model: Model, events: Sequence[Event]) -> list[str]:
    """The answer in words: what was found, or what the silence means."""
    if model.calibration is None:
        return [
            "Not calibrated, so nothing was judged: run `faultgauge calibrate` on healthy logs."
        ]
    known = limits_in(model)
    if known is None:
        return [
            "Calibrated for the bank, so nothing was judged: an observer needs limits of its own; "
            "run `faultgauge calibrate --observer eso --out OTHER_MODEL` on healthy logs."
        ]
    units = {fault.name: fault.unit for fault in model.plant.signals.faults}
    if events:
        return [sentence(event, units.get(event.fault, "")) for event in events]
    limits = ", ".join(
        f"{name} {channel['limit']:.3g} {units.get(name, '')}".rstrip()
        for name, channel in known["channels"].items()
    )
    return [f"No fault above the limit ({limits})."]


def as_dicts(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Events as plain JSON."""
    return [asdict(event) for event in events]
