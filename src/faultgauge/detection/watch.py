"""The one walk along a log: a row in, everything that is said of it out.

A file is walked at once and a stream row by row, by the same compiled step, so that both say the
same to the bit. What needs doing once (noise, priors, regions, limits) is in the `Watch`; what goes
on from row to row is in its state: arrays of fixed shapes and nothing else, which may be kept as
bytes and gone on from at any row.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.bank import AGES, FaultBank, build_fault_bank
from faultgauge.detection.bank.envelope import Envelope
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.bank.start import Start
from faultgauge.detection.posterior.alike import Alike
from faultgauge.detection.posterior.consistency import Consistency, ConsistencyState
from faultgauge.detection.posterior.inexact import Inexact
from faultgauge.detection.posterior.mimicked import Mimicked
from faultgauge.detection.posterior.posterior import Mixture, Posterior
from faultgauge.detection.posterior.verdicts import (
    NOT_JUDGED,
    STATUS,
    Heard,
    Rules,
    RulesState,
    Verdict,
)
from faultgauge.detection.posterior.verdicts import words as in_words
from faultgauge.detection.rows.intake import Intake, IntakeState, Taken
from faultgauge.detection.rows.judged import samples_to_start
from faultgauge.detection.rows.prepared import Prepared
from faultgauge.identification.validation.evaluation import WARMUP
from faultgauge.observers.branches import BranchInfo, BranchState
from faultgauge.observers.branching import Branching
from faultgauge.observers.follow import follow
from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Signals
from faultgauge.programs import program
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING

__all__ = ["Row", "Watch", "WatchState"]

SHOWS = 40.0  # twice the log-odds that outweigh its prior: information of a fault that shows


class WatchState(NamedTuple):
    """A checkpoint. `running`: the row before belongs to a stretch, which `begun` [s] `rows` ago
    (that row included); `last` [s] is the latest row of any stretch."""

    intake: IntakeState
    bank: BranchState
    fits: ConsistencyState
    rules: RulesState
    running: Bool[Array, ""]
    begun: Float[Array, ""]
    rows: Int[Array, ""]
    last: Float[Array, ""]


class Row(NamedTuple):
    """What is said of a row (or of many): the posterior and the verdict on it, the probability of
    every set of faults and, last, of the unknown; the same were the model's answers as far off as
    in healthy logs, by which `rivals` are told; that of noise far beyond the usual in each of the
    measured outputs (`noisy`); how badly the likeliest explanation fits lately (`nis`); and what of
    the row was believed."""

    posterior: Posterior
    verdict: Verdict
    sets: Float[Any, "*samples sets"]
    rivals: Float[Any, "*samples sets"]
    noisy: Float[Any, "*samples measured"]
    nis: Float[Any, "*samples windows"]
    taken: Taken


class Watch(eqx.Module):
    """Watches a plant with a calibrated model; pure `init` and `step`, which may be compiled,
    batched over units (`jax.vmap`) and gone on with from a state that was kept
    (`equinox.tree_serialise_leaves`).

        watch = Watch(model, ["u", "x"], step=0.1)
        state = watch.init()
        state, row = watch.step(state, t, u, y)
        watch.words(row.verdict)

    **Arguments**

    - `model`: a calibrated model.
    - `columns`: of the telemetry to come: inputs and outputs of the plant.
    - `step`: a row comes so often [s].
    - `bank`: that of the model, where it is there already.

    Raises `InputError` where the model is not calibrated, declares no fault, or lacks all its
    outputs. In the methods, `state` is the checkpoint before, none of which is changed.
    """

    intake: Intake
    modes: Branching
    start: Start
    inexact: Inexact
    mimicked: Mimicked
    alike: Alike
    consistency: Consistency
    mixture: Mixture
    envelope: Envelope
    rules: Rules
    used: Bool[np.ndarray, "outputs"]
    hold_off: Float[np.ndarray, ""]
    step_s: Float[np.ndarray, ""]
    signals: Signals = eqx.field(static=True)
    settling: int = eqx.field(static=True)

    def __init__(
        self,
        model: Model,
        columns: Sequence[str],
        step: float,
        *,
        bank: FaultBank | None = None,
    ) -> None:
        if bank is None:
            t = step * np.arange(2)
            stub = Run("watch", "Watch", t, {name: np.zeros(2) for name in columns}, step)
            bank = build_fault_bank(model, [stub], noise_of(model))
        self.signals = signals = bank.model.plant.signals
        slow = [n for n, rows in zip(bank.outputs, bank.rows, strict=True) if rows > 1]
        self.intake = Intake.of(model, step, slow)
        self.modes, self.start = bank.modes, Start.of(bank)
        self.inexact, self.mimicked = Inexact.of(bank), Mimicked.of(bank)
        self.alike = Alike.of(signals.faults, bank.sets, bank.alike)
        self.consistency = Consistency.of(bank)
        self.mixture, self.rules = Mixture.of(bank), Rules.of(bank)
        self.envelope = Envelope.of(model, bank.regions)
        self.used = np.array([n in bank.outputs for n in signals.output_names], bool)
        self.hold_off, self.step_s = np.asarray(bank.hold_off), np.asarray(step)
        needed = samples_to_start(model, columns)
        self.settling = needed if needed == WARMUP else 0

    @property
    def plant(self) -> Plant:
        """The plant that healthy data were judged by, without what it may be off by."""
        disturbed = self.modes.filter.plant
        assert isinstance(disturbed, Disturbed)
        return disturbed.base

    def init(self, *, averaged: bool = False) -> WatchState:
        """Before the first row; `averaged`: inputs are means over the rows' intervals, as in a log
        that was brought to a lower rate."""
        return _first(self, averaged)

    def step(
        self,
        state: WatchState,
        t: Float[Array, ""],
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
    ) -> tuple[WatchState, Row]:
        """One row at `t` [s]: inputs as commanded and outputs as measured, in the plant's order and
        units; NaN where not sampled."""
        intake, taken = self.intake.step(state.intake, t, u, y)
        y = jnp.where(self.used, taken.y, jnp.nan)
        output = jnp.any(jnp.isfinite(y))
        usable = jnp.all(jnp.isfinite(taken.u))
        late = t - state.last > (GAP_STEPS + ROUNDING) * intake.step
        follows = usable & state.running & ~late
        begins = usable & ~follows & output
        running = follows | begins
        gap = jnp.where(jnp.isnan(state.last), 0.0, t - state.last)

        def go(bank: BranchState) -> tuple[BranchState, BranchInfo]:
            new = self.start.anew(self.modes, bank, gap, taken.u, y)
            bank = jax.tree.map(lambda a, b: jnp.where(begins, a, b), new, bank)
            return self.modes.step(bank, taken.u, y, jnp.where(begins, 0.0, gap))

        def stay(bank: BranchState) -> tuple[BranchState, BranchInfo]:
            return bank, self._nothing()

        bank, said = jax.lax.cond(running, go, stay, state.bank)
        said = self.mimicked.told(self.inexact.told(said))
        said = self.alike.told(self.inexact.unsure(said))
        since = jnp.where(begins | ~running, 0.0, gap)
        fits, told = self.consistency.step(state.fits, since, said)
        begun, rows = jnp.where(begins, t, state.begun), jnp.where(begins, 0, state.rows)
        held = running & ((t - begun < self.hold_off) | (rows < self.settling))
        heard = Heard(
            running,
            held,
            self._outside(said, taken.u, running),
            said.seen >= SHOWS,
            taken.standing,
            taken.u,
            output,
            said.p[-1],
        )
        found = self.mixture.marginal(told, heard.seen)
        rules, verdict = self.rules.step(state.rules, t, found, heard)
        left = (heard.outside > 0) & (verdict.status == STATUS.index(NOT_JUDGED))
        found = self.mixture.untrusted(found, left)
        posterior = Posterior(
            *(found.p, found.f, found.lo, found.hi, found.healthy, found.unknown, found.calm),
            *(found.sd, heard.seen, heard.outside, said.x, said.onset, said.ever, held),
        )
        last = jnp.where(running, t, state.last)
        after = WatchState(intake, bank, fits, rules, running, begun, rows + 1, last)
        rivals, noisy = self.inexact.rivals(said), said.alien[len(AGES) :]
        return after, Row(posterior, verdict, told.p, rivals, noisy, said.nis, taken)

    def commanded(self, state: WatchState, u: Float[Array, "inputs"]) -> WatchState:
        """The state when `u` acts from the last row on in place of what that row said: in a loop
        the command is known only after the row is. Inputs with a dead time have no such row."""
        return state._replace(bank=state.bank._replace(u=u))

    def _nothing(self) -> BranchInfo:
        """What the bank says of a row that is in no stretch."""
        sets, faults = len(self.modes.more), self.modes.declared
        states = len(self.modes.filter.plant.signals.states)
        each, of_sets, both = (faults,), (sets, faults), (faults, 2)
        shapes = (
            (sets,),
            of_sets,
            of_sets,
            (states,),
            both,
            both,
            each,
            each,
            of_sets,
            of_sets,
            of_sets,
            each,
            (len(self.modes.ages),),
            (len(self.modes.windows),),
            (),
        )
        return BranchInfo(*(jnp.full(shape, jnp.nan) for shape in shapes))

    def _outside(self, said: BranchInfo, u: Array, running: Array) -> Int[Array, ""]:
        x = said.x[: len(self.signals.states)]
        return jnp.where(running, self.envelope.outside(x, u, said.p, said.f), 1)

    def along(self, state: WatchState, rows: Prepared) -> tuple[WatchState, Row]:
        """The next `rows` of telemetry, however many; what they come in does not change a bit of
        what is said of them. NumPy arrays."""
        return follow(self, state, (rows.run.t, rows.u, rows.y))

    def words(self, verdict: Verdict) -> tuple[list[str], list[str]]:
        """(status, reason) of every row of a `verdict`, in words."""
        names = [region.covered for region in self.envelope.regions]
        status, reason = (np.atleast_1d(each) for each in verdict[:2])
        return in_words(self.signals, names, status, reason)


@program
def _first(watch: Watch, averaged: bool) -> WatchState:
    """The state before the first row."""
    nothing = jnp.asarray(jnp.nan)
    return WatchState(
        watch.intake.init(watch.step_s, averaged),
        watch.start.init(watch.modes),
        watch.consistency.init(),
        watch.rules.init(),
        jnp.asarray(False),
        nothing,
        jnp.asarray(0),
        nothing,
    )
