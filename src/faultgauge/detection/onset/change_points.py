"""Where in a window a fault began, how large it is and which one it is: change-point posterior.

A window ends where the bank saw its fault go, and at a gap.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.knowledge import longest_delay
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.window import Causes, Window, causes_in, shocks_of, window_of
from faultgauge.detection.posterior.verdicts import FAULT, NAMED
from faultgauge.detection.rows.judged import start_from_samples
from faultgauge.detection.rows.prepared import Prepared
from faultgauge.telemetry import Run, segments

__all__ = ["causes_of", "total", "windows_of"]

PASSES = 2  # of linearising the filter around the fault that was found
FEWEST = 20  # samples below which a window is not judged


def total(weight: Float[np.ndarray, "..."]) -> float:
    """ln of a sum of weights."""
    return float(np.logaddexp.reduce(weight, axis=None))


def windows_of(bank: FaultBank, decision: Decision) -> Iterator[Window]:
    """The windows of a judged run that have samples to judge, in order."""
    believed, used = _believed(bank, decision), _quiet(bank, decision)
    for part in _windows(bank, decision, decision.used.run):
        window = _window(bank, used, part, believed)
        if window is not None:
            yield window


def causes_of(bank: FaultBank, window: Window) -> Causes:
    """The posterior of a window, beside the faults that are known in it, as against none but what
    is made up.

    A fault that beats the healthy hypothesis is linearised around itself: what it does to the
    state, and to its own effect, then counts in full.
    """
    faults = bank.model.plant.signals.faults
    plain = shocks_of(bank, window)
    found = causes_in(bank, window, plain)
    seen = [plain] * (len(faults) + 1)
    for k, fault in enumerate(faults):
        for _ in range(PASSES if total(found.weight[:, k]) > 0 else 0):
            best = int(np.argmax(found.weight[:, k]))
            size = float(np.clip(found.mean[best, k], fault.min, fault.max))
            around = shocks_of(bank, window, window.record.f.at[best:, k].set(size))
            if not np.isfinite(around.base):  # so large a fault loses the filter
                break
            seen[k], again = around, causes_in(bank, window, around)
            more = float(around.base - plain.base)
            found.weight[:, k] = again.weight[:, k] + more
            found.made_up[:, k] = again.made_up[:, k] + more
            found.mean[:, k], found.sd[:, k] = again.mean[:, k], again.sd[:, k]
    none = np.logaddexp(0.0, total(found.made_up))
    return found._replace(weight=found.weight - none, seen=tuple(seen))


def _believed(bank: FaultBank, decision: Decision) -> Bool[np.ndarray, "samples"]:
    """Samples at which the model is trusted: inside the training envelope, or under an alarm that
    began there."""
    return decision.posterior.inside | (np.array(decision.status) == FAULT)


def _quiet(bank: FaultBank, decision: Decision) -> Prepared:
    """The rows less the samples of an output while it had far more noise than in healthy logs."""
    used, outputs = decision.used, bank.model.plant.signals.output_names
    y, t = used.y.copy(), used.run.t
    for event in decision.events:
        if event.noisy is not None:
            there = (t >= event.onset_lo) & (t <= event.end)
            y[there, outputs.index(event.noisy)] = np.nan
    return replace(used, y=y)


def _windows(bank: FaultBank, decision: Decision, run: Run) -> Iterator[slice]:
    """Stretches without a gap, cut where a fault went and the plant was healthy again: as long
    before the bank saw it as it may take to see it. What lies between belongs to no window."""
    names = bank.model.plant.signals.fault_names
    for stretch in segments(run, bank.model.plant.signals.input_names or bank.outputs):
        first = stretch.start
        for event in decision.events:
            stop = int(np.searchsorted(run.t, event.end, "right"))
            if not first < stop < stretch.stop or not _healthy_after(decision, stop, stretch.stop):
                continue
            late = 0.0
            if event.size is not None:
                k = names.index(event.fault)
                late = longest_delay(
                    bank.knowledge, k, event.size, float(bank.onset[k]), bank.level
                )
            last = int(np.searchsorted(run.t, max(event.end - late, event.start), "right"))
            yield slice(first, max(last, first))
            first = stop
        yield slice(first, stretch.stop)


def _healthy_after(decision: Decision, stop: int, end: int) -> bool:
    """Whether the bank was sure of it between `stop` and the next event."""
    t = decision.run.t
    starts = [int(np.searchsorted(t, event.start)) for event in decision.events]
    following = min((start for start in starts if start >= stop), default=end)
    return bool(np.any(decision.posterior.healthy[stop : min(following, end)] >= NAMED))


def _window(
    bank: FaultBank,
    used: Prepared,
    part: slice,
    believed: Bool[np.ndarray, "samples"],
) -> Window | None:
    complete = np.all([np.isfinite(used.run.columns[n][part]) for n in bank.outputs], axis=0)
    usable = np.flatnonzero(complete & believed[part])
    if len(usable) < FEWEST:
        return None
    part = slice(part.start + int(usable[0]), part.stop)
    start = start_from_samples(bank.model, used.cut(part))
    more = np.zeros(len(bank.plant.signals.states) - len(start.x))
    return window_of(bank, used, part, believed, np.append(start.x, more))
