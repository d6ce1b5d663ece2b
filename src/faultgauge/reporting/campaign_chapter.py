"""The report of `campaign`: what is found of faults whose truth is known, and how honestly."""

from faultgauge.campaigns.result import Campaign, KindResult
from faultgauge.detection.words import number
from faultgauge.rehearsal.shares import Rate, Share
from faultgauge.rehearsal.words import HEADER, amount, fault_row, legend, said
from faultgauge.reporting.campaign_figures import (
    delay_by_rate,
    detection_by_rate,
    isolation_map,
    missed,
    reliability,
)
from faultgauge.reporting.rehearsal_chapter import size_section
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.words.campaign import interval, remarks

__all__ = ["campaign_report"]

HOW = (
    "Every run was simulated with its faults in the loop, and the calibrated model judged it "
    "without knowing of them. The smallest size that is foretold for a run comes from the same run "
    "without the fault, from that onset on. All intervals are 95 %: Wilson's for shares, Garwood's "
    "for rates, and of drawing whole runs anew for the rest."
)
KINDS = (
    "fault",
    "runs",
    "named right",
    "named in 90 %",
    "rows inside",
    "interval over size",
    "told after",
)
LEVELS = ("level (log-odds)", "false alarms per hour", "runs with an alarm", "median time")


def campaign_report(campaign: Campaign) -> Report:
    """The table of all kinds, alarms by their level, names, probabilities, and each by its size."""
    faults = [each.faults for each in campaign.kinds]
    table = Table(HEADER, tuple(fault_row(each) for each in faults), legend(faults))
    seen = [each for each in (missed(campaign),) if each]
    sections = [
        Section(
            "What was found", (HOW, *remarks(campaign)), (table, _kinds(campaign)), tuple(seen)
        ),
        Section(
            "Alarms by their level",
            (),
            (_levels(campaign),),
            (detection_by_rate(campaign), delay_by_rate(campaign)),
        ),
        Section("Who was named", (), _names(campaign), (isolation_map(campaign),)),
        Section("Probabilities", (), (_probabilities(campaign),), (reliability(campaign),)),
    ]
    for each in campaign.kinds:
        if each.faults.by_size:
            sections.append(size_section(each.faults, each.trials))
    return Report(
        f"Campaign: {campaign.name}",
        (_headline(campaign), *(f"Warning: {text}." for text in campaign.warnings)),
        tuple(sections),
    )


def _headline(campaign: Campaign) -> str:
    runs = len(campaign.rows)
    head = f"{runs} runs of {campaign.plant} were simulated and judged"
    exact = campaign.separable.exact
    if not exact.total:
        return f"{head}."
    return f"{head}; of faults that were foretold to be told, named exactly: {said(exact)}."


def _kinds(campaign: Campaign) -> Table:
    caption = (
        "Named right: the names that count; named in 90 %: by size, with its interval; rows "
        "inside: since the fault was named, those whose interval holds its size; interval over "
        "size: their median width; told after: median over all runs, those in which it never was, "
        "too."
    )
    return Table(KINDS, tuple(_kind_row(each) for each in campaign.kinds), caption)


def _kind_row(kind: KindResult) -> tuple[str, ...]:
    return (
        kind.faults.name,
        str(kind.runs),
        " or ".join(kind.right) or "nothing",
        interval(kind.smallest, unit=kind.faults.unit),
        interval(kind.covers, 100.0, "%"),
        interval(kind.width),
        interval(kind.delay, unit="s"),
    )


def _levels(campaign: Campaign) -> Table:
    whole = campaign.curves[0]
    rows = tuple(
        (f"{level:g}", _rate(rate), _share(share), interval(delay, unit="s"))
        for level, rate, share, delay in zip(
            campaign.levels, campaign.false, whole.detected, whole.delay, strict=True
        )
    )
    caption = f"Calibration chose {number(campaign.level)}. In brackets: 95 % intervals."
    return Table(LEVELS, rows, caption)


def _names(campaign: Campaign) -> tuple[Table, ...]:
    sets = [
        (kind, each, str(count))
        for kind, own in campaign.isolation.sets.items()
        for each, count in sorted(own.items(), key=lambda item: -item[1])
    ]
    if not sets:
        return ()
    caption = "Under an alarm without a name: what had 5 % and more at the end of the fault."
    return (Table(("fault", "still possible", "runs"), tuple(sets), caption),)


def _probabilities(campaign: Campaign) -> Table:
    rows = tuple(
        (
            f"{100 * each.low:g} to {100 * each.high:g} %",
            "-" if each.said is None else f"{number(100 * each.said)} %",
            str(each.share.total),
            _share(each.share),
        )
        for each in campaign.reliability
    )
    caption = (
        f"Brier score {interval(campaign.brier)}, log score {interval(campaign.log_score)}: sums "
        "over all causes and health, means over the runs; 0 is best."
    )
    return Table(("told", "mean", "times", "was so"), rows, caption)


def _share(share: Share) -> str:
    if not share.total:
        return "-"
    return f"{number(100 * share.value)} % ({100 * share.lo:.0f} to {100 * share.hi:.0f})"


def _rate(rate: Rate) -> str:
    if not rate.hours:
        return "-"
    return f"{amount(rate.value, '')} ({number(rate.lo, 2)} to {number(rate.hi, 2)})"
