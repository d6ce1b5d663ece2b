"""How well the bank decides: every figure is of seeds 100 on; it was tuned on those below.

python benchmarks/decisions.py [--windows N] [--records N] [--flights N] [--healthy N]
    [--calibration N] [--tanks N] [--first SEED]

Without options: 40 of each set of windows, 40 linear records, 40 of the README's tanks, 200 faulty
and 760 healthy flights, and 840 healthy flights to calibrate on, which support one false alarm in
10^6 samples.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from decision_studies.naming import Verdict, left_out, named, rig_bank
from decision_studies.optimal import against_kalman, linear_bank
from decision_studies.rig import FAULTS
from decision_studies.tank import leak_found
from decision_studies.wheel import STEP, false_alarms, friction_found, wheel_bank
from faultgauge.detection.posterior.uncalibrated import level_in
from faultgauge_studies import merit

FIRST = 100  # seeds below are for tuning: --first 0
HEALTHY = 1000  # more than --first: the first seed of the fresh healthy flights


def share(found: Sequence[bool]) -> str:
    if not found:
        return "none"
    each = merit.share(found)
    return f"{sum(found)} of {len(found)} ({each.value:.1%} [{each.lo:.1%}, {each.hi:.1%}])"


def spread(values: Sequence[float], digits: int = 3) -> str:
    median, low, high = np.median(values), min(values), max(values)
    return f"{median:.{digits}g} [{low:.{digits}g}, {high:.{digits}g}]"


def onsets(dated: Sequence[merit.Dated | None]) -> str:
    found = [each for each in dated if each is not None]
    widths = spread([each.width for each in found]) if found else "none"
    return f"{share([each.inside for each in found])}, as long as [s] {widths}"


def over_runs(values: Sequence[float], samples: Sequence[int] | None = None) -> str:
    weights = None if samples is None else np.asarray(samples, float)
    each = merit.mean_of_runs(np.asarray(values, float), weights)
    return f"{each.value:.3f} [{each.lo:.3f}, {each.hi:.3f}]"


def naming(first: int, count: int) -> None:
    bank = rig_bank()
    verdicts = [v for k in range(count) for v in named(bank, first + k)]
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
    for count, which in enumerate((single, pair), 1):
        dated = [each for v in which for each in v.dated]
        print(f"rig: onset inside its 95 % interval, {count} acting: {onsets(dated)}")
    print(f"rig: windows with an event that names a healthy channel: {blamed(verdicts)}")
    print(
        "rig: healthy windows HEALTHY or NOT_JUDGED: "
        f"{share([v.status != 'FAULT' for v in healthy])}"
    )


def blamed(verdicts: Sequence[Verdict]) -> str:
    return share([v.blamed for v in verdicts])


def undeclared(first: int, count: int) -> None:
    banks = {name: rig_bank(name) for name in FAULTS}
    verdicts = [v for k in range(count) for v in left_out(banks, first + k)]
    seen = [v for v in verdicts if v.visible and v.acting]
    wrong = [v.unknown < 0.5 and v.status == "FAULT" for v in seen]
    print(f"left out: p_unknown >= 0.5 at window end: {share([v.unknown >= 0.5 for v in seen])}")
    print(f"left out: a wrong name at window end: {share(wrong)}; in any event: {blamed(seen)}")


def optimal(first: int, count: int) -> None:
    bank = linear_bank()
    found = [against_kalman(bank, first + k) for k in range(count)]
    print(f"linear: RMSE over the Kalman filter's: {spread([e.bank / e.kalman for e in found])}")
    print(f"linear: coverage {over_runs([e.coverage for e in found])}")
    print(f"linear: delay [s] {spread([e.delay for e in found])}")
    print(f"linear: onset inside its 95 % interval: {onsets([e.dated for e in found])}")


def tanks(first: int, count: int) -> None:
    found = [leak_found(first + k) for k in range(count)]
    leaks = [each for each in found if each is not None]
    print(f"tank: leak named: {share([each is not None for each in found])}")
    print(f"tank: size inside its 95 % interval: {share([each.sized for each in leaks])}")
    print(f"tank: half of that interval, of the size: {spread([each.width for each in leaks])}")
    print(f"tank: onset inside its 95 % interval: {onsets([each.dated for each in leaks])}")
    print(f"tank: false alarms before the onset, in all: {sum(each.early for each in leaks)}")


def wheel(first: int, flights: int, healthy: int, calibration: int) -> None:
    bank = wheel_bank(calibration)
    block = level_in(bank.model)
    print(
        f"wheel: alarm at log-odds of {block.level:.2f}, from {block.judged_s / STEP:.4g} "
        f"healthy samples with {block.alarms} alarms: at most one false alarm in "
        f"{block.mtbfa_s / STEP:.4g} samples (95 %)"
    )
    found = [friction_found(bank, first + k) for k in range(flights)]
    weights = [a.samples for a in found]
    settled = [a.samples_settled for a in found]
    print(f"wheel: delay [s] until named: {spread([a.delay for a in found])}")
    print(f"wheel: run mean after 60 s, error [%]: {spread([100 * a.bias for a in found])}")
    covered = over_runs([a.covered for a in found], weights)
    later = over_runs([a.covered_settled for a in found], settled)
    print(f"wheel: coverage given alarm {covered}, settled {later} ({flights} flights)")
    print(f"wheel: onset inside its 95 % interval: {onsets([a.dated for a in found])}")
    counts = np.array([false_alarms(bank, HEALTHY + k) for k in range(healthy)]).sum(axis=0)
    rate = merit.alarm_rate(int(counts[0]), counts[1] / 1e6)
    print(
        f"wheel: {counts[0]} false alarms in {counts[1]} fresh healthy samples: "
        f"{rate.value:.3g} [{rate.lo:.3g}, {rate.hi:.3g}] per million"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    defaults = {
        "windows": 40,
        "records": 40,
        "tanks": 40,
        "flights": 200,
        "healthy": 760,
        "calibration": 840,
    }
    for name, default in {**defaults, "first": FIRST}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    if given.records:
        optimal(given.first, given.records)
    if given.tanks:
        tanks(given.first, given.tanks)
    if given.windows:
        naming(given.first, given.windows)
        undeclared(given.first, given.windows)
    if given.flights:
        wheel(given.first, given.flights, given.healthy, given.calibration)
