"""The five benchmarks of free runs: what is trained on, what is scored, and from which sample on.

Splits and windows are those of nonlinear_benchmarks 1.0.1 (`benchmarks.py` there); where another
convention is in use, it is a split of its own. Every test run is simulated from its inputs alone;
its first `window` measured outputs find the initial state and are not scored.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge_studies.published import data
from faultgauge_studies.published.results import PUBLISHED, Published

__all__ = [
    "BENCHMARKS",
    "FAULTED",
    "Benchmark",
    "Records",
    "Split",
    "benchmark",
    "plant_named",
    "plant_of",
    "plant_text",
    "records",
]

# The first and last sample of each part: silverbox and Wiener-Hammerstein are cut from one record.
SB_TRAIN, SB_MULTISINE = (40650, 105712), (105712, 127400)
SB_ARROW, SB_ARROW_INSIDE = (100, 40575), (100, 32100)
WH_TRAIN, WH_TEST, WH_TEST_STEADY = (0, 100000), (100000, 188000), (105200, 184000)


FAULTED = ("crazypad", "skab")  # benchmarks of decisions, `faulted.py`


@dataclass(frozen=True)
class Split:
    """One test run; of it the first `window` samples give the initial state and are not scored."""

    name: str
    test: Run
    window: int
    published: Published | None


@dataclass(frozen=True)
class Records:
    """What is fitted on, and what is scored."""

    train: tuple[Run, ...]
    splits: tuple[Split, ...]


@dataclass(frozen=True)
class Benchmark:
    """One benchmark. `scale` turns the log's unit of `output` into `unit`, that of the scores."""

    name: str
    title: str
    output: str
    unit: str
    scale: float
    description: str
    read: Callable[[], tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]]


def _emps() -> tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]:
    found = data.emps()
    return {"nominal": found["train"]}, {"pulses": (found["test"], 20)}


def _tanks() -> tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]:
    found = data.tanks()
    test = found["test"]
    return {"train": found["train"]}, {"window_50": (test, 50), "window_5": (test, 5)}


def _silverbox() -> tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]:
    whole = data.silverbox()["whole"]
    tests = {
        "arrow_full": (whole.part(*SB_ARROW), 50),
        "arrow_no_extrapolation": (whole.part(*SB_ARROW_INSIDE), 50),
        "multisine": (whole.part(*SB_MULTISINE), 50),
    }
    return {"multisine": whole.part(*SB_TRAIN)}, tests


def _wiener_hammerstein() -> tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]:
    whole = data.wiener_hammerstein()["whole"]
    tests = {
        "test": (whole.part(*WH_TEST), 50),
        "test_steady": (whole.part(*WH_TEST_STEADY), 50),
    }
    return {"train": whole.part(*WH_TRAIN)}, tests


def _quarter_drone() -> tuple[dict[str, data.Record], dict[str, tuple[data.Record, int]]]:
    found = data.quarter_drone()
    train = {name: found[name] for name in ("semi_static", "steps", "multisine", "rig")}
    return train, {name: (found[name], 50) for name in ("swept_sine", "rig_sequence")}


BENCHMARKS: Mapping[str, Benchmark] = {
    each.name: each
    for each in (
        Benchmark(
            "emps",
            "EMPS, a positioning drive",
            "q",
            "mm",
            1e3,
            "DC motor and ball screw in closed loop, 1 kHz, friction. Fitted on the nominal "
            "record; tested on the record with 5 V pulses in the loop, which the model is given "
            "as part of its input (the voltage applied).",
            _emps,
        ),
        Benchmark(
            "cascaded_tanks",
            "Cascaded tanks",
            "y",
            "V",
            1.0,
            "Two tanks with overflow, a sensor that saturates at 10 V, 1024 samples of 4 s. The "
            "same test run twice: the initial state from 50 samples, as the official loader has "
            "it, and from 5.",
            _tanks,
        ),
        Benchmark(
            "silverbox",
            "Silverbox",
            "y",
            "mV",
            1e3,
            "An electronic Duffing oscillator, 610.35 Hz. Fitted on the first three quarters of "
            "the multisines; tested on the last quarter, on the growing arrow, and on the arrow's "
            "first 32000 samples, which stay within the training range.",
            _silverbox,
        ),
        Benchmark(
            "wiener_hammerstein_2009",
            "Wiener-Hammerstein 2009",
            "y",
            "mV",
            1e3,
            "An electronic circuit, 51.2 kHz. Fitted on the first 100000 samples. test: the last "
            "88000; test_steady: those of them that the official loader scores, without the "
            "silence at the end.",
            _wiener_hammerstein,
        ),
        Benchmark(
            "quarter_drone",
            "Quarter drone",
            "theta",
            "deg",
            1.0,
            "An arm with one propeller under closed-loop control, 100 Hz. Fitted on four whole "
            "runs (semi-static, steps and multisine of one source, one recording of the rig); "
            "tested on two whole runs that the fit has not seen: the swept sine of the first "
            "source and the sequence of the rig.",
            _quarter_drone,
        ),
    )
}


def benchmark(name: str) -> Benchmark:
    """The benchmark of a free run called `name`; `InputError` with the names of all benchmarks."""
    if name not in BENCHMARKS:
        legal = ", ".join((*BENCHMARKS, *FAULTED))
        raise InputError(f"{name!r} is no benchmark; choose one of {legal}.")
    return BENCHMARKS[name]


def records(chosen: Benchmark) -> Records:
    """The runs of a benchmark. Raises `InputError` where the data are absent."""
    train, tests = chosen.read()
    name, output = chosen.name, chosen.output
    return Records(
        tuple(each.run(run, name, output) for run, each in train.items()),
        tuple(
            Split(split, each.run(split, name, output), window, PUBLISHED.get((name, split)))
            for split, (each, window) in tests.items()
        ),
    )


def plant_of(chosen: Benchmark) -> GrayBoxPlant:
    """The plant file of a benchmark, untrained."""
    return plant_named(chosen.name)


def plant_named(name: str) -> GrayBoxPlant:
    """The plant file that is shipped for the benchmark `name`, untrained."""
    return GrayBoxPlant.untrained(parse_plant(plant_text(name), f"{name}.toml"))


def plant_text(name: str) -> str:
    """The text of that plant file."""
    folder = resources.files("faultgauge_studies.published")
    return folder.joinpath("plants", f"{name}.toml").read_text()
