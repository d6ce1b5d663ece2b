"""`detectability`: what could be seen in logs as these are, told apart, and by what test input."""

from collections.abc import Callable, Sequence
from itertools import combinations, permutations

import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.smallest import (
    apart_size,
    around,
    deviations,
    information_left,
    least_size,
    possible,
    rivals_of,
    seen_size,
)
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.uncalibrated import level_in, uncalibrated
from faultgauge.detection.posterior.unit_faults import Effects, Information, effects_of, information
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.errors import InputError
from faultgauge.foresight.experiments import InputTrials, propose
from faultgauge.foresight.problems import problems_of
from faultgauge.foresight.result import (
    Delay,
    FaultSheet,
    Help,
    PairSheet,
    RunSheet,
    Sheet,
    TripleSheet,
)
from faultgauge.foresight.sensors import sensors_for
from faultgauge.foresight.structure import Structure, structure_of
from faultgauge.plants.model import Model
from faultgauge.progress import Step
from faultgauge.telemetry import Run

__all__ = ["RARER", "detectability", "levels_off"]

RARER = (1.0, 10.0, 100.0)  # times as rare as calibrated: false alarms
FEWEST = 20  # rows
ONSETS = 8  # along a log
DELAYS, TIMES = 40, 120  # points of curves
FLAT = 0.125  # of a slope of the logarithms; white noise alone has 0.5
TAIL = 2.0  # times: how long a deviation must have been flat to have levelled off
NONE = 1e-12  # of a standard deviation squared: no information


def detectability(
    model: Model, runs: Sequence[Run], *, progress: Callable[[str], None] = lambda text: None
) -> Sheet:
    """What `model` could see in logs like `runs`, had a fault begun in them.

    Every run is judged as it goes: its inputs, operating points, slow sensors and gaps; a run of
    more than 20,000 rows around its middle. Raises `InputError` for a model without calibration,
    where no fault is declared, and for a run that holds no information on any of them.
    """
    evaluated_faults(model.plant.signals)
    if lacking := uncalibrated(model):
        raise InputError(
            f"the model is {lacking}, so nobody knows how much noise hides its faults; run "
            "`faultgauge calibrate` on healthy logs first."
        )
    sheets = list[RunSheet]()
    for k, run in enumerate(runs):

        def within(text: str, share: float, k: int = k) -> None:
            progress(Step(text, (k + share) / len(runs)))

        within(f"the filter along {run.name}", 0.0)
        bank = build_fault_bank(model, [run], noise_of(model))
        sheets.append(_along(bank, run, within))
    rate = 3600 / level_in(model).mtbfa_s
    return Sheet(model.plant.spec.name, rate, RARER, tuple(sheets))


def _along(bank: FaultBank, run: Run, progress: Callable[[str, float], None]) -> RunSheet:
    signals = bank.model.plant.signals
    effects = effects_of(bank, as_it_acts(signals, run))
    rows, kept = len(effects.t), [k for k in range(len(bank.size)) if (k,) in bank.sets]
    if rows < FEWEST:
        raise InputError(
            f"{run.source}: {rows} rows of run {run.name!r} can be judged, too few to hold "
            f"information on a fault; give a log of at least {FEWEST} rows with "
            f"{', '.join((*signals.input_names, *bank.outputs))} sampled."
        )
    middle = rows // 2
    delays = np.unique(np.geomspace(1, rows - 1 - middle, DELAYS).astype(int))
    found = information(effects, middle, around(middle, rows), (middle + delays).tolist())
    onsets = np.linspace(0, rows - 1, ONSETS, endpoint=False).astype(int)
    ends = np.unique(np.linspace(0, rows - 1, TIMES).astype(int))
    over = information(effects, 0, onsets.tolist(), ends.tolist())
    if not np.any(over.other[-1, kept].max(axis=1) * bank.size[kept] ** 2 > NONE):
        raise InputError(
            f"{run.source}: run {run.name!r} holds no information on any declared fault "
            f"({', '.join(signals.fault_names[k] for k in kept)}): none of them would change what "
            "its outputs show; give a log whose inputs move."
        )
    structure = structure_of(bank.model.plant.spec, bank.outputs, [signals.faults[k] for k in kept])
    seconds = float(effects.t[-1] - effects.t[0])
    delay = effects.t[middle + delays] - effects.t[middle]
    faults = tuple(
        _fault(bank, k, structure, found, delay, seconds, effects, over, onsets, ends) for k in kept
    )
    pairs = tuple(_pair(bank, i, j, structure, found, delay) for i, j in permutations(kept, 2))
    return RunSheet(
        run.name, seconds, rows, faults, pairs, _triples(bank, kept, found),
        _help(bank, run, effects, structure, found, seconds, progress),
    )  # fmt: skip


def _fault(
    bank: FaultBank,
    k: int,
    structure: Structure,
    found: Information,
    delay: Float[np.ndarray, "ends"],
    seconds: float,
    effects: Effects,
    over: Information,
    onsets: np.ndarray,
    ends: np.ndarray,
) -> FaultSheet:
    fault, rivals = bank.model.plant.signals.faults[k], rivals_of(bank, k)
    own = found.own[:, k]
    left = np.array([information_left(found, bank, k, j) for j in rivals])
    left = left.reshape(len(rivals), len(delay))
    both = [deviations(float(own[n]), left[:, n].tolist()) for n in range(len(delay))]
    sd = np.array([each[0] for each in both])
    sizes = {
        rarer: tuple(
            possible(bank, k, least_size(bank, k, s, apart, seconds, rarer)) for s, apart in both
        )
        for rarer in RARER
    }
    nearest = int(np.argmin(left[:, -1])) if len(rivals) else -1
    confused = len(rivals) and apart_size(both[-1][1]) > _seen(bank, k, both[-1][0], seconds)
    return FaultSheet(
        name=fault.name,
        unit=fault.unit,
        widest=float(bank.size[k]),
        seen_from=possible(bank, k, _seen(bank, k, both[-1][0], seconds)),
        smallest={rarer: each[-1] for rarer, each in sizes.items()},
        like=structure.faults[_place(bank, rivals[nearest])] if confused else None,
        structural=structure.detectable(fault.name),
        levels_off=levels_off(delay, sd),
        floor=float(sd[-1]) if np.isfinite(sd[-1]) else None,
        delay=Delay(
            tuple(delay.tolist()),
            tuple(possible(bank, k, _seen(bank, k, s, seconds)) for s, _ in both),
            sizes,
            tuple(_finite(s) for s in sd),
        ),
        onsets=tuple(effects.t[onsets].tolist()),
        from_onset=tuple(
            possible(bank, k, _seen(bank, k, deviations(float(J), [])[0], seconds))
            for J in over.other[-1, k]
        ),
        times=tuple(effects.t[ends].tolist()),
        information=tuple(tuple(each) for each in over.other[:, k].T.tolist()),
    )


def _seen(bank: FaultBank, k: int, sd: float, seconds: float) -> float:
    return seen_size(bank, k, sd, seconds) if np.isfinite(sd) else np.inf


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _place(bank: FaultBank, fault: int) -> int:
    """Among those that are not disabled."""
    return sum((k,) in bank.sets for k in range(fault))


def _pair(
    bank: FaultBank,
    i: int,
    j: int,
    structure: Structure,
    found: Information,
    window: Float[np.ndarray, "ends"],
) -> PairSheet:
    names = bank.model.plant.signals.fault_names
    left, own = information_left(found, bank, i, j), found.own[:, i]
    share = np.where(own > 0, left / np.where(own > 0, own, 1.0), 0.0)
    told = apart_size(deviations(float(own[-1]), [float(left[-1])])[1])
    return PairSheet(
        fault=names[i],
        other=names[j],
        share=float(share[-1]),
        apart_from=possible(bank, i, told),
        divergence=float(left[-1] / 2),
        structural=structure.isolable(names[i], names[j]),
        window=tuple(window.tolist()),
        left=tuple(left.tolist()),
    )


def _triples(bank: FaultBank, kept: list[int], found: Information) -> tuple[TripleSheet, ...]:
    """Each fault beside every two others that may be there together, from its own onset on."""
    if bank.model.plant.signals.max_simultaneous < 2:
        return ()
    names, triples = bank.model.plant.signals.fault_names, []
    for i in kept:
        for pair in combinations([k for k in kept if k != i], 2):
            rest = list(pair)
            J = found.shared[-1, :, :, _same(found)]
            beside = J[np.ix_(rest, rest)] + np.diag(bank.size[rest] ** -2.0)
            own = float(J[i, i])
            left = own - float(J[i, rest] @ np.linalg.solve(beside, J[i, rest]))
            left = min(left, *(float(information_left(found, bank, i, j)[-1]) for j in rest))
            share = max(left, 0.0) / own if own > 0 else 0.0
            told = apart_size(deviations(own, [max(left, 0.0)])[1])
            others = (names[pair[0]], names[pair[1]])
            triples.append(TripleSheet(names[i], others, share, possible(bank, i, told)))
    return tuple(triples)


def _same(found: Information) -> int:
    """Which of the other onsets is the reference: there a fault shares all with itself."""
    gap = np.abs(found.other[-1] - found.own[-1][:, None]).sum(axis=0)
    return int(np.argmin(gap))


def levels_off(t: Float[np.ndarray, "ends"], sd: Float[np.ndarray, "ends"]) -> float | None:
    """When [s] a standard deviation stops falling, for at least as long again: by less than a
    quarter of what it would in white noise; None where it falls on to the end."""
    if len(t) < 3 or not np.all(np.isfinite(sd[-2:])):
        return None
    there = np.isfinite(sd)
    t, sd = t[there], sd[there]
    # slopes over a factor of time and not from row to row, where an input moves now and then
    falls = np.log(sd / sd[-1]) > FLAT * np.log(t[-1] / t)
    if not falls.any():
        return float(t[0])
    last = int(np.flatnonzero(falls)[-1]) + 1
    return float(t[last]) if last < len(t) and t[-1] >= TAIL * t[last] else None


def _help(
    bank: FaultBank,
    run: Run,
    effects: Effects,
    structure: Structure,
    found: Information,
    seconds: float,
    progress: Callable[[str, float], None],
) -> tuple[Help, ...]:
    problems = problems_of(bank, found, seconds)
    if not problems:
        return ()
    progress(f"one sensor more along {run.name}", 0.2)
    sensors = sensors_for(bank, run, effects, structure, problems)
    bench, faults = InputTrials(bank, run, effects), bank.model.plant.signals.faults
    helped = []
    for n, each in enumerate(problems):
        text = f"test inputs from the end of {run.name}: {n + 1} of {len(problems)}"
        progress(text, 0.4 + 0.6 * n / len(problems))
        fault = faults[each.fault]
        helped.append(
            Help(
                fault.name,
                None if each.rival is None else faults[each.rival].name,
                each.size,
                fault.unit,
                tuple(
                    (s.value, s.unit, s.sigma, s.sizes[n])
                    for s in sensors
                    if s.sizes[n] <= each.size
                ),
                propose(bench, each),
            )
        )
    return tuple(helped)
