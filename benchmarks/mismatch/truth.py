"""A plant as it is, simulated sample by sample: Runge-Kutta of fourth order in plain Python.

It shares nothing with faultgauge's simulator, so that a slip there cannot hide itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

__all__ = [
    "Acting",
    "Truth",
    "Vector",
    "coloured",
    "levels",
    "moves",
    "ramps",
    "rk4",
    "scattered",
    "simulate",
    "white",
]

Vector: TypeAlias = tuple[float, ...]


@dataclass(frozen=True)
class Truth:
    """A plant, what drives it and what is measured of it, for `len(disturbances)` samples.

    `rates(x, u, d)` are dx/dt at inputs u as they act and disturbances d, both held from sample to
    sample. Output k is state `sensors[k]`, or `sensors[k](x, d)`, plus `noise[:, k]`, rounded to
    multiples of `quantum[k]` (0: not rounded). `command(k, y)` gives the inputs of sample k from
    the measured outputs of samples 0 to k; `limits` (lo, hi) cut off what acts. Steps in s.
    """

    rates: Callable[[Vector, Vector, Vector], Vector]
    states: tuple[str, ...]
    start: Vector
    sensors: tuple[int | Callable[[Vector, Vector], float], ...]
    command: Callable[[int, Sequence[Vector]], Vector]
    limits: tuple[tuple[float, float], ...]
    disturbances: Float[np.ndarray, "samples disturbances"]
    noise: Float[np.ndarray, "samples outputs"]
    quantum: Vector
    step: float
    substeps: int


@dataclass(frozen=True)
class Acting:
    """A fault of `size` from `onset` [s] on, until `end`; `grows`: `size` per second from there.

    `enters` is a plant file's: "state" adds to a rate, "input" and "output" to a value; "gain"
    takes the share `size` of input `index`, "output_gain" of output `index` before its bias and
    noise. "disturbance" adds to one of the truth's disturbances.
    """

    enters: str
    index: int
    size: float
    onset: float
    grows: bool = False
    end: float = float("inf")

    def at(self, t: float) -> float:
        if not self.onset <= t < self.end:
            return 0.0
        return self.size * (t - self.onset) if self.grows else self.size


def rk4(rates: Callable[[Vector], Vector], x: Vector, step: float, substeps: int) -> Vector:
    """x after `step` seconds of dx/dt = rates(x), by `substeps` classical Runge-Kutta steps."""
    dt = step / substeps
    for _ in range(substeps):
        k1 = rates(x)
        k2 = rates(_moved(x, k1, dt / 2))
        k3 = rates(_moved(x, k2, dt / 2))
        k4 = rates(_moved(x, k3, dt))
        x = tuple(
            a + dt / 6 * (p + 2 * q + 2 * r + s)
            for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)
        )
    return x


def simulate(
    truth: Truth, faults: Sequence[Acting] = ()
) -> tuple[Float[np.ndarray, "samples inputs"], Float[np.ndarray, "samples outputs"]]:
    """(inputs as commanded, outputs as measured) of one record."""
    noise, disturbed = truth.noise.tolist(), truth.disturbances.tolist()
    x, commanded, measured = truth.start, list[Vector](), list[Vector]()
    for k, undisturbed in enumerate(disturbed):
        t = k * truth.step
        d = _moved(tuple(undisturbed), _entering(faults, "disturbance", t, len(undisturbed)), 1.0)
        bias = _entering(faults, "output", t, len(truth.sensors))
        lost = _entering(faults, "output_gain", t, len(truth.sensors))
        sensed = [x[each] if isinstance(each, int) else each(x, d) for each in truth.sensors]
        measured.append(
            tuple(
                _rounded(value * (1 - g) + b + v, q)
                for value, g, b, v, q in zip(
                    sensed, lost, bias, noise[k], truth.quantum, strict=True
                )
            )
        )
        u = truth.command(k, measured)
        commanded.append(u)
        x = rk4(_held(truth, faults, t, u, d), x, truth.step, truth.substeps)
    return np.array(commanded), np.array(measured)


def _held(
    truth: Truth, faults: Sequence[Acting], t: float, u: Vector, disturbance: Vector
) -> Callable[[Vector], Vector]:
    """dx/dt over the step from `t` on, with what is held over it."""
    lost, added = _entering(faults, "gain", t, len(u)), _entering(faults, "input", t, len(u))
    acting = tuple(
        min(max(a * (1 - g) + b, lo), hi)
        for a, g, b, (lo, hi) in zip(u, lost, added, truth.limits, strict=True)
    )
    driven = _entering(faults, "state", t, len(truth.states))
    if not any(driven):
        return lambda x: truth.rates(x, acting, disturbance)
    return lambda x: _moved(truth.rates(x, acting, disturbance), driven, 1.0)


def _entering(faults: Sequence[Acting], enters: str, t: float, count: int) -> Vector:
    """What enters each of `count` places at `t`."""
    found = [0.0] * count
    for each in faults:
        if each.enters == enters:
            found[each.index] += each.at(t)
    return tuple(found)


def _moved(x: Vector, rates: Vector, dt: float) -> Vector:
    return tuple(a + dt * r for a, r in zip(x, rates, strict=True))


def _rounded(value: float, quantum: float) -> float:
    return round(value / quantum) * quantum if quantum else value


def white(
    rng: np.random.Generator, samples: int, sd: Sequence[float]
) -> Float[np.ndarray, "samples columns"]:
    return rng.standard_normal((samples, len(sd))) * np.asarray(sd)


def coloured(
    rng: np.random.Generator, samples: int, step: float, sd: Sequence[float], time: float
) -> Float[np.ndarray, "samples columns"]:
    """Stationary Ornstein-Uhlenbeck processes of standard deviation `sd` and correlation `time`
    [s], exact at the samples:  v(k+1) = a v(k) + sd sqrt(1 - a^2) e(k),  a = exp(-step/time)."""
    fade = np.exp(-step / time)
    found = white(rng, samples, sd)
    for k in range(1, samples):
        found[k] = fade * found[k - 1] + np.sqrt(1 - fade**2) * found[k]
    return found


def scattered(rng: np.random.Generator, constants: Vector, sd: float) -> Vector:
    """`constants`, each times exp(sd e): what differs from run to run."""
    return tuple(each * float(np.exp(sd * rng.standard_normal())) for each in constants)


def levels(
    rng: np.random.Generator,
    samples: int,
    step: float,
    between: tuple[float, float],
    hold: tuple[float, float],
) -> list[float]:
    """A command that stands for a random time `hold` [s], then moves to a random level."""
    found = list[float]()
    while len(found) < samples:
        level = float(rng.uniform(*between))
        found += [level] * max(round(rng.uniform(*hold) / step), 1)
    return found[:samples]


def ramps(places: Sequence[float], most: float) -> list[float]:
    """What follows `places` by no more than `most` from sample to sample."""
    found = [places[0]]
    for place in places[1:]:
        found.append(found[-1] + min(max(place - found[-1], -most), most))
    return found


def moves(
    rng: np.random.Generator,
    samples: int,
    step: float,
    between: tuple[float, float],
    hold: tuple[float, float],
    rows: int,
    wave: float,
) -> Float[np.ndarray, "samples"]:
    """`levels`, between which each move takes so many `rows`, and a slow sine of size `wave`."""
    t = step * np.arange(samples)
    places = np.array(levels(rng, samples, step, between, hold))
    kernel, edge = np.hanning(rows), rows - 1
    smooth = np.convolve(np.pad(places, edge, mode="edge"), kernel / kernel.sum(), mode="same")
    sine = wave * np.sin(2 * np.pi * (rng.uniform(0.1, 0.4) * t + rng.uniform()))
    return smooth[edge : edge + samples] + sine
