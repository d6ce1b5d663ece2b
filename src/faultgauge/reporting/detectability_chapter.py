"""The report of `detectability`: for each log what could be seen, told apart, and by what test."""

from faultgauge.detection.words import listed, number
from faultgauge.foresight.result import PairSheet, RunSheet, Sheet
from faultgauge.foresight.words import HEADER, amount, fault_row, legend, remarks
from faultgauge.reporting.detectability_figures import (
    along_the_log,
    left_by_window,
    pairs_map,
    size_by_delay,
)
from faultgauge.reporting.report import Report, Section, Table

__all__ = ["detectability_report"]

HOW = (
    "The healthy filter runs over the log as it is: its inputs, operating points, slow sensors and "
    "gaps. What a unit of each fault would leave in its innovations from then on adds up to the "
    "information about it, beside noise, the model's own error and its uncertain constants as "
    "calibration found them."
)
PAIRS = (
    "fault",
    "beside",
    "information left",
    "told apart from",
    "divergence of a unit",
    "by the equations alone",
)


def detectability_report(sheet: Sheet) -> Report:
    """A section for each log, its curves and its pairs."""
    sections = list[Section]()
    for run in sheet.runs:
        faults = Table(HEADER, tuple(fault_row(each) for each in run.faults), legend(sheet))
        title = "What could be seen" if len(sheet.runs) == 1 else f"What {run.name} could show"
        sections.append(Section(title, (HOW, *remarks(run)), (faults,), ()))
        drawn = [d(each) for each in run.faults for d in (size_by_delay, along_the_log)]
        sections.append(Section(f"{run.name}: size and delay", (), (), tuple(drawn)))
        if run.pairs:
            sections.append(_pairs(run))
    return Report(f"Detectability: {sheet.plant}", (_headline(sheet),), tuple(sections))


def _headline(sheet: Sheet) -> str:
    """The smallest sizes of the first log."""
    run = sheet.runs[0]
    named = {each.name: min(each.smallest.items())[1] for each in run.faults}
    said = [
        f"{each.name} from {amount(named[each.name], each.unit)} on"
        for each in run.faults
        if named[each.name] is not None
    ]
    blind = [name for name, size in named.items() if size is None]
    if not said:
        return f"In a log like {run.name} no size of {listed(blind, 'or')} would be named."
    beside = f", and no size of {listed(blind, 'or')}" if blind else ""
    return f"In a log like {run.name} one would be told of {listed(said)}{beside}."


def _pairs(run: RunSheet) -> Section:
    units = {each.name: each.unit for each in run.faults}
    rows = tuple(_row(each, units[each.fault]) for each in run.pairs)
    caption = (
        "Information left about a fault where another one, of any size that its prior allows and "
        "from any onset nearby, is fitted beside it; divergence: Kullback-Leibler, in nats, of a "
        "fault of one unit from the other at its most alike, and of a size f, f squared times it."
    )
    tables = [Table(PAIRS, rows, caption)]
    if run.triples:
        rows = tuple(
            (
                each.fault,
                " and ".join(each.others),
                f"{number(100 * each.share, 2)} %",
                amount(each.apart_from, units[each.fault]),
            )
            for each in run.triples
        )
        note = "Beside two others at once, which begin with it."
        tables.append(Table(PAIRS[:4], rows, note))
    drawn = (pairs_map(run), *(left_by_window(run, each) for each in run.faults))
    return Section(f"{run.name}: told apart", (), tuple(tables), drawn)


def _row(pair: PairSheet, unit: str) -> tuple[str, ...]:
    return (
        pair.fault,
        pair.other,
        f"{number(100 * pair.share, 2)} %",
        amount(pair.apart_from, unit),
        f"{number(pair.divergence)}",
        "yes" if pair.structural else "no",
    )
