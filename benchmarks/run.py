"""All benchmarks: each goal a row, ours beside a tight C loop and beside the peers, here.

    python benchmarks/run.py [--quick] [--out FOLDER]

Writes `latest.json` and `latest.html`, with bars, into FOLDER (by default `results` beside this
file). `latest.json` is a list of rows

    {name, goal, ours, c, peers: {NAME: ...}, ratio_to_c, ratio_to_best_peer, met}

where a time is {median, min, max} [s] over interleaved rounds and a peer that is not there is a
sentence; ratios are medians of the rounds' own, ours by theirs. Only ratios travel. Every
competitor runs in one thread: OpenBLAS, OpenMP and MKL are told so, and XLA's CPU thread pool is
off; but ours of thousands of units or flights, which the product spreads over the cores. `--quick`
takes fewer rounds and leaves out what is long.
"""

import argparse
import json
import os
import platform
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgauge.settings import COMPILER

SINGLE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": COMPILER,
    "JAX_PLATFORMS": "cpu",
}
os.environ.update(SINGLE_THREAD)  # before NumPy and JAX are loaded; child processes inherit it

import numpy as np  # noqa: E402

import fit_process  # noqa: E402
import free_runs  # noqa: E402
import lm_trial  # noqa: E402
import monitor  # noqa: E402
import observer  # noqa: E402
import spacecraft  # noqa: E402
import wheels  # noqa: E402
from faultgauge.files import write_atomically  # noqa: E402
from faultgauge.reporting.model_figures import bars  # noqa: E402
from faultgauge.reporting.report import Report, Section, Table, render  # noqa: E402
from interleave import Times  # noqa: E402

OURS, C = "faultgauge", "C"
ROUNDS, QUICK = 9, 3


@dataclass(frozen=True)
class Measure:
    """What is measured, by whom, and how many times as long as each ours may take: the names that
    begin with a key; `within` is the most that ours may take by the clock [s]."""

    name: str
    compete: Callable[[int], tuple[Times, dict[str, str]]]
    goals: dict[str, float]
    long: bool = False
    within: float | None = None


MEASURES = (
    Measure(
        "one LM trial, N = 10,000, 2-10-1, from a plant file",
        lm_trial.compete,
        {C: 2.5, "SciPy": 1 / 5, "Optimistix": 1 / 5},
    ),
    Measure("100 wheels fitted, N = 1,000: a trial", wheels.compete, {C: 1.3}),
    Measure("1,000 wheels fitted, N = 1,000: a trial", wheels.compete_many, {C: 1.3}, long=True),
    Measure("free run, one trajectory: a step", free_runs.compete_alone, {"NumPy": 1 / 40}),
    Measure("free runs, 1,000 side by side: a step of one", free_runs.compete_together, {C: 0.6}),
    Measure("observer, 10,000 samples in one scan: a sample", observer.compete_scan, {C: 1.5}),
    Measure(
        "observer, printed C, called from Python: a sample",
        observer.compete_calls,
        {"filterpy": 1 / 100},
    ),
    Measure("observer, printed C: a sample", observer.compete_printed, {}, within=150e-9),
    Measure(
        "10,000 units observed, all cores: a sample of one",
        monitor.compete,
        {C: 1 / 2.5},
        within=50e-9,
    ),
    Measure(
        "spacecraft on three wheels, 512 at once, all cores: a second",
        spacecraft.compete,
        {"Basilisk": 1 / 200, "real time": 1 / 527_400},  # the second: 200 x Basilisk's 2,637
        long=True,
    ),
    Measure(
        "faultgauge fit, 10 starts, 5,000 samples: a process, warm",
        fit_process.compete,
        {"SciPy, 1 start": 2.5, "SciPy, 10 starts": 1.5},
        long=True,
    ),
)


def row(measure: Measure, times: Times, absent: dict[str, str]) -> dict[str, Any]:
    """A row of `latest.json`."""
    ratios = {
        name: statistics.median(a / b for a, b in zip(times[OURS], each, strict=True))
        for name, each in times.items()
        if name != OURS
    }
    peers = {name: ratio for name, ratio in ratios.items() if name != C}
    missed = [
        name
        for name, ratio in ratios.items()
        for key, most in measure.goals.items()
        if name.startswith(key) and ratio > most
    ]
    if measure.within is not None and statistics.median(times[OURS]) > measure.within:
        missed.append("clock")
    # who is not there cannot be outrun
    alone = [key for key in measure.goals if not any(n.startswith(key) for n in ratios)]
    return {
        "name": measure.name,
        "goal": goal(measure),
        "ours": told(times[OURS]),
        "c": told(times[C]) if C in times else None,
        "peers": {name: told(times[name]) for name in peers} | absent,
        "ratio_to_c": ratios.get(C),
        # the best is the fastest, which ours takes longest beside
        "ratio_to_best_peer": max(peers.values(), default=None),
        "met": None if alone and not missed else not missed,
        "missed": missed,
    }


def goal(measure: Measure) -> str:
    said = [f"<= {most:.3g} x {key}" for key, most in measure.goals.items()]
    if measure.within is not None:
        said.append(f"<= {1e9 * measure.within:.3g} ns")
    return ", ".join(said)


MET = {True: "met", False: "MISSED", None: "not compared with all"}


def told(seconds: list[float]) -> dict[str, float]:
    return {"median": statistics.median(seconds), "min": min(seconds), "max": max(seconds)}


def page(rows: list[dict[str, Any]], about: str) -> Report:
    """Times as shares of ours, and what is not there."""
    sections = []
    for each in rows:
        times = {C: each["c"]} if each["c"] else {}
        times |= {n: t for n, t in each["peers"].items() if isinstance(t, dict)}
        ours = each["ours"]["median"]
        ranges = np.array(
            [[t["median"], t["min"], t["max"]] for t in (each["ours"], *times.values())]
        )
        drawn = bars(
            [OURS, *times], ranges / ours, title=each["name"], name="Time by ours", unit="1"
        )
        absent = [f"{n}: {t}." for n, t in each["peers"].items() if isinstance(t, str)]
        said = (f"Goal {each['goal']}: {MET[each['met']]}.", *absent)
        sections.append(Section(each["name"], said, (), (drawn,)))
    table = Table(
        ("what", "goal", "by C", "by the best peer", ""),
        tuple(
            (
                each["name"],
                each["goal"],
                number(each["ratio_to_c"]),
                number(each["ratio_to_best_peer"]),
                MET[each["met"]],
            )
            for each in rows
        ),
    )
    met = sum(each["met"] is True for each in rows)
    said = (f"{met} of {len(rows)} goals are met.", about)
    return Report("Benchmarks", said, tuple(sections), table)


def number(ratio: float | None) -> str:
    return "" if ratio is None else f"{ratio:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="3 rounds, nothing long")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("results"))
    arguments = parser.parse_args()
    rounds = QUICK if arguments.quick else ROUNDS
    settings = " ".join(f"{name}={value}" for name, value in SINGLE_THREAD.items())
    about = f"{platform.machine()}, {os.cpu_count()} CPUs, {rounds} interleaved rounds; {settings}"
    print(about)
    rows = []
    for measure in MEASURES:
        if arguments.quick and measure.long:
            continue
        found = row(measure, *measure.compete(rounds))
        rows.append(found)
        print(f"\n{found['name']}: goal {found['goal']}, {MET[found['met']]}")
        for name, time in {OURS: found["ours"], C: found["c"], **found["peers"]}.items():
            if isinstance(time, dict):
                print(f"  {name:<40} {time['median'] * 1e6:14.3f} us")
            elif time is not None:
                print(f"  {name:<40} {time}")
        print(
            f"  ratio to C {number(found['ratio_to_c']) or '-'}, to the best peer "
            f"{number(found['ratio_to_best_peer']) or '-'}"
        )
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_atomically(arguments.out / "latest.json", (json.dumps(rows, indent=1) + "\n").encode())
    write_atomically(arguments.out / "latest.html", render(page(rows, about)).encode())
    print(f"\nwrote {arguments.out / 'latest.json'} and {arguments.out / 'latest.html'}")


if __name__ == "__main__":
    main()
