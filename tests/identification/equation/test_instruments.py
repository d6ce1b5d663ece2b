"""Instruments: a closed loop biases equation error, the more the higher its gain; a reference from
outside the loop does not."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from faultgauge.errors import InputError
from faultgauge.identification.equation import fit as equation_fit
from faultgauge.identification.equation.fit import material
from faultgauge.identification.equation.instruments import project, refit
from faultgauge.identification.fit import fit
from faultgauge.identification.samples import Samples, Stretch, channels
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """
name = "first order"
[states.x]
derivative = "b*u - a*x"
[inputs.u]
{key}
[outputs.x]
value = "x"
[parameters]
a = {{ value = 1.0 }}
b = {{ value = 1.0 }}
"""
INSTRUMENT = 'instrument = "r"'
A, B, STEP, COUNT = 0.8, 2.5, 0.05, 4000
SEEDS = range(3)


def plant(key=INSTRUMENT):
    return GrayBoxPlant.untrained(parse_plant(PLANT.format(key=key), "plant.toml"))


def closed_loop(gain, seed, count=COUNT):
    """x' = b u - a x + load under u = r - gain * x as measured: held and sampled in closed form."""
    random = np.random.default_rng(seed)
    r = np.repeat(random.uniform(-2, 2, count // 40), 40)
    sensor, drive = random.standard_normal((2, count))
    decay, keep = np.exp(-A * STEP), np.exp(-STEP / 0.3)
    x, u, state, load = np.zeros(count), np.zeros(count), 0.0, 0.0
    for k in range(count):
        load = keep * load + 0.3 * np.sqrt(1 - keep**2) * drive[k]
        x[k] = state + 0.02 * sensor[k]
        u[k] = r[k] - gain * x[k]
        state = decay * state + (1 - decay) / A * (B * u[k] + load)
    return Run(f"run{seed}", "loop.csv", STEP * np.arange(count), {"x": x, "u": u, "r": r})


def bias(gain, key):
    """Medians over the seeds of the relative errors of a and b."""
    found = []
    for seed in SEEDS:
        log = closed_loop(gain, seed)
        model, _ = fit(plant(key), [log], restarts=1, refine=False)
        found.append([float(model.plant.parameters[name]) for name in "ab"])
    return np.median(found, axis=0) / [A, B] - 1


@pytest.mark.study
def test_the_bias_grows_with_the_gain_and_the_instrument_removes_it():
    plain = np.array([bias(gain, "") for gain in (0.25, 1.0, 4.0)])
    assert np.all(np.diff(np.abs(plain), axis=0) > 0)
    assert np.all(np.abs(plain[2]) > 0.1)
    freed = np.array([bias(gain, INSTRUMENT) for gain in (0.25, 1.0, 4.0)])
    assert np.all(np.abs(freed) < np.abs(plain))
    # A run scatters by 6 % in a and by 2 % in b at the highest gain, a median of three by 0.7 of
    # it; twice that.
    assert np.all(np.abs(freed) < [0.09, 0.03])


def test_standard_errors_with_an_instrument_are_the_scatter():
    logs, rows = 20, []
    for seed in range(logs):
        known = fit(plant(), [closed_loop(1.0, seed, 2000)], restarts=1)[1].information
        rows.append([(each.value, each.standard_error) for each in known.constants])
    values, errors = np.moveaxis(np.array(rows), 2, 0)
    ratio = np.mean(errors**2, axis=0) / values.var(axis=0, ddof=1)
    # the scatter of 20 is a chi-square of 19, one in a thousand on either side: 0.43 to 3.5
    low, high = (logs - 1) / chi2.ppf([0.999, 0.001], logs - 1)
    assert np.all((ratio > low) & (ratio < high))


def test_the_fit_without_has_the_standard_errors_without(monkeypatch):
    monkeypatch.setattr(equation_fit, "WORSE", 1e-9)  # the fit without is kept
    told = []
    for key in (INSTRUMENT, ""):
        account = fit(plant(key), [closed_loop(1.0, 0)], restarts=1)[1]
        assert not account.groups[0].freed
        told.append([vars(each) for each in account.information.constants])
    assert told[0] == told[1]


def test_a_linear_equation_gets_the_textbook_estimate():
    """theta = (Zhat' Phi)^-1 Zhat' y, Zhat the projected regressors: two-stage least squares."""
    random = np.random.default_rng(0)
    z, noise = random.standard_normal((500, 2)), random.standard_normal(500)
    mix = np.array([[1.0, 0.3], [-0.4, 1.2]])
    phi = z @ mix + 0.7 * noise[:, None]
    y = phi @ [1.5, -0.5] + noise
    nothing = np.zeros((500, 0))
    samples = Samples(x=phi, u=nothing, dx=y[:, None], y=nothing)
    projected = samples._replace(x=z @ np.linalg.lstsq(z, phi, rcond=None)[0])

    def residual(theta, sample):
        return jnp.atleast_1d(sample.x @ theta - sample.dx[0])

    limits = np.full(2, -np.inf), np.full(2, np.inf)
    start = np.linalg.lstsq(phi, y, rcond=None)[0]
    found = refit(residual, start, samples, projected, limits)
    expected = np.linalg.solve(projected.x.T @ phi, projected.x.T @ y)
    np.testing.assert_allclose(found, expected, rtol=1e-8)  # where LM stops short of rounding
    assert np.linalg.norm(start - expected) > 0.3  # least squares is elsewhere


def stretch(r, u):
    count = len(r)
    nothing = np.zeros((count, 0))
    samples = Samples(x=u[:, None], u=u[:, None], dx=u[:, None], y=nothing)
    t = np.arange(count, dtype=float)
    return Stretch("a", 1.0, 0, t, samples, nothing, u[:, None], r[:, None])


def test_what_follows_the_reference_is_found_and_noise_is_not_followed():
    random = np.random.default_rng(0)
    r, noise = random.standard_normal((2, 3000))
    follows = r + np.concatenate([[0.0], r[:-1]])  # lies in the boxes of age 0 and 1
    signals, mask = plant().signals, [np.ones(3000, bool)]
    part, explained = project(signals, [stretch(r, follows + noise)], mask)
    assert explained["u"] == pytest.approx(2 / 3, abs=0.04)  # 2 of 3 parts, +- 2 / sqrt(3000)
    # 30 weights on 3000 samples err by sqrt(30 / 3000) of the noise; the first sample has no past
    assert np.std(part.u[1:, 0] - follows[1:]) < 0.15
    # each block is predicted by the others, so that its own noise cannot be in its prediction
    assert abs(np.corrcoef(part.u[:, 0] - follows, noise)[0, 1]) < 0.06  # 3 / sqrt(3000)


def test_an_input_without_an_instrument_stands_for_itself():
    text = PLANT.format(key=INSTRUMENT).replace("[outputs.x]", "[inputs.w]\n[outputs.x]")
    signals = parse_plant(text, "plant.toml").signals
    random = np.random.default_rng(0)
    r, w = random.standard_normal((2, 800))
    given = stretch(r, r + w)
    both = np.stack([r + w, w], axis=1)
    given = Stretch(**{**vars(given), "samples": given.samples._replace(u=both), "applied": both})
    part, explained = project(signals, [given], [np.ones(800, bool)])
    np.testing.assert_array_equal(part.u[:, 1], w)
    assert list(explained) == ["u"]
    assert explained["u"] == pytest.approx(1.0)  # r + w is in the span of both


@pytest.mark.parametrize(
    ("r", "words"),
    [
        (None, ["loop.csv has no column 'r'", "input 'u'", '--map "r=']),
        (np.zeros(COUNT), ["'r'", "never changes", "remove instrument from [inputs.u]"]),
        (np.random.default_rng(9).standard_normal(COUNT), ["'r'", "explains", "too little"]),
    ],
)
def test_an_instrument_that_cannot_serve_is_refused(r, words):
    log = closed_loop(1.0, 0)
    columns = {k: v for k, v in log.columns.items() if k != "r"} | ({} if r is None else {"r": r})
    with pytest.raises(InputError) as refusal:
        fit(plant(), [Run("a", "loop.csv", log.t, columns)], restarts=1)
    assert all(word in str(refusal.value) for word in words)


def test_a_weak_instrument_is_a_warning_and_its_share_is_on_record():
    log = closed_loop(1.0, 0)
    other = closed_loop(1.0, 1).columns["r"]  # of the same size: 4 times the power
    weak = {**log.columns, "r": log.columns["r"] + 2 * other}
    model, account = fit(plant(), [Run("a", "loop.csv", log.t, weak)], restarts=1)
    share = model.record.instruments["u"]
    assert 0.01 < share < 0.1
    assert f"the instrument of input 'u', explains only {100 * share:.1f} %" in account.warnings[0]
    strong, account = fit(plant(), [log], restarts=1)
    assert strong.record.instruments["u"] > 0.8
    assert account.warnings == []


def test_validation_logs_need_no_instrument():
    held = closed_loop(1.0, 1)
    held = Run("held", "held.csv", held.t, {k: held.columns[k] for k in "xu"})
    spec, logs = plant().spec, [closed_loop(1.0, 0)]
    how = replace(channels(spec, [*logs, held]), references=("r",))
    given = material(spec, logs, [held], how, 0)
    assert given.exogenous is not None
    assert given.exogenous.x.shape == given.training.x.shape
