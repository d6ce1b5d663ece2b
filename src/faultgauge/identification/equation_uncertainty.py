"""What the equation error says about the parameters that it fitted."""

import numpy as np

from faultgauge.identification.constants import Information, constants
from faultgauge.identification.refinement.unknowns import unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["equation_information"]


def equation_information(plant: GrayBoxPlant) -> Information:
    """Warnings about the parameters of `plant`, fitted by equation error."""
    unknowns = unknowns_of(plant)
    count = len(unknowns.parameters)
    unknown = np.full((count, count), np.nan)
    found = constants(plant, unknowns, unknowns.vector(plant), unknown, [None] * count)
    return Information(*found, (), 1.0)
