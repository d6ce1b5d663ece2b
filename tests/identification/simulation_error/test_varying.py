"""Parameters with a value per run: found from several runs, and for a new one from its warm-up."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.identification.validation.evaluation import evaluate, start_of_run
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

HEATER = """
name = "heater"
[states.T]
derivative = "b*u - a*T + 0.1"
[inputs.u]
hold = "zero"
[outputs.T]
value = "T"
[parameters]
a = { value = 0.5, min = 0 }
b = { value = 1.0, min = 0, vary = "VARY" }
"""
A, GROUPS, NOISE = 0.8, (1.5, 1.5, 3.0, 3.0), 0.02
STEP, COUNT = 0.1, 300


def plant(vary):
    return GrayBoxPlant.untrained(parse_plant(HEATER.replace("VARY", vary), "heater.toml"))


def run(seed, b):
    """T' = b u - 0.8 T + 0.1 under a zero-order hold: closed form."""
    rng = np.random.default_rng(seed)
    u, T, decay = np.repeat(rng.uniform(-2, 2, COUNT // 10), 10), np.zeros(COUNT), np.exp(-A * STEP)
    T[0] = 1.0
    for k in range(COUNT - 1):
        T[k + 1] = decay * T[k] + (1 - decay) / A * (b * u[k] + 0.1)
    noisy = T + NOISE * rng.standard_normal(COUNT)
    return Run(f"heat{seed}", "heat.csv", STEP * np.arange(COUNT), {"u": u, "T": noisy})


def of_run(model, log, samples=COUNT):
    """(b, a) that the model takes for this run from its first samples."""
    found, _ = start_of_run(
        model.plant,
        log.t[:samples],
        log.columns["u"][:samples, None],
        log.columns["T"][:samples, None],
        {"T": float(log.columns["T"][0])},
        model.max_step,
    )
    assert isinstance(found, GrayBoxPlant)
    return float(found.parameters["b"]), float(found.parameters["a"])


def exact_error(samples, log):
    """Standard error of b alone, in which T is linear, from the first samples."""
    unit, decay = np.zeros(samples), np.exp(-A * STEP)
    for k in range(samples - 1):
        unit[k + 1] = decay * unit[k] + (1 - decay) / A * log.columns["u"][k]
    return NOISE / np.linalg.norm(unit)


@pytest.fixture(scope="module", params=["run", "slow"])
def fitted(request):
    logs = [run(seed, b) for seed, b in enumerate(GROUPS)]
    return logs, *fit(plant(request.param), logs, restarts=3)


def test_what_is_shared_is_found_beside_what_is_not(fitted):
    _, model, report = fitted
    shared = next(c for c in report.refinement.information.constants if c.name == "a")
    assert abs(shared.value - A) < 4 * shared.standard_error  # beyond with 6e-5
    # white noise on 4 x 300 samples, of which the inputs move T by 0.7: a fraction of a percent
    assert 0 < shared.standard_error < 0.01 * A
    own = report.refinement.per_run["b"]
    for log, b in zip(fitted[0], GROUPS, strict=True):
        assert own[log.name] == pytest.approx(b, abs=4 * exact_error(COUNT, log) + 0.005 * b)
        # beside the error of b alone, that of the shared a: 0.2 % of the gain b / a
    # in the middle as the fit counts, by factors; a drifting one moves a little along each run
    middle = np.exp(np.mean(np.log(list(own.values()))))
    assert float(model.plant.parameters["b"]) == pytest.approx(middle, rel=0.01)


def test_each_group_has_its_own_value(fitted):
    logs, model, _ = fitted
    for log, b in zip(logs, GROUPS, strict=True):
        found, shared = of_run(model, log)
        # its own error, and that of T(0), a single noisy sample that is taken as the start: it
        # decays as exp(-0.8 t) and meets the inputs by chance, at most as large again
        assert abs(found - b) < 4 * 2 * exact_error(COUNT, log) + 0.005 * b
        assert shared == float(model.plant.parameters["a"])


@pytest.mark.parametrize("b", [1.0, 2.2, 4.5])
def test_a_new_run_takes_its_value_from_the_warm_up(fitted, b):
    """Also outside what the fitted runs had."""
    _, model, _ = fitted
    log = run(20, b)
    found, _ = of_run(model, log, 50)
    assert abs(found - b) < 4 * 2 * exact_error(50, log) + 0.005 * b  # as above
    table, (prediction,) = evaluate(model.plant, [log], model.max_step)
    assert prediction.warmup == 50
    # noise alone is left: 250 samples know it to 4.5 %, three of which are 13 %
    assert table["outputs"]["T"]["rmse"] == pytest.approx(NOISE, rel=0.15)


def test_one_program_finds_starts_around_any_value(tmp_path, monkeypatch):
    """What a run's own value is found around is no part of the program."""
    monkeypatch.setenv("FAULTGAUGE_PROGRAMS", str(tmp_path))
    log, found = run(20, 2.2), []
    for value in (1.0, 1.5, 3.0):
        there = plant("run").with_constants({"a": jnp.asarray(A), "b": jnp.asarray(value)})
        found.append(
            start_of_run(
                there,
                log.t[:47],
                log.columns["u"][:47, None],
                log.columns["T"][:47, None],
                {"T": 1.0},
                0.05,
            )[0].values()["b"]
        )
    assert len(list(tmp_path.glob("*.program"))) == 1
    # the prior is wide: all three lie on the least squares of 47 samples, 2.2 within 4 sd
    assert np.ptp(found) < 1e-4
    assert abs(found[0] - 2.2) < 4 * 2 * exact_error(47, log)


def test_varying_parameters_need_the_refinement():
    with pytest.raises(InputError, match=r"b of plant 'heater'.*simulation error only"):
        fit(plant("run"), [run(0, 1.5)], refine=False)


def drifting(seed, b):
    """`run` with b as it goes, one value to each sample."""
    rng = np.random.default_rng(seed)
    u, T, decay = np.repeat(rng.uniform(-2, 2, COUNT // 10), 10), np.zeros(COUNT), np.exp(-A * STEP)
    T[0] = 1.0
    for k in range(COUNT - 1):
        T[k + 1] = decay * T[k] + (1 - decay) / A * (b[k] * u[k] + 0.1)
    noisy = T + NOISE * rng.standard_normal(COUNT)
    return Run(f"heat{seed}", "heat.csv", STEP * np.arange(COUNT), {"u": u, "T": noisy})


SHARE = np.arange(COUNT) / COUNT
COURSES = {
    "sine": 2.0 + 0.6 * np.sin(2 * np.pi * SHARE),
    "ramp": 1.5 + 1.5 * SHARE,
    "constant": np.full(COUNT, 2.0),
}


# a ramp is the easier of two courses
RAMP = pytest.param("ramp", marks=pytest.mark.study)


@pytest.fixture(scope="module", params=["sine", RAMP, "constant"])
def drifted(request):
    b = COURSES[request.param]
    logs = [drifting(seed, b) for seed in range(3)]
    _, report = fit(plant("slow"), logs, restarts=3)
    return request.param, b, logs, report.refinement


def test_a_drift_within_a_run_is_followed(drifted):
    kind, b, logs, found = drifted
    shared = next(c for c in found.information.constants if c.name == "a")
    assert abs(shared.value - A) < 4 * shared.standard_error
    # as well known as without a drift (0.0007), but for 3 runs of 300 and 16 unknowns to each
    assert 0 < shared.standard_error < 0.005 * A
    for log, course in zip(logs, found.courses["b"], strict=True):
        assert course.run == log.name
        at = np.interp(log.t, course.t, course.value)
        # of a segment of 19 samples b alone is known to exact_error times sqrt(300 / 19); straight
        # lines over it are off a sine of 0.6 by h^2 / 8 * 0.6 (2 pi / 300)^2 = 0.012
        error = exact_error(COUNT, log) * np.sqrt(COUNT / 19) + 0.012
        assert np.sqrt(np.mean((at - b) ** 2)) < 1.5 * error
        assert found.per_run["b"][log.name] == pytest.approx(b.mean(), abs=error)
    if kind == "constant":  # the evidence leaves it where it is
        assert max(np.std(course.value) for course in found.courses["b"]) < 0.005
    else:
        assert min(np.std(course.value) for course in found.courses["b"]) > 0.9 * np.std(b)


SINE = pytest.param("sine", marks=pytest.mark.study)


@pytest.mark.parametrize("drifted", [SINE, RAMP, "constant"], indirect=True)
def test_one_value_per_run_spoils_what_a_drift_does_not(drifted):
    """The logs fitted with `vary = "run"`: off by many times the noise unless b is constant."""
    kind, _, logs, found = drifted
    _, report = fit(plant("run"), logs, restarts=3)
    share = NOISE / np.std(np.concatenate([log.columns["T"] for log in logs]))
    told = [each for each in report.warnings if "seems to change within the runs" in each]
    assert len(told) == (kind != "constant")
    assert all(each.startswith("parameter 'b' ") for each in told)
    changing = report.refinement.information.changing
    if kind == "constant":
        # of white noise 3 quarters of 3 runs explain 9 / 765; five times that is beyond chance
        assert max(changing.values()) < 0.06
        assert report.refinement.error == pytest.approx(share, rel=0.3)
        assert found.error < 1.05 * report.refinement.error
    else:
        assert report.refinement.error > 10 * share
        # values constant over the quarters of a run leave 1/16 of a ramp's variance and 1 - 8/pi^2
        # = 0.19 of a sine's
        assert changing["b"] > 0.75
        assert found.error < report.refinement.error / 2
        # the tail goes on from where the drift was last seen, and b moves on by up to a fifth


def test_courses_stand_in_the_record(drifted):
    _, _, logs, found = drifted
    told = found.metrics()["courses"]["b"]
    assert [each["run"] for each in told] == [log.name for log in logs]
    for each, log in zip(told, logs, strict=True):
        assert len(each["t"]) == len(each["value"]) == 17  # knots every 19 of 300 samples, and ends
        assert (each["t"][0], each["t"][-1]) == (log.t[0], log.t[-1])
