"""Which fault is it: windows of the rig, named, hidden, and with a kind of fault left out."""

from dataclasses import dataclass

from decision_studies.rig import (
    FAULTS,
    LIMIT,
    Window,
    every_set,
    rig,
    true_model,
    window,
)
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.calibration.bank_calibration import calibrate_bank, calibrated
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.decisions import Decision, decide
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.detection.posterior.posterior import WIDE
from faultgauge.detection.posterior.verdicts import QUIET
from faultgauge_studies import merit

__all__ = ["Verdict", "left_out", "named", "rig_bank"]

CALIBRATION = (10_000, 10_001)  # seeds of the healthy logs
VISIBLE = 0.2  # K, rms: four standard deviations of the noise


@dataclass(frozen=True)
class Verdict:
    """One window judged: was the set at its end right, was a healthy channel named in an event,
    what was said at the end, whether every fault could be seen at all, and whether all still act
    at the end, where a heater may just have come to a limit.

    `wide` says whether the interval of a hidden fault reached as far as its prior, `dated` how the
    onsets of those that were named were told.
    """

    truth: tuple[str, ...]
    hidden: str | None
    visible: bool
    acting: bool
    exact: bool
    blamed: bool
    status: str
    unknown: float
    wide: bool
    dated: tuple[merit.Dated, ...]


def rig_bank(left_out: str | None = None, seconds: float = 4000.0) -> FaultBank:
    """The bank of the rig, calibrated on two healthy logs of so many `seconds`."""
    runs = [window(seed, seconds=seconds).run for seed in CALIBRATION]
    model = true_model(rig(left_out), runs)
    noise = estimate_noise(model, runs)
    found = calibrate_bank(model, runs, noise)
    return build_fault_bank(calibrated(model, found), runs, found.noise)


def named(bank: FaultBank, seed: int) -> list[Verdict]:
    """A healthy window, every single and pair, and the singles and pairs with a heater's bias cut
    off by its limit."""
    found = [_judged(bank, window(_seed(seed, 0)))]
    for k, faults in enumerate(every_set()):
        found.append(_judged(bank, window(_seed(seed, 1 + k), faults)))
    for k, (stuck, other) in enumerate([("p", None), ("q", None), ("p", "sensor_b")]):
        faults = (f"heater_{stuck}", *([other] if other else []))
        found.append(_judged(bank, window(_seed(seed, 20 + k), faults, stuck=stuck)))
    return found


def left_out(banks: dict[str, FaultBank], seed: int) -> list[Verdict]:
    """A window with each single fault, judged by the bank of `banks` that does not know it."""
    return [
        _judged(banks[name], window(_seed(seed, 30 + k), (name,)))
        for k, name in enumerate(FAULTS)
        if name in banks
    ]


def _seed(seed: int, k: int) -> int:
    return 100 * seed + k


def _judged(bank: FaultBank, case: Window) -> Verdict:
    names = bank.model.plant.signals.fault_names
    decision = decide(bank, case.run)
    end = decision.posterior.p[-1]
    said = {name for name, p in zip(names, end, strict=True) if p >= QUIET}
    told = {event.fault for event in decision.events} - {UNKNOWN}
    truth = set(case.faults) - {case.hidden}
    dated = [merit.dated(decision.events, name, case.onsets[name]) for name in case.faults]
    return Verdict(
        truth=tuple(case.faults),
        hidden=case.hidden,
        visible=case.hidden is None and all(_shows(case, name) for name in case.faults),
        acting=all(_acts(case, name) for name in case.faults),
        exact=merit.exact_set(said, truth),
        blamed=merit.wrong_names(told, case.faults),
        status=decision.status[-1],
        unknown=float(decision.posterior.unknown[-1]),
        wide=case.hidden is None or _reaches(bank, decision, case.hidden),
        dated=tuple(each for each in dated if each is not None),
    )


def _reaches(bank: FaultBank, decision: Decision, fault: str) -> bool:
    """The interval at the end reaches the prior's end on one side at least."""
    k = bank.model.plant.signals.fault_names.index(fault)
    far = max(-decision.posterior.lo[-1, k], decision.posterior.hi[-1, k])
    return bool(far >= 0.99 * WIDE * bank.size[k])


def _acts(case: Window, fault: str) -> bool:
    """Whether the heater's limits leave anything of a bias at the end of the window."""
    power = case.run.columns.get(fault.removeprefix("heater_"))
    return power is None or bool(0 <= power[-1] + case.faults[fault] <= LIMIT)


def _shows(case: Window, fault: str) -> bool:
    """Whether the same window without this fault (the same noise) looks different."""
    onset = case.onsets[fault]
    without = case.without(fault)
    late = case.run.t >= onset
    moved = [merit.rms((case.run.columns[y] - without.columns[y])[late]) for y in ("ya", "yb")]
    return max(moved) >= VISIBLE
