"""Hypotheses that are structurally the same: no data will ever tell them apart.

A fault leaves h(n) = D, C B, C A B, ... in the outputs n samples after its onset, at each point of
the training envelope (Markov parameters of the linearised plant). Two faults with parallel h are
one; three whose h span a plane are such that any two look like any other two (Basseville and
Nikiforov, "Detection of Abrupt Changes", 1993, 7.2: isolation needs independent signatures).
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.rows.judged import measured_outputs, operating_points
from faultgauge.observers.observer import linearise
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["EqualFaults", "equal_faults", "signatures"]

LENGTH = 100  # samples after an onset
ALIKE = 1e-6  # least singular value over the largest, of signatures scaled to 1


class EqualFaults(NamedTuple):
    """`pairs` (one, other, how many units of the other do what one of the first does), and a
    sentence for every pair, and every three."""

    pairs: list[tuple[str, str, float]]
    warnings: list[str]


def equal_faults(model: Model, runs: Sequence[Run]) -> EqualFaults:
    """Which two, and which three, faults are the same to the outputs."""
    h = signatures(model, runs)
    faults = model.plant.signals.faults
    seen = [
        k
        for k, fault in enumerate(faults)
        if fault.monitor != "disabled" and np.isfinite(h[:, k]).all() and np.any(h[:, k])
    ]
    size = np.linalg.norm(h, axis=0)
    unit = h[:, seen] / size[seen]
    gram = np.eye(len(faults))
    gram[np.ix_(seen, seen)] = unit.T @ unit
    names, found = model.plant.signals.fault_names, EqualFaults([], [])
    same = {pair for pair in combinations(seen, 2) if _dependent(gram, pair)}
    for j, k in sorted(same):
        found.pairs.append((names[j], names[k], float(np.sign(gram[j, k]) * size[j] / size[k])))
        found.warnings.append(
            f"faults {names[j]!r} and {names[k]!r} act on the measured outputs in the same way, so "
            "no data can tell them apart and the bank leaves the cause undecided; keep one of the "
            'two, or give the other monitor = "disabled"'
        )
    if model.plant.signals.max_simultaneous > 1:
        for three in combinations(seen, 3):
            alike = any(pair in same for pair in combinations(three, 2))
            if not alike and _dependent(gram, three):
                a, b, c = (repr(names[k]) for k in three)
                found.warnings.append(
                    f"of the faults {a}, {b} and {c} any two together look like any other two, and "
                    "like the third: their cause may stay undecided; set [detection] "
                    "max_simultaneous = 1, or measure more"
                )
    return found


def signatures(model: Model, runs: Sequence[Run]) -> Float[np.ndarray, "effects faults"]:
    """h of every fault, over all points, times and measured outputs."""
    step = float(np.median([run.step for run in runs]))
    outputs = measured_outputs(model, runs)
    # a stiff plant's step of RK4 may grow, and all that grows looks the same
    linear = linearise(model.plant, operating_points(model), step, None)
    measured = [model.plant.signals.output_names.index(name) for name in outputs]
    C, shift = linear.C[:, measured], np.zeros_like(linear.B)
    found = []
    for _ in range(LENGTH):
        found.append(C @ shift + linear.D[:, measured])
        shift = linear.A @ shift + linear.B
    return np.concatenate(found, axis=1).reshape(-1, len(model.plant.signals.faults))


def _dependent(gram: Float[np.ndarray, "faults faults"], some: tuple[int, ...]) -> bool:
    """Whether the signatures of `some` faults span less than their number."""
    values = np.linalg.eigvalsh(gram[np.ix_(some, some)])  # squares of singular values
    return bool(values[0] <= ALIKE**2 * values[-1])
