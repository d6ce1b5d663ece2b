"""The model alone, sample by sample: what no measurement corrects."""

import equinox as eqx
from jaxtyping import Array, Float

from faultgauge.observers.observer import CurrentObserver
from faultgauge.plants.plant import Plant

__all__ = ["OpenLoop"]


class OpenLoop(CurrentObserver):
    """x = x-: a free run as an observer without gains (the paper's residual reference, eq 9)."""

    plant: Plant
    target: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def correct(
        self, x: Float[Array, "states"], f: Float[Array, ""], e: Float[Array, "outputs"]
    ) -> tuple[Float[Array, "states"], Float[Array, ""]]:
        return x, f
