"""How many hidden units networks get where the plant file leaves it open."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import PlantSpec
from faultgauge.plants.settle import settle

__all__ = ["SIZES", "chosen_sizes", "smallest_sufficient", "with_hidden"]

SIZES = (2, 5, 10, 20)
CLEARLY = 0.97  # of the validation error with fewer units: less gain does not pay for more

Found = TypeVar("Found")


def with_hidden(plant: GrayBoxPlant, sizes: dict[str, int]) -> GrayBoxPlant:
    """`plant` with untrained networks of these `sizes` where its file leaves them open."""
    sized = GrayBoxPlant.untrained(settle(plant.spec, {}, sizes))
    kept = {name: net for name, net in plant.networks.items() if name not in sizes}
    return eqx.tree_at(
        lambda p: (p.networks, p.parameters),
        sized,
        (sized.networks | kept, plant.parameters),
    )


def chosen_sizes(spec: PlantSpec, plant: GrayBoxPlant) -> dict[str, int]:
    """What `plant` has where the file of `spec` leaves it open."""
    return {n.name: n.hidden for n in plant.spec.networks if n.name in spec.open_sizes}


def smallest_sufficient(
    plant: GrayBoxPlant, fit: Callable[[GrayBoxPlant], tuple[float, Found]]
) -> Found:
    """What `fit` finds (validation error, result) with the fewest units that suffice.

    Sizes grow until one more step no longer lowers the error clearly.
    """
    if not plant.spec.open_sizes:
        return fit(plant)[1]
    best, result = fit(with_hidden(plant, dict.fromkeys(plant.spec.open_sizes, SIZES[0])))
    for size in SIZES[1:]:
        error, found = fit(with_hidden(plant, dict.fromkeys(plant.spec.open_sizes, size)))
        if not error < CLEARLY * best:
            break
        best, result = error, found
    return result
