"""What a plant that is not its model does to constants, and to their standard errors."""

import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import faultgauge as fg
from faultgauge.identification.constants import ConstantsInformation, FittedConstant
from faultgauge.identification.model_error import InOrder, band_scatter, delays
from faultgauge.reporting.report import render
from faultgauge.telemetry import Run

FILE = """
name = "first order"
[states.x]
unit = "m"
derivative = "b*u - a*x"
[inputs.u]
unit = "V"
hold = "zero"
[outputs.x]
unit = "m"
value = "x"
[parameters]
a = { value = 1.0, min = 0, unit = "1/s" }
b = { value = 1.0, unit = "m/(V*s)" }
"""
A, B, STEP, COUNT = 0.8, 2.5, 0.05, 1600
LAG = 0.3  # s, of a sensor


def log(seed, lag=0.0, noise=0.01):
    """x' = b u - a x under a zero-order hold, read through a lag and with noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, COUNT // 40), 40)
    fine = np.repeat(u, 10)  # the lag is stepped at a tenth of the samples
    decay, keep = np.exp(-A * STEP / 10), np.exp(-STEP / 10 / lag) if lag else 0.0
    x = lfilter([0, 1], [1, -decay], (1 - decay) / A * B * fine)
    seen = lfilter([1 - keep], [1, -keep], x)[::10]
    return Run(
        f"run{seed}",
        "a.csv",
        STEP * np.arange(COUNT),
        {"u": u, "x": seen + noise * rng.standard_normal(COUNT)},
    )


def along(r, *J, C=()):
    """A stretch at 1 Hz."""
    C = np.stack(C, axis=-1)[:, None] if C else np.zeros((len(r), 1, 0))
    return InOrder(r[:, None], np.stack(J, axis=-1)[:, None], C, 1.0)


def constants(found):
    known = found.account.refinement or found.account
    return {each.name: each for each in known.information.constants}


def assert_said(found, words):
    """One sentence of the terminal and JSON, with `words`; and beside each number, in the report
    as well, what slow and fast motion ask for."""
    (said,) = [text for text in found.warnings if text.startswith("slow and fast motion")]
    assert said == (
        f"slow and fast motion ask for other values of {words} than both together, so the plant "
        "does something that the file lacks, or noise in what the equations read moves them: the "
        "constants are this model's, and their standard errors hold by how much the values "
        "differ; compare with `faultgauge fit --refine` by `faultgauge evaluate` on a log that "
        "neither has seen, and add what the file lacks"
    )
    told = found.as_dict()
    assert said in told["warnings"]
    rows = {row["name"]: row for row in told["equation_error"]["parameters"]}
    page = html.unescape(re.sub(r"<[^>]+>|\s+", " ", render(found.page())))
    shown = [each for each in constants(found).values() if each.slow is not None]
    assert shown
    for each in shown:
        beside = f"slow motion asks for {each.slow:.3g}, fast for {each.fast:.3g} {each.unit}"
        assert rows[each.name]["shift"] == beside
        assert (rows[each.name]["slow"], rows[each.name]["fast"]) == (each.slow, each.fast)
        assert any(line.startswith(f"{each.name} = ") and beside in line for line in found.lines)
        assert beside in page


def test_the_scatter_of_slow_and_fast_motion():
    """One constant, for which slow motion, a share p of the information, asks for +1 and fast
    motion for -1: least squares has 2 p - 1, from which they are off by 2 - 2 p and 2 p."""
    rng = np.random.default_rng(0)
    t = np.arange(4000)
    phases = rng.uniform(0, 2 * np.pi, (2, 200))
    slow = np.sum(
        [
            np.cos(2 * np.pi * f * t + p)
            for f, p in zip(np.linspace(0.01, 0.1, 200), phases[0], strict=True)
        ],
        axis=0,
    )
    fast = 1.4 * np.sum(
        [
            np.cos(2 * np.pi * f * t + p)
            for f, p in zip(np.linspace(0.2, 0.4, 200), phases[1], strict=True)
        ],
        axis=0,
    )
    wanted = slow - fast  # the constant times (slow + fast) is to follow that
    parts = [along(-wanted[k], (slow + fast)[k]) for k in (slice(0, 2500), slice(2500, 4000))]
    p = np.sum(slow**2) / np.sum(slow**2 + fast**2)
    found = band_scatter(parts)
    # of eight bands one holds both
    np.testing.assert_allclose(found.off, [2 * np.sqrt(p * (1 - p))], rtol=0.08)
    # the faster half of the information is fast motion's, which asks for -1; p of the slower half's
    # 1/2 is slow motion's: (p - (1/2 - p)) / (1/2) = 4 p - 1; both about 2 p - 1
    np.testing.assert_allclose([found.slow, found.fast], [[2 * p], [-2 * p]], rtol=0.08)


@pytest.mark.parametrize("kind", ["white", "a derivative", "lasting"])
def test_chance_is_no_scatter(kind):
    """Two constants, of a walk and of what moves at once, beside residuals of three spectra."""
    rng, told = np.random.default_rng(1), 0
    for _ in range(200):
        white = rng.standard_normal(2001)
        r = {
            "white": white[1:],
            "a derivative": np.diff(white),
            "lasting": lfilter([1], [1, -0.9], white)[1:],
        }
        J = lfilter([1], [1, -0.98], rng.standard_normal(2000)), rng.standard_normal(2000)
        told += bool(np.any(band_scatter([along(r[kind], *J)]).off))
    assert told <= 2  # of 200, where one in a thousand is expected


def test_a_column_that_is_late_is_found():
    """z = 2 s, of which the first column comes 0.7 s late; both late alike are none."""
    rng = np.random.default_rng(2)
    s = lfilter([1, 2, 1], [4], lfilter([1], [1, -0.9], rng.standard_normal(5000)))
    rate = np.gradient(s)
    noise = 0.05 * rng.standard_normal(5000)
    r = -2 * 0.7 * rate + noise  # what a shift of the first column by 0.7 s takes away
    still = rng.standard_normal((2, 5000))
    found = delays([along(r, s, C=(2 * rate, *still))])
    assert found.sure.tolist() == [True, False, False]
    assert found.seconds[0] == pytest.approx(0.7, abs=4 * found.errors[0])
    assert found.errors[0] < 0.05
    together = delays([along(noise, s, C=(2 * rate, -2 * rate, *still))])
    assert not np.any(together.sure)
    assert not np.any(together.moved)


def test_a_lag_that_the_file_lacks():
    """Constants are off by many standard errors of chance and by few of those printed; the lag has
    its name and size, and every view has the same errors."""
    found = fg.fit(FILE, [log(0, LAG), log(1, LAG)], restarts=1)
    for name, true in (("a", A), ("b", B)):
        each = constants(found)[name]
        assert abs(each.value - true) > 5 * each.by_chance
        assert abs(each.value - true) < 2 * each.standard_error
        assert f"{name} = {each.value:.6g} +- {each.standard_error:.2g}" in str(found)
    (late,) = found.account.information.late
    assert (late.name, late.is_input) == ("x", False)
    assert late.seconds == pytest.approx(LAG, rel=0.2)
    (said,) = [text for text in found.warnings if "lacks a lag" in text]
    assert said.startswith(f"'x' comes about {late.seconds:.2g} s later than the plant file has it")
    a = constants(found)["a"]
    assert_said(found, f"a (slow motion asks for {a.slow:.3g}, fast for {a.fast:.3g} 1/s), b")
    told = json.loads(json.dumps(found.as_dict(), allow_nan=False))["equation_error"]
    errors = [each.standard_error for each in constants(found).values()]
    assert [row["standard_error"] for row in told["parameters"]] == errors
    assert found.model.record.constants.standard_errors == errors
    assert found.model.record.constants.errors == [c.by_chance for c in constants(found).values()]


def test_a_fit_that_contradicts_itself_says_what_whole_runs_err_by():
    """Beside the error of the short pieces that it held out, a seventh of each log."""
    logs = [log(0, LAG), log(1, LAG)]
    found = fg.fit(FILE, logs, restarts=1)
    told = fg.evaluate(found.model, logs).as_dict()["outputs"]["x"]["nrmse"]
    error, whole = found.model.record.metrics.free_run_error, STEP * (COUNT - 1)
    assert error < told
    assert str(found).splitlines()[-1] == (
        f"on held-out data the free run is off by {100 * error:.2f} % of the output's standard "
        f"deviation within {0.15 * whole:.4g} s, and by {100 * told:.2f} % in runs through whole "
        f"logs (up to {whole:.4g} s), in which small errors add up"
    )
    assert fg.fit(FILE, [log(0), log(1)], restarts=1).account.anew is None


def test_an_input_that_acts_later():
    """Beside two columns that do not: of two alone, either may be late."""
    run = log(0)
    x = run.columns["x"]
    z = STEP * np.cumsum(0.5 * (x + np.append(0.0, x[:-1])))
    moved = {"u": np.roll(run.columns["u"], -3), "x": x, "z": z}
    text = FILE.replace("[inputs.u]", '[states.z]\nderivative = "c*x"\n[inputs.u]')
    text += 'c = { value = 0.5 }\n[outputs.z]\nvalue = "z"\n'
    found = fg.fit(text, Run(run.name, run.source, run.t, moved), restarts=1)
    (late,) = found.account.information.late
    assert (late.name, late.is_input) == ("u", True)
    assert late.seconds == pytest.approx(3 * STEP, rel=0.4)
    assert any(text.startswith("the plant follows 'u' about") for text in found.warnings)


AXIS = """
name = "axis"
[states.w]
unit = "rad/s"
derivative = "k*u - b*w - c*tanh(w/0.1)"
[inputs.u]
unit = "V"
hold = "zero"
[outputs.w]
unit = "rad/s"
value = "w"
[parameters]
k = { value = 7, unit = "rad/s**2/V", min = 0.1 }
b = { value = 5, unit = "1/s", min = 0 }
c = { value = 8, unit = "rad/s**2", min = 0 }
"""
GAIN, DRIVE, SUBSTEPS = 8.0, 0.05, 10  # rad/s^2/V; s, of the drive


def axis(lag):
    """A drive's `lag` [s] before an axis with friction, by Euler's steps of 1 ms; 0: none."""
    rng, w, drive, seen = np.random.default_rng(0), 0.0, 0.0, []
    u, h = np.repeat(rng.uniform(-6, 6, 100), 40), 0.01 / SUBSTEPS
    for volts in u:
        seen.append(w)
        for _ in range(SUBSTEPS):
            drive = drive + h * (volts - drive) / lag if lag else volts
            w += h * (GAIN * drive - 6 * w - 10 * np.tanh(w / 0.1))
    noisy = np.array(seen) + 0.02 * rng.standard_normal(len(u))
    return Run("axis", "axis.csv", 0.01 * np.arange(len(u)), {"u": u, "w": noisy})


@pytest.mark.study
def test_simulated_instruments_have_them_too():
    """The file lacks the drive's lag, and the gain comes out far too low, by chance alone tight."""
    found = fg.fit(AXIS, axis(DRIVE), restarts=1)
    (group,) = found.account.groups
    assert group.form == "instrumental"
    k = constants(found)["k"]
    assert k.value < GAIN - 10 * k.by_chance
    assert k.value > GAIN - 3 * k.standard_error
    b = constants(found)["b"]
    assert_said(
        found,
        f"k (slow motion asks for {k.slow:.3g}, fast for {k.fast:.3g} rad/s**2/V), "
        f"b (slow motion asks for {b.slow:.3g}, fast for {b.fast:.3g} 1/s), c",
    )
    without = fg.fit(AXIS, axis(0.0), restarts=1)
    assert not any("slow and fast" in each for each in without.warnings)


@pytest.mark.study
def test_a_refinement_has_them_too():
    found = constants(fg.fit(FILE, log(0, LAG), restarts=1, refine=True))
    for name, true in (("a", A), ("b", B)):
        each = found[name]
        assert abs(each.value - true) > 5 * each.by_chance
        assert each.standard_error > 2 * each.by_chance


def test_noise_in_what_the_equations_read():
    """It biases the constants of fast motion, not those of slow motion."""
    found = constants(fg.fit(FILE, [log(k, noise=0.6) for k in range(4)], restarts=1))
    for name, true in (("a", A), ("b", B)):
        assert abs(found[name].value - true) < 3 * found[name].standard_error


def spoken(*named, refined=False):
    known = ConstantsInformation(named, np.eye(len(named)), (), 1.0, refined=refined)
    return [each for each in known.warnings() if each.startswith("slow and fast")]


def test_what_is_worth_a_word():
    """Errors of the model beyond half more than chance and 2 % of the value; a refinement knows no
    noise in what equations read, and is not told to refine."""
    off = FittedConstant("k", "V", 5.0, 0.4, None, None, by_chance=0.1, slow=4.0, fast=6.0)
    assert spoken(replace(off, by_chance=0.3)) == []
    assert spoken(replace(off, standard_error=0.09, by_chance=0.01)) == []
    (said,) = spoken(off, replace(off, name="c", slow=None, fast=None), refined=True)
    values = "k (slow motion asks for 4, fast for 6 V), c"
    assert said.startswith(f"slow and fast motion ask for other values of {values} than")
    assert "lacks: the constants" in said
    assert said.endswith("by how much the values differ; add what the file lacks")


@pytest.mark.parametrize(("value", "where"), [(0.005, "at"), (0.005187, "0.005187, next to")])
def test_a_value_that_is_not_quite_its_limit_is_said_beside_it(value, where):
    """Within a thousandth of the range up to 0.2, and another number than the file's."""
    leak = FittedConstant("leak", "kg/s", value, None, "min = 0.005", None)
    (said,) = ConstantsInformation((leak,), np.eye(1), (), 1.0).warnings()
    why = "its value is the file's bound, not the data's"
    assert said == f"parameter 'leak' is {where} its min = 0.005; {why}"


def test_a_plant_that_is_its_model_keeps_its_standard_errors():
    ratios = []
    for seed in range(12):
        found = fg.fit(FILE, log(seed), restarts=1)
        ratios += [c.standard_error / c.by_chance for c in constants(found).values()]
        assert not found.account.information.late
    assert np.median(ratios) == 1.0
    assert np.sum(np.array(ratios) > 1.3) <= 2
