"""What noise in the regressors does to a motor's inductance, and whether it is said."""

import html
import re

import numpy as np
import pytest
from scipy.linalg import expm

from faultgauge.reporting.report import render
from faultgauge.telemetry import Run
from faultgauge.verbs.fit import fit

MOTOR = """
name = "motor"
[states.i]
unit = "A"
derivative = "(v - R*i - K*w)/L"
[states.w]
unit = "rad/s"
derivative = "(K*i - 1e-4*w)/2e-4"
[inputs.v]
unit = "V"
hold = "zero"
[outputs.i]
value = "i"
[outputs.w]
value = "w"
[parameters]
R = { value = 0.5, min = 0.01, max = 10, unit = "ohm" }
L = { value = 1e-3, min = 1e-5, max = 1e-1, unit = "H" }
K = { value = 0.05, min = 0.001, max = 1, unit = "V*s" }
"""
# R stands in an output, too: the current's equation is then not fitted with simulated instruments
SENSED = MOTOR.replace("[parameters]", '[outputs.s]\nvalue = "R*i"\n[parameters]')
R, L, K, STEP, COUNT = 0.8, 1.5e-3, 0.06, 1e-3, 4000


def log(noise):
    """Exact under the hold; `noise` [A] in the current."""
    rng = np.random.default_rng(0)
    system = np.zeros((3, 3))
    system[:2] = [[-R / L, -K / L, 1 / L], [K / 2e-4, -1e-4 / 2e-4, 0.0]]
    moved = expm(system * STEP)[:2]
    v, x = np.repeat(rng.uniform(-3, 3, COUNT // 100), 100), np.zeros((COUNT, 2))
    for k in range(COUNT - 1):
        x[k + 1] = moved @ [*x[k], v[k]]
    y = x + [noise, 0.01] * rng.standard_normal(x.shape)
    columns = {"v": v, "i": y[:, 0], "w": y[:, 1], "s": R * x[:, 0]}
    return Run("a", "a.csv", STEP * np.arange(COUNT), columns)


def constant(found, name):
    return next(c for c in found.account.information.constants if c.name == name)


@pytest.mark.study
def test_a_bias_beyond_chance_is_said_beside_the_number():
    """The current settles within two samples, so that noise of 0.3 A hides what L does."""
    found = fit(SENSED, [log(0.3)], restarts=1)
    told, off = constant(found, "L"), found.parameters["L"] - L
    assert off > 3 * told.by_chance  # wrong, and by chance alone it would be tight
    assert off < 2 * told.standard_error  # noise hides fast motion, and spares slow one
    # the same noise once more does less where there is some already: half to all of it
    assert 0.4 * off < told.bias < 1.1 * off
    assert constant(found, "K").bias is None
    (warning,) = (each for each in found.warnings if "'L'" in each)
    assert "because of noise" in warning
    assert warning.endswith("use `faultgauge fit --refine`")
    # beside the number, and what to do, in the terminal, in JSON and in the report
    said = f"off by about {told.bias:+.2g} H because of noise: use --refine"
    (line,) = (each for each in found.lines if each.startswith("L = "))
    assert line.endswith(f" H ({said})")
    rows = {row["name"]: row for row in found.as_dict()["equation_error"]["parameters"]}
    assert (rows["L"]["bias"], rows["L"]["shift"]) == (told.bias, said)
    assert rows["K"]["bias"] is None
    assert said in html.unescape(re.sub(r"<[^>]+>|\s+", " ", render(found.page())))


def test_simulated_instruments_leave_no_bias():
    found = fit(MOTOR, [log(0.3)], restarts=1)
    assert [group.form for group in found.account.groups] == ["instrumental"]
    # a straight line between samples, of a current that settles in two: (1 ms / 1.9 ms)**2 / 12
    assert found.parameters["L"] == pytest.approx(L, rel=0.03)
    assert [c.bias for c in found.account.information.constants] == [None] * 3


def test_nothing_is_said_of_a_clean_log():
    found = fit(MOTOR, [log(0.0)], restarts=1)
    assert found.parameters["L"] == pytest.approx(L, rel=0.05)  # of the smoothing
    assert [c.bias for c in found.account.information.constants] == [None] * 3
    assert not any("noise" in each for each in found.warnings)
