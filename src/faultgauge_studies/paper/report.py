"""The report of `reproduce`: the paper's figures redrawn, and what stands beside them."""

from typing import Any

from faultgauge.reporting.report import Report, Section, Table
from faultgauge_studies.paper import comparison_section, figures, tables
from faultgauge_studies.paper.accommodating import measured
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.claims.registry import CLAIMS, ONCE, Claim
from faultgauge_studies.paper.goals import GOALS, Goal, found, met
from faultgauge_studies.paper.reproduce import Reproduction

__all__ = ["goal_rows", "paper_report", "wheel_sections"]

Rows = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]


def paper_report(found_: Reproduction) -> Report:
    """All of the study: figures of the first seed, numbers over all seeds."""
    results, seeds = found_.results, found_.seeds
    reached = sum(met(goal, results) for goal in GOALS)
    rmse = found(results, "fault_estimate.mode1_intermittent.iesonn.rmse")
    model = found(results, "identification.gbnnm.rmse")
    floor = found(results, "floor.rms_f")
    summary = (
        f"A friction fault in one reaction wheel of a satellite under control is estimated to "
        f"{_mean(rmse, 1e3)} mN·m (RMSE, median of {len(seeds)} seeds) by a model learned from "
        f"{found(results, 'coverage.noise_with_sweep.h_share')['median'] or 0:.0%} of the range "
        "of momentum in 1000 s.",
        f"The learned model's free run is off by {_mean(model, 1e3)} mN·m, where "
        f"{_mean(floor, 1e3)} mN·m are a disturbance inside the wheel that no model can know. "
        f"{reached} of {len(GOALS)} goals are met.",
    )
    header, rows = goal_rows(results)
    first = seeds[0]
    sections = (
        *wheel_sections(results, found_.first.traces),
        _other_logs(results, found_),
        _severity(results, found_),
        _mode_2(results, found_),
        _torque_form(results, found_),
        *comparison_section.sections(results, found_.first.traces),
        *(claim.section(results, found_.first.traces) for claim in _claims(results)),
        *measured.sections(results, found_.first.traces),
        Section(
            "How to read this",
            (
                f"Curves are of seed {first}; a number is the median over seeds {first} to "
                f"{seeds[-1]}, with the smallest and the largest in brackets. One seed is a whole "
                "experiment: noise, 10 restarts of the fit, selection on a second excitation "
                "record. Nothing is selected on the flights that are scored.",
                "Residuals of mode 2 are judged up to 700 s, where the paper's own figure ends: "
                "the loop is broken, and later the wheel runs to its greatest speed, far beyond "
                "what the experiment covered. The whole run stands in results.json as "
                "rmse_to_desired_whole_run.",
            ),
        ),
        _verdicts(results),
    )
    return Report(
        "The paper's reaction wheel, reproduced",
        summary,
        sections,
        Table(header, rows, f"Goals, over {len(seeds)} seeds"),
    )


def goal_rows(results: dict[str, Any]) -> Rows:
    """(header, rows): each goal, what was found, and whether it is met."""
    rows = [
        (
            goal.label,
            _span(found(results, goal.path), goal.unit),
            _bound(goal, results),
            goal.paper or "-",
            "met" if met(goal, results) else "MISSED",
        )
        for goal in GOALS
    ]
    return ("", "median [smallest, largest]", "goal", "paper", ""), tuple(rows)


def wheel_sections(results: dict[str, Any], traces: Traces) -> tuple[Section, ...]:
    """Experiment, flight, the paper's Figs 9 to 12, 14 and 15."""
    return (*_healthy(results, traces), *_residuals(results, traces), _estimates(results, traces))


def _healthy(results: dict[str, Any], traces: Traces) -> tuple[Section, ...]:
    return (
        Section(
            "Experiment and what was learned from it",
            (
                "Band-limited noise on the torque command, 0.005 to 0.4 Hz, while feedback sweeps "
                "the momentum up and down; 1000 samples at 1 Hz. All that the model knows of the "
                "wheel is that torque integrates to momentum. " + tables.reach(results),
            ),
            (),
            (
                *figures.coverage(traces),
                *figures.friction(traces),
            ),
        ),
        Section(
            "The fault-free flight",
            (
                "A slew of 64 degrees in pitch, then hold; the satellite enters the Earth's "
                f"shadow at {figures.shadow(traces):.0f} s and goes on without the Sun. The pitch "
                "wheel's torque has a standard deviation of "
                f"{found(results, 'flight.torque_sd')['median'] or 0:.3f} N·m, as the paper's "
                "table implies (0.37).",
            ),
            (),
            figures.flight(traces),
        ),
    )


def _residuals(results: dict[str, Any], traces: Traces) -> tuple[Section, ...]:
    return (
        Section(
            "Mode 2 (the paper's Figs 9, 10 and 12)",
            (
                "The torque output is stuck at d2 and the loop is broken. The residual shows the "
                "size at the onset and then grows with the loop's own action. "
                + tables.continuity(results),
            ),
            (tables.jump_table(results),),
            (
                figures.residual_stack(
                    traces, "mode2_sustained", "The paper's Fig 9", (400.0, 700.0)
                ),
                figures.command(traces, "mode2_sustained", (400.0, 700.0)),
                figures.residual_stack(
                    traces, "mode2_intermittent", "The paper's Fig 12", (400.0, 700.0)
                ),
            ),
        ),
        Section(
            "Mode 1 (the paper's Fig 11)",
            (
                "The free-running reference keeps a momentum that the wheel no longer has, so the "
                "residual decays while the fault lasts and does not return to zero after it. "
                "Against a reference that is given the measured momentum it does both.",
            ),
            (),
            (
                figures.residual_stack(
                    traces, "mode1_intermittent", "The paper's Fig 11", (400.0, 1000.0)
                ),
                figures.references(traces, "mode1_intermittent"),
            ),
        ),
    )


def _estimates(results: dict[str, Any], traces: Traces) -> Section:
    return Section(
        "Fault estimates (the paper's Figs 14 and 15)",
        (
            "ESO is the observer over the true wheel, IESONN the same observer over the "
            "learned one; both read the command and the momentum. Without noise in its "
            "telemetry the residual against measured states is quicker than any observer, but "
            "passes f(t) on whole; the observers filter it. The residual of the free-running "
            "reference is not an estimate of this fault.",
        ),
        (tables.estimate_table(results), tables.noise_table(results)),
        (
            figures.estimates(traces, "mode1_sustained", "The paper's Fig 14"),
            figures.estimates(traces, "mode1_intermittent", "The paper's Fig 15"),
            figures.estimate_errors(traces, "mode1_intermittent"),
            figures.noisy(traces, "mode1_intermittent"),
        ),
    )


def _other_logs(results: dict[str, Any], study: Reproduction) -> Section:
    return Section(
        "What other logs would have taught",
        (
            "The same fit from other healthy logs, scored on the same flight. Noise alone leaves "
            "the momentum near zero; normal operation hardly moves the command.",
        ),
        (tables.log_table(results),),
        (figures.log_bars(results),),
    )


def _severity(results: dict[str, Any], study: Reproduction) -> Section:
    offset = found(results, "severity.output_fault_rmse")
    return Section(
        "Residual and severity (eq 9)",
        (
            f"An offset on the output is the residual itself, r = d1, to {_mean(offset, 1e3)} mN·m "
            "RMSE, f(t) included. An offset on the input shows its size at the onset, "
            "then r = m2(d, t) also depends on time: the loop lowers the command by d, so the "
            "reference slows down, and where it passes zero speed its friction turns round.",
        ),
        (tables.severity_table(results),),
        (figures.severity(study.first.traces),),
    )


def _mode_2(results: dict[str, Any], study: Reproduction) -> Section:
    return Section(
        "Mode 2 as written and as said",
        (
            "As eq (18) writes it, only the output is overwritten: momentum goes on as commanded, "
            "and an observer closed on it sees nothing. The text says that the speed changes "
            "steadily, d(h)/dt = d2: then momentum and observer see it too.",
        ),
        (tables.channel_table(results),),
        (figures.channels(study.first.traces),),
    )


def _torque_form(results: dict[str, Any], study: Reproduction) -> Section:
    form = results["torque_form"]
    left = [form["momentum_error_left"][beta_1]["median"] for beta_1 in ("0.4", "1.6")]
    return Section(
        "Eq (11) closed on torque, as it is written",
        (
            "With y = c d(h) the observer's error has the matrix [[0, a], [0, -b]]: determinant "
            "0. The fault's error decays as a first-order lag of (1 + c beta_1)/(c beta_2); for "
            "c = -1, the sign of eq (18), it grows where beta_1 < 1, and at beta_1 = 1 the "
            "algebraic loop has no solution; beta_2 only scales the rate. The momentum's error is "
            f"never corrected: from 1 N·m·s off, {left[0]:+.2f} (beta_1 = 0.4) and "
            f"{left[1]:+.2f} N·m·s (1.6) are left. "
            "This is why the observers above are closed on momentum.",
        ),
        (),
        figures.torque_form(study.first.traces),
    )


def _claims(results: dict[str, Any]) -> tuple[Claim, ...]:
    """With `quick` none of them has been measured."""
    return () if results["quick"] else (*CLAIMS, *ONCE)


def _verdicts(results: dict[str, Any]) -> Section:
    """The last word on every claim, those that fail first."""
    verdicts = comparison_section.verdicts(results)
    verdicts += [claim.verdict(results) for claim in _claims(results)]
    found = sorted(verdicts, key=lambda verdict: verdict.holds)
    fallen = sum(not verdict.holds for verdict in found)
    rows = tuple((v.claim, "holds" if v.holds else "does not hold", v.found) for v in found)
    return Section(
        "Where the paper does not hold",
        (
            f"Of {len(found)} claims that can be put into numbers, {fallen} did not hold here. "
            "Each verdict is computed from the figures above.",
        ),
        (Table(("claim", "verdict", "what was found"), rows),),
    )


def _bound(goal: Goal, results: dict[str, Any]) -> str:
    bound = goal.bound
    if goal.times:
        bound *= found(results, goal.times)["median"] or 0.0
    sign = "≤" if goal.sense == "<=" else "≥"
    text = f"{sign} {bound:.6g}" if goal.unit == "" else f"{sign} {bound:.3g} {goal.unit}"
    return text.replace("*", "·").strip()


def _span(values: dict[str, float | None], unit: str) -> str:
    form = ".7f" if unit == "" and (values["median"] or 0.0) > 0.99 else ".3g"
    return tables.span(values, form, unit.replace("*", "·"))


def _mean(values: dict[str, float | None], factor: float) -> str:
    return f"{(values['median'] or 0.0) * factor:.3g}"
