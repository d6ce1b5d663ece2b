"""Fitted parameters and what the data say about them, whichever way they were fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse.csgraph import connected_components

from faultgauge.identification.model_error import BandScatter
from faultgauge.identification.unknowns import WEIGHTS, Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import spoken
from faultgauge.plants.spec import Parameter

__all__ = [
    "ConstantsInformation",
    "FittedConstant",
    "LateColumn",
    "at_bound",
    "constants",
    "contradictions",
    "imitated",
    "shifted",
]

IMITATED = 0.99  # of what a parameter does to what is fitted, a network's weights can do too
ALIKE = 0.99  # correlation at which two parameters cannot be told apart
VAGUE = 0.1  # of a constant: a standard error worth a word
CONTRADICTED = 1.5  # times what chance does: less of a model's error is not worth a word
BIASED = 0.02  # of a parameter: less of a bias, or of a model's error, is not worth a word
CHANGES = 0.5  # of the squared error, to be worth a word
APART = 3.0  # standard errors of a difference, which chance does not reach
NEAR = 1e-3  # of the range: a parameter this near to a bound is at it
ROUNDING = 1e-16  # of a value: what numbers hold of it
FEW = 3.0  # samples: a state that follows within fewer is hardly known, and faults hide behind it


@dataclass(frozen=True)
class FittedConstant:
    """A fitted parameter: value, standard error and unit; `bound` names the bound it is at,
    `imitated_by` the network that can do what it does. The standard error holds what chance does to
    it from log to log, `by_chance`, and how far the model's errors move it; `bias` is how far noise
    in what the equations read has shifted it, where that is more than chance does; `slow` and
    `fast` are what slow and fast motion ask for, where they contradict each other."""

    name: str
    unit: str
    value: float
    standard_error: float | None
    bound: str | None
    imitated_by: str | None
    bias: float | None = None
    by_chance: float | None = None
    slow: float | None = None
    fast: float | None = None

    @property
    def lost(self) -> bool:
        """Whether its standard error would be below rounding, as slopes that have grown without
        end make it."""
        return self.standard_error is None and self.by_chance is not None

    @property
    def contradicted(self) -> bool:
        """Whether the model's errors move it further than chance does, and by a notable share."""
        if self.standard_error is None or self.by_chance is None:
            return False
        notable = max(CONTRADICTED * self.by_chance, BIASED * abs(self.value))
        return self.standard_error > notable

    @property
    def where(self) -> str:
        """How a value that has a `bound` lies to it: at it, or next to it and another number."""
        limit = float((self.bound or "= nan").split("= ")[1])
        at = f"{self.value:.4g}" == f"{limit:.4g}"
        return "at" if at else f"{self.value:.4g}, next to"

    @property
    def vague(self) -> bool:
        """Whether its standard error is more than a tenth of it."""
        return self.standard_error is not None and self.standard_error > VAGUE * abs(self.value)

    @property
    def asked(self) -> str | None:
        """What slow and fast motion ask for, where they contradict each other."""
        if self.slow is None:
            return None
        values = f"slow motion asks for {self.slow:.3g}, fast for {self.fast:.3g}"
        return f"{values} {spoken(self.unit)}".rstrip()

    @property
    def off(self) -> str:
        """By how much its value is biased."""
        return f"{self.bias:+.2g} {spoken(self.unit)}".rstrip()

    @property
    def shift(self) -> str | None:
        """What is to be known of a biased or contradicted value beside it, and what to do."""
        if self.bias is not None:
            return f"off by about {self.off} because of noise: use --refine"
        return self.asked


@dataclass(frozen=True)
class LateColumn:
    """A column that comes later than the file has it, or an input that acts later: seconds, their
    standard error, and how many samples that is."""

    name: str
    seconds: float
    error: float
    is_input: bool
    samples: float

    def __str__(self) -> str:
        who = f"the plant follows {self.name!r}" if self.is_input else f"{self.name!r} comes"
        return f"{who} about {self.seconds:.2g} s later"


@dataclass(frozen=True)
class ConstantsInformation:
    """Constants, their correlations (NaN: not known), and combinations of states that no output
    shows; whether networks were kept from what they could imitate; whether by simulation error; by
    which share the squared error would fall if a parameter changed along the logs (see
    `constancy`)."""

    constants: tuple[FittedConstant, ...]
    correlation: Float[np.ndarray, "constants constants"]
    unseen: tuple[str, ...]
    residual_time: float
    kept_apart: bool = False
    refined: bool = False
    changing: dict[str, float] = field(default_factory=dict)
    late: tuple[LateColumn, ...] = ()

    def warnings(self) -> list[str]:
        """What somebody who reads the numbers should know, a sentence each."""
        found = []
        for each in self.constants:
            if each.bound:
                found.append(
                    f"parameter {each.name!r} is {each.where} its {each.bound}; its value is the "
                    "file's bound, not the data's"
                )
            elif each.standard_error is None and each.by_chance is None:
                found.append(
                    f"parameter {each.name!r} moves no equation that these logs show, so that its "
                    f"value, {each.value:g}, is not the data's; give a log in which it matters, a "
                    "column to the output that it stands in if that has none (--map "
                    "OUTPUT=EXPRESSION), or fix it"
                )
            if each.bias is not None:
                found.append(
                    f"parameter {each.name!r} is off by about {each.off} "
                    f"({100 * abs(each.bias / each.value):.0f} %) because of noise in what "
                    "its equation reads, further than chance moves it; use "
                    "`faultgauge fit --refine`"
                )
            if each.imitated_by:
                both = (
                    "can imitate it, and was kept from it: the parameter got all that either can "
                    "explain, which is too much if some of it is the network's"
                    if self.kept_apart
                    else "can imitate it"
                )
                found.append(
                    f"parameter {each.name!r} is not identifiable: network {each.imitated_by!r} "
                    f"{both}; fix it, or leave its part to the network"
                )
        found += self._lost()
        found += self._alike()
        found += self._of_model_error()
        best = max(self.changing, key=self.changing.__getitem__, default="")
        if best and self.changing[best] > CHANGES:
            found.append(
                f"parameter {best!r} seems to change within the runs or between them: that would "
                f"explain {100 * min(self.changing[best], 1.0):.0f} % of the squared error; if "
                "it may, say "
                'vary = "slow" or "run", if not, the model lacks something that looks like it'
            )
        for direction in self.unseen:
            found.append(
                f"the outputs do not show {direction}: no log can tell where it starts; measure "
                "one of these states, or leave it out"
            )
        return found

    def _lost(self) -> list[str]:
        """A sentence for those whose standard errors are lost."""
        lost = [each.name for each in self.constants if each.lost]
        if not lost:
            return []
        return [
            f"the standard errors of {', '.join(lost)} cannot be told: in a run through these logs "
            "the smallest change of a constant grows without end, so the plant is unstable where "
            "it is, or far quicker than the rows; a curve may be too steep, such as a tanh with a "
            "small scale: give what rounds it a larger min"
        ]

    def _alike(self) -> list[str]:
        """A sentence for those that only a combination of is known, however many."""
        vague = np.array([each.vague for each in self.constants], bool)
        close = (np.abs(np.nan_to_num(self.correlation)) > ALIKE) & np.outer(vague, vague)
        count, member = connected_components(close, directed=False)
        found = []
        for group in (np.flatnonzero(member == k) for k in range(count)):
            if len(group) > 1:
                *first, last = (repr(self.constants[k].name) for k in group)
                told = self.correlation[np.ix_(group, group)][np.triu_indices(len(group), 1)]
                how = (
                    f"correlation {told[0]:+.3f}"
                    if len(group) == 2
                    else f"correlations up to {np.max(np.abs(told)):.3f}"
                )
                found.append(
                    f"parameters {', '.join(first)} and {last} cannot be told apart by these logs "
                    f"({how}); fix one of them"
                )
        return found

    def _of_model_error(self) -> list[str]:
        found = []
        short = [each for each in self.late if each.samples < FEW]
        long = [each for each in self.late if each.samples >= FEW]
        lacks = "than the plant file has it: it lacks a lag or a delay, which moves the constants"
        if long:
            found.append(
                f"{', '.join(map(str, long))} {lacks}; add it as a state, or give delay in "
                "[inputs.NAME]"
            )
        if short:
            found.append(
                f"{', '.join(map(str, short))} {lacks}. It is of less than three samples, for "
                "which, and for what it does to the constants, `calibrate` allows: give it no "
                "state, since faults are harder to see behind one that follows so fast"
            )
        told = [each for each in self.constants if each.contradicted]
        if told:
            named = [f"{e.name} ({e.asked})" if e.asked else e.name for e in told]
            noise = "" if self.refined else ", or noise in what the equations read moves them"
            compare = (
                ""
                if self.refined
                else "compare with `faultgauge fit --refine` by `faultgauge evaluate` on a log "
                "that neither has seen, and "
            )
            found.append(
                f"slow and fast motion ask for other values of {', '.join(named)} than both "
                f"together, so the plant does something that the file lacks{noise}: the constants "
                "are this model's, and their standard errors hold by how much the values differ; "
                f"{compare}add what the file lacks"
            )
        return found

    def for_bank(self) -> dict[str, Any]:
        """How uncertain the constants are, for whoever uses the model: by chance, as `calibrate`
        finds the model's errors itself, and in all."""
        return {
            "names": [each.name for each in self.constants],
            "errors": [each.by_chance for each in self.constants],
            "standard_errors": [each.standard_error for each in self.constants],
            "correlation": self.to_dict()["correlation"],
        }

    def to_dict(self) -> dict[str, Any]:
        rows = [vars(each) | {"shift": each.shift} for each in self.constants]
        return {
            "parameters": rows,
            "correlation": [
                [None if np.isnan(each) else each for each in row]
                for row in np.round(self.correlation, 6).tolist()
            ],
            "unseen": list(self.unseen),
            "late": [vars(each) for each in self.late],
            "changing": self.changing,
            "residual_time_samples": self.residual_time,
        }


def contradictions(
    by_equations: Sequence[FittedConstant], refined: Sequence[FittedConstant]
) -> list[str]:
    """A sentence for each parameter on which equation error and simulation error contradict each
    other: by more than `APART` of both standard errors."""
    found = []
    for one, other in zip(by_equations, refined, strict=True):
        if one.standard_error is None or other.standard_error is None:
            continue
        if abs(one.value - other.value) > APART * np.hypot(
            one.standard_error, other.standard_error
        ):
            found.append(
                f"parameter {other.name!r} is {other.value:.3g} +- {other.standard_error:.2g} by "
                f"simulation error and {one.value:.3g} +- {one.standard_error:.2g} by equation "
                "error, too far apart for either standard error: what disturbs the plant, or a "
                "loop that answers it, biases one of them at least; compare what --no-refine gives"
            )
    return found


def constants(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "unknowns"],
    covariance: Float[np.ndarray, "parameters parameters"],
    imitated_by: Sequence[str | None],
    off: BandScatter,
) -> tuple[tuple[FittedConstant, ...], Float[np.ndarray, "parameters parameters"]]:
    """(the parameters at `theta`, their correlations), with the covariance of their theta (NaN:
    not known), and how far the model's errors move it, `off`."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = np.where(np.outer(sd, sd) == 0, 0.0, covariance / np.outer(sd, sd))
    np.fill_diagonal(correlations, 1.0)
    own = theta[unknowns.weights(plant) :]
    found = tuple(
        _constant(plant, unknowns, own, k, float(sd[k]), off, imitated_by[k])
        for k in range(len(unknowns.parameters))
    )
    return found, correlations


def _constant(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "parameters"],
    k: int,
    sd: float,
    off: BandScatter,
    imitated: str | None,
) -> FittedConstant:
    name = unknowns.parameters[k]
    spec = next(p for p in plant.spec.parameters if p.name == name)
    center, scale = unknowns.centers[k], unknowns.scales[k]
    value = center * np.exp(scale * theta[k]) if unknowns.positive[k] else center + scale * theta[k]
    slope = abs(value) * scale if unknowns.positive[k] else scale
    bound = _bound(spec, float(value))
    chance = None if bound or np.isnan(sd) else float(slope * sd)
    if chance is None or 0 < chance < ROUNDING * abs(value):
        error = None
    else:
        error = float(np.hypot(chance, slope * off.off[k]))
    found = FittedConstant(name, spec.unit, float(value), error, bound, imitated, by_chance=chance)
    if not found.contradicted or off.slow[k] == off.fast[k]:
        return found
    asked = np.clip(value + slope * np.array([off.slow[k], off.fast[k]]), spec.min, spec.max)
    return replace(found, slow=float(asked[0]), fast=float(asked[1]))


def _bound(spec: Parameter, value: float) -> str | None:
    """The bound that `value` is at."""
    width = spec.max - spec.min
    if not np.isfinite(width):  # a positive one that went to 0 is at it, not merely small
        width = max(abs(value), NEAR * abs(spec.value))
    if value - spec.min <= NEAR * width:
        return f"min = {spec.min:g}"
    return f"max = {spec.max:g}" if spec.max - value <= NEAR * width else None


def shifted(
    found: Sequence[FittedConstant], before: GrayBoxPlant, after: GrayBoxPlant
) -> tuple[FittedConstant, ...]:
    """`found` with the bias that takes `before` to `after`, where it is worth a word."""

    def bias(each: FittedConstant) -> float | None:
        moved = float(after.parameters[each.name] - before.parameters[each.name])
        if each.by_chance is None or not np.isfinite(moved):
            return None
        notable = max(each.by_chance, BIASED * abs(each.value))
        return moved if abs(moved) > notable else None

    return tuple(replace(each, bias=bias(each)) for each in found)


def at_bound(plant: GrayBoxPlant, unknowns: Unknowns) -> Bool[np.ndarray, "parameters"]:
    """Which of the unknown parameters are at a bound of theirs."""
    specs = {p.name: p for p in plant.spec.parameters}
    bounds = [_bound(specs[n], float(plant.parameters[n])) for n in unknowns.parameters]
    return np.array([bound is not None for bound in bounds])


def imitated(
    plant: GrayBoxPlant, unknowns: Unknowns, hessian: Float[np.ndarray, "n n"]
) -> list[str | None]:
    """For every parameter the network whose weights span what it does to what is fitted."""
    found: list[str | None] = []
    first = unknowns.weights(plant)
    spans, start = {}, 0
    for name in unknowns.networks:
        size = sum(getattr(plant.networks[name], f).size for f in WEIGHTS)
        spans[name] = slice(start, start + size)
        start += size
    for k in range(first, first + len(unknowns.parameters)):
        own = hessian[k, k]
        shares = {}
        for name, span in spans.items():
            block = hessian[span, span] + 1e-9 * np.trace(hessian[span, span]) * np.eye(
                span.stop - span.start
            )
            cross = hessian[span, k]
            if own > 0 and np.trace(block) > 0:
                shares[name] = float(cross @ np.linalg.solve(block, cross) / own)
        name = max(shares, key=lambda n: shares[n]) if shares else None
        found.append(name if name is not None and shares[name] > IMITATED else None)
    return found
