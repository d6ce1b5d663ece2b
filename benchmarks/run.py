"""All benchmarks: a table of ratios, each measured side by side on this machine.

    python benchmarks/run.py [--quick] [--out [FILE]]

Only ratios travel between machines. Every competitor runs in one thread: OpenBLAS, OpenMP and MKL
are told so, and XLA's CPU thread pool is off.
"""

import argparse
import json
import os
import platform
from pathlib import Path

SINGLE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "JAX_PLATFORMS": "cpu",
}
os.environ.update(SINGLE_THREAD)  # before NumPy and JAX are loaded; child processes inherit it

import fit_process  # noqa: E402
import lm_trial  # noqa: E402

Rows = list[dict[str, object]]


def ratio(seconds: dict[str, float], a: str, b: str, sign: str, goal: float) -> dict[str, object]:
    """How many times `a` takes longer than `b`, beside its goal ("<=" or ">=" `goal`)."""
    value = seconds[a] / seconds[b]
    met = value <= goal if sign == "<=" else value >= goal
    return {"what": f"{a} / {b}", "ratio": round(value, 3), "goal": f"{sign} {goal:g}", "met": met}


def trial(rounds: int) -> tuple[dict[str, float], Rows]:
    seconds = lm_trial.run(rounds=rounds)
    peers = [name for name in seconds if name not in ("faultgauge", "C")]
    rows = [ratio(seconds, "faultgauge", "C", "<=", 2.5)]
    return seconds, rows + [ratio(seconds, peer, "faultgauge", ">=", 5) for peer in peers]


def process(rounds: int) -> tuple[dict[str, float], Rows]:
    seconds = fit_process.run(rounds=rounds)
    ours, *peers = seconds
    goals = {peer: 2.5 if "1 start" in peer else 1.5 for peer in peers}
    return seconds, [ratio(seconds, ours, peer, "<=", goal) for peer, goal in goals.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="three rounds instead of nine")
    parser.add_argument(
        "--out",
        type=Path,
        nargs="?",
        const=Path(__file__).with_name("results.json"),
        help="also write the results as JSON, beside this file unless FILE is given",
    )
    arguments = parser.parse_args()
    rounds = 3 if arguments.quick else 9
    print(
        f"{platform.machine()}, {os.cpu_count()} CPUs; "
        + " ".join(f"{name}={value}" for name, value in SINGLE_THREAD.items())
    )
    results = {}
    for title, measure in (
        ("one LM trial, N = 10,000, 2-10-1", trial),
        ("whole process, 5,000 samples, warm compilation cache", process),
    ):
        seconds, rows = measure(rounds)
        results[title] = {"seconds": seconds, "ratios": rows}
        print(f"\n{title}: medians of {rounds} interleaved rounds")
        for name, value in seconds.items():
            print(f"  {name:<44} {value * 1e3:10.2f} ms")
        for row in rows:
            verdict = "met" if row["met"] else "MISSED"
            print(f"  {row['what']:<66} {row['ratio']:8.2f}   goal {row['goal']:<6} {verdict}")
    if arguments.out is not None:
        arguments.out.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
