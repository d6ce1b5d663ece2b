"""The report of `rehearse`: how small a fault would be found in these logs, named and sized."""

from collections.abc import Sequence

from faultgauge.rehearsal.result import FaultResult, Figures, Rehearsal, Trial
from faultgauge.rehearsal.shares import Share
from faultgauge.rehearsal.words import (
    HEADER,
    after,
    amount,
    fault_row,
    legend,
    percent,
    remarks,
    said,
)
from faultgauge.reporting.rehearsal_figures import against_sheet, by_size
from faultgauge.reporting.report import Report, Section, Table

__all__ = ["rehearsal_report", "size_section"]

FIGURES = (
    "logs",
    "alarm",
    "named",
    "named exactly",
    "another named",
    "undeclared told",
    "size error, median",
    "nine in ten below",
    "size inside",
    "onset inside",
    "told after",
)
HOW = (
    "Declared faults were put into healthy logs, and the calibrated model judged them. What acted "
    "on the plant stays as it was: for a fault of an input the command that the model sees is "
    "changed, and for one of a state that of an input by the model's own gain, whose error is then "
    "not in the sizes. How a control loop would have answered the fault is not in these logs."
)


def rehearsal_report(rehearsal: Rehearsal) -> Report:
    """The table of all faults, then each by its size."""
    faults = Table(
        HEADER, tuple(fault_row(each) for each in rehearsal.faults), legend(rehearsal.faults)
    )
    drawn = [each for each in (against_sheet(rehearsal.faults),) if each]
    tables = (faults, *_pairs(rehearsal))
    sections = [
        Section("What would be found", (HOW, *remarks(rehearsal)), tables, tuple(drawn)),
    ]
    for each in rehearsal.faults:
        if each.by_size:
            mine = [trial for trial in rehearsal.trials if trial.names == (each.name,)]
            sections.append(size_section(each, mine))
    return Report(
        f"Rehearsal: {rehearsal.plant}",
        (_headline(rehearsal), *(f"Warning: {text}." for text in rehearsal.warnings)),
        tuple(sections),
    )


def _headline(rehearsal: Rehearsal) -> str:
    count, windows = len(rehearsal.trials), len(rehearsal.windows)
    parts = "one part" if windows == 1 else f"{windows} parts"
    head = f"Faults were put into {parts} of the healthy logs, {count} times"
    if not rehearsal.exact.total:
        return f"{head}."
    return f"{head}; of the larger ones, named exactly: {said(rehearsal.exact)}."


def size_section(fault: FaultResult, trials: Sequence[Trial]) -> Section:
    """One fault by its size; `trials` are those of it alone."""
    rows = tuple((amount(row.size, fault.unit), *_cells(row)) for row in fault.by_size)
    caption = (
        "In brackets: 95 % intervals of the shares; size error, what is inside its interval and "
        "the delay are of what was named."
    )
    table = Table(("size", *FIGURES), rows, caption)
    return Section(f"{fault.name}, by size", (), (table,), (by_size(fault, trials),))


def _pairs(rehearsal: Rehearsal) -> tuple[Table, ...]:
    if not rehearsal.pairs:
        return ()
    rows = tuple(
        (f"{' and '.join(each.names)}, {each.times:g} times", *_cells(each.figures))
        for each in rehearsal.pairs
    )
    caption = "Two faults in one log, each of so many times the foretold size; named: both."
    return (Table(("pair", *FIGURES), rows, caption),)


def _cells(row: Figures) -> tuple[str, ...]:
    return (
        str(row.trials),
        _plain(row.alarmed),
        _share(row.found),
        _share(row.exact),
        _plain(row.wrong),
        _plain(row.unknown),
        percent(row.error_median),
        percent(row.error_p90),
        _plain(row.size_covered),
        _plain(row.onset_covered),
        after(row.delay_median),
    )


def _plain(share: Share) -> str:
    return f"{100 * share.value:.0f} %" if share.total else "-"


def _share(share: Share) -> str:
    """ "94 % (84 to 98)" """
    if not share.total:
        return "-"
    return f"{100 * share.value:.0f} % ({100 * share.lo:.0f} to {100 * share.hi:.0f})"
