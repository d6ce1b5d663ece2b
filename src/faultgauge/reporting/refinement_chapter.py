"""The chapter on the refinement: what was found, how surely, and what else was tried."""

from collections.abc import Collection

import numpy as np

from faultgauge.identification.constants import ConstantsInformation, FittedConstant
from faultgauge.identification.simulation_error.result import Refinement
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.style import quantity
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import curves

__all__ = ["correlation_table", "parameter_table", "refinement_section"]

MOST_CORRELATIONS = 20  # rows: the strongest pairs
MOST_TRIED = 40  # rows of the table of candidates
MOST_RUNS = 8  # whose own values are drawn
PARAMETERS = (
    "A parameter at its bound has the file's value, not the data's; one that a network can imitate "
    "is not identifiable; from some thousand samples on it has all that it can explain, and the "
    "network the rest."
)
REFITTED = (
    "Since the log is short, the best was then fitted to those data, too: parameters and standard "
    "errors are of all samples, errors on unseen data of the model before."
)


def refinement_section(found: Refinement) -> Section:
    """Parameters with standard errors, their correlations, and every candidate that was tried."""
    diverged = sum(not np.isfinite(error) for _, error in found.tried)
    losses = f"; {diverged} of them diverged" if diverged else ""
    after = (REFITTED,) if found.refitted else ()
    return Section(
        "Refinement by simulation error",
        (
            "The model was fitted to the outputs as sampled, by simulation through whole runs. "
            f"{len(found.tried)} candidates were run over data that no fit had seen, and the one "
            f"with the least error there was kept ({found.chosen}){losses}.",
            "A residual of a simulation is not white: a standard error counts "
            f"{found.information.residual_time:.3g} samples as one.",
            *after,
        ),
        (
            *parameter_table(found.information, PARAMETERS, found.per_run),
            *_per_run(found),
            *correlation_table(found.information),
            *_choices(found),
            _tried(found),
        ),
        tuple(_drift(found, name) for name in found.courses),
    )


def _tried(found: Refinement) -> Table:
    best = sorted(found.tried, key=lambda each: each[1])[:MOST_TRIED]
    rows = tuple(
        (name, f"{100 * error:.3f} %" if np.isfinite(error) else "diverges") for name, error in best
    )
    header = ("candidate", "free-run error on unseen data")
    return Table(header, rows, "What was tried, best first; shares of the outputs' spread.")


def parameter_table(
    found: ConstantsInformation, caption: str, varying: Collection[str] = ()
) -> tuple[Table, ...]:
    """Parameters; of the `varying` ones the value that they have in common has no error."""
    if not found.constants:
        return ()
    rows = tuple(
        (
            each.name,
            _value(each),
            "" if each.name in varying else _error(each),
            each.bound or "",
            each.imitated_by or "",
        )
        for each in found.constants
    )
    header = ("parameter", "value", "standard error", "at its bound", "imitated by")
    kept = [k for k in range(len(header)) if any(row[k] for row in rows)]
    cells = tuple(tuple(row[k] for k in kept) for row in rows)
    return (Table(tuple(header[k] for k in kept), cells, caption),)


def _per_run(found: Refinement) -> tuple[Table, ...]:
    units = {each.name: each.unit or "1" for each in found.information.constants}
    rows = tuple(
        (name, run, quantity(value, units.get(name, "1")))
        for name, runs in found.per_run.items()
        for run, value in runs.items()
    )
    header = ("parameter", "run", "its value there")
    caption = "Parameters with a value per run; the mean over it of one that drifts."
    return (Table(header, rows, caption),) if rows else ()


def _drift(found: Refinement, name: str) -> Figure:
    """How a drifting parameter went, run by run."""
    (unit,) = {each.unit or "1" for each in found.information.constants if each.name == name}
    shown = list(dict.fromkeys(course.run for course in found.courses[name]))[:MOST_RUNS]
    courses = [course for course in found.courses[name] if course.run in shown]
    t = np.unique(np.concatenate([course.t for course in courses]))
    values = {run: np.full(len(t), np.nan) for run in shown}
    for course in courses:
        within = (t >= course.t[0]) & (t <= course.t[-1])
        values[course.run][within] = np.interp(t[within], course.t, course.value)
    return curves(t, values, title=f"How {name} drifted", name=name, unit=unit)


def _value(each: FittedConstant) -> str:
    """To the second figure of its standard error."""
    figures = 3
    if each.standard_error and each.value:
        known = np.log10(abs(each.value) / each.standard_error)
        figures = int(np.clip(np.ceil(known) + 2, 3, 7))
    return quantity(each.value, each.unit or "1", figures)


def _error(each: FittedConstant) -> str:
    if each.standard_error is None:
        return ""
    unit = each.unit or "1"
    shift = "" if each.shift is None else f"; {each.shift}"
    return quantity(each.standard_error, unit) + shift


def correlation_table(found: ConstantsInformation) -> tuple[Table, ...]:
    """The pairs of constants that the logs tell apart least; none where no two are correlated."""
    names = [each.name for each in found.constants]
    pairs = [
        (float(found.correlation[i, j]), names[j], names[i])
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(found.correlation[i, j])
    ]
    if not pairs:
        return ()
    strongest = sorted(pairs, key=lambda pair: -abs(pair[0]))[:MOST_CORRELATIONS]
    rows = tuple((a, b, f"{value:+.3f}") for value, a, b in strongest)
    header = ("parameter", "and", "correlation of their errors")
    return (Table(header, rows, "Near +1 or -1 the logs cannot tell two parameters apart."),)


def _choices(found: Refinement) -> tuple[Table, ...]:
    rows = tuple(
        (name, key, str(value))
        for key, chosen in found.choices.items()
        for name, value in chosen.items()
    )
    caption = "What the plant file left open, chosen by the error on unseen data."
    return (Table(("name", "key", "chosen"), rows, caption),) if rows else ()
