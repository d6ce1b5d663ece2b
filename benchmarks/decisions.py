"""How well the bank decides: every figure is of seeds 100 on; it was tuned on those below.

python benchmarks/decisions.py [--windows N] [--records N] [--flights N] [--healthy N]

Without options: 40 of each set of windows, 40 linear records, 200 faulty and 750 healthy flights.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from faultgauge.studies.decisions.naming import Verdict, left_out, named, rig_bank
from faultgauge.studies.decisions.optimal import against_kalman, linear_bank
from faultgauge.studies.decisions.rig import FAULTS
from faultgauge.studies.decisions.wheel import false_alarms, friction_found, wheel_bank

FIRST = 100


def share(found: Sequence[bool]) -> str:
    return f"{sum(found)} of {len(found)}" + (f" ({np.mean(found):.1%})" if found else "")


def spread(values: Sequence[float], digits: int = 3) -> str:
    median, low, high = np.median(values), min(values), max(values)
    return f"{median:.{digits}g} [{low:.{digits}g}, {high:.{digits}g}]"


def naming(count: int) -> None:
    bank = rig_bank()
    verdicts = [v for k in range(count) for v in named(bank, FIRST + k)]
    healthy = [v for v in verdicts if not v.truth]
    seen = [v for v in verdicts if v.truth and v.visible]
    single = [v for v in seen if len(v.truth) == 1]
    pair = [v for v in seen if len(v.truth) == 2]
    hidden = [v for v in verdicts if v.hidden and len(v.truth) == 1]
    beside = [v for v in verdicts if v.hidden and len(v.truth) == 2]
    print(f"rig: exact set at window end, observable: {share([v.exact for v in seen])}")
    print(f"  singles {share([v.exact for v in single])}, pairs {share([v.exact for v in pair])}")
    print(
        f"rig: hidden by a limit, NOT_JUDGED: {share([v.status == 'NOT_JUDGED' for v in hidden])}"
    )
    print(f"  interval as wide as the prior: {share([v.wide for v in hidden])}")
    print(f"rig: hidden beside a visible one, that one exact: {share([v.exact for v in beside])}")
    print(f"rig: windows with an event that names a healthy channel: {blamed(verdicts)}")
    print(
        "rig: healthy windows HEALTHY or NOT_JUDGED: "
        f"{share([v.status != 'FAULT' for v in healthy])}"
    )


def blamed(verdicts: Sequence[Verdict]) -> str:
    return share([v.blamed for v in verdicts])


def undeclared(count: int) -> None:
    banks = {name: rig_bank(name) for name in FAULTS}
    verdicts = [v for k in range(count) for v in left_out(banks, FIRST + k)]
    seen = [v for v in verdicts if v.visible and v.acting]
    wrong = [v.unknown < 0.5 and v.status == "FAULT" for v in seen]
    print(f"left out: p_unknown >= 0.5 at window end: {share([v.unknown >= 0.5 for v in seen])}")
    print(f"left out: a wrong name at window end: {share(wrong)}; in any event: {blamed(seen)}")


def optimal(count: int) -> None:
    bank = linear_bank()
    found = [against_kalman(bank, FIRST + k) for k in range(count)]
    print(f"linear: RMSE over the Kalman filter's: {spread([e.bank / e.kalman for e in found])}")
    print(f"linear: coverage {np.mean([e.coverage for e in found]):.3f}")
    print(f"linear: delay [s] {spread([e.delay for e in found])}")


def wheel(flights: int, healthy: int) -> None:
    bank = wheel_bank()
    found = [friction_found(bank, FIRST + k) for k in range(flights)]
    weights = [a.samples for a in found]
    settled = [a.samples_settled for a in found]
    print(f"wheel: delay [s] until named: {spread([a.delay for a in found])}")
    print(f"wheel: run mean after 60 s, error [%]: {spread([100 * a.bias for a in found])}")
    covered = np.average([a.covered for a in found], weights=weights)
    later = np.average(np.nan_to_num([a.covered_settled for a in found]), weights=settled)
    print(f"wheel: coverage given alarm {covered:.3f}, settled {later:.3f} ({flights} flights)")
    counts = np.array([false_alarms(bank, 1000 + k) for k in range(healthy)]).sum(axis=0)
    print(f"wheel: {counts[0]} false alarms in {counts[1]} fresh healthy samples")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("windows", 40), ("records", 40), ("flights", 200), ("healthy", 750)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    if given.records:
        optimal(given.records)
    if given.windows:
        naming(given.windows)
        undeclared(given.windows)
    if given.flights:
        wheel(given.flights, given.healthy)
