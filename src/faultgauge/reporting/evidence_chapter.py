"""The section on evidence: of each event the window over which the bank gives it again."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.evidence import MOST_SHOWN, Evidence
from faultgauge.detection.words import moment
from faultgauge.reporting.report import Section
from faultgauge.reporting.scales import least_sizes, noise_scales
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, around, panels

__all__ = ["evidence_section"]


def evidence_section(bank: FaultBank, windows: Sequence[Evidence]) -> Section:
    """What each window is, and its figure."""
    return Section(
        "Evidence",
        tuple(_words(each) for each in windows[:MOST_SHOWN]),
        (),
        tuple(_figure(bank, each) for each in windows[:MOST_SHOWN]),
    )


def _words(found: Evidence) -> str:
    run = found.decision.run
    first, last = (moment(run.clock, float(found.run.t[k]), 1.0) for k in (0, -1))
    verb = "gives" if found.replayed is not None else "does not give"
    return (
        f"{found.event.fault}, run {run.name}: {first} to {last}; judged alone, this part "
        f"{verb} the same answer."
    )


def _figure(bank: FaultBank, found: Evidence) -> Figure:
    """Outputs, the probability of the fault, and its estimate."""
    part, decision, signals = found.part, found.decision, bank.model.plant.signals
    posterior, names = decision.posterior, signals.fault_names
    units, noise = {each.name: each.unit for each in signals.outputs}, noise_scales(bank.model)
    seen = {name: decision.run.columns[name][part] for name in bank.outputs}
    stack = [
        Panel(name, units[name], {"measured": y}, span=around(y, noise[name]))
        for name, y in seen.items()
    ]
    curves = {"healthy": posterior.healthy[part], "unknown": posterior.unknown[part]}
    if found.event.fault in names:
        k = names.index(found.event.fault)
        curves[found.event.fault] = posterior.p[part, k]
        size = {
            "estimate": posterior.f[part, k],
            "lower": posterior.lo[part, k],
            "upper": posterior.hi[part, k],
        }
        least = least_sizes(bank, decision.run)[k]
        unit = signals.faults[k].unit
        stack.append(Panel(found.event.fault, unit, size, span=(-least, least)))
    stack.append(Panel("probability", "", curves, span=(0.0, 1.0)))
    return panels(
        np.asarray(found.run.t),
        stack,
        title=f"Evidence of {found.event.fault}, {decision.run.name}",
        caption="The part of the log that the answer rests on.",
        clock=found.run.clock,
    )
