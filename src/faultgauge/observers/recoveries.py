"""What is known once a fault has gone.

It is 0, and z is what it is given that. What was told amid a fault that acts on the plant is off as
the answer to it is: with e = shape z, z being how clearly the fault showed, by e of its own
standard deviation. So variances grow by 1 + e^2, to what they are before any data at most, and
another fault that was told amid it is there, or was made up (`real_odds`).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.branches import NEVER, BranchState
from faultgauge.observers.divided_difference import Belief
from faultgauge.observers.onsets import NONE, Onsets

__all__ = ["Recoveries", "real_odds", "told_at_once"]


def told_at_once(
    sudden: Float[Array, "*any"],
    sharp: Float[Array, "*any"],
    f: Float[Array, "*any"],
    variance: Float[Array, "*any"],
    e2: Float[Array, "*any"],
) -> Float[Array, "*any"]:
    """What the first sample of a fault of size f tells against one that is made up (ln L).

    That had the score sigma = `sudden` and the info J = `sharp`; made up it is e of its own
    standard deviations within a sample:

        sigma^2 / J / (1 + e^2) / 2
            - (sigma - J f)^2 / J / (1 + J variance) / 2,   or nothing where that is less.
    """
    J = jnp.maximum(sharp, 1e-300)
    made_up = sudden**2 / J / (1 + e2)
    real = (sudden - sharp * f) ** 2 / J / (1 + sharp * variance)
    return jnp.maximum(made_up - real, 0.0) / 2


def real_odds(
    z2: Float[Array, "*any"],
    s2: Float[Array, "*any"],
    e2: Float[Array, "*each"],
    common: Float[Array, ""],
) -> Float[Array, "*any"]:
    """ln of the odds that a fault which shows with a size z, in its own standard deviations, is
    there, z ~ N(0, 1 + e^2 + s^2), and is not made up by others, z ~ N(0, 1 + e^2):

        ln c + ln N(z; 0, 1 + e^2 + s^2) / N(z; 0, 1 + e^2) - ln (e^2 / (1 + e^2)),

    `common`, c, being how often one fault brings another. The less they make up, the surer it is.
    """
    rarely = jnp.log(jnp.maximum(e2, NONE) / (1 + e2))
    return jnp.log(common) + _evidence(z2, s2, e2) - rarely


def _evidence(
    z2: Float[Array, "*any"], s2: Float[Array, "*any"], e2: Float[Array, "*each"]
) -> Float[Array, "*any"]:
    """ln N(z; 0, 1 + e^2 + s^2) / N(z; 0, 1 + e^2)."""
    wide = 1 + e2 + s2
    return (z2 / (1 + e2) - z2 / wide - jnp.log(wide / (1 + e2))) / 2


class Recoveries(Onsets):
    """Faults that go. `usual` is the variance that the states behind the plant's own have when a
    log begins; `shape` the share of all that a fault does by which the answer to it is off;
    `declared` faults come first."""

    usual: Float[Array, "n"]
    shape: Float[Array, ""]
    declared: int = eqx.field(static=True)

    def _known_gone(
        self,
        mean: Array,
        P: Array,
        fault: Int[Array, ""],
        gone: Bool[Array, ""],
        off: Float[Array, ""],
    ) -> tuple[Array, Array, list[Array]]:
        """The belief given that a fault that has gone is 0, and so is its growth; and by which
        gains of z that is known."""
        n, gains = self.filter.states, []
        for slot, owner in enumerate(self.owner[: self.moved]):
            i = n + slot
            there = gone & (fault == owner) & (P[i, i] > 0)
            gain = P[:, i] / jnp.maximum(P[i, i], NONE)
            gain = jnp.where(there, gain.at[i].set(1.0), 0.0)  # exactly: nothing is left of it
            gains.append(gain)
            P = P - jnp.outer(gain, P[i])
            none = jnp.where(there & (jnp.arange(len(mean)) == i), 0.0, 1.0)
            P = P * none[:, None] * none[None]
        P = (P + P.T) / 2
        return self._without(mean, gains), P + jnp.diag(self._untold(P, off)), gains

    def _acts(self) -> Float[np.ndarray, "faults"]:
        return np.array([float(each.acts) for each in self.filter.plant.signals.faults])

    def _off(
        self, before: Belief, fault: Int[Array, ""], gone: Bool[Array, ""]
    ) -> Float[Array, ""]:
        """(shape z)^2 of a fault that has gone, z being how clearly it showed `before`: by so much
        of its own variance is off what was told amid it. 0 where it does not act on the plant."""
        i = self.filter.states + fault
        z2 = before.mean[i] ** 2 / jnp.maximum(before.P[i, i], 1e-300)
        return jnp.where(gone, jnp.asarray(self._acts())[fault] * self.shape**2 * z2, 0.0)

    def _untold(self, P: Float[Array, "n n"], off: Float[Array, ""]) -> Float[Array, "n"]:
        """Variance to add to constants, slow errors and other faults once a fault has gone; they
        are as unsure as when a log, or a fault, begins at most."""
        known, n, F = jnp.diagonal(P), self.filter.states, self.filter.faults
        there = known[n : n + F] > 0
        usual = self.usual.at[n : n + F].set(jnp.where(there, self.prior.size[:F] ** 2, 0.0))
        return jnp.minimum(off * known, jnp.maximum(usual - known, 0.0))

    def _told_before(
        self, state: BranchState, b: Int[Array, ""], fault: Int[Array, ""], gone: Bool[Array, ""]
    ) -> Float[Array, "faults"]:
        """What has been told (ln L) of each fault of branch `b` that another one, `fault`, does not
        make up: all that had been told before that came beside it. Of one that changes nothing
        is left of this."""
        F, at = self.filter.faults, self.filter.states + np.arange(self.filter.faults)
        P = jnp.diagonal(state.belief.P[b])[at]
        there, v = P > 0, jnp.maximum(P, NONE)
        z2 = jnp.where(there, state.belief.mean[b, at] ** 2 / v, 0.0)
        acting = z2 * self._acts()
        e2 = self.shape**2 * (jnp.sum(acting) - acting)  # by those that are there already
        told = jnp.maximum(_evidence(z2, self.prior.size[:F] ** 2 / v, e2), 0.0)
        told = jnp.where(there, jnp.minimum(told, self._likelier(state, b)), 0.0)
        comes = ~gone & ~there[fault] & (jnp.asarray(self._acts())[fault] > 0)
        after = jnp.where(comes, jnp.maximum(state.told[b], told), state.told[b])
        return after.at[fault].set(0.0)

    def _likelier(self, state: BranchState, b: Int[Array, ""]) -> Float[Array, "faults"]:
        """By how much (ln) branch `b` is likelier than any without each fault."""
        with_it = self._present(state.belief)
        best = jnp.max(jnp.where(with_it, NEVER, state.weight[:, None]), axis=0)
        return jnp.maximum(state.weight[b] - best, 0.0)

    def _real(
        self,
        state: BranchState,
        b: Int[Array, ""],
        mean: Float[Array, "n"],
        fault: Int[Array, ""],
        off: Float[Array, ""],
    ) -> Float[Array, "faults"]:
        """ln of the odds that each other fault of branch `b` was there, and was not made up by
        `fault`, which has gone and by which what was told of it is `off` (`real_odds`). `mean` is
        after that. Infinite for none, and where `fault` does not act on the plant."""
        F, n = self.filter.faults, self.filter.states
        before = jnp.diagonal(state.belief.P[b])[n : n + F]
        others = (before > 0) & (np.arange(F) != fault)
        v = jnp.maximum(before, NONE)
        z2, s2 = mean[n : n + F] ** 2 / v, self.prior.size[:F] ** 2 / v
        size = state.belief.mean[b, n + fault]
        quick = jnp.where(
            fault < self.declared, state.quick[jnp.minimum(fault, self.declared - 1)], 0.0
        )
        e2 = self.shape**2 * size**2 * quick
        at_once = told_at_once(
            state.sudden[b], state.sharp[b], mean[n : n + F], before, jnp.broadcast_to(e2, F)
        )
        told = jnp.maximum(at_once, state.told[b])
        odds = real_odds(z2, s2, off, self.prior.common) + told
        return jnp.where(others & (off > 0), odds, jnp.inf)
