"""What a plant file leaves open, decided: holds of inputs and sizes of networks."""

from collections.abc import Mapping
from dataclasses import replace
from typing import cast, get_args

from faultgauge.plants.schema import MAX_HIDDEN
from faultgauge.plants.signals import Hold
from faultgauge.plants.spec import PlantSpec

__all__ = ["settle"]


def settle(
    spec: PlantSpec,
    holds: Mapping[str, str] = {},
    hidden: Mapping[str, int] = {},
    delays: Mapping[str, float] = {},
) -> PlantSpec:
    """`spec` with the `holds` and `delays` [s] of inputs and the `hidden` units of networks that
    were chosen.

    What is chosen is no longer open; the text of the file stays as it is. Raises `ValueError` for
    a name that is not open in `spec`, and for a value that no plant file may hold.
    """
    for name, hold in holds.items():
        if name not in spec.open_holds or hold not in get_args(Hold):
            raise ValueError(f"hold {hold!r} of input {name!r}")
    for name, delay in delays.items():
        if name not in spec.open_delays or not delay > 0:
            raise ValueError(f"delay {delay!r} of input {name!r}")
    for name, size in hidden.items():
        if name not in spec.open_sizes or not 1 <= size <= MAX_HIDDEN:
            raise ValueError(f"{size} hidden units of network {name!r}")
    inputs = tuple(
        replace(
            each,
            hold=cast(Hold, holds.get(each.name, each.hold)),
            delay=delays.get(each.name, each.delay),
        )
        for each in spec.signals.inputs
    )
    return replace(
        spec,
        signals=replace(spec.signals, inputs=inputs),
        networks=tuple(replace(n, hidden=hidden.get(n.name, n.hidden)) for n in spec.networks),
        open_holds=tuple(name for name in spec.open_holds if name not in holds),
        open_delays=tuple(name for name in spec.open_delays if name not in delays),
        open_sizes=tuple(name for name in spec.open_sizes if name not in hidden),
    )
