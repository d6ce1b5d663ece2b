"""What `simulate` puts into its report: inputs, outputs and true faults over time."""

from collections.abc import Sequence

import numpy as np

from faultgauge.accommodation.simulate import ACTED, ADDED, ESTIMATED
from faultgauge.plants.signals import Input, Output
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, curves, panels
from faultgauge.simulation.scenario import TRUTH, Scenario
from faultgauge.simulation.schedules import Schedule
from faultgauge.telemetry import Run

__all__ = ["simulation_report"]


def simulation_report(scenario: Scenario, run: Run) -> Report:
    """The report of `simulate`."""
    signals = scenario.plant.signals
    faults = tuple(_fault_figure(run, fault) for fault in scenario.faults)
    sections = [
        Section(
            "Inputs", ("As commanded, inside their limits.",), (), _figures(run, signals.inputs)
        )
    ]
    outputs = ("As measured, with noise.",)
    sections.append(Section("Outputs", outputs, (), _figures(run, signals.outputs)))
    if faults:
        sections.append(Section("True faults", (), (_table(run, scenario.faults),), faults))
    if scenario.accommodation:
        sections.append(_accommodation(run, signals.inputs))
    count = (
        f"{len(faults)} fault{'s' if len(faults) != 1 else ''} injected" if faults else "healthy"
    )
    seconds, plant = scenario.samples * scenario.step, scenario.plant.spec.name
    summary = (
        f"{scenario.name}: {seconds:g} s of {plant}, {count}.",
        f"{len(run.t)} rows, {scenario.step * scenario.log_every:g} s apart; seed {scenario.seed}.",
    )
    return Report(f"Simulation: {scenario.name}", summary, tuple(sections))


def _accommodation(run: Run, inputs: Sequence[Input]) -> Section:
    """Every fault of the alarms: estimate, truth where there is one, decision; what was added."""
    names = [n.removeprefix(ESTIMATED) for n in run.columns if n.startswith(ESTIMATED)]
    figures = [
        panels(
            run.t,
            [
                Panel(
                    name,
                    "",
                    {"estimate": run.columns[ESTIMATED + name]},
                    run.columns.get(TRUTH + name),
                ),
                Panel("acted upon", "", {name: run.columns[ACTED + name]}),
            ],
            title=f"Estimate and decision: {name}",
        )
        for name in names
    ]
    added = {each.name: run.columns[ADDED + each.name] for each in inputs}
    figures.append(
        panels(
            run.t,
            [Panel(each.name, each.unit, {"added": added[each.name]}) for each in inputs],
            title="What was added to the controller's command",
        )
    )
    return Section("Accommodation", (), (), tuple(figures))


def _figures(run: Run, channels: Sequence[Input | Output]) -> tuple[Figure, ...]:
    return tuple(
        curves(
            run.t,
            {each.name: run.columns[each.name]},
            title=each.name,
            name=each.name,
            unit=each.unit,
        )
        for each in channels
    )


def _fault_figure(run: Run, fault: Schedule) -> Figure:
    unit = "" if fault.effect == "dropout" else fault.unit
    values = {fault.name: run.columns[TRUTH + fault.name]}
    return curves(run.t, values, title=f"True fault: {fault.name}", name=fault.name, unit=unit)


def _table(run: Run, faults: Sequence[Schedule]) -> Table:
    rows = []
    for fault in faults:
        first = run.t[np.argmax(fault.profile.active(run.t))]
        rows.append((fault.name, fault.enters, fault.target, fault.effect, f"{first:g} s"))
    return Table(("fault", "enters", "target", "effect", "from"), tuple(rows))
