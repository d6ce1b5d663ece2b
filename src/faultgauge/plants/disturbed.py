"""A plant that is not its model: F is followed by a discrepancy, and constants are uncertain.

    x' = F(x, u; theta + offset + W xi) + F_ae + E d + G q,    d' = -d / tau + w,

    xi' = -fading xi + w,

    q' = -(1 / gripping + (1 - G) |x| / travel) q + w,    G = 1 / (1 + (x / slip)^2) of the

    states that stick,

    F_ae = F(x, u + a + e + v; theta + offset) - F(x, u; theta + offset),

    a' = -a / straying + w,    v' = -v / leaning,    and by lean du where u changes

    e = share r h,    r' = -r / settling + w,    h' = -h / settling,    and by du where u changes

    y = h(x', x, u; ...) + h_ae + b + l + g + z,    b' = -b / wandering + w,    z' = 0,

    l' = -l / lag,    and by N(0, (late (h(x', x, u) - h(x', x, u before)))^2) where u changes

    g' = -g / trail - dh/dt,    and by -dh where u changes

F and h read    u + 4 bend (high - low) s (1 - s),    s = (u - low) / (high - low),

and w and l are `doubt` times as large while an input, or a state, is where the model errs more
than elsewhere.

d is a Gauss-Markov process beside every state that is not exact kinematics (Kennedy and O'Hagan, J.
R. Statist. Soc. B 63 (2001), "Bayesian calibration of computer models": what the model lacks is a
process of its own); with infinite tau it is a random walk. e is what an input's change does
besides, wherever the input acts: a random share r, of unit variance, of h, by which the input is
off where it was lately. So what the model does not have is borne for as long as `settling`, and no
loop that answers d by u makes d look like an effect of u; an input that trembles, as a loop passes
on the noise of its sensor, comes to nothing, however often it is sampled. v is by what an input
comes late, where healthy logs show that it does: a lag of the first order that the model lacks is a
`lean` of -1. a is by what an input strays from what is commanded, where healthy logs show that it
does: a supply that gives way, a pump's curve. b is what an output's own equation lacks, where they
show that it lacks something: noise of a sensor that remembers, a gust in what an accelerometer
feels; l is what an input's change does to an output besides: a flow that follows its command within
seconds. g is by what a sensor trails what it measures, where healthy logs show that it does: a lag
of the first order behind the plant, h + g = s with s' = (h - s) / trail. z is by what an output's
zero is off in a run, where healthy runs show that it is. `bend` is by
how much of its range an input's curve is off a straight line in the middle, where healthy logs show
that it is: a valve's, a pump's. q is what holds a state where it comes to rest, and lets go as it
moves, where healthy logs show that something does: friction that sticks, of which a smooth curve
through zero has nothing, is any force up to that which breaks loose, and one of one size everywhere
would have to be as large as that (C. Canudas de Wit et al., IEEE TAC 40 (1995), on what a bristle
model has there). xi are the directions in
which the constants are uncertain, of unit variance, fading where a constant differs within a run,
too; one that is `positive` and hardly known goes
down by s to c^2 / (c + s), as a normal distribution would have negative stiffness, and time
constants near 0, as well.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.plants.expression import derivatives_used, is_state, names_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, ValueChange, applied, respond
from faultgauge.plants.reached import Bent, Held, Reached, Strayed
from faultgauge.plants.signals import Fault, Signals, State
from faultgauge.products import contract, taken

__all__ = [
    "Disturbed",
    "Error",
    "answering_outputs",
    "deriving_outputs",
    "dynamic_states",
    "following_inputs",
    "shared_inputs",
]


class Error(NamedTuple):
    """Time constant `tau` [s] of every driven state's d; of every e its time constant `settling`
    [s] and its `share` of an input's change (a standard deviation); time constant
    `wandering` [s] of every b; of every l its time constant `lag` [s] and its share, `late`;
    time constant `straying` [s] of every a; what acts at random is `doubt` times as large where an
    input or a state lies between `above` and `below`; of every v its time constant `leaning` [s]
    and its share, `lean`; time constant `trail` [s] of every g; the `bend` of an input's curve
    between `low` and `high`; time constant `gripping` [s] of every q and within which of its state
    it acts (`slip`, where half is left), and on which `travel` [the state's unit times s] it
    becomes another; by how much an input may have changed just `before` a log (none: not at all);
    by which rate every xi is `fading` [1/s] (none: not at all)."""

    tau: Float[Array, "driven"]
    settling: Float[Array, "following"]
    share: Float[Array, "following"]
    wandering: Float[Array | np.ndarray, "wandering"] = np.zeros(0)
    lag: Float[Array | np.ndarray, "lagging"] = np.zeros(0)
    late: Float[Array | np.ndarray, "lagging"] = np.zeros(0)
    straying: Float[Array | np.ndarray, "straying"] = np.zeros(0)
    doubt: Float[Array | np.ndarray, "doubted"] = np.zeros(0)
    above: Float[Array | np.ndarray, "doubted"] = np.zeros(0)
    below: Float[Array | np.ndarray, "doubted"] = np.zeros(0)
    leaning: Float[Array | np.ndarray, "leaning"] = np.zeros(0)
    lean: Float[Array | np.ndarray, "leaning"] = np.zeros(0)
    trail: Float[Array | np.ndarray, "trailing"] = np.zeros(0)
    bend: Float[Array | np.ndarray, "bending"] = np.zeros(0)
    low: Float[Array | np.ndarray, "bending"] = np.zeros(0)
    high: Float[Array | np.ndarray, "bending"] = np.zeros(0)
    gripping: Float[Array | np.ndarray, "sticking"] = np.zeros(0)
    slip: Float[Array | np.ndarray, "sticking"] = np.zeros(0)
    travel: Float[Array | np.ndarray, "sticking"] = np.zeros(0)
    before: Float[Array | np.ndarray, "some"] = np.zeros(0)
    fading: Float[Array | np.ndarray, "some"] = np.zeros(0)


class Parts(NamedTuple):
    """Where x, d, r, b, l, a, v, g, z, q, h and xi stand among the states."""

    x: slice
    d: slice
    r: slice
    b: slice
    lag: slice
    a: slice
    v: slice
    g: slice
    z: slice
    q: slice
    h: slice
    xi: slice


class Disturbed(Plant):
    """`base` with the states [x, d, r, b, l, a, v, g, z, q, h, xi]; `driven` are the states that d
    acts on, `following` the inputs that e acts on, `wandering` the outputs that b acts on,
    `lagging` those that l acts on, `straying` the inputs that a acts on, `leaning` those that v
    acts on, `trailing` the outputs that g acts on, which read no derivative, `zeroed` the outputs
    that z acts on, `bending` the inputs whose curve is bent, `sticking` the states that q acts on,
    `doubted` the inputs, and behind them the states, for which the model is to be doubted
    somewhere, `names` the parameters, of
    which `directions` (W) is a row each, `positive` the places of those that are, and are so
    uncertain that it matters."""

    signals: Signals = eqx.field(static=True)
    base: Plant
    error: Error
    offset: Float[Array, "parameters"]
    directions: Float[Array, "parameters directions"]
    driven: tuple[int, ...] = eqx.field(static=True)
    following: tuple[int, ...] = eqx.field(static=True)
    wandering: tuple[int, ...] = eqx.field(static=True)
    lagging: tuple[int, ...] = eqx.field(static=True)
    straying: tuple[int, ...] = eqx.field(static=True)
    leaning: tuple[int, ...] = eqx.field(static=True)
    trailing: tuple[int, ...] = eqx.field(static=True)
    zeroed: tuple[int, ...] = eqx.field(static=True)
    bending: tuple[int, ...] = eqx.field(static=True)
    sticking: tuple[int, ...] = eqx.field(static=True)
    positive: tuple[int, ...] = eqx.field(static=True)
    doubted: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    @staticmethod
    def of(
        base: Plant,
        driven: tuple[int, ...],
        following: tuple[int, ...],
        error: Error,
        names: tuple[str, ...],
        offset: Float[Array, "parameters"],
        directions: Float[Array, "parameters directions"],
        undeclared: tuple[Fault, ...] = (),
        wandering: tuple[int, ...] = (),
        lagging: tuple[int, ...] = (),
        straying: tuple[int, ...] = (),
        doubted: tuple[int, ...] = (),
        leaning: tuple[int, ...] = (),
        trailing: tuple[int, ...] = (),
        zeroed: tuple[int, ...] = (),
        bending: tuple[int, ...] = (),
        sticking: tuple[int, ...] = (),
        positive: tuple[int, ...] = (),
    ) -> "Disturbed":
        """`undeclared` faults stand behind those that `base` declares."""
        signals = base.signals
        more = [State(f"d({signals.state_names[i]})") for i in driven]
        more += [State(f"r({signals.input_names[i]})") for i in following]
        more += [State(f"b({signals.output_names[j]})") for j in wandering]
        more += [State(f"l({signals.output_names[j]})") for j in lagging]
        more += [State(f"a({signals.input_names[j]})") for j in straying]
        more += [State(f"v({signals.input_names[j]})") for j in leaning]
        more += [State(f"g({signals.output_names[j]})") for j in trailing]
        more += [State(f"z({signals.output_names[j]})") for j in zeroed]
        more += [State(f"q({signals.state_names[i]})") for i in sticking]
        more += [State(f"h({signals.input_names[i]})") for i in following]
        more += [State(f"xi({k})") for k in range(directions.shape[1])]
        own = replace(
            signals,
            states=(*signals.states, *more),
            faults=(*signals.faults, *undeclared),
        )
        beside = (wandering, lagging, straying, leaning, trailing, zeroed)
        acting = (driven, following, *beside, bending, sticking, positive, doubted, names)
        return Disturbed(own, base, error, offset, directions, *acting)

    @property
    def count(self) -> int:
        """How many states `base` has."""
        return len(self.base.signals.states)

    @property
    def parts(self) -> Parts:
        """Where x, d, r, b, l, a, v, g, z, q, h and xi stand among the states."""
        beside = (self.wandering, self.lagging, self.straying, self.leaning, self.trailing)
        acting = (self.driven, self.following, *beside, self.zeroed, self.sticking, self.following)
        counts = [self.count, *map(len, acting), self.directions.shape[1]]
        return Parts(*(slice(*each) for each in pairwise([0, *np.cumsum(counts).tolist()])))

    @property
    def stirring(self) -> Int[np.ndarray, "some"]:
        """The places of what the own states of `base` follow: of all but b, l, g and z, which act
        on outputs alone, and of h, where inputs were lately, which is known whatever comes."""
        parts = self.parts
        acting = parts.x, parts.d, parts.r, parts.a, parts.v, parts.q, parts.xi
        return _places(acting)

    @property
    def shown(self) -> Int[np.ndarray, "some"]:
        """The places of what outputs depend on by h: x; xi, where they are more than states; r, a
        and v where they read an input; all that stirs where they read a derivative."""
        parts, base = self.parts, self.base
        if deriving_outputs(base):
            return self.stirring
        inputs = (parts.r, parts.a, parts.v) if answering_outputs(base) else ()
        constants = () if _shows_states(base) else (parts.xi,)
        return _places((parts.x, *inputs, *constants))

    @property
    def added(self) -> Float[np.ndarray, "outputs states"]:
        """What is added to the outputs by a unit of each state: of b, l, g and z."""
        parts, unit = self.parts, np.zeros((len(self.signals.outputs), len(self.signals.states)))
        for part, on in (
            (parts.b, self.wandering),
            (parts.lag, self.lagging),
            (parts.g, self.trailing),
            (parts.z, self.zeroed),
        ):
            unit[list(on), range(part.start, part.stop)] = 1.0
        return unit

    @property
    def times(self) -> Float[Array, "others"]:
        """How long [s] d, r, b, l, a, v, g, z, q, h and xi last."""
        error = self.error
        beside = (error.wandering, error.lag, error.straying, error.leaning, error.trail)
        zero = jnp.full(len(self.zeroed), jnp.inf)
        lasting = (error.tau, error.settling, *beside, zero, error.gripping, error.settling)
        fading = error.fading if len(error.fading) else np.zeros(self.directions.shape[1])
        return jnp.concatenate([*lasting, 1 / jnp.asarray(fading)])

    @property
    def lately(self) -> Float[Array, "states"]:
        """What the states are besides where a log begins: an input may just have changed."""
        none = jnp.zeros(len(self.signals.states))
        return none.at[self.parts.h].set(self.error.before) if len(self.error.before) else none

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self.moved(x, u, np.zeros(len(x)))

    @property
    def chained(self) -> bool:
        return self.base.chained

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        own = x[self.parts.x]
        slow = self._slow(x, jnp.zeros(1))[0]
        dx = self._told(x).moved(own, u, slow + beside[self.parts.x])
        dx = dx + self._astray(x, lambda plant: plant.derivative(own, u))
        rest = -x[self.count :] * self._fading(jnp.abs(own))
        if self.trailing:
            _, moves = jax.jvp(lambda own: self._shown(self._told(x), own, u), (own,), (dx,))
            g = self.parts.g
            rest = rest.at[g.start - self.count : g.stop - self.count].add(-moves)
        return jnp.concatenate([dx, rest + beside[self.count :]])

    def lasting(
        self,
        dt: Float[Array, ""],
        x_before: Float[Array, "_"],
        x: Float[Array, "_"],
    ) -> Float[Array, "others"]:
        """Which share of d, r, b, l, a, v, g, z, q, h and xi is left after `dt` [s] on the way
        from `x_before` to `x`."""
        return jnp.exp(-dt * self._fading(self._moves(x_before, x)))

    def _moves(self, x_before: Float[Array, "_"], x: Float[Array, "_"]) -> Float[Array, "own"]:
        """How large the own states are in the mean between the two."""
        return (jnp.abs(x_before[: self.count]) + jnp.abs(x[: self.count])) / 2

    def _fading(self, moves: Float[Array, "own"]) -> Float[Array, "others"]:
        """By which rates [1/s] d, r, b, l, a, v, g, z, q, h and xi fade where the own states are so
        large: what sticks is another once its state has gone on."""
        rates = 1 / self.times
        if not self.sticking:
            return rates
        q = self.parts.q
        x = taken(moves, np.array(self.sticking))
        m = (x / self.error.slip) ** 2
        gone = x * m / (1 + m) / self.error.travel
        return rates.at[q.start - self.count : q.stop - self.count].add(gone)

    def meanwhile(self, dt: Float[Array, ""]) -> Float[Array, "states"]:
        """Which share of it each state is in the mean of `dt` [s]: d, and what inputs err by."""
        share = jnp.ones(len(self.signals.states))
        for part, lasting in (
            (self.parts.d, self.error.tau),
            (self.parts.h, self.error.settling / 2),  # r fades as h does
            (self.parts.a, self.error.straying),
            (self.parts.v, self.error.leaning),
        ):
            share = share.at[part].set(_mean_left(dt / lasting))
        return share

    def trails(
        self,
        plant: Plant,
        x: Float[Array, "states"],
        after: Float[Array, "own"],
        stages: Float[Array, "stages inputs"],
        u: Float[Array, "inputs"],
        f: Float[Array, "faults"],
        dt: Float[Array, ""],
    ) -> Float[Array, "trailing"]:
        """By how much g moves besides fading while `plant`, that of `own_at`, goes evenly from `x`
        to `after` in `dt` [s], under inputs that go through `stages` and then are `u`."""
        left, own = _mean_left(dt / self.error.trail), x[self.parts.x]
        if not self._answering:  # what reads states alone does not jump
            middle = stages[len(stages) // 2]
            return (self._shown(plant, own, middle) - self._shown(plant, after, middle)) * left
        later = jnp.concatenate([after, self.lasting(dt, x, after) * x[self.count :]])
        jumped = later + self.leans(stages[0], u, f, f)
        begin = self._shown_astray(plant, x, stages[0], f)
        end = self._shown_astray(plant, later, stages[-1], f)
        return (begin - end) * left + end - self._shown_astray(plant, jumped, u, f)

    def shows_late(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        f_before: Float[Array, "faults"],
        f: Float[Array, "faults"],
    ) -> Float[Array, "states"]:
        """By how much g jumps where faults change that act on the plant."""
        none = jnp.zeros(len(x))
        if not self._answering:
            return none
        plant, acting = self.own_at(x), np.array([float(k.acts) for k in self.signals.faults])
        before, now = (self._shown_astray(plant, x, u, each * acting) for each in (f_before, f))
        return none.at[self.parts.g].set(before - now)

    @property
    def _answering(self) -> bool:
        """Whether an output that trails reads an input."""
        return bool({*self.trailing} & {*answering_outputs(self.base)})

    def _shown_astray(
        self,
        plant: Plant,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        f: Float[Array, "faults"],
    ) -> Float[Array, "trailing"]:
        """What `plant` shows in the outputs that trail under inputs that stray as in `x`."""

        def shown(plant: Plant) -> Float[Array, "trailing"]:
            y = respond(Reached(self._own, plant), x[self.parts.x], u, f)[1]
            return taken(y, np.array(self.trailing, int))

        return shown(plant) + self._astray(x, shown)

    def _shown(
        self, plant: Plant, x: Float[Array, "own"], u: Float[Array, "inputs"]
    ) -> Float[Array, "trailing"]:
        """What `plant` shows in the outputs that trail, which read no derivative."""
        y = plant.output(jnp.zeros_like(x), x, u)
        return taken(y, np.array(self.trailing, int))

    def forces(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        f: Float[Array, "faults"],
        t: Float[Array, "times"],
    ) -> Float[Array, "times own"]:
        """What is added to the rates of `base` `t` [s] after `x`, the last of which ends the step:
        by d, and by a, e and v what they do at `x` under `u` in the mean of the step. What d does
        to a rate that reads another one is what it does at `x`."""
        beside = x * self.meanwhile(t[-1])

        def rates(plant: Plant) -> Float[Array, "own"]:
            return respond(Reached(self._own, plant), x[self.parts.x], u, f)[0]

        slow = self._slow(x, t)
        if self.base.chained:
            own, plant = x[self.parts.x], self._told(x)
            usual = plant.derivative(own, u)
            slow = jax.vmap(lambda d: plant.moved(own, u, d) - usual)(slow)
        return slow + self._astray(beside, rates)

    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        own = self.parts.x

        def shown(plant: Plant) -> Float[Array, "outputs"]:
            return plant.output(dx[own], x[own], u)

        return shown(self._told(x)) + self._astray(x, shown)

    def besides(self, x: Float[Array, "states"]) -> Float[Array, "outputs"]:
        """b, l, g and z, and what `base` shows besides."""
        count, parts = len(self.signals.outputs), self.parts
        more = _put(count, self.wandering, x[parts.b])
        more = more + _put(count, self.lagging, x[parts.lag])
        more = more + _put(count, self.trailing, x[parts.g])
        more = more + _put(count, self.zeroed, x[parts.z])
        return self.base.besides(x[parts.x]) + more

    def jumps(
        self,
        x: Float[Array, "states"],
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        f_before: Float[Array, "faults"],
        f: Float[Array, "faults"],
        unseen: Float[Array, ""] | float = 0.0,
    ) -> Float[Array, "states"]:
        """By how much the states may jump where input or faults change (standard deviations). An
        input that changed may have done so at any time of those last `unseen` [s] in which no row
        came: by u t / sqrt(3) too far or too near, u being what it does in a second."""
        if not self.following and not self.lagging:
            return jnp.zeros(len(x))
        # what an output's own fault does is not late
        acting = [fault.acts for fault in self.signals.faults]
        us, fs = jnp.stack([u, u_before]), jnp.stack([f, f_before]) * np.array(acting, float)
        dx, y = jax.vmap(lambda u, f: respond(self, x, u, f))(us, fs)
        parts = self.parts
        shown = taken(y[0] - y[1], np.array(self.lagging, int))
        driven = np.isin(np.arange(self.count), self.driven)
        rates = jnp.where(driven, (dx[0] - dx[1])[parts.x], 0.0)
        jumps = jnp.zeros(len(x)).at[parts.x].set(unseen * jnp.abs(rates) / np.sqrt(3))
        return jumps.at[parts.lag].set(jnp.abs(self.error.late * shown))

    def leans(
        self,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        f_before: Float[Array, "faults"],
        f: Float[Array, "faults"],
    ) -> Float[Array, "states"]:
        """By how much v jumps where input or faults change, and h where the input does."""
        jump = jnp.zeros(len(self.signals.states))
        us = jnp.stack([u, u_before])
        if self.following:
            moved = self._moved(us, jnp.stack([f, f]))
            moved = taken(moved, np.array(self.following, int))
            jump = jump.at[self.parts.h].set(moved)
        if self.leaning:
            jump = jump + self._leant(self._moved(us, jnp.stack([f, f_before])))
        return jump

    def enters(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        f: Float[Array, "faults"],
        by: Float[Array, "faults"],
    ) -> Float[Array, "states faults"]:
        """By how much v and g jump for a unit of each fault, where it changes from `f` by `by`, to
        the side on which it does more."""
        if not self.leaning and not self._answering:
            return jnp.zeros((len(self.signals.states), len(f)))
        units = []
        for k, step in enumerate(by * np.eye(len(by))):
            up, down = (
                self._moved(jnp.stack([u, u]), jnp.stack([f + side, f])) / by[k]
                for side in (step, -step)
            )
            leant = self._leant(jnp.where(jnp.abs(up) >= jnp.abs(down), up, -down))
            up, down = (self.shows_late(x, u, f, f + side) / by[k] for side in (step, -step))
            units.append(leant + jnp.where(jnp.abs(up) >= jnp.abs(down), up, -down))
        return jnp.stack(units, axis=1)

    def doubts(
        self,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        x_before: Float[Array, "states"],
        x: Float[Array, "states"],
        dt: Float[Array, ""],
    ) -> Float[Array | np.ndarray, "states"]:
        """How many times as large as usual what acts on each state at random is on the way of
        `dt` [s] from `u_before` and `x_before` to `u` and `x`. An input jumps between two values,
        and a state passes what lies between them. What sticks stays as large wherever its state
        goes, 1 - e^(-2 rate dt) of its variance being new."""
        usual = jnp.ones(len(self.signals.states))
        if self.sticking:
            q, time = self.parts.q, self.error.gripping
            left = self.lasting(dt, x_before, x)[q.start - self.count : q.stop - self.count]
            new = (1 - left**2) * time / (2 * jnp.where(dt > 0, dt, 1.0))
            usual = usual.at[q].set(jnp.sqrt(jnp.where(dt > 0, new, 1.0)))
        if not self.doubted:
            return usual
        low, high = self.error.above, self.error.below
        ends = jnp.stack([u_before, u]), jnp.stack([x_before[: self.count], x[: self.count]])
        ends = jnp.concatenate(ends, axis=1)[:, np.array(self.doubted)]
        there = jnp.any((ends > low) & (ends < high), axis=0)
        passed = (jnp.max(ends, axis=0) > low) & (jnp.min(ends, axis=0) < high)
        there = jnp.where(np.array(self.doubted) < len(u), there, passed)
        times = jnp.max(jnp.where(there, self.error.doubt, 1.0))
        return jnp.where(np.arange(len(usual)) < self.parts.xi.start, times * usual, usual)

    def altered(self, changes: Mapping[str, ValueChange]) -> "Disturbed":
        """`base` altered: what xi adds to a constant is not."""
        return replace(self, base=self.base.altered(changes))

    def own_at(self, x: Float[Array, "states"]) -> Plant:
        """`base` with the constants that xi makes of them, held by q, and with all faults."""
        return Reached(self._own, self._told(x))

    @property
    def _own(self) -> Signals:
        """Those of `base`, with all faults."""
        return replace(self.signals, states=self.base.signals.states)

    def _told(self, x: Float[Array, "states"]) -> Plant:
        """`base` with the constants that xi makes of them, held by q."""
        plant = self._with(contract("ij,j->i", self.directions, x[self.parts.xi]))
        if not self.sticking:
            return plant
        return Held(plant.signals, plant, x[self.parts.q], self.error.slip, self.sticking)

    def _moved(
        self, us: Float[Array, "two inputs"], fs: Float[Array, "two faults"]
    ) -> Float[Array, "inputs"]:
        """What reaches the plant of the inputs, less what did before."""
        reached = jax.vmap(lambda u, f: applied(self.signals, u, f))(us, fs)
        return reached[0] - reached[1]

    def _leant(self, moved: Float[Array, "inputs"]) -> Float[Array, "states"]:
        """By how much v jumps where the inputs have `moved`."""
        jump = self.error.lean * taken(moved, np.array(self.leaning, int))
        return jnp.zeros(len(self.signals.states)).at[self.parts.v].set(jump)

    def _slow(
        self, x: Float[Array, "states"], t: Float[Array, "times"]
    ) -> Float[Array, "times own"]:
        """What d adds to the rates of `base` `t` [s] after `x`."""
        slow = jnp.exp(-t[:, None] / self.error.tau) * x[self.parts.d]
        return _put(self.count, self.driven, slow)

    def _astray(
        self, x: Float[Array, "states"], of: Callable[[Plant], Float[Array, "some"]]
    ) -> Float[Array, "some"]:
        """By how much more there is `of` a plant whose inputs stray by a, e and v in `x`: of the
        usual one, as of an unknown input times an unknown constant a linear filter makes a bias of
        both."""
        usual = self._with(jnp.zeros_like(self.offset))
        count = len(self.signals.inputs)
        stray = _put(count, self.straying, x[self.parts.a])
        e = self.error.share * x[self.parts.r] * x[self.parts.h]
        stray = stray + _put(count, self.following, e)
        stray = stray + _put(count, self.leaning, x[self.parts.v])
        if not self.straying and not self.following and not self.leaning:
            return jnp.zeros_like(of(usual))
        return of(Strayed(usual.signals, usual, stray)) - of(usual)

    def _with(self, shift: Float[Array, "parameters"]) -> Plant:
        """`base` with its constants by `offset` and `shift` off, and with the curves of its
        inputs."""
        plant = self.base
        if self.names:
            values = plant.values()
            off = {}
            for k, name in enumerate(self.names):
                value = values[name] + self.offset[k]
                there = k in self.positive
                off[name] = _positive(value, shift[k]) if there else value + shift[k]
            plant = plant.with_constants(off)
        if not self.bending:
            return plant
        curve = self.error.bend, self.error.low, self.error.high
        return Bent(plant.signals, plant, *curve, self.bending)


def _positive(value: Float[Array, ""], by: Float[Array, ""]) -> Float[Array, ""]:
    """`value` changed `by` so much, and above 0 however far down."""
    down = value**2 / (value - jnp.minimum(by, 0.0))
    return jnp.where(by < 0, down, value + by)


def _mean_left(spans: Float[Array, "some"]) -> Float[Array, "some"]:
    """What is left, in the mean of a step, of what fades within `spans` of it."""
    return jnp.where(spans > 0, -jnp.expm1(-spans) / jnp.where(spans > 0, spans, 1.0), 1.0)


def _places(parts: Sequence[slice]) -> Int[np.ndarray, "some"]:
    """Those of some parts, one behind the other."""
    return np.concatenate([np.arange(part.start, part.stop) for part in parts])


def _shows_states(plant: Plant) -> bool:
    """Whether every output is one state and nothing else."""
    if not isinstance(plant, GrayBoxPlant):
        return False
    names = plant.signals.state_names
    return all(is_state(value.tree, names) for value in plant.spec.values)


def _put(count: int, on: tuple[int, ...], values: Float[Array, "*many some"]) -> Array:
    """`values` at the places `on` of `count` numbers, 0 elsewhere."""
    none = jnp.zeros((*values.shape[:-1], 1))
    places = np.full(count, len(on))
    places[list(on)] = range(len(on))
    return jnp.concatenate([values, none], axis=-1)[..., places]


def dynamic_states(plant: Plant) -> tuple[int, ...]:
    """The states whose equation may be wrong: those that are not exact kinematics, which the file
    says, or whose derivative is another state and nothing else."""
    states = plant.signals.states
    exact = [each.exact for each in states]
    if isinstance(plant, GrayBoxPlant):
        names = plant.signals.state_names
        trees = [each.tree for each in plant.spec.derivatives]
        exact = [e or is_state(tree, names) for e, tree in zip(exact, trees, strict=True)]
    return tuple(k for k, known in enumerate(exact) if not known)


def following_inputs(plant: Plant) -> tuple[int, ...]:
    """The inputs that a dynamic state's derivative reads."""
    inputs = plant.signals.input_names
    if not isinstance(plant, GrayBoxPlant):
        return tuple(range(len(inputs)))
    read = [set(names_used(plant.spec.derivatives[k])) for k in dynamic_states(plant)]
    return tuple(j for j, name in enumerate(inputs) if any(name in each for each in read))


def deriving_outputs(plant: Plant) -> tuple[int, ...]:
    """The outputs whose value reads the derivative of a state, as far as that can be told."""
    if not isinstance(plant, GrayBoxPlant):
        return tuple(range(len(plant.signals.outputs)))
    return tuple(j for j, value in enumerate(plant.spec.values) if derivatives_used(value))


def answering_outputs(plant: Plant) -> tuple[int, ...]:
    """The outputs whose value reads an input, or the derivative of a state."""
    outputs = tuple(range(len(plant.signals.outputs)))
    if not isinstance(plant, GrayBoxPlant):
        return outputs
    spec = plant.spec
    direct = {*plant.signals.input_names}
    return tuple(
        j
        for j in outputs
        if direct & set(names_used(spec.values[j])) or derivatives_used(spec.values[j])
    )


def shared_inputs(plant: Plant) -> tuple[int, ...]:
    """The inputs that act in two places or more, derivatives of dynamic states or outputs: what
    they stray by is one error there, not one for each."""
    inputs = range(len(plant.signals.inputs))
    if not isinstance(plant, GrayBoxPlant):
        return tuple(inputs)
    spec, states = plant.spec, plant.signals.state_names
    read = {name: set(names_used(spec.derivatives[k])) for k, name in enumerate(states)}
    places = [read[states[k]] for k in dynamic_states(plant)]
    for value in spec.values:
        through = [read[name] for name in derivatives_used(value)]
        places.append(set(names_used(value)).union(*through))
    names = plant.signals.input_names
    return tuple(j for j in inputs if sum(names[j] in each for each in places) > 1)
