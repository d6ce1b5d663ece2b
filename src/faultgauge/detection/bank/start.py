"""What is known when a stretch begins: of the states next to nothing, of all else what was.

In a gap of length T nothing is sampled, and what was known goes on: the weights of all branches and
onsets, and faults as they were, the discrepancy as far as it lasts, exp(-T / tau), and constants
but for what they differ between the stretches of a healthy run. The states may be anywhere in the
training envelope again, or as far off as a fault of the sensor that shows them may be; the samples
that follow tell, to each branch on its own terms, x = y - f where it takes the sensor for faulty.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.extended import start_spread
from faultgauge.detection.rows.judged import operating_points
from faultgauge.observers.branches import BranchState, Probe
from faultgauge.observers.branching import Branching
from faultgauge.observers.divided_difference import Belief

__all__ = ["Start"]

ROOM = 10.0  # standard deviations of the sensor: at least that far off may a state be


class Start(eqx.Module):
    """States at `mean` +- `sd` behind a gap and as `extended` where a log begins; each `measured`
    by an output (its place; -1: by none). Discrepancies of stationary `size` last `lasting` [s],
    infinite of all else; constants are `renewed` by as much of their variance."""

    mean: Float[np.ndarray, "states"]
    sd: Float[np.ndarray, "states"]
    extended: Float[np.ndarray, "extended"]
    size: Float[np.ndarray, "extended"]
    lasting: Float[np.ndarray, "extended"]
    renewed: Float[np.ndarray, "constants"]
    measured: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of(bank: FaultBank) -> "Start":
        model, noise, x = bank.model, bank.noise, operating_points(bank.model).x
        signals = model.plant.signals
        measured = np.full(len(signals.states), -1)
        sd = np.ptp(x, axis=0) / 2 + 1e-9
        for j, output in enumerate(signals.outputs):
            if output.measures is None or output.name not in bank.outputs:
                continue
            k = signals.state_names.index(output.measures)
            off = [bank.size[i] for i, f in enumerate(signals.faults) if f.target == output.name]
            measured[k], sd[k] = j, max(sd[k], ROOM * noise.sigma[j], *off)
        extended = start_spread(model, noise, ())
        extended[: len(sd)] = sd
        plant = bank.plant
        parts, error = plant.parts, plant.error
        fading = [k for part in (parts.d, parts.b, parts.a) for k in range(part.start, part.stop)]
        lasting = np.full(len(extended), np.inf)
        lasting[fading] = np.concatenate([error.tau, error.wandering, error.straying])
        return Start(
            (x.max(axis=0) + x.min(axis=0)) / 2, sd, extended, extended, lasting,
            np.asarray(noise.renewed, float), tuple(int(j) for j in measured),
        )  # fmt: skip

    def init(self, modes: Branching) -> BranchState:
        """Before the first row."""
        nothing = jnp.zeros(len(self.extended) - len(self.mean))
        u = jnp.zeros(len(modes.filter.plant.signals.inputs))
        return modes.init(jnp.concatenate([self.mean, nothing]), jnp.asarray(self.extended), u)

    def anew(
        self,
        modes: Branching,
        state: BranchState,
        gap: Float[Array, ""],
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
    ) -> BranchState:
        """Before the first row of a stretch, `gap` [s] after the last one, where `u` acts and `y`
        (NaN: not sampled) is measured."""
        states, end = len(self.mean), len(self.extended)
        renewed = slice(end - len(self.renewed), end)
        fade = jnp.exp(-gap / self.lasting)
        keep = fade.at[:states].set(0.0).at[renewed].set(jnp.sqrt(1 - self.renewed))
        more = (1 - fade**2) * self.size**2
        more = more.at[:states].set(self.sd**2).at[renewed].set(self.renewed)
        keep = jnp.concatenate([keep, jnp.ones(modes.moved)])
        more = jnp.concatenate([more, jnp.zeros(modes.moved)])
        shown = jnp.append(y, jnp.nan)[np.array(self.measured)]
        x = jnp.where(jnp.isfinite(shown), shown, self.mean)
        mean = (state.belief.mean * keep).at[:, :states].set(x)
        P = state.belief.P * keep[:, None] * keep + jnp.diag(more)
        return state._replace(
            belief=Belief(mean, P),
            lanes=state.lanes._replace(eta=state.lanes.eta * keep[:, None, None]),
            probe=Probe(
                state.probe.eta * keep[:, None, None, None],
                state.probe.J * jnp.exp(-gap / modes.recall)[:, None, None],
                state.probe.age + gap,
            ),
            u=u,
            t=state.t + gap,
        )
