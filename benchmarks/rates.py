"""The same physical log at 10, 100 and 1000 Hz: does it tell the same?

    python benchmarks/rates.py [--plant lag|motor]... [--rates HZ ...] [--seeds N] [--json FILE]
        [--without-discrepancy]

A lag and a motor under position control, both behind an actuator whose lag the plant file does not
know, and pushed by a load that wanders (an Ornstein-Uhlenbeck process of 0.3 s, well below 5 Hz).
The truth runs at 1000 Hz by its matrix exponential; a log at a lower rate has every so many of its
samples, and for its noise the mean of the fine log's over them, so that noise has one density per
Hz. The file is fitted to two logs and calibrated on three per rate. For each of N seeds (0 to
N - 1, by default 5) bisection finds the smallest step of the load that an event names online, and
the smallest that the whole log's answer names. Both searches take it that whatever names one size
names all larger ones. Printed per rate: the medians over seeds, and half of the 95 % interval at
the log's end under the largest step; then the largest over the smallest of each across rates (goal:
within 1.3), and online over hindsight (goal: within 1.5).
"""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.onset.retrospective import retrospect
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from mismatch.harness import calibrated, without_discrepancy

FINE = 1000  # Hz
HELD = 0.1  # s: how long a command stands, at any rate
SECONDS, ONSET = 30.0, 10.0
WIND, WIND_TIME = 0.02, 0.3  # of the load, s
ACTUATOR = {"lag": 0.1, "motor": 0.04}  # s
STEPS_PER_OCTAVE, OCTAVES = 4, 8  # of the sizes that are tried
FITS, CALIBRATIONS = 2, 3
FIT, CALIBRATE, TEST = range(3)  # the first number of a seed
RATE_GOAL, HINDSIGHT_GOAL = 1.3, 1.5


@dataclass(frozen=True)
class Body:
    """dz = A z + B u + E f,  y = z[measured];  z[0] is the actuator's output and z[1] the wandering
    load. `noise` is y's standard deviation at 1000 Hz, `largest` the largest load; `gains` (on the
    error and on -dy) close a loop around y."""

    name: str
    file: str
    A: Float[np.ndarray, "states states"]
    B: Float[np.ndarray, "states"]
    E: Float[np.ndarray, "states"]
    measured: int
    noise: float
    largest: float
    gains: tuple[float, float] | None = None

    @cached_property
    def plant(self) -> GrayBoxPlant:
        return GrayBoxPlant.untrained(parse_plant(self.file))


def lag() -> Body:
    """da = (u - a)/0.1,  dx = 2 a - x + load,  y = x."""
    file = """
name = "lag"
states.x = { derivative = "(g*u - x)/tau" }
inputs.u = { min = -10, max = 10, hold = "zero" }
outputs.y = { value = "x" }
faults.load = { enters = "state", target = "x" }
[parameters]
g = { value = 1.5, min = 0 }
tau = { value = 0.7, unit = "s", min = 0.1 }
"""
    A = np.array([[-1 / ACTUATOR["lag"], 0, 0], [0, -1 / WIND_TIME, 0], [2.0, 1.0, -1.0]])
    B, E = np.array([1 / ACTUATOR["lag"], 0, 0]), np.array([0, 0, 1.0])
    return Body("lag", file, A, B, E, 2, 0.1, 1.0)


def motor() -> Body:
    """da = (u - a)/0.04,  dw = 10 a - 2 w + load,  dq = w,  y = q under PD control."""
    file = """
name = "motor"
states.q = { derivative = "w" }
states.w = { derivative = "K*u - b*w" }
inputs.u = { min = -10, max = 10, hold = "zero" }
outputs.y = { value = "q" }
faults.load = { enters = "state", target = "w" }
[parameters]
K = { value = 8, min = 0 }
b = { value = 1.5, min = 0 }
"""
    A = np.array(
        [
            [-1 / ACTUATOR["motor"], 0, 0, 0],
            [0, -1 / WIND_TIME, 0, 0],
            [10.0, 1.0, -2.0, 0],
            [0, 0, 1.0, 0],
        ]
    )
    B, E = np.array([1 / ACTUATOR["motor"], 0, 0, 0]), np.array([0, 0, 1.0, 0])
    return Body("motor", file, A, B, E, 3, 0.02, 4.0, (0.6, 0.15))


BODIES: dict[str, Callable[[], Body]] = {"lag": lag, "motor": motor}


class Exact(NamedTuple):
    """z(k+1) = F z(k) + G u(k) + L f(k) + S e(k), e white of variance 1."""

    F: Float[np.ndarray, "states states"]
    G: Float[np.ndarray, "states"]
    L: Float[np.ndarray, "states"]
    S: Float[np.ndarray, "states states"]


def discrete(body: Body, step: float) -> Exact:
    """Exact at the samples, u and f being held, by exponentials of block matrices: Van Loan,
    "Computing integrals involving the matrix exponential" (1978). The wandering load is driven by
    white noise of density 2 sd^2 / time."""
    n = len(body.A)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[:n, n + 1] = body.A, body.B, body.E
    whole = expm(block * step)
    drive = np.zeros((n, n))
    drive[1, 1] = 2 * WIND**2 / WIND_TIME
    pair = np.block([[-body.A, drive], [np.zeros((n, n)), body.A.T]])
    found = expm(pair * step)
    Q = found[n:, n:].T @ found[:n, n:]
    values, vectors = np.linalg.eigh((Q + Q.T) / 2)
    S = vectors * np.sqrt(np.maximum(values, 0.0))
    return Exact(whole[:n, :n], whole[:n, n], whole[:n, n + 1], S)


class Record(NamedTuple):
    """Fine samples of physical logs, one row each; `noise` is not in y."""

    u: Float[np.ndarray, "logs samples"]
    y: Float[np.ndarray, "logs samples"]
    noise: Float[np.ndarray, "logs samples"]


def physical(
    body: Body, kind: int, seeds: Sequence[int], sizes: Sequence[float], rate: int = FINE
) -> Record:
    """Logs of `seeds`, the load stepping by `sizes` at the onset."""
    count, hold = round(SECONDS * rate), round(HELD * rate)
    exact, n = discrete(body, 1 / rate), len(body.A)
    drawn = [np.random.default_rng([kind, seed]) for seed in seeds]
    pushed = np.stack([rng.standard_normal((n, count)) for rng in drawn])
    noise = np.stack([body.noise * rng.standard_normal(count) for rng in drawn])
    wanted = np.stack([_wanted(rng, count // hold) for rng in drawn])
    z = np.zeros((n, len(seeds)))
    u, y = np.zeros((len(seeds), count)), np.zeros((len(seeds), count))
    command, last = np.zeros(len(seeds)), np.zeros(len(seeds))
    load = np.asarray(sizes, float)
    for k in range(count):
        y[:, k] = z[body.measured]
        if k % hold == 0:
            seen = y[:, k] + noise[:, k : k + hold].mean(axis=1)
            command = _command(body, wanted[:, k // hold], seen, (seen - last) / HELD)
            last = seen
        u[:, k] = command
        f = load if k >= ONSET * rate else np.zeros(len(seeds))
        z = (
            exact.F @ z
            + np.outer(exact.G, command)
            + np.outer(exact.L, f)
            + exact.S @ pushed[:, :, k].T
        )
    return Record(u, y, noise)


def _command(
    body: Body,
    wanted: Float[np.ndarray, "logs"],
    seen: Float[np.ndarray, "logs"],
    speed: Float[np.ndarray, "logs"],
) -> Float[np.ndarray, "logs"]:
    if body.gains is None:
        return wanted
    return body.gains[0] * (3 * wanted - seen) - body.gains[1] * speed


def _wanted(rng: np.random.Generator, count: int) -> Float[np.ndarray, "commands"]:
    """Levels between -1 and 1 that stand for 0.5 to 2.5 s."""
    found = list[float]()
    while len(found) < count:
        found += [float(rng.uniform(-1, 1))] * int(rng.integers(5, 25))
    return np.array(found[:count])


def at_rate(record: Record, rate: int) -> list[Run]:
    """The logs as a recorder of `rate` Hz has them."""
    every = FINE // rate
    noise = record.noise.reshape(len(record.noise), -1, every).mean(axis=2)
    t = np.arange(noise.shape[1]) / rate
    return [
        Run(f"{j}", f"{rate} Hz", t, {"u": u[::every], "y": y[::every] + v})
        for j, (u, y, v) in enumerate(zip(record.u, record.y, noise, strict=True))
    ]


class Judged(NamedTuple):
    """Whether the load was named, online and in hindsight, and half its interval at the end."""

    online: bool
    hindsight: bool
    half: float


@dataclass
class Search:
    """The smallest told sizes of a body at a rate: `judged` remembers (seed, place in `sizes`)."""

    body: Body
    model: Model
    rate: int
    judged: dict[tuple[int, int], Judged] = field(default_factory=dict)

    @property
    def sizes(self) -> Float[np.ndarray, "sizes"]:
        """From the smallest to the largest."""
        places = np.arange(STEPS_PER_OCTAVE * OCTAVES + 1)
        return self.body.largest * 2.0 ** (places / STEPS_PER_OCTAVE - OCTAVES)

    def judge(self, places: Mapping[int, int]) -> dict[int, Judged]:
        """Per seed, the size at its place."""
        new = {seed: at for seed, at in places.items() if (seed, at) not in self.judged}
        if new:
            sizes = [float(self.sizes[at]) for at in new.values()]
            logs = at_rate(physical(self.body, TEST, list(new), sizes), self.rate)
            decisions, bank = decide_runs(self.model, logs)
            for key, decision in zip(new.items(), decisions, strict=True):
                late = [e for e in decision.events if e.fault == "load" and e.end >= ONSET]
                seen = [] if bank is None else retrospect(bank, decision)
                found = decision.posterior
                self.judged[key] = Judged(
                    bool(late),
                    any(each.cause == "load" and each.p >= NAMED for each in seen),
                    float(found.hi[-1, 0] - found.lo[-1, 0]) / 2,
                )
        return {seed: self.judged[seed, at] for seed, at in places.items()}

    def smallest(self, seeds: int, told: Callable[[Judged], bool]) -> list[float]:
        """Per seed; infinite where the largest size is not told."""
        top = len(self.sizes) - 1
        first = self.judge(dict.fromkeys(range(seeds), top))
        high = {seed: top for seed, each in first.items() if told(each)}
        low = dict.fromkeys(high, -1)  # told at `high`, not at `low`
        while asked := {s: (low[s] + high[s]) // 2 for s in high if high[s] - low[s] > 1}:
            for seed, each in self.judge(asked).items():
                (high if told(each) else low)[seed] = asked[seed]
        return [float(self.sizes[high[s]]) if s in high else np.inf for s in range(seeds)]


def measure(body: Body, rate: int, seeds: int, options: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of one rate, as plain JSON."""
    print(f"{body.name}, {rate} Hz: fitting and calibrating", file=sys.stderr)
    fitted = at_rate(physical(body, FIT, range(FITS), [0.0] * FITS), rate)
    sound = at_rate(physical(body, CALIBRATE, range(CALIBRATIONS), [0.0] * CALIBRATIONS), rate)
    model, warnings = calibrated(body.plant, fitted, sound, options)
    search = Search(body, model, rate)
    print(f"{body.name}, {rate} Hz: searching", file=sys.stderr)
    online = search.smallest(seeds, lambda each: each.online)
    hindsight = search.smallest(seeds, lambda each: each.hindsight)
    largest = search.judge(dict.fromkeys(range(seeds), len(search.sizes) - 1))
    return {
        "rate": rate,
        "warnings": warnings,
        "online": online,
        "hindsight": hindsight,
        "half": [each.half for each in largest.values()],
    }


def ratios(found: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Largest over smallest median across rates; and online over hindsight, the largest."""
    medians = {
        key: np.array([np.median(each[key]) for each in found])
        for key in ("online", "hindsight", "half")
    }
    across = {
        key: float(values.max() / values.min()) if np.isfinite(values).all() else np.inf
        for key, values in medians.items()
    }
    late = np.isfinite(medians["online"]) & np.isfinite(medians["hindsight"])
    worst = medians["online"][late] / medians["hindsight"][late] if late.all() else [np.inf]
    return {**across, "online_over_hindsight": float(np.max(worst))}


def show(body: Body, found: Sequence[Mapping[str, Any]], across: Mapping[str, float]) -> None:
    print(f"{body.name}, of a largest load of {body.largest:g}:")
    for each in found:
        for warning in each["warnings"]:
            print(f"  {each['rate']} Hz warned: {warning}")
        said = ", ".join(
            f"{text} {np.median(each[key]):.3g} [{min(each[key]):.3g}, {max(each[key]):.3g}]"
            for key, text in (
                ("online", "smallest told online"),
                ("hindsight", "in hindsight"),
                ("half", "half of the interval"),
            )
        )
        print(f"  {each['rate']} Hz: {said}")
    print(
        f"  across rates, largest over smallest: online {across['online']:.2f}, hindsight "
        f"{across['hindsight']:.2f}, half of the interval {across['half']:.2f} "
        f"(goal: within {RATE_GOAL})"
    )
    print(
        f"  online over hindsight, the largest: {across['online_over_hindsight']:.2f} "
        f"(goal: within {HINDSIGHT_GOAL})",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plant", action="append", choices=list(BODIES))
    parser.add_argument("--rates", metavar="HZ", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--without-discrepancy", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if any(rate < 1 / HELD or FINE % rate for rate in given.rates):
        parser.error(f"--rates: from {1 / HELD:g} Hz on, and divisors of {FINE}.")
    options = without_discrepancy() if given.without_discrepancy else {}
    every = {}
    for name in given.plant or BODIES:
        body = BODIES[name]()
        found = [measure(body, rate, given.seeds, options) for rate in given.rates]
        every[name] = {"rates": found, "ratios": ratios(found)}
        show(body, found, every[name]["ratios"])
    if given.json:
        given.json.write_text(json.dumps(every))


if __name__ == "__main__":
    main()
