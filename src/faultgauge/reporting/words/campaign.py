"""A campaign as a person reads it: a table, and what else is to be said."""

from faultgauge.campaigns.result import Campaign, RunFigure
from faultgauge.detection.words import number
from faultgauge.rehearsal.words import legend, said, table

__all__ = ["interval", "lines", "remarks"]


def lines(campaign: Campaign) -> list[str]:
    """The table of the kinds with its legend, and the remarks."""
    faults = [each.faults for each in campaign.kinds]
    return [*table(faults), "", legend(faults), *remarks(campaign)]


def remarks(campaign: Campaign) -> list[str]:
    """Sentences on names, intervals, probabilities and false alarms."""
    alarms, apart = campaign.false_alarms, campaign.separable
    found = [
        f"Of a size that was foretold to be named, from that onset on: named exactly in "
        f"{said(apart.exact)}. Apart from these {said(apart.apart)} of all runs with a fault: "
        f"{apart.below} below that size or of a kind that has none, {apart.undecided} under an "
        f"alarm without a name, {apart.not_judged} not judged."
    ]
    if campaign.size_covered.total:
        found.append(
            f"True sizes in their 95 % interval: {said(campaign.size_covered)} of events; "
            f"{interval(campaign.covers, 100.0, '%')} of rows since a fault was named; true "
            f"onsets: {said(campaign.onset_covered)}."
        )
    found.append(
        f"Probabilities at the end of the faults: Brier score {interval(campaign.brier)}, log "
        f"score {interval(campaign.log_score)} (sums over all causes; 0 is best)."
    )
    found.append(
        f"Without a fault: {alarms.count} false alarm{'' if alarms.count == 1 else 's'} in "
        f"{number(alarms.hours)} h, {number(alarms.value)} per hour (95 % interval "
        f"{number(alarms.lo, 2)} to {number(alarms.hi, 2)}); calibration allows at most "
        f"{number(campaign.calibrated_rate)} per hour."
    )
    return found


def interval(figure: RunFigure, scale: float = 1.0, unit: str = "") -> str:
    """ "12.1 % (11.0 to 13.5)"; "-" for nothing, "never" for an end that is not reached."""
    if figure.value is None:
        return "-" if figure.lo is None else f"never (from {number(scale * figure.lo)} {unit})"
    ends = ["never" if each is None else number(scale * each) for each in (figure.lo, figure.hi)]
    return f"{number(scale * figure.value)} {unit}".rstrip() + f" ({ends[0]} to {ends[1]})"
