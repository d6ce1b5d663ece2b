"""Structural detectability against brute force, and by hand for tanks."""

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import structural_rank

from faultgauge.foresight.structure import overdetermined, rate_of, structure_of, value_of
from faultgauge.plants.plant_file import parse_plant

TANKS = """
name = "two tanks and a meter that nothing reads"
[states.a]
derivative = "u - k*a"
[states.b]
derivative = "k*a - NN(b)"
[states.c]
derivative = "a - c"
[inputs.u]
[outputs.y]
value = "b"
[outputs.z]
value = "a"
[parameters]
k = { value = 1 }
[networks.NN]
[faults.pump]
enters = "input"
target = "u"
[faults.loss]
enters = "gain"
target = "u"
[faults.leak]
enters = "state"
target = "b"
[faults.bias]
enters = "output"
target = "y"
[faults.pipe]
enters = "parameter"
target = "k"
[faults.drain]
enters = "network"
target = "NN"
[faults.meter]
enters = "state"
target = "c"
"""


def structure(outputs):
    spec = parse_plant(TANKS)
    return structure_of(spec, outputs, spec.signals.faults)


@pytest.mark.parametrize("seed", range(30))
def test_the_overdetermined_part_is_what_no_matching_needs(seed):
    """An equation belongs to it if the others match as many unknowns without it."""
    random = np.random.default_rng(seed)
    there = random.random((7, 5)) < 0.3
    there[np.arange(7), random.integers(0, 5, 7)] = True  # each reads something
    equations = {str(k): [f"v{j}" for j in np.flatnonzero(row)] for k, row in enumerate(there)}
    whole = structural_rank(csr_array(there.astype(int)))
    spare = {
        str(k)
        for k in range(7)
        if structural_rank(csr_array(np.delete(there, k, axis=0).astype(int))) == whole
    }
    assert overdetermined(equations) == spare


def test_what_no_output_reads_cannot_be_seen():
    both = structure(["y", "z"])
    assert [name for name in both.faults if not both.detectable(name)] == ["meter"]
    seen = both.measuring(value_of("c"))
    assert seen.detectable("meter")
    assert seen.isolable("meter", "leak")


def test_one_output_tells_no_two_faults_apart():
    """One equation is over, and a fault that may do anything takes it."""
    one = structure(["y"])
    pairs = combinations(["pump", "loss", "leak", "bias", "pipe", "drain"], 2)
    assert not any(one.isolable(a, b) or one.isolable(b, a) for a, b in pairs)


def test_two_outputs_tell_faults_of_two_tanks_apart():
    both = structure(["y", "z"])
    assert both.isolable("pump", "leak")
    assert both.isolable("leak", "pump")
    assert not both.isolable("pump", "loss")  # at the same place
    assert not both.isolable("leak", "drain")  # in the same equation
    # k stands in both tanks: it hides neither of the two residuals from the other faults alone
    assert both.isolable("pipe", "pump")
    assert not both.isolable("leak", "bias")  # one residual holds both: that of tank b
    assert both.measuring(rate_of("b")).isolable("leak", "bias")
