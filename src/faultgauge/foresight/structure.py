"""What the equations alone allow: which faults leave anything to test, and which another one hides.

The plant file is read as equations in unknowns: dx = F(x, u), dx = d(x)/dt, y = h(dx, x, u) for
every measured output, and f = 0 for every fault, which stands wherever it enters. A matching of
equations to unknowns leaves some equations over; those that alternating paths reach from there are
the overdetermined part (Dulmage and Mendelsohn, Canad. J. Math. 10 (1958)). A fault can be seen
where its f = 0 lies in that part, and told from another one where it still does without the other's
(Krysander and Frisk, IEEE Trans. SMC-A 38 (2008)). Faults may change in time at will here: that one
is constant, or its input known, is not used.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from faultgauge.plants.expression import (
    Call,
    Expression,
    Name,
    derivatives_used,
    names_used,
    networks_used,
)
from faultgauge.plants.signals import Fault
from faultgauge.plants.spec import PlantSpec

__all__ = ["Structure", "overdetermined", "rate_of", "structure_of", "value_of"]


@dataclass(frozen=True)
class Structure:
    """Which unknowns each equation reads; the fault f stands in unknown "f NAME" and its f = 0 in
    the equation of that name."""

    equations: Mapping[str, frozenset[str]]
    faults: tuple[str, ...]

    def detectable(self, fault: str) -> bool:
        """Whether the outputs test for it."""
        return _absent(fault) in overdetermined(self.equations)

    def isolable(self, fault: str, other: str) -> bool:
        """Whether they still do where the `other` may be there, however it changes."""
        rest = {name: each for name, each in self.equations.items() if name != _absent(other)}
        return _absent(fault) in overdetermined(rest)

    def measuring(self, value: Expression) -> "Structure":
        """With a sensor of `value` more."""
        return replace(self, equations={**self.equations, "new sensor": _reads(value)})


def structure_of(spec: PlantSpec, outputs: Sequence[str], faults: Iterable[Fault]) -> Structure:
    """Of a plant file with measured `outputs`."""
    signals, faults = spec.signals, tuple(faults)
    equations = dict[str, frozenset[str]]()
    for name, derivative in zip(signals.state_names, spec.derivatives, strict=True):
        entering = _entering(faults, derivative, {"state": name})
        equations[f"derivative {name}"] = _reads(derivative) | {f"d {name}"} | entering
        equations[f"integral {name}"] = frozenset({f"x {name}", f"d {name}"})
    for name, value in zip(signals.output_names, spec.values, strict=True):
        if name in outputs:
            places = {"output": name, "output_gain": name}
            equations[f"output {name}"] = _reads(value) | _entering(faults, value, places)
    states = {f"x {name}" for name in signals.state_names}
    known = states | {f"d {name}" for name in signals.state_names}
    known |= {f"f {fault.name}" for fault in faults}
    found = {name: frozenset(each & known) for name, each in equations.items()}
    found |= {_absent(fault.name): frozenset({f"f {fault.name}"}) for fault in faults}
    return Structure(found, tuple(fault.name for fault in faults))


def value_of(state: str) -> Expression:
    """A sensor of the state itself."""
    return Expression(state, Name(state))


def rate_of(state: str) -> Expression:
    """A sensor of its derivative."""
    return Expression(f"d({state})", Call("d", (Name(state),)))


def _absent(fault: str) -> str:
    return f"no {fault}"


def _reads(expression: Expression) -> frozenset[str]:
    rates = {f"d {name}" for name in derivatives_used(expression)}
    return frozenset(rates | {f"x {name}" for name in names_used(expression)})


def _entering(
    faults: Iterable[Fault], expression: Expression, places: Mapping[str, str]
) -> frozenset[str]:
    """The faults that stand in an equation: of what it is of, and of what it reads."""
    inner = {*names_used(expression), *networks_used(expression)}
    return frozenset(
        f"f {fault.name}"
        for fault in faults
        if (
            places.get(fault.enters) == fault.target
            if fault.enters in ("state", "output", "output_gain")
            else fault.target in inner
        )
    )


def overdetermined(equations: Mapping[str, Iterable[str]]) -> frozenset[str]:
    """The equations of the overdetermined part."""
    names = list(equations)
    unknowns = {
        each: k for k, each in enumerate(sorted({u for e in equations.values() for u in e}))
    }
    if not unknowns:
        return frozenset(names)
    reads = [[unknowns[u] for u in equations[name]] for name in names]
    rows = np.repeat(np.arange(len(names)), [len(each) for each in reads])
    columns = np.concatenate([np.array(each, int) for each in reads])
    shape = (len(names), len(unknowns))
    graph = csr_array((np.ones(len(rows), int), (rows, columns)), shape=shape)
    solves = maximum_bipartite_matching(graph, perm_type="row")  # the equation of each unknown
    free = set(range(len(names))) - set(solves.tolist())
    reached, waiting = set(free), list(free)
    while waiting:
        for unknown in reads[waiting.pop()]:
            equation = int(solves[unknown])
            if equation >= 0 and equation not in reached:
                reached.add(equation)
                waiting.append(equation)
    return frozenset(names[k] for k in reached)
