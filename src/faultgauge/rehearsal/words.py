"""A rehearsal as a person reads it: a table, and what else is to be said."""

from collections.abc import Sequence

from faultgauge.detection.words import duration, number
from faultgauge.rehearsal.result import NEAR, FaultResult, PairResult, Rehearsal, Trial
from faultgauge.rehearsal.shares import Share

__all__ = [
    "HEADER",
    "after",
    "amount",
    "fault_row",
    "legend",
    "lines",
    "percent",
    "remarks",
    "said",
    "table",
]

MOST_INSTEAD = 4  # of what was told instead
HEADER = (
    "fault",
    "foretold",
    "named in 90 %",
    "alarm",
    "named",
    "named exactly",
    "size error",
    "size inside",
    "onset inside",
    "told after",
)


def lines(rehearsal: Rehearsal) -> list[str]:
    """The table of the faults with its legend, and the remarks."""
    return [*table(rehearsal.faults), "", legend(rehearsal.faults), *remarks(rehearsal)]


def table(faults: Sequence[FaultResult]) -> list[str]:
    """A line for the header and one for each of `faults`."""
    rows = [HEADER, *(fault_row(each) for each in faults)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def legend(faults: Sequence[FaultResult]) -> str:
    """What the columns of the table mean."""
    some_predicted = any(each.predicted is not None for each in faults)
    which = "of at least 4 times the foretold size" if some_predicted else "of all sizes"
    return (
        "foretold: the smallest size that the model says it would name; named in 90 %: the one "
        f"that was named in 90 % of the logs; right of that: faults {which}, medians, and how "
        "often the truth was inside the 95 % interval."
    )


def fault_row(fault: FaultResult) -> tuple[str, ...]:
    """The cells of `HEADER`."""
    large = fault.large
    return (
        fault.name,
        amount(fault.predicted, fault.unit),
        _smallest(fault),
        _count(large.alarmed),
        _count(large.found),
        _count(large.exact),
        percent(large.error_median),
        _count(large.size_covered),
        _count(large.onset_covered),
        after(large.delay_median),
    )


def remarks(rehearsal: Rehearsal) -> list[str]:
    """Sentences on names, pairs, false alarms, and what was not rehearsed."""
    found = []
    if rehearsal.exact.total:
        found.append(
            "Named exactly, all faults of at least 4 times the foretold size: "
            f"{said(rehearsal.exact)}."
        )
    found += _against_sheet(rehearsal.faults)
    for times in sorted({each.times for each in rehearsal.pairs}):
        found.append(_pairs([each for each in rehearsal.pairs if each.times == times], times))
    found.append(_false_alarms(rehearsal))
    found.append(_before(rehearsal.trials))
    found += [f"Not rehearsed: {name}, {reason}." for name, reason in rehearsal.left_out.items()]
    for each in rehearsal.faults:
        if each.large.instead:
            instead = sorted(each.large.instead.items(), key=lambda item: -item[1])
            listed = ", ".join(f"{name} ({count})" for name, count in instead[:MOST_INSTEAD])
            found.append(f"{each.name}, where not named exactly, was told as: {listed}.")
        found += [
            f"{each.name}: {count} time{'' if count == 1 else 's'} left out: {reason}."
            for reason, count in each.not_injectable.items()
        ]
    return found


def _against_sheet(faults: Sequence[FaultResult]) -> list[str]:
    """How far the sizes that were found are off those of the sheet."""
    known = [each for each in faults if each.ratio is not None]
    if not known:
        return []
    sure = [each for each in known if each.within is not None]
    near = sum(bool(each.within) for each in sure)
    each = ", ".join(
        f"{fault.name} {number(fault.ratio or 0.0, 2)}"
        + (" or less" if fault.smallest is not None and fault.smallest.at_most else "")
        for fault in known
    )
    return [
        "The size named in 90 %, over the one that `faultgauge detectability` foretells for 90 % "
        f"of the onsets (the table's is for one onset, in the middle): {each}; within {NEAR:g} "
        f"times: {near} of {len(sure)}."
    ]


def _false_alarms(rehearsal: Rehearsal) -> str:
    alarms = rehearsal.false_alarms
    if not alarms.hours:
        return "In untouched logs nothing could be judged, so they tell of no false alarms."
    return (
        f"In untouched logs: {alarms.count} false alarm{'' if alarms.count == 1 else 's'} in "
        f"{number(alarms.hours)} h, {number(alarms.value)} per hour (95 % interval "
        f"{number(alarms.lo, 2)} to {number(alarms.hi, 2)}); calibration allows at most "
        f"{number(rehearsal.calibrated_rate)} per hour."
    )


def _before(trials: Sequence[Trial]) -> str:
    early = sum(each.false_before > 0 for each in trials)
    silent = sum(each.not_judged for each in trials) / len(trials)
    return (
        f"Told before any onset: in {early} of {len(trials)} logs; not judged: {percent(silent)} "
        "of the rows."
    )


def _pairs(some: Sequence[PairResult], times: float) -> str:
    worst = min(some, key=lambda each: each.figures.exact.value)
    exact = sum(each.figures.exact.count for each in some)
    total = sum(each.figures.exact.total for each in some)
    names = " and ".join(worst.names)
    count = _count(worst.figures.exact)
    return (
        f"Pairs at {times:g} times the foretold sizes: {exact} of {total} named exactly; "
        f"least often {names} ({count})."
    )


def _smallest(fault: FaultResult) -> str:
    if not fault.by_size:
        return "-"
    if fault.smallest is None:
        return "not reached"
    value = amount(fault.smallest.size, fault.unit)
    return f"<= {value}" if fault.smallest.at_most else value


def said(share: Share) -> str:
    """ "47 of 50, 94 % (84 to 98 %)" """
    return (
        f"{share.count} of {share.total}, {100 * share.value:.0f} % "
        f"({100 * share.lo:.0f} % to {100 * share.hi:.0f} %)"
    )


def amount(value: float | None, unit: str) -> str:
    """ "0.00117 m/s"; "-" for nothing."""
    return "-" if value is None else f"{number(value)} {unit}".rstrip()


def after(delay: float | None) -> str:
    """ "2.5 h", of a delay [s]; "-" for nothing."""
    return "-" if delay is None else duration(delay)


def percent(value: float | None) -> str:
    """ "3.1 %"; "-" for nothing."""
    return "-" if value is None else f"{number(100 * value, 2)} %"


def _count(share: Share) -> str:
    return f"{share.count}/{share.total}" if share.total else "-"
