"""The detectability sheet as a person reads it: a table of faults, and sentences."""

from collections.abc import Iterator

from faultgauge.detection.words import duration, number
from faultgauge.foresight.result import FaultSheet, Help, RunSheet, Sheet
from faultgauge.plants.signals import spoken

__all__ = ["HEADER", "amount", "fault_row", "legend", "lines", "remarks"]

HEADER = (
    "fault",
    "seen from",
    "named from",
    "10 times rarer",
    "100 times rarer",
    "most like",
    "levels off after",
)
MANY = 4  # triples that are spoken of


def lines(sheet: Sheet) -> list[str]:
    """A table and remarks for every log."""
    said = list[str]()
    for run in sheet.runs:
        rows = [HEADER, *(fault_row(each) for each in run.faults)]
        widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
        said.append(f"{run.name}: {run.rows} rows, {duration(run.seconds)}")
        said += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        said += ["", *remarks(run), ""]
    return [*said, legend(sheet)]


def legend(sheet: Sheet) -> str:
    """What the columns of the table mean."""
    return (
        "Seen from, named from: the smallest size that would raise an alarm, or be told by its "
        "name, 9 times in 10, by the end of the log, had it begun in its middle; right of them "
        f"the same with false alarms 10 and 100 times as rare as the {number(sheet.rate)} per "
        "hour that calibration allows. Levels off: from then on more of the log hardly "
        "tells more of a constant fault, because of the model's own slow error."
    )


def fault_row(fault: FaultSheet) -> tuple[str, ...]:
    """The cells of `HEADER`."""
    rates = (fault.smallest[each] for each in sorted(fault.smallest))
    return (
        fault.name,
        amount(fault.seen_from, fault.unit),
        *(amount(each, fault.unit) for each in rates),
        fault.like or "-",
        "not in this log" if fault.levels_off is None else duration(fault.levels_off),
    )


def remarks(run: RunSheet) -> Iterator[str]:
    """Sentences on what cannot be seen or told apart, and on what would help."""
    for fault in run.faults:
        if fault.seen_from is None:
            why = "" if fault.structural else ": the equations leave nothing to see it by"
            yield f"{fault.name} of any size that it may have would not have shown{why}."
    hidden = {fault.name for fault in run.faults if fault.seen_from is None}
    apart = {(pair.fault, pair.other): pair.apart_from for pair in run.pairs}
    for pair in run.pairs:
        if pair.apart_from is not None or pair.fault in hidden:
            continue
        structure = (
            "though the equations would allow it"
            if pair.structural
            else "nor do the equations alone tell them apart"
        )
        if apart[pair.other, pair.fault] is not None or pair.other in hidden:
            yield f"{pair.fault} is not told from {pair.other} in this log, {structure}."
        elif pair.fault < pair.other:
            both = f"{pair.fault} and {pair.other}"
            yield f"{both} are not told apart in this log, {structure}."
    unsure = [
        each
        for each in run.triples
        if each.apart_from is None
        and each.fault not in hidden
        and all(apart[each.fault, other] is not None for other in each.others)
    ]
    for each in unsure[:MANY]:
        either = " or ".join(each.others)
        yield f"{each.fault} is told from {either} alone, but not from both together."
    if len(unsure) > MANY:
        yield f"The same holds for {len(unsure) - MANY} more sets of three faults."
    for each in run.help:
        yield from _helped(each)


def _helped(each: Help) -> Iterator[str]:
    what = f"{each.fault} of {amount(each.size, each.unit)}"
    what += " would be seen" if each.other is None else f" would be told from {each.other}"
    for value, unit, sigma, size in each.sensors[:1]:
        yield (
            f"{what} with a sensor of {value} (noise {amount(sigma, unit)}), from "
            f"{amount(size, each.unit)} on."
        )
    test = each.test
    if test is not None:
        yield (
            f"{what} by a {test.kind} of {test.amplitude:+.3g} {spoken(test.unit)}".rstrip()
            + f" on {test.input} for {duration(test.seconds)} from "
            f"{amount(test.base, test.unit)} on; simulated, from "
            f"{amount(test.told.obtained, each.unit)} on."
        )
    if not each.sensors and test is None:
        how = "show it" if each.other is None else f"tell it from {each.other}"
        yield (
            f"{each.fault} of {amount(each.size, each.unit)}: no sensor and no test input that was "
            f"tried would {how}."
        )


def amount(size: float | None, unit: str) -> str:
    """ "0.0012 N*m"; "-" where there is none."""
    return "-" if size is None else f"{number(size)} {spoken(unit)}".rstrip()
