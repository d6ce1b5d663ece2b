"""What may stand between a controller and the actuators: a pure `init` and `step`."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

__all__ = ["Policy"]


class Policy(eqx.Module):
    """Turns what a controller wants into commands; it sees what the controller sees.

    It runs inside the loop: everything that it remembers stands in its state (any tree of
    arrays), and `info` of each step is recorded.
    """

    @abc.abstractmethod
    def init(self, x: Float[Array, "*states"], u: Float[Array, "inputs"]) -> Any:
        """The state before a run that starts near `x` under the command `u`."""

    @abc.abstractmethod
    def step(
        self,
        state: Any,
        wanted: Float[Array, "channels"],
        y: Float[Array, "*outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Any, Float[Array, "inputs"], Any]:
        """(state, command, info) at a sample: `y` as measured under the last command (NaN: not
        sampled), `dt` [s] after the last sample."""
