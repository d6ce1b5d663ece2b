"""A judged run, or a part of it, at a glance."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.answer.unnamed import unnamed_alarms
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.uncertain_constants import drifting_of
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import NOT_JUDGED, STALE
from faultgauge.reporting.glance import Compared, ToldSpan, overview
from faultgauge.reporting.scales import least_sizes, noise_scales
from faultgauge.reporting.style import quantity
from faultgauge.reporting.svg import Figure
from faultgauge.telemetry import Run

__all__ = ["run_overview", "silent"]

MOST_OUTPUTS, MOST_TOLD = 8, 8  # panels, and events beside them


def run_overview(
    bank: FaultBank,
    decision: Decision,
    truth: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
    *,
    part: slice = slice(None),
    likely: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
    title: str = "",
) -> Figure:
    """Outputs, and the faults that were told or may be the cause of an alarm without a name, in a
    `part` of the run; undeclared ones are shaded only. `truth` (fault: size) where it is known,
    `likely` (cause: probability) in a panel of its own; all are of the whole run."""
    run, found, signals = decision.run, decision.posterior, bank.model.plant.signals
    t = run.t[part]
    outputs = _compared(bank, decision, part)
    ordered = sorted(outputs, key=_noises_off, reverse=True)
    furthest = {each.name for each in ordered[:MOST_OUTPUTS]}
    seen = [e for e in decision.events if e.onset <= t[-1] and t[0] <= e.end]
    spans = {
        fault.name: [(e.onset, e.end) for e in seen if e.fault == fault.name]
        for fault in signals.faults
    }
    unnamed = [e for e in unnamed_alarms(bank, decision) if e.start <= t[-1] and t[0] <= e.end]
    left = {cause.name for each in unnamed for cause in each.causes}
    least = least_sizes(bank, decision)
    told = [
        ToldSpan(
            fault.name,
            fault.unit,
            found.f[part, k],
            found.lo[part, k],
            found.hi[part, k],
            spans[fault.name],
            least[k],
            truth[fault.name][part] if truth and fault.name in truth else None,
        )
        for k, fault in enumerate(signals.faults)
        if spans[fault.name] or fault.name in left
    ]
    notes = _held(bank, run)
    if len(outputs) > MOST_OUTPUTS:
        chosen = f"Of {len(outputs)} outputs the {MOST_OUTPUTS} that are furthest off the model."
        notes = [chosen, *notes]
    return overview(
        t,
        [each for each in outputs if each.name in furthest],
        told[:MOST_TOLD],
        run=run.name,
        spans=[(each.onset, each.end) for each in seen],
        alarms=[(each.start, each.end) for each in unnamed],
        not_judged=silent(decision)[part],
        likely={cause: p[part] for cause, p in (likely or {}).items()},
        clock=run.clock,
        note=" ".join(notes),
        title=title,
    )


def _compared(bank: FaultBank, decision: Decision, part: slice) -> list[Compared]:
    """Every output that has a residual, beside the healthy model."""
    run, noise = decision.run, noise_scales(bank.model)
    return [
        Compared(
            each.name,
            each.unit,
            run.own(each.name)[part],
            (run.own(each.name) - decision.residuals[each.name])[part],
            noise[each.name],
        )
        for each in bank.model.plant.signals.outputs
        if each.name in decision.residuals
    ]


def _held(bank: FaultBank, run: Run) -> list[str]:
    """A sentence for every parameter that drifts while the healthy model has one value of it."""
    units = {each.name: each.unit for each in bank.model.plant.spec.parameters}
    usual = bank.noise.drift * np.sqrt(run.t[-1] - run.t[0])
    return [
        f"The healthy model holds {name} at one value; in a log as long as this one it drifts by "
        f"about {quantity(float(far), units[name], 2)}."
        for name, far in zip(drifting_of(bank.model), usual, strict=True)
        if far > 0
    ]


def silent(decision: Decision) -> Bool[np.ndarray, "samples"]:
    """Rows that are not judged."""
    return np.isin(decision.status, [NOT_JUDGED, STALE])


def _noises_off(output: Compared) -> float:
    """The most that an output was off the healthy model, in standard deviations of its noise."""
    off = np.abs(output.measured - output.healthy)
    return float(np.max(off[np.isfinite(off)], initial=0.0)) / (output.noise or 1.0)
