"""Dead time: what was commanded some seconds ago acts now."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.telemetry.runs import ROUNDING, Run, gaps

__all__ = ["check_delays", "delayed"]


def delayed(run: Run, delays: Mapping[str, float], held: Collection[str]) -> Run:
    """`run` with u(t - delay) [s] in the columns that `delays` names.

    Inputs in `held` are constant from a sample to the next; the others run straight between two.
    NaN where the command is not known: before the first sample plus delay, and where it came
    within a gap or next to an empty cell.

    Raises `InputError` for a delay that leaves nothing of the run.
    """
    check_delays(run, delays)
    columns = dict(run.columns)
    for name, delay in delays.items():
        if delay:
            columns[name] = _shifted(run, name, delay, name in held)
    return replace(run, columns=columns)


def check_delays(run: Run, delays: Mapping[str, float]) -> None:
    """Raises `InputError` for a delay [s] that leaves nothing of the run."""
    lasts = float(run.t[-1] - run.t[0])
    for name, delay in delays.items():
        if delay and delay >= lasts:
            raise InputError(
                f"{run.source}: run {run.name!r} lasts {lasts:g} s, no longer than "
                f"the delay of input {name!r}, {delay:g} s; correct the delay or give a longer run."
            )


def _shifted(run: Run, name: str, delay: float, held: bool) -> Float[np.ndarray, "samples"]:
    """u(t - delay) of input `name`, NaN where it is not known.

    What was averaged over the intervals of a lower rate is averaged over the delayed ones, too.
    """
    t, u = run.t, run.columns[name]
    steps = np.diff(t)
    sought = t - delay
    # a delay of whole steps meets samples, but for the rounding of t
    left = np.searchsorted(t, sought + ROUNDING * run.step, side="right") - 1
    known = left >= 0
    left = np.clip(left, 0, len(steps) - 1)  # sought < t[-1], as the delay is not 0
    share = np.clip((sought - t[left]) / steps[left], 0.0, 1.0)
    met = np.abs(sought - t[left]) <= ROUNDING * run.step
    stays = held and run.resampled is None
    between = u[left] if stays else u[left] + share * (u[left + 1] - u[left])
    between = np.where(gaps(t, run.step)[left], np.nan, between)
    return np.where(known, np.where(met, u[left], between), np.nan)
