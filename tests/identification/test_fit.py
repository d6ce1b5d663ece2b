"""`fit` from log to model, on plants whose truth is known."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import save_model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run, cut

FIRST_ORDER = """
name = "first order"
[states.x]
derivative = "b*u - a*x"
[inputs.u]
[outputs.x]
value = "x"
[parameters]
a = { value = 1.0, min = 0 }
b = { value = 1.0 }
"""
FRICTION = """
name = "cart"
[states.v]
derivative = "k*u - friction(v)"
[inputs.u]
[outputs.v]
value = "v"
[parameters]
k = { value = 1.0 }
[networks.friction]
hidden = 4
"""
STEP = 0.05


def plant(text):
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


def staircase(count, seed, width=20):
    steps = np.random.default_rng(seed).uniform(-2, 2, count // width)
    return np.repeat(steps, width)


def first_order(count=400, seed=0, a=0.8, b=2.5):
    """x' = b u - a x under a zero-order hold, sampled: closed form."""
    u, x, decay = staircase(count, seed), np.zeros(count), np.exp(-a * STEP)
    for k in range(count - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / a * b * u[k]
    return Run(f"run{seed}", "a.csv", STEP * np.arange(count), {"u": u, "x": x})


def friction(v):
    return 0.3 * v + 0.8 * np.tanh(3 * v)


def cart(count=1600, seed=0, width=20, scale=1.0):
    """v' = 2 u - friction(v), integrated by SciPy over every stair."""
    u, v = scale * staircase(count, seed), np.zeros(count)
    ticks = STEP * np.arange(width + 1)
    for first in range(0, count, width):
        piece = solve_ivp(
            lambda t, x, drive: 2 * drive - friction(x),
            (0, ticks[-1]),
            v[first : first + 1],
            t_eval=ticks,
            args=(u[first],),
            rtol=1e-8,
            atol=1e-10,
        )
        v[first : first + width + 1] = piece.y[0, : count - first]
    return Run(f"cart{seed}", "cart.csv", STEP * np.arange(count), {"u": u, "v": v})


@pytest.fixture(scope="module")
def cart_fits():
    """The same fit twice."""
    log = cart()
    return [fit(plant(FRICTION), [log], seed=4, restarts=3) for _ in range(2)]


def test_parameter_and_network_are_recovered(cart_fits):
    model, report = cart_fits[0]
    # What is left: the trapezoid on the friction, (STEP 2.7)^2 / 12 = 0.15 % where it is steepest
    assert float(model.plant.parameters["k"]) == pytest.approx(2.0, rel=2e-3)
    low, high = model.record.envelope["v"]
    assert low < -2
    assert high > 2
    v = np.linspace(0.95 * low, 0.95 * high, 41)
    learned = np.array([float(model.plant.networks["friction"](jnp.asarray(p))) for p in v])
    # 0.15 % of 2.2, and four units that stand for a line and a tanh: a hundredth of the range
    np.testing.assert_allclose(learned, friction(v), rtol=0, atol=0.01 * np.ptp(friction(v)))
    assert [g.group.name for g in report.groups] == ["friction, k"]
    assert report.warnings == []


def test_free_run_of_the_fitted_cart(cart_fits):
    """On a log it has not seen, by SciPy again and from the model's own numbers."""
    model, _ = cart_fits[0]
    log = cart(400, seed=9, scale=0.7)  # inside the envelope
    v, network, k = log.columns["v"], model.plant.networks["friction"], model.plant.parameters["k"]
    W = {name: np.asarray(value) for name, value in vars(network).items()}

    def learned(x):
        scaled = np.clip((x - W["input_center"]) / W["input_scale"], -1, 1)
        hidden = np.tanh(W["weights_in"] @ scaled + W["bias"])
        return W["output_center"] + W["output_scale"] * (W["weights_out"] @ hidden + W["bias_out"])

    free, h = [v[:1]], STEP / 4
    for drive in log.columns["u"][:-1]:
        x = free[-1]
        for _ in range(4):
            half = x + h / 2 * (float(k) * drive - learned(x))
            x = x + h * (float(k) * drive - learned(half))
        free.append(x)
    error = np.concatenate(free) - v
    assert np.std(error) < 0.01 * np.std(v)  # a third of the friction's tolerance


def test_same_seed_same_bytes(cart_fits, tmp_path):
    for k, (model, _) in enumerate(cart_fits):
        save_model(model, tmp_path / f"{k}.fgm")
    assert (tmp_path / "0.fgm").read_bytes() == (tmp_path / "1.fgm").read_bytes()


def test_record_tells_what_was_done(cart_fits):
    model, report = cart_fits[0]
    record = model.record.as_dict()
    assert record["seed"] == 4
    assert record["sample_time"] == pytest.approx(STEP, rel=1e-12)
    assert record["data"] == {"fit": [cart().content_hash], "validate": []}
    (group,) = record["metrics"]["groups"]
    assert group["starts"] == 3
    # one group: what selected it is what the whole model scores
    assert group["free_run_nrmse"] == pytest.approx(
        record["metrics"]["validation_free_run_nrmse"], rel=1e-6
    )
    assert group["free_run_nrmse"] == np.min(report.groups[0].free_run)
    # the fastest rate is friction's slope at rest, 0.3 + 2.4 = 2.7 1/s
    assert record["max_step"] == pytest.approx(0.5 / 2.7, rel=0.1)
    assert record["columns"] == {"states": [["v", 0]], "outputs": ["v"]}


def test_linear_plant_to_the_trapezoids_error():
    model, _ = fit(plant(FIRST_ORDER), [first_order()], restarts=2)
    # (a STEP)^2 / 12 = 1.3e-4, relative, is what the trapezoid on x costs
    assert float(model.plant.parameters["a"]) == pytest.approx(0.8, rel=3e-4)
    assert float(model.plant.parameters["b"]) == pytest.approx(2.5, rel=3e-4)


def test_doubled_run_is_for_validation_only():
    first, second, third = (first_order(seed=s) for s in (1, 2, 3))
    both, report = fit(plant(FIRST_ORDER), [first, second], [second, third], restarts=2)
    assert report.warnings == [
        "run2: given for fitting and for validation; used for validation only"
    ]
    alone, quiet = fit(plant(FIRST_ORDER), [first], [second, third], restarts=2)
    assert quiet.warnings == []
    assert both.record == alone.record
    assert both.record.data.fit == [first.content_hash]
    assert both.record.data.validate_ == sorted([second.content_hash, third.content_hash])
    for name in "ab":
        assert float(both.plant.parameters[name]) == float(alone.plant.parameters[name])
    with pytest.raises(InputError, match="no run is left to fit"):
        fit(plant(FIRST_ORDER), [first], [first])


def test_training_takes_nothing_from_validation():
    """A validation log from another plant changes where the search stops, not what it fits."""
    log = first_order(seed=1)
    _, report = fit(plant(FIRST_ORDER), [log], [first_order(seed=2, a=1.2)], restarts=2)
    reach = round(report.noise["x"]["window_s"] / np.median(np.diff(log.t)) / 2)
    assert len(report.training.x) == 400 - 2 * reach
    # smoothed x lies between the smallest and largest of the log itself
    assert report.training.x.max() <= log.columns["x"].max()


def test_the_plants_warnings_are_passed_on():
    text = FIRST_ORDER.replace("[parameters]", "[parameters]\nidle = { value = 1 }")
    _, report = fit(plant(text), [first_order()], restarts=2)
    assert any("idle" in warning for warning in report.warnings)


@pytest.mark.study  # refined alone: test_bad_input.py
@pytest.mark.parametrize("end", ["max = 2.0", "min = 3"])
def test_a_parameter_at_its_bound(end):
    """b is 2.5; the same sentence with and without the refinement."""
    low = ", value = 4" if end.startswith("min") else ", value = 1.0"
    text = FIRST_ORDER.replace("b = { value = 1.0 }", f"b = {{ {end}{low} }}")
    said = []
    for refine in (False, True):
        _, report = fit(plant(text), [first_order()], restarts=2, refine=refine)
        said.append([w for w in report.warnings if w.startswith("parameter ")])
    name, _, value = end.partition(" = ")
    assert said[0] == said[1]
    assert said[0] == [
        f"parameter 'b' is at its {name} = {float(value):g}; its value is the file's bound, not "
        "the data's"
    ]


def test_a_parameter_that_a_network_imitates():
    """a x beside NN(x) is a part of it; b u is not."""
    text = FIRST_ORDER.replace("- a*x", "- a*x - NN(x)") + "[networks.NN]\nhidden = 3\n"
    _, report = fit(plant(text), [first_order()], restarts=2)
    assert report.information is not None
    imitated = {each.name: each.imitated_by for each in report.information.constants}
    assert imitated == {"a": "NN", "b": None}
    (said,) = [each for each in report.warnings if each.startswith("parameter ")]
    assert "'a' is not identifiable: network 'NN' can imitate it; fix it" in said


def test_refusals():
    log = first_order()
    silent = Run("r", "a.csv", log.t, {"u": log.columns["u"], "z": log.columns["x"]})
    hidden = plant(FIRST_ORDER.replace("[outputs.x]", "[outputs.y]"))
    measured = Run("r", "a.csv", log.t, {"u": log.columns["u"], "x": log.columns["x"]})
    with pytest.raises(InputError, match=r"none of the outputs x .* has a column in a\.csv"):
        fit(plant(FIRST_ORDER), [silent])
    with pytest.raises(InputError, match=r"none of the outputs y .* has a column in a\.csv"):
        fit(hidden, [measured])
    still = Run("r", "a.csv", log.t, {"u": np.ones(400), "x": log.columns["x"]})
    with pytest.raises(InputError, match="input 'u' never changes"):
        fit(plant(FIRST_ORDER), [still])
    with pytest.raises(InputError, match=r"a\.csv: no stretch of 18 complete samples"):
        fit(plant(FIRST_ORDER), [cut(log, slice(0, 17))])


def test_what_needs_the_refinement_says_so():
    log = first_order()
    for option in ("ensemble", "robust"):
        with pytest.raises(InputError, match=f"--{option} is about the refinement.*--no-refine"):
            fit(plant(FIRST_ORDER), [log], refine=False, **{option: True})
    hidden = plant(FIRST_ORDER.replace('value = "x"', 'value = "2*x"').replace(".x]\nv", ".y]\nv"))
    seen = Run("r", "a.csv", log.t, {"u": log.columns["u"], "y": 2 * log.columns["x"]})
    with pytest.raises(InputError, match="x of plant 'first order': hidden states"):
        fit(hidden, [seen], refine=False)


# one condition for both, which a refusal above asks of either
@pytest.mark.study
@pytest.mark.parametrize("option", ["ensemble", "robust"])
def test_what_is_about_the_refinement_switches_it_on(option):
    plain = fit(plant(FIRST_ORDER), [first_order()], restarts=1)[1]
    assert plain.refinement is None  # all states are measured
    asked, said = fit(plant(FIRST_ORDER), [first_order()], restarts=1, **{option: True})
    told, _ = fit(plant(FIRST_ORDER), [first_order()], restarts=1, refine=True, **{option: True})
    assert said.refinement is not None
    assert asked.record == told.record


DELAY = 0.3  # s: six steps


def late(run):
    """The run of a plant whose input was commanded `DELAY` before it acted."""
    u = run.columns["u"]
    return Run(run.name, run.source, run.t, {"u": np.append(u[6:], np.full(6, u[-1])),
                                             "x": run.columns["x"]})  # fmt: skip


def test_dead_time_is_taken_out():
    """Told of the delay the fit finds what it finds without one; untold it cannot."""
    text = FIRST_ORDER.replace("[inputs.u]", f"[inputs.u]\ndelay = {DELAY}")
    log = late(first_order(1200))
    told, _ = fit(plant(text), [log], restarts=2)
    untold, _ = fit(plant(FIRST_ORDER), [log], restarts=2)
    for name, truth in (("a", 0.8), ("b", 2.5)):
        # as without a delay: the trapezoid's (a STEP)^2 / 12 = 1.3e-4
        assert float(told.plant.parameters[name]) == pytest.approx(truth, rel=3e-4)
        assert abs(float(untold.plant.parameters[name]) / truth - 1) > 0.03
    assert told.record.data.fit == [log.content_hash], "of the log as it is"


def test_cost_that_is_never_finite():
    text = FIRST_ORDER.replace("- a*x", "- a*log(x - 100)")
    with pytest.raises(InputError, match="a, b: no start has a finite cost; likely causes"):
        fit(plant(text), [first_order()], restarts=2)


def test_a_model_worse_than_nothing_is_called_so():
    """Validated on a log with the sign turned, it is off by twice the output."""
    other = first_order(seed=1)
    turned = Run("r", "a.csv", other.t, {"u": other.columns["u"], "x": -other.columns["x"]})
    _, report = fit(plant(FIRST_ORDER), [first_order()], [turned], restarts=2, refine=False)
    assert any("do not use this model" in warning for warning in report.warnings)


def test_model_that_runs_away():
    """A feedback of the wrong sign in fixed physics fits its offset and still diverges."""
    text = FIRST_ORDER.replace("b*u - a*x", "b*u + x**3").replace(
        "a = { value = 1.0, min = 0 }", ""
    )
    log = first_order(800)
    with pytest.raises(InputError, match="every start diverges") as refused:
        fit(plant(text), [log], restarts=2)
    named = re.search(r"state 'x' .* at t = ([0-9.]+) s of run 'run0'", str(refused.value))
    assert named is not None
    # by SciPy, with the b that least squares finds: the time at which x passes the millions
    x, u = log.columns["x"], log.columns["u"]
    half = slice(1, -1)
    slope = (x[2:] - x[:-2]) / (2 * STEP) - x[half] ** 3
    b = slope @ u[half] / (u[half] @ u[half])
    t, state = 0.0, x[:1]
    for k, drive in enumerate(u):
        found = solve_ivp(lambda t, x, drive: b * drive + x**3, (0, STEP), state, args=(drive,))
        t, state = k * STEP + found.t[-1], found.y[:, -1]
        if not found.success or abs(state[0]) > 1e6:
            break
    assert float(named[1]) == pytest.approx(t, abs=4 * STEP)  # b by another derivative


FOLLOWER = """
name = "follower"
[states.T]
derivative = "(b*u - T)/M"
[inputs.u]
hold = "zero"
[outputs.T]
value = "T"
[parameters]
b = { value = 1.0, min = 0 }
M = { value = 5.0, min = 0.1 }
"""


def wandering(seed, count=1500, lasts=60.0):
    """T follows u within 3 s, exactly, beside as much that comes and goes within a minute."""
    rng, fade, keeps = np.random.default_rng(seed), np.exp(-1 / 3), np.exp(-1 / lasts)
    u, T, w = np.repeat(rng.uniform(-2, 2, count // 150), 150), np.zeros(count), np.zeros(count)
    for k in range(count - 1):
        T[k + 1] = fade * T[k] + (1 - fade) * u[k]
        w[k + 1] = keeps * w[k] + np.sqrt(1 - keeps**2) * rng.standard_normal()
    return Run(f"{seed}", "follower.csv", np.arange(count) * 1.0, {"u": u, "T": T + w})


@pytest.mark.study
def test_where_the_files_values_run_better_the_fit_goes_on():
    """Equation error takes what comes and goes for a state that hardly moves (M = 416 s), and over
    what is held out that follows better than the truth does, as the start holds what is there; in
    runs through whole logs the file's 5 s is better. M is told by twenty steps in as much that
    wanders: to a factor of two."""
    plant = GrayBoxPlant.untrained(parse_plant(FOLLOWER))
    model, report = fit(plant, [wandering(seed) for seed in (20, 21)])
    assert report.refinement is not None
    assert 1.5 < float(model.plant.parameters["M"]) < 6


RESTLESS = """
name = "restless"
[states.x]
derivative = "(mean - x)/memory"
[outputs.x]
value = "x"
[parameters.mean]
value = 0
[parameters.memory]
value = 15
fixed = true
"""


@pytest.mark.study
def test_without_an_input_errors_over_one_step_have_the_last_word():
    """A level that wanders about 3 and forgets it over 15 s, with no input: every free run is its
    mean. The mean of 400 s is known to sqrt(2 * 15 / 400) of the spread; four of those."""
    fade, rng = np.exp(-1 / 15), np.random.default_rng(5)
    x = 3 + 0.5 * rng.standard_normal(400)
    for k in range(399):
        x[k + 1] = 3 + fade * (x[k] - 3) + 0.5 * np.sqrt(1 - fade**2) * rng.standard_normal()
    log = Run("a", "restless.csv", np.arange(400) * 1.0, {"x": x})
    plant = GrayBoxPlant.untrained(parse_plant(RESTLESS))
    model, report = fit(plant, [log])
    assert report.refinement is None
    assert float(model.plant.parameters["mean"]) == pytest.approx(
        3, abs=4 * 0.5 * np.sqrt(30 / 400)
    )
    _, report = fit(plant, [log], refine=True)
    assert report.refinement is not None  # whoever asks for it gets it
