"""The hypotheses of a plant and how they follow one another.

A mode is a set of faults that are present together, each in a slot of the filter's state. The
first mode is healthy. The last three are unknown ones, for what no set of declared faults explains:

- driven: every state is driven by a constant of its own, as a leak or an actuator's bias does it;
- jumped: the same after the states have jumped, as the bias of a sensor looks from outside;
- loose: the states walk freely and the outputs are noisier, for what changes all the time.

Every single fault has two modes: in the first it is as good as constant, in the second, the agile
one, it has just changed or keeps changing.

A declared fault that fits wins by its smaller number of unknowns.

Faults come and go one at a time, so the prior of a pair is the product of its members', but for
the few that a common cause brings together.
"""

from collections.abc import Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.sigma_point import Hypothesis

__all__ = ["Levels", "Links", "hypotheses", "links", "mode_sets", "with_unknown"]

SWAPPED = 1e-4  # of recoveries: how often the unknown mode turns into a named fault
CHANGED = 10.0  # times the recovery rate: how often one unknown mode turns into another
CREEPING = 0.01  # of onsets: how often a fault begins by changing all the time
COMMON = 1e-3  # of onsets: one in a thousand brings two faults at once, by a common cause


class Levels(NamedTuple):
    """Noise and prior knowledge, all as standard deviations in the plant's units.

    `sigma` per sample; `process`, `drift`, `walk` and `agile` per sqrt(s) of states, drifting
    parameters and faults, constant and changing; `size` of a fault that has just begun; `drifted`
    of a drifting parameter at the start. Declared faults come first, then what drives the states
    in the unknown modes; `jump` of the states, `loose` (per sqrt(s)) their free walk and `noisier`
    the noise it comes with. `hides` is how far, where a declared fault comes second (the first
    axis), the estimate of a sensor's fault that was there (the second one) takes its effect on the
    sensor's state to itself before it is noticed; 0 for other faults. `onset` per
    declared fault, `unknown` per unknown mode and `recovery` are rates [1/s]; a fault changes as
    often as it recovers, and `settling` ends the change.
    """

    sigma: Float[np.ndarray, "outputs"]
    process: Float[np.ndarray, "states"]
    drift: Float[np.ndarray, "drifting"]
    drifted: Float[np.ndarray, "drifting"]
    walk: Float[np.ndarray, "every"]
    agile: Float[np.ndarray, "every"]
    size: Float[np.ndarray, "every"]
    onset: Float[np.ndarray, "faults"]
    jump: Float[np.ndarray, "states"]
    hides: Float[np.ndarray, "faults faults states"]
    loose: Float[np.ndarray, "states"]
    noisier: Float[np.ndarray, "outputs"]
    unknown: Float[np.ndarray, "unknown"]
    recovery: float
    settling: float


class Links(NamedTuple):
    """What each mode is mixed from: `rate` [1/s] of the change from mode `source`.

    `place` says which component of the source's z stands where; `fresh` components enter with
    the standard deviations `entering` and mean 0; all gain `jump` on the way in. The first column
    is the mode itself, `leaving` the rate at which it is left; unused columns have rate 0. `hidden`
    is a shift, as a standard deviation, that leaves the outputs where they are.
    """

    source: Int[Array, "modes incoming"]
    rate: Float[Array, "modes incoming"]
    place: Int[Array, "modes incoming n"]
    fresh: Bool[Array, "modes incoming n"]
    entering: Float[Array, "modes n"]
    jump: Float[Array, "modes n"]
    leaving: Float[Array, "modes"]
    hidden: Float[Array, "modes incoming n"]


Set = tuple[int, ...]


def mode_sets(faults: Sequence[int], most: int) -> tuple[Set, ...]:
    """The sets of faults: healthy, singles, pairs, and once more the singles, agile; the unknown
    modes come after."""
    sizes = range(min(most, len(faults)) + 1)
    steady = [each for size in sizes for each in combinations(faults, size)]
    return (*steady, *((k,) for k in faults))


def _is_agile(sets: tuple[Set, ...], mode: int) -> bool:
    return mode < len(sets) and sets.index(sets[mode]) != mode


def with_unknown(sets: tuple[Set, ...], levels: Levels) -> tuple[Set, ...]:
    """`sets` and what acts in the unknown modes: driven, jumped, loose."""
    driving = tuple(range(len(levels.onset), len(levels.size)))
    return (*sets, driving, driving, ())


def hypotheses(sets: tuple[Set, ...], levels: Levels) -> Hypothesis:
    """The hypothesis of every mode, the unknown ones last."""
    everyone = with_unknown(sets, levels)
    slots = max(len(each) for each in everyone)
    modes = len(everyone)
    select = np.zeros((modes, len(levels.size), slots))
    walk = np.zeros((modes, len(levels.drift) + slots))
    walk[:, : len(levels.drift)] = levels.drift
    for m, present in enumerate(everyone):
        for slot, fault in enumerate(present):
            select[m, fault, slot] = 1.0
            walks = levels.agile if _is_agile(sets, m) else levels.walk
            walk[m, len(levels.drift) + slot] = walks[fault]
    process = np.repeat(levels.process[None], modes, axis=0)
    sigma = np.repeat(levels.sigma[None], modes, axis=0)
    process[-1] = np.hypot(levels.process, levels.loose)
    sigma[-1] = np.hypot(levels.sigma, levels.noisier)
    return Hypothesis(*(jnp.asarray(each) for each in (select, process, walk, sigma)))


def links(sets: tuple[Set, ...], states: int, levels: Levels) -> Links:
    """Who turns into whom, and what becomes of the fault slots on the way."""
    everyone = with_unknown(sets, levels)
    slots = max(len(each) for each in everyone)
    fixed = states + len(levels.drift)
    modes, n = len(everyone), fixed + slots
    incoming, leaving = _changes(sets, modes, levels)
    width = max(len(each) for each in incoming)
    source, rate = np.zeros((modes, width), int), np.zeros((modes, width))
    place = np.zeros((modes, width, n), int) + np.arange(n)
    fresh = np.zeros((modes, width, n), bool)
    entering, jump = np.ones((modes, n)), np.zeros((modes, n))
    hidden = np.zeros((modes, width, n))
    for m, each in enumerate(incoming):
        for slot, fault in enumerate(everyone[m]):
            entering[m, fixed + slot] = levels.size[fault]
        for k, (other, how_often) in enumerate(each):
            source[m, k], rate[m, k] = other, how_often
            for slot in range(slots):
                held = everyone[m][slot] if slot < len(everyone[m]) else None
                if held in everyone[other]:
                    place[m, k, fixed + slot] = fixed + everyone[other].index(held)
                else:
                    fresh[m, k, fixed + slot] = True
            if m < len(sets) and other < len(sets) and set(everyone[other]) < set(everyone[m]):
                hidden[m, k] = _hidden(everyone[other], everyone[m], fixed, levels, n)
        if _is_agile(sets, m):
            jump[m, fixed] = levels.size[sets[m][0]]
    jump[-2, :states] = levels.jump
    arrays = (source, rate, place, fresh, entering, jump, leaving, hidden)
    return Links(*(jnp.asarray(array) for array in arrays))


def _hidden(kept: Set, present: Set, fixed: int, levels: Levels, n: int) -> Float[np.ndarray, "n"]:
    """What a sensor's fault in `kept` has taken to itself of the effect of the one that is new: its
    state has moved, and the fault's estimate by as much the other way."""
    shift = np.zeros(n)
    for new in set(present) - set(kept):
        for k in kept:
            shift[: levels.hides.shape[2]] += levels.hides[new, k]
            shift[fixed + present.index(k)] = -levels.hides[new, k].sum()
    return shift


def _changes(
    sets: tuple[Set, ...], modes: int, levels: Levels
) -> tuple[list[list[tuple[int, float]]], Float[np.ndarray, "modes"]]:
    """(for every mode (source, rate [1/s]), itself first; the rate at which it is left)."""
    incoming: list[list[tuple[int, float]]] = [[(m, 0.0)] for m in range(modes)]
    leaving = np.zeros(modes)
    unknown = range(len(sets), modes)

    def link(source: int, target: int, rate: float) -> None:
        incoming[target].append((source, rate))
        leaving[source] += rate

    for m, present in enumerate(sets):
        if _is_agile(sets, m):
            link(0, m, CREEPING * float(levels.onset[present[0]]))
            link(sets.index(present), m, levels.recovery)
            link(m, sets.index(present), levels.settling)
            continue
        for gone in present:
            rest = sets.index(tuple(k for k in present if k != gone))
            link(rest, m, float(levels.onset[gone]))
            link(m, rest, levels.recovery)
        if len(present) == 2:
            link(0, m, COMMON * float(levels.onset[list(present)].min()))
        for u in unknown if len(present) < 2 else ():
            link(m, u, float(levels.unknown[u - len(sets)]))
            back = SWAPPED / max(len(levels.onset), 1) if present else 1.0
            link(u, m, levels.recovery * back)
    for u, v in permutations(unknown, 2):
        if levels.unknown[v - len(sets)] > 0:
            link(u, v, CHANGED * levels.recovery)
    return incoming, leaving
