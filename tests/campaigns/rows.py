"""Rows of a campaign, made up by hand."""

from faultgauge.campaigns.outcome import LEVELS

NAMES = ("leak", "gauge", "weak", "unknown")


def row(number, kind="healthy", told="", *, p=(0.0, 0.0, 0.0, 0.0), after=None, **more):
    """A run; of one with a fault the alarm came so long `after` its onset, of odds e^4.5."""
    there = kind != "healthy"
    cells = {
        "run": number,
        "kind": kind,
        "healthy_hours": 1.0,
        "false_alarms": 0,
        "alarmed": after is not None,
        "told": told,
        "exact": told == kind,
        "answer": told or ("undecided" if after is not None else "nothing"),
        "possible": "",
        "early": 0,
        "not_judged": 0.0,
        "p_healthy": max(1 - sum(p), 0.0),
        **{f"p_{name}": each for name, each in zip(NAMES, p, strict=True)},
        **{f"false_at_{level:g}": int(not there and level <= 2) for level in LEVELS},
        **{f"alarm_after_at_{k:g}": after if k <= 4.5 else None for k in LEVELS},
    }
    if there:
        found = kind in told.split("+")
        cells |= {
            "fault": kind,
            "size": 2.0,
            "onset": 10.0,
            "foretold": 0.5,
            "delay": after if found else None,
            "estimate": 2.2 if found else None,
            "size_inside": True if found else None,
            "onset_inside": True if found else None,
            "rows": 10 if found else 0,
            "rows_inside": 9 if found else 0,
            "width": 0.4 if found else None,
        }
    return cells | more
