"""What the posterior means: a status with its reason, an alarm, and the faults that are named.

An alarm begins where the log-odds of an active fault, ln (1 - p0) / p0 with p0 the probability that
there is none, reach the calibrated level, where the model is trusted and outside the hold-off, and
have done so for `persistence`; where they do by what is undeclared alone, once that has outlasted
the model's own error. It ends where the probability falls below `release`. A fault is
named while there is an alarm, its own probability has been 0.98 of that of any for `persistence`
and for a quarter of the time in which a large one shows at least, in all since it was below
`release`, and its sign is known: while one fault follows another, a third may fit for a while. A
passive fault is named without an alarm, where its probability is 0.98. Where a loop answers a fault
by a change of an input that no healthy log has, what the model lacks looks like a fault that acts
on the plant until that has settled, and none of these is named meanwhile.

Status and reason are numbers, which `words` looks up.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.envelope import bounds_of
from faultgauge.detection.posterior.inexact import acting
from faultgauge.detection.posterior.limit_checker import LimitChecker, LimitState
from faultgauge.detection.posterior.posterior import Marginal
from faultgauge.detection.rows.flat_line import is_standing, standing_still
from faultgauge.plants.signals import Fault, Signals, spoken

__all__ = [
    "EITHER",
    "FAULT",
    "HEALTHY",
    "NAMED",
    "NEARLY",
    "NOT_JUDGED",
    "OUTSIDE",
    "PLACES",
    "PLAIN",
    "QUIET",
    "STALE",
    "STATUS",
    "Heard",
    "Reason",
    "Rules",
    "RulesState",
    "Verdict",
    "is_sure",
    "is_unheard",
    "log_odds",
    "words",
]

STATUS = HEALTHY, FAULT, NOT_JUDGED, STALE = "HEALTHY", "FAULT", "NOT_JUDGED", "STALE"
QUIET = 0.5  # p of no fault above: nothing speaks of one
NAMED = 0.98  # p of a fault, where there is one, from which on it is named
FRESH = 10.0  # samples without any output after which the answer is stale
OUTSIDE = "outside of"  # what the plant file or training bounds
PLACES = 4096  # more than there are of anything that a reason may be about
EITHER = "cause undecided: "
NEARLY = "not certain for long enough to be named: "
TOO_SOON = ": too soon after a start or a gap, or not in these data"
TIE = 1e-9  # of p: of causes that are as likely as each other the first comes first
EDGE = 1e-6  # of an input's limits: that near it stands at one


class Reason(IntEnum):
    """Why a row has its status; its number goes with those of up to two things that it is about,
    reason + count (first + PLACES second)."""

    NONE = 0
    NOT_SAMPLED = 1
    STANDING = 2  # an output
    STALE = 3
    HELD = 4
    UNDECLARED = 5
    EITHER = 6  # two of [something undeclared, faults]
    OUTSIDE = 7  # what of the envelope
    PASSIVE = 8  # a fault, as in all that follow but the next
    UNDECIDED = 9
    SMALL = 10
    AT_LIMIT = 11
    NOT_EXCITED = 12
    NOT_YET = 13
    NONE_SHOWS = 14
    NEARLY = 15  # a fault


PLAIN = {
    Reason.NONE: "",
    Reason.NOT_SAMPLED: "not sampled",
    Reason.STALE: "no output was sampled for a while",
    Reason.HELD: "too soon after a start or a gap",
    Reason.UNDECLARED: "no declared fault explains it",
    Reason.UNDECIDED: "undecided whether there is a fault",
    Reason.NONE_SHOWS: f"no declared fault would show{TOO_SOON}",
}


class Verdict(NamedTuple):
    """Of every sample; `status` is a place in `STATUS`, `reason` a `Reason` with what it is about;
    `named` are the declared faults and, last, an undeclared one."""

    status: Int[Any, "*samples"]
    reason: Int[Any, "*samples"]
    alarm: Bool[Any, "*samples"]
    named: Bool[Any, "*samples causes"]


class Heard(NamedTuple):
    """What rules need of a row beside its marginals: whether it was `sampled` at all and is `held`
    back, what is `outside` and would be `seen`, which output is `standing` (0: none), the inputs
    as they act, whether any output was sampled, and how likely something undeclared is of itself,
    not as declared faults explain too little."""

    sampled: Bool[Array, ""]
    held: Bool[Array, ""]
    outside: Int[Array, ""]
    seen: Bool[Array, "faults two"]
    standing: Int[Array, ""]
    u: Float[Array, "inputs"]
    output: Bool[Array, ""]
    undeclared: Float[Array, ""]


class RulesState(NamedTuple):
    """`lasting`: since when there is any fault, declared or not, by the level;
    `fresh`: when an output was sampled last; `strange`: when each input last changed by more
    than healthy logs have it [s], and by how much (`jump`); `u`, the inputs of the last row."""

    alarm: LimitState
    lasting: LimitState
    names: LimitState
    signs: LimitState
    fresh: Float[Array, ""]
    strange: Float[Array, "inputs"]
    jump: Float[Array, "inputs"]
    u: Float[Array, "inputs"]


def log_odds(calm: Any) -> Any:
    """ln (1 - p0) / p0; -inf where nothing was sampled."""
    p0 = jnp.where(jnp.isfinite(calm), jnp.clip(calm, 1e-300, 1.0), 1.0)
    return jnp.log1p(-p0) - jnp.log(p0)


def is_sure(p: Any, calm: Any, passive: Any) -> Any:
    """Whether a fault of probability `p` is the cause, as far as a name asks for that: of an active
    one given that there is one, which an alarm has told; `calm` is the probability of none."""
    return p >= NAMED * jnp.where(passive, 1.0, 1 - calm)


class Rules(eqx.Module):
    """Pure `init` and `step`. `stale` [s] after the last sample of an output; `watched` are inputs
    that faults act on, whose limits are `low` and `high`, and which some change upwards or
    downwards only; `changes` of the inputs from row to row
    are no larger in healthy logs, and what they do is known once they have `settled` [s], which
    matters to the causes that are `acting` on the plant. A fault of that input itself that is as
    large as its change and opposite says that nothing of it came to the plant."""

    alarm: LimitChecker
    lasting: LimitChecker
    names: LimitChecker
    signs: LimitChecker
    level: Float[np.ndarray, ""]
    release: Float[np.ndarray, ""]
    stale: Float[np.ndarray, ""]
    low: Float[np.ndarray, "faults"]
    high: Float[np.ndarray, "faults"]
    changes: Float[np.ndarray, "inputs"]
    settled: Float[np.ndarray, "inputs"]
    acting: Bool[np.ndarray, "causes"]
    only_up: Bool[np.ndarray, "faults"]
    only_down: Bool[np.ndarray, "faults"]
    watched: tuple[int, ...] = eqx.field(static=True)
    monitors: tuple[str, ...] = eqx.field(static=True)
    gains: tuple[bool, ...] = eqx.field(static=True)

    @staticmethod
    def of(bank: FaultBank) -> "Rules":
        signals = bank.model.plant.signals
        rules = signals.detection
        wait = np.maximum(rules.persistence, bank.waits)
        low, high = np.array([_limits(signals, fault) for fault in signals.faults]).T
        return Rules(
            LimitChecker(np.asarray(float(rules.persistence)), rules.latch),
            LimitChecker(np.asarray(bank.outlasts), latch=False),
            LimitChecker(wait, rules.latch, on_end=False),
            LimitChecker(np.asarray(0.0), rules.latch),
            np.asarray(bank.level),
            np.asarray(float(rules.release)),
            np.asarray(FRESH * bank.step * min(bank.rows)),
            low,
            high,
            bank.changes * (1 + EDGE),
            bank.settled,
            np.append(acting(signals.faults) > 0, True),
            np.array([fault.min >= 0 for fault in signals.faults]),
            np.array([fault.max <= 0 for fault in signals.faults]),
            tuple(_watched(signals, fault) for fault in signals.faults),
            tuple(fault.monitor for fault in signals.faults),
            tuple(fault.enters == "gain" for fault in signals.faults),
        )

    def init(self) -> RulesState:
        causes = len(self.monitors) + 1
        two = self.names.init(causes), self.signs.init(causes)
        none = jnp.full(len(self.changes), jnp.nan)
        own = self.alarm.init(), self.lasting.init(), *two
        return RulesState(*own, jnp.asarray(jnp.nan), none, none, none)

    def step(
        self, state: RulesState, t: Float[Array, ""], found: Marginal, heard: Heard
    ) -> tuple[RulesState, Verdict]:
        """The verdict on the row at `t` [s]."""
        free, inside = heard.sampled & ~heard.held, heard.outside == 0
        over, gone = log_odds(found.calm) >= self.level, free & (1 - found.calm < self.release)
        lasts, lasting = self.lasting.step(state.lasting, t, free & inside & over, gone)
        declared = log_odds(found.calm + heard.undeclared) >= self.level
        over = free & inside & over & (declared | lasting)
        alarms, alarm = self.alarm.step(state.alarm, t, over, gone)
        # behind a gap an input is elsewhere, and that is no change from row to row
        moved = heard.u - state.u
        large = ~heard.held & (jnp.abs(moved) > self.changes)
        strange = jnp.where(large, t, state.strange)
        jump = jnp.where(large, moved, state.jump)
        known = self._known(t - strange < self.settled, jump, found)
        known = known & jnp.append(jnp.ones(len(self.monitors), bool), lasting)
        names, signs, named = self._named(state, t, found, alarm, free, inside, known)
        first = jnp.isnan(state.fresh)
        fresh = jnp.where(heard.output | first, t, state.fresh)
        status, reason = self._answer(found, heard, alarm, named, t - fresh)
        u = jnp.where(jnp.isfinite(heard.u), heard.u, state.u)
        after = RulesState(alarms, lasts, names, signs, fresh, strange, jump, u)
        return after, Verdict(status, reason, alarm, named)

    def _known(
        self, late: Bool[Array, "inputs"], jump: Float[Array, "inputs"], found: Marginal
    ) -> Bool[Array, "causes"]:
        """The causes to which what inputs did of `late`, by a `jump`, does not matter."""
        own = np.array(self.watched)[:, None] == np.arange(len(self.changes))
        low, high = found.lo[:, None] - self.changes, found.hi[:, None] + self.changes
        never = own & (-jump >= low) & (-jump <= high)
        matters = jnp.append(jnp.any(late & ~never, axis=1), jnp.any(late))
        return jnp.logical_not(self.acting & matters)

    def _named(
        self,
        state: RulesState,
        t: Array,
        found: Marginal,
        alarm: Array,
        free: Array,
        inside: Array,
        known: Bool[Array, "causes"],
    ) -> tuple[LimitState, LimitState, Bool[Array, "causes"]]:
        passive = np.array([*(each == "passive" for each in self.monitors), False])
        p = jnp.append(found.p, found.unknown)
        alone = inside & (log_odds(found.healthy) >= self.level)
        sure = is_sure(p, found.calm, passive)
        over = free & jnp.where(passive, alone, alarm) & known & sure
        gone = free & ((p < self.release) | (~alarm & ~passive))
        names, likely = self.names.step(state.names, t, over, gone)
        signed = jnp.append(~((found.lo < 0) & (found.hi > 0)), True)
        signs, named = self.signs.step(state.signs, t, likely & signed, ~likely)
        return names, signs, named

    def _answer(
        self, found: Marginal, heard: Heard, alarm: Array, named: Array, age: Array
    ) -> tuple[Int[Array, ""], Int[Array, ""]]:
        shown, on = jnp.any(heard.seen, axis=1), [k != "disabled" for k in self.monitors]
        clear, blind = jnp.any(shown & np.array(on)), jnp.any(~shown & np.array(on))
        unseen = self._unseen(heard, ~shown & np.array(on))
        none_shows = _reason(Reason.NONE_SHOWS) if sum(on) > 1 else unseen
        quiet = found.healthy > QUIET
        nothing = _reason(Reason.NONE)
        cases = (
            (~heard.sampled, NOT_JUDGED, _reason(Reason.NOT_SAMPLED)),
            (
                (heard.standing > 0) & ((age > 0) | ~alarm),
                NOT_JUDGED,
                _reason(Reason.STANDING, heard.standing - 1),
            ),
            (age > self.stale, STALE, _reason(Reason.STALE)),
            (heard.held, NOT_JUDGED, _reason(Reason.HELD)),
            (alarm, FAULT, self._cause(found, named)),
            (heard.outside > 0, NOT_JUDGED, _reason(Reason.OUTSIDE, heard.outside - 1)),
            (~quiet, NOT_JUDGED, self._small(found)),
            (~clear, NOT_JUDGED, none_shows),
        )
        status = jnp.asarray(STATUS.index(HEALTHY))
        reason = jnp.where(blind, unseen, nothing)
        for here, what, why in reversed(cases):
            status = jnp.where(here, STATUS.index(what), status)
            reason = jnp.where(here, why, reason)
        return status, reason

    def _cause(self, found: Marginal, named: Array) -> Int[Array, ""]:
        shares = jnp.append(found.unknown, jnp.nan_to_num(found.p))
        shares = shares - TIE * np.arange(len(self.monitors) + 1)
        first = jnp.argmax(shares)
        second = jnp.argmax(jnp.where(jnp.arange(len(shares)) == first, -1.0, shares))
        # what no other cause comes near lacks no rival, but time
        alone = (first > 0) & (shares[second] < (1 - NAMED) * (1 - found.calm))
        nearly = _reason(Reason.NEARLY, first - 1)
        either = jnp.where(alone, nearly, _reason(Reason.EITHER, first, second))
        told = jnp.where(jnp.any(named[:-1]), _reason(Reason.NONE), either)
        return jnp.where(found.unknown >= QUIET, _reason(Reason.UNDECLARED), told)

    def _small(self, found: Marginal) -> Int[Array, ""]:
        """Why what is there raises no alarm."""
        likely = jnp.argmax(jnp.nan_to_num(found.p))
        passive = jnp.array([each == "passive" for each in self.monitors])[likely]
        told = jnp.where(passive, _reason(Reason.PASSIVE, likely), _reason(Reason.SMALL, likely))
        unnamed = _reason(Reason.UNDECIDED)
        unnamed = jnp.where(found.unknown >= QUIET, _reason(Reason.UNDECLARED), unnamed)
        return jnp.where(found.calm > QUIET, told, unnamed)

    def _unseen(self, heard: Heard, hidden: Array) -> Int[Array, ""]:
        """Why a fault would not show."""
        fault = jnp.argmax(hidden)
        u = jnp.append(heard.u, jnp.nan)[np.array(self.watched)]
        # a limit hides what pushes beyond it, and nothing that pulls away from it
        edge = (((u <= self.low) & self.only_down) | ((u >= self.high) & self.only_up))[fault]
        told = jnp.where(
            jnp.array(self.gains)[fault],
            _reason(Reason.NOT_EXCITED, fault),
            _reason(Reason.NOT_YET, fault),
        )
        return jnp.where(edge, _reason(Reason.AT_LIMIT, fault), told)


def _reason(
    which: Reason, first: Int[Array, ""] | int = 0, second: Int[Array, ""] | int = 0
) -> Int[Array, ""]:
    return jnp.asarray(which + len(Reason) * (first + PLACES * second), int)


def _watched(signals: Signals, fault: Fault) -> int:
    """The input that `fault` is a bias of; the place behind all inputs where it is none."""
    if fault.enters != "input":
        return len(signals.inputs)
    return signals.input_names.index(fault.target)


def _limits(signals: Signals, fault: Fault) -> tuple[float, float]:
    """Where the input that `fault` is a bias of stands at a limit."""
    if fault.enters != "input":
        return -np.inf, np.inf
    target = signals.inputs[signals.input_names.index(fault.target)]
    room = EDGE * max((abs(e) for e in (target.min, target.max) if np.isfinite(e)), default=0.0)
    return target.min + room, target.max - room


def words(
    signals: Signals,
    regions: Sequence[str],
    status: Int[np.ndarray, "samples"],
    reason: Int[np.ndarray, "samples"],
) -> tuple[list[str], list[str]]:
    """(status, reason) of every sample in words; `regions` are what networks were trained on."""
    said = {code: _said(signals, regions, code) for code in np.unique(reason).tolist()}
    return [STATUS[k] for k in status.tolist()], [said[code] for code in reason.tolist()]


def is_unheard(reason: str) -> bool:
    """Whether a row's `reason` is that nothing of it was measured."""
    return reason in (PLAIN[Reason.NOT_SAMPLED], PLAIN[Reason.STALE]) or is_standing(reason)


def _said(signals: Signals, regions: Sequence[str], code: int) -> str:
    places, why = divmod(code, len(Reason))
    second, first = divmod(places, PLACES)
    causes: Sequence[str] = ("something undeclared", *signals.fault_names)
    match Reason(why):
        case Reason.STANDING:
            return standing_still(signals.output_names[first])
        case Reason.EITHER:
            return f"{EITHER}{causes[first]} or {causes[second]}"
        case Reason.NEARLY:
            return f"{NEARLY}{signals.fault_names[first]}"
        case Reason.OUTSIDE:
            if first < len(regions):
                return f"{OUTSIDE} what training covered of {regions[first]}"
            left = bounds_of(signals)[first - len(regions)]
            reach = f"{left.low:g} to {left.high:g} {spoken(left.unit)}".rstrip()
            return f"{left.name} is {OUTSIDE} its trusted range, {reach}"
        case Reason.PASSIVE:
            return f"{signals.fault_names[first]}, which is passive"
        case Reason.SMALL:
            name = signals.fault_names[first]
            return f"{name} is possible, but not certain enough for an alarm"
        case Reason.AT_LIMIT | Reason.NOT_EXCITED | Reason.NOT_YET as unseen:
            return _unseen(signals.faults[first], unseen)
        case plain:
            return PLAIN[plain]


def _unseen(fault: Fault, why: Reason) -> str:
    match why:
        case Reason.AT_LIMIT:
            return f"{fault.name} would not show: {fault.target} is at its limit"
        case Reason.NOT_EXCITED:
            return f"{fault.name} would not show: {fault.target} does not excite it"
        case _:
            return f"{fault.name} would not show{TOO_SOON}"
