"""What every run has of its own: values of the parameters that vary, and how some drift within."""

from typing import NamedTuple

import numpy as np

from faultgauge.identification.simulation_error.candidate import Candidate
from faultgauge.identification.simulation_error.data import Data

__all__ = ["Course", "PerRun", "along_runs"]

PerRun = dict[str, dict[str, float]]


class Course(NamedTuple):
    """A drifting parameter, in its unit, along a stretch of one run, at times t [s]."""

    run: str
    t: list[float]
    value: list[float]


def along_runs(best: Candidate, data: Data) -> tuple[PerRun, dict[str, list[Course]]]:
    """(every run's own value of every parameter that varies, the mean over its samples; the
    courses of those that drift, at the knots of their walks)."""
    unknowns, fitted = best.unknowns, best.fitted
    first, states = unknowns.weights(best.plant), fitted.x.shape[2]
    walk = data.drift.walk(fitted.x.shape[1])
    values: dict[str, dict[str, list[np.ndarray]]] = {}
    courses: dict[str, list[Course]] = {}
    for piece, own in zip(data.pieces, fitted.z, strict=True):
        record, samples = data.records[piece.record], np.arange(piece.stop - piece.start)
        increments = own[states + len(unknowns.varying) :].reshape(walk.shape[1:])
        drift = np.einsum("nks,ks->ns", walk[samples], increments)
        for j, k in enumerate(unknowns.varying):
            name = unknowns.parameters[k]
            theta = fitted.theta[first + k] + own[states + j] + np.zeros(len(samples))
            if k in unknowns.slow:
                theta += drift[:, unknowns.slow.index(k)]
            value = np.asarray(unknowns.parameter(k, theta))
            values.setdefault(name, {}).setdefault(record.run, []).append(value)
            if k in unknowns.slow:
                knots = np.unique(np.append(samples[:: data.drift.segment], samples[-1]))
                t = record.t[piece.start + knots].tolist()
                courses.setdefault(name, []).append(Course(record.run, t, value[knots].tolist()))
    means = {
        name: {run: float(np.mean(np.concatenate(each))) for run, each in runs.items()}
        for name, runs in values.items()
    }
    return means, courses
