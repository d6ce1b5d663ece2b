"""Every place where a fault may enter, so that one compiled program serves whatever comes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.plants.plant import Stuck
from faultgauge.plants.signals import INNER, LOSSES, Fault, Signals
from faultgauge.simulation.schedules import Schedule, inject

__all__ = ["Happening", "every_channel", "happening"]


class Happening(NamedTuple):
    """What schedules do on a time grid: sizes by channel, stuck ones, outputs without a sample."""

    f: Float[np.ndarray, "*grid channels"]
    stuck: Stuck
    dropped: Bool[np.ndarray, "*grid outputs"]


def every_channel(signals: Signals) -> tuple[Fault, ...]:
    """An additive fault on every state, input and output, a gain loss on every input and output,
    and what the plant's own faults do to parameters and networks."""
    own = (f for f in signals.faults if f.enters in INNER)
    inner = {
        (f.enters, f.target, f.relative): Fault(
            f"{f.enters} {f.target}", f.enters, f.target, relative=f.relative
        )
        for f in own
    }
    return (
        *(Fault(f"state {name}", "state", name) for name in signals.state_names),
        *(Fault(f"input {name}", "input", name) for name in signals.input_names),
        *(Fault(f"gain {name}", "gain", name) for name in signals.input_names),
        *(Fault(f"output {name}", "output", name) for name in signals.output_names),
        *(Fault(f"output_gain {name}", "output_gain", name) for name in signals.output_names),
        *inner.values(),
    )


def happening(
    schedules: Sequence[Schedule], signals: Signals, times: Float[np.ndarray, "*grid"]
) -> Happening:
    """What `schedules` do at `times` [s]; sizes on the channels that `every_channel` lists."""
    channels = every_channel(signals)
    injection = inject(schedules, signals, times)
    f = np.zeros((*times.shape, len(channels)))
    place = {(c.enters, c.target, c.relative): k for k, c in enumerate(channels)}
    for fault, sizes in zip(injection.faults, np.moveaxis(injection.f, -1, 0), strict=True):
        k = place[fault.enters, fault.target, fault.relative]
        if fault.enters in LOSSES:  # they multiply: 1 - f = (1 - f1)(1 - f2)
            f[..., k] += sizes * (1 - f[..., k])
        elif fault.relative:  # 1 + f = (1 + f1)(1 + f2)
            f[..., k] += sizes * (1 + f[..., k])
        else:
            f[..., k] += sizes
    return Happening(f, injection.stuck, injection.dropped)
