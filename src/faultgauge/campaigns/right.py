"""Which answer is right: what the judge calls a kind of fault, and whether it knows its size."""

from collections.abc import Sequence
from typing import NamedTuple

from faultgauge.campaigns.schema import Kind, Plan
from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.signals import Fault
from faultgauge.rehearsal.judging import UNKNOWN
from faultgauge.simulation.schedules import Schedule

__all__ = ["Right", "right_of"]


class Right(NamedTuple):
    """The `names` that count as right, none where nothing should be named; `sized` is the one among
    them that is the very fault that was put in, so that its size can be told from the truth."""

    names: tuple[str, ...]
    sized: str | None

    @property
    def name(self) -> str:
        """The one that stands for all."""
        return self.names[0]


def right_of(plan: Plan, faults: Sequence[Fault]) -> dict[str, Right]:
    """By kind, where the judge declares `faults`. Raises `InputError` for a name that it does not
    have, and for a pair of which both go by one name."""
    declared = {each.name: each for each in faults if each.monitor != "disabled"}
    found = {}
    for (kind,) in (group for group in plan.kinds if len(group) == 1):
        schedule = kind.schedule(plan.scenario, 1.0, plan.onset.values[0])
        same = [n for n, each in declared.items() if _same(each, schedule)]
        names = _names(plan, kind, same, declared)
        sized = next((name for name in names if name in same), None)
        found[kind.name] = Right(names, sized)
    for group in (group for group in plan.kinds if len(group) == 2):
        one, other = (set(found[each.name].names) for each in group)
        if one & other:
            raise InputError(
                f"{plan.source}: pairs: {group[0].name} and {group[1].name} both go by the name "
                f"{min(one & other)!r}, so nobody can tell whether both were named; leave it out."
            )
    return found


def _names(
    plan: Plan, kind: Kind, same: Sequence[str], declared: dict[str, Fault]
) -> tuple[str, ...]:
    if kind.named is not None:
        for name in kind.named:
            if name not in (*declared, UNKNOWN):
                what = unknown("fault", name, [*declared, UNKNOWN])
                raise InputError(f"{plan.source}: [faults.{kind.name}] named: {what}.")
        return kind.named
    if kind.name in declared:
        return (kind.name,)
    return (same[0] if same else UNKNOWN,)


def _same(fault: Fault, schedule: Schedule) -> bool:
    mine = fault.enters, fault.target, fault.relative
    return schedule.effect == "add" and mine == (
        schedule.enters,
        schedule.target,
        schedule.relative,
    )
