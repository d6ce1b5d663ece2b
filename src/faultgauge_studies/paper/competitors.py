"""The paper's baselines and a sceptic's, trained: Table 2's way, and as well as we can.

Rows as in Table 2: torque from the command alone, 1000 samples at 1 Hz, normal operation for the
dynamic networks, the experiment for the others. Rows `_best`: the GBNNM's records of the
experiment, linear outputs, and the measured momentum as a second input at all times, which is more
than the GBNNM has, who knows it at the first sample of a run only.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.identification.optimise.levenberg_marquardt import Options
from faultgauge.simulation.satellite.observatory import HOLD, run
from faultgauge.telemetry import Run
from faultgauge_studies.baselines.adaptive_observer import (
    Gains,
    adaptive_observer,
    learn_online,
)
from faultgauge_studies.baselines.baseline import (
    Baseline,
    Record,
    Scaling,
    free_run,
    one_step,
)
from faultgauge_studies.baselines.bayesian import train_by_evidence
from faultgauge_studies.baselines.elman import elman
from faultgauge_studies.baselines.narx import narx
from faultgauge_studies.baselines.neural_ode import neural_ode
from faultgauge_studies.baselines.static_network import static_network
from faultgauge_studies.baselines.training import Mode, train
from faultgauge_studies.baselines.wiener_hammerstein import wiener_hammerstein
from faultgauge_studies.paper.bench import Bench
from faultgauge_studies.paper.cases import SECONDS
from faultgauge_studies.paper.excited import SWEEP, records, wheel_log

__all__ = [
    "ALONE",
    "PER_SECOND",
    "Budget",
    "Competitor",
    "Logs",
    "competitors",
    "logs",
    "record",
    "samples_of",
]

HIDDEN = 10
ORDER = 2  # of each linear block of Wiener-Hammerstein
LATENT = 2  # states of the neural ODE
WINDOW = 50  # s, of its training
HELD_OUT = 150  # of Table 2's 1000 samples: they stop and select
PER_SECOND = 4  # samples of a flight
NORMAL_SEED = 1000  # flights of normal operation are none of the flights that are scored
GAINS = (Gains(0.5, 0.03, 0.01), Gains(0.5, 0.3, 0.1), Gains(2.0, 0.3, 0.1))
PASSES = 20
ALONE, GIVEN = ("u",), ("u", "hm")


class Budget(NamedTuple):
    """Starts per model and LM trials per start: those of the GBNNM's own two networks."""

    starts: int = 10
    trials: int = 100


class Competitor(NamedTuple):
    """A trained model: what it reads, whether it is fed measured outputs, what it cost."""

    model: Baseline
    reads: tuple[str, ...]
    outputs: tuple[str, ...]
    online: bool
    trials: int
    starts: int
    per_second: int = 1
    effective: float = np.nan  # parameters that the data determine, where evidence says so

    def beside(self, flight: Run) -> Float[np.ndarray, "samples outputs"]:
        """Its outputs beside a flight at 4 Hz, at every whole second."""
        skip = PER_SECOND // self.per_second
        given = record(flight, self.reads, self.outputs, skip)
        found = (one_step if self.online else free_run)(self.model, given)
        return np.asarray(found)[:: self.per_second]


class Logs(NamedTuple):
    """Healthy logs at 1 Hz: the experiment twice, and normal operation."""

    training: Run
    validation: Run
    normal: Run


def logs(bench: Bench) -> Logs:
    held = run(bench.wheel, SECONDS, bench.seed + NORMAL_SEED, bench.inner, angles=HOLD)
    given = records(bench.wheel, SWEEP, bench.seed, bench.inner)
    return Logs(*given, samples_of(wheel_log(held, "pitch", "normal operation")))


def samples_of(flight: Run, skip: int = PER_SECOND) -> Run:
    """Every `skip`-th sample: 1 Hz."""
    columns = {name: x[::skip] for name, x in flight.columns.items()}
    return Run(flight.name, flight.source, flight.t[::skip], columns)


def record(log: Run, reads: Sequence[str], outputs: Sequence[str], skip: int = 1) -> Record:
    return Record(*(np.stack([log.columns[c][::skip] for c in cs], 1) for cs in (reads, outputs)))


def competitors(
    bench: Bench,
    budget: Budget,
    *,
    best: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Competitor]:
    """All of them by their names in results.json; without `best` those of Table 1 alone."""
    given = logs(bench)
    found = {}
    for name, train_one in (_PAPER | _MORE if best else _PAPER).items():
        progress(f"training {name}")
        found[name] = train_one(given, bench.seed, budget)
    return found


def _rngs(seed: int, name: str, starts: int) -> list[np.random.Generator]:
    return [np.random.default_rng([seed, *name.encode(), k]) for k in range(starts)]


def _split(log: Run, reads: tuple[str, ...], outputs: tuple[str, ...] = ("T",)) -> list[Record]:
    """[fitted, held out] of one log, as records of one run each."""
    whole = record(log, reads, outputs)
    cut = len(whole.u) - HELD_OUT
    return [
        Record(whole.u[None, part], whole.y[None, part]) for part in (slice(cut), slice(cut, None))
    ]


def _pair(given: Logs, reads: tuple[str, ...], outputs: tuple[str, ...] = ("T",)) -> list[Record]:
    both = (record(log, reads, outputs) for log in (given.training, given.validation))
    return [Record(r.u[None], r.y[None]) for r in both]


def _data(given: Logs, source: str) -> tuple[tuple[str, ...], list[Record]]:
    """What a model reads, and its records."""
    if source == "best":
        return GIVEN, _pair(given, GIVEN)
    return ALONE, _split(given.normal if source == "normal" else given.training, ALONE)


Network = Callable[[Scaling, np.random.Generator], Baseline]
Training = Callable[[Logs, int, Budget], Competitor]


def _network(name: str, make: Network, source: str, mode: Mode = "parallel") -> Training:
    def trained(given: Logs, seed: int, budget: Budget) -> Competitor:
        reads, (fitted, held_out) = _data(given, source)
        scaling = Scaling.of(fitted)
        models = [make(scaling, rng) for rng in _rngs(seed, name, budget.starts)]
        options = Options(max_trials=budget.trials, batch=budget.starts)
        found = train(models, fitted, held_out, mode, options)
        online = mode == "series_parallel"
        return Competitor(found.model, reads, ("T",), online, found.trials, found.starts)

    return trained


def _opened(given: Logs, seed: int, budget: Budget) -> Competitor:
    """PNN trained one step ahead first, and then in parallel from where that ended."""
    reads, (fitted, held_out) = _data(given, "normal")
    scaling = Scaling.of(fitted)
    models = [narx(scaling, HIDDEN, rng) for rng in _rngs(seed, "pnn", budget.starts)]
    options = Options(max_trials=budget.trials // 2, batch=budget.starts)
    opened = train(models, fitted, held_out, "series_parallel", options)
    closed = train(opened.models, fitted, held_out, "parallel", options)
    trials = opened.trials + closed.trials
    return Competitor(closed.model, reads, ("T",), False, trials, closed.starts)


def _evidence(name: str, source: str) -> Training:
    def trained(given: Logs, seed: int, budget: Budget) -> Competitor:
        reads, (fitted, held_out) = _data(given, source)
        scaling = Scaling.of(fitted)
        models = [narx(scaling, HIDDEN, rng) for rng in _rngs(seed, name, budget.starts)]
        found = train_by_evidence(models, fitted, "series_parallel")
        whole = Record(held_out.u[0], held_out.y[0])
        errors = [np.mean((np.asarray(one_step(e.model, whole)) - whole.y) ** 2) for e in found]
        best = found[int(np.argmin(errors))]
        trials = sum(each.trials for each in found)
        return Competitor(best.model, reads, ("T",), True, trials, len(found), effective=best.gamma)

    return trained


def _blocks(name: str, source: str) -> Training:
    def trained(given: Logs, seed: int, budget: Budget) -> Competitor:
        reads, (fitted, held_out) = _data(given, source)
        models = wiener_hammerstein(
            Scaling.of(fitted),
            Record(fitted.u[0], fitted.y[0]),
            HIDDEN,
            ORDER,
            [column == "hm" for column in reads],
            _rngs(seed, name, budget.starts),
        )
        options = Options(max_trials=budget.trials, batch=budget.starts)
        found = train(models, fitted, held_out, "parallel", options)
        return Competitor(found.model, reads, ("T",), False, found.trials, found.starts)

    return trained


def _ode(given: Logs, seed: int, budget: Budget) -> Competitor:
    """Fitted on short windows, each from its own first sample, and selected on the free run of the
    whole validation record. It learns and starts from momentum as the GBNNM does."""
    outputs = ("T", "hm")
    whole = _pair(given, ALONE, outputs)
    fitted, held_out = (_windows(each) for each in whole)
    scaling = Scaling.of(fitted)
    models = [
        neural_ode(scaling, HIDDEN, LATENT, 1.0, rng)
        for rng in _rngs(seed, "neural_ode", budget.starts)
    ]
    options = Options(max_trials=budget.trials, batch=budget.starts)
    found = train(models, fitted, held_out, "parallel", options, selection=whole[1])
    faster = found.model.every(1.0 / PER_SECOND)
    return Competitor(
        faster, ALONE, outputs, False, found.trials, found.starts, per_second=PER_SECOND
    )


def _windows(whole: Record) -> Record:
    """(windows, samples, signals)"""
    return Record(*(np.reshape(x, (-1, WINDOW, x.shape[-1])) for x in whole))


def _observer(given: Logs, seed: int, budget: Budget) -> Competitor:
    """It learns online beside the experiment, then goes on learning beside the plant."""
    outputs = ("T", "hm")
    fitted, held_out = (record(log, ALONE, outputs) for log in (given.training, given.validation))
    scaling = Scaling.of(fitted)
    candidates = [
        learn_online(
            adaptive_observer(scaling, HIDDEN, GAINS[k % len(GAINS)], 1.0, rng), fitted, PASSES
        )
        for k, rng in enumerate(_rngs(seed, "adaptive_observer", budget.starts))
    ]
    errors = [
        np.mean((np.asarray(one_step(each, held_out)) - held_out.y)[:, 0] ** 2)
        for each in candidates
    ]
    best = candidates[int(np.nanargmin(errors))].every(1.0 / PER_SECOND)
    return Competitor(
        best, ALONE, outputs, True, PASSES * len(candidates), len(candidates), PER_SECOND
    )


_PAPER: dict[str, Training] = {
    "snn": _network("snn", lambda s, rng: static_network(s, HIDDEN, rng, "tansig"), "experiment"),
    "rnn": _network("rnn", lambda s, rng: elman(s, HIDDEN, rng, "tansig"), "normal"),
    "pnn": _network("pnn", lambda s, rng: narx(s, HIDDEN, rng), "normal"),
    "spnn": _evidence("spnn", "normal"),
    "wiener_hammerstein": _blocks("wiener_hammerstein", "experiment"),
}
_MORE: dict[str, Training] = {
    "pnn_open_then_closed": _opened,
    "snn_best": _network("snn", lambda s, rng: static_network(s, HIDDEN, rng, "purelin"), "best"),
    "rnn_best": _network("rnn", lambda s, rng: elman(s, HIDDEN, rng, "purelin"), "best"),
    "pnn_best": _network("pnn", lambda s, rng: narx(s, HIDDEN, rng), "best"),
    "spnn_best": _evidence("spnn", "best"),
    "wiener_hammerstein_best": _blocks("wiener_hammerstein", "best"),
    "neural_ode": _ode,
    "adaptive_observer": _observer,
}
