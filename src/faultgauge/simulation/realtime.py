"""A scenario against the clock, under faults that are injected while it runs."""

import gc
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

from faultgauge.errors import InputError
from faultgauge.simulation.bench import Row, bench_of
from faultgauge.simulation.commands import Commanded, Commands
from faultgauge.simulation.pacing import Pacer
from faultgauge.simulation.scenario import TRUTH, Scenario
from faultgauge.simulation.schedules import grid, truth
from faultgauge.telemetry import Run

__all__ = ["Session"]

LONGEST = 1e6  # s of a sample


class Session:
    """One run of `scenario`, `speed` times as fast as the clock.

    `columns` are those of every row that is given out: time, inputs, outputs, and the truth of the
    faults that scenario and plant declare. The log also holds the truth of what else was injected.
    What has happened so far can be had at any time, as after an interrupt.
    """

    def __init__(self, scenario: Scenario, speed: float) -> None:
        if not 0 < speed < np.inf:
            raise InputError(f"--realtime {speed:g}: give a positive factor; 1 is real time.")
        if scenario.step / speed > LONGEST:
            raise InputError(
                f"--realtime {speed:g}: a sample would last {scenario.step / speed:g} s; give a "
                f"factor with which it lasts {LONGEST:g} s at most."
            )
        self.scenario = scenario
        self.bench = bench_of(scenario)
        self.commands = Commands(scenario)
        declared = dict.fromkeys([*self.commands.schedules, *scenario.plant.signals.fault_names])
        self.columns = ("t", *self.bench.columns, *(TRUTH + name for name in declared))
        self.pacer = Pacer(scenario.step / speed)
        # columns of the log; those of the truth of what is injected come when it is
        self.kept = {name: array("d") for name in ("t", *self.bench.columns)}
        self.kept |= {TRUTH + name: array("d") for name in self.commands.schedules}
        self.injections: list[dict[str, Any]] = []

    def run(
        self,
        poll: Callable[[], list[str]],
        emit: Callable[[Row], None],
        complain: Callable[[str], None],
    ) -> None:
        """Go through the scenario, or until a command stops it.

        At every sample `poll` gives the commands that have come; they act from this sample on.
        `emit` takes each row of the log when it is due; `complain` takes what is wrong with a
        command, which then changes nothing.
        """
        scenario = self.scenario
        times = grid(scenario.samples, scenario.step)[:, 0].tolist()
        gc.collect()
        gc.freeze()  # a collection walks over all modules' objects otherwise, for tens of ms
        try:
            for k, t in enumerate(times):
                self.pacer.wait_for_work()
                if self._obeyed(poll(), k, t, complain):
                    return
                row = self._row(t)
                self.pacer.wait()
                if k % scenario.log_every == 0:
                    self._keep(row)
                    emit({name: row.get(name, 0.0) for name in self.columns})
                self.pacer.done()
        finally:
            gc.unfreeze()

    def log(self) -> Run:
        """The rows so far as `simulate` has them, and the truth of what was injected."""
        rows = min(len(values) for values in self.kept.values())  # an interrupt comes any time
        columns = {name: np.array(values[:rows]) for name, values in self.kept.items()}
        return Run(self.scenario.name, self.scenario.source, columns.pop("t"), columns)

    def _row(self, t: float) -> Row:
        commands, at = self.commands, np.array([t])
        row = {"t": t, **self.bench.sample(list(commands.schedules.values()))}
        row |= {TRUTH + name: _absent(effect) for name, effect in commands.effects.items()}
        for name, schedule in commands.schedules.items():
            row[TRUTH + name] = float(truth(schedule, at)[0])
        return row

    def _keep(self, row: Row) -> None:
        rows = len(self.kept["t"])
        for name, value in row.items():
            if name not in self.kept:
                absent = _absent(self.commands.effects[name.removeprefix(TRUTH)])
                self.kept[name] = array("d", [absent] * rows)
            self.kept[name].append(value)

    def _obeyed(self, lines: list[str], k: int, t: float, complain: Callable[[str], None]) -> bool:
        """Whether one of the commands `lines` said to stop."""
        for line in filter(str.strip, lines):
            try:
                change = self.commands.obey(line, t)
            except InputError as wrong:
                complain(str(wrong))
                continue
            self.injections += _records(change, k, t)
            if change.did == "stop":
                return True
        return False


def _records(change: Commanded, k: int, t: float) -> list[dict[str, Any]]:
    """What is kept of a command: the sample at which it began to act, and what it did."""
    at = {"sample": k, "t": t, "did": change.did}
    if change.schedule is None:
        return [{**at, "name": name} for name in change.cleared] or [at]
    schedule = change.schedule
    return [
        {
            **at,
            "name": schedule.name,
            "enters": schedule.enters,
            "target": schedule.target,
            "effect": schedule.effect,
            "size": change.size,
            "ramp": change.ramp,
            "unit": schedule.unit,
        }
    ]


def _absent(effect: str) -> float:
    """The truth of a fault that does not act: what is stuck has a value only while it is."""
    return np.nan if effect == "stuck" else 0.0
