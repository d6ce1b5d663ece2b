"""How many hidden units networks get where the plant file leaves it open."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.settle import settle
from faultgauge.plants.spec import PlantSpec

__all__ = ["SIZES", "chosen_sizes", "smallest_sufficient", "with_hidden"]

SIZES = (2, 5, 10, 20)  # hidden units that are tried in turn
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

    All open networks grow together until one more step no longer lowers the error clearly: one
    may hide what another gains. Of several, each in turn then takes the fewest units that do not
    raise it clearly.
    """
    names = plant.spec.open_sizes
    if not names:
        return fit(plant)[1]
    sizes = dict.fromkeys(names, SIZES[0])
    best, result = fit(with_hidden(plant, sizes))
    for size in SIZES[1:]:
        larger = dict.fromkeys(names, size)
        error, found = fit(with_hidden(plant, larger))
        if not error < CLEARLY * best:
            break
        best, result, sizes = error, found, larger
    for name in names if len(names) > 1 else ():
        for size in SIZES[: SIZES.index(sizes[name])]:
            smaller = sizes | {name: size}
            error, found = fit(with_hidden(plant, smaller))
            if not best < CLEARLY * error:
                best, result, sizes = min(error, best), found, smaller
                break
    return result
