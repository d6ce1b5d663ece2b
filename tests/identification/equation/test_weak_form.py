"""The weak form: exact where the filtered form is not, equal where both are, chosen by free run."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from faultgauge.identification import samples
from faultgauge.identification.equation import fit as equation_fit
from faultgauge.identification.equation.fit import GroupReport, material
from faultgauge.identification.equation.groups import (
    equation_errors,
    fit_group,
    groups,
)
from faultgauge.identification.equation.uncertainty import equation_information
from faultgauge.identification.equation.weak_form import (
    WeakErrors,
    fit_weak,
    gap,
    weak_samples,
    weak_states,
)
from faultgauge.identification.fit import fit
from faultgauge.identification.samples import channels, collect
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.reporting.chapters import fit_sections
from faultgauge.telemetry import Run
from faultgauge.telemetry.derivatives import Kernel

STEP, LOGS = 0.02, 60
K, C, G, NOISE = 2.0, 0.5, 1.5, 0.03
SPRING = {"q": "v", "v": "u - k*q**3 - c*v"}


def plant(states, outputs=None, parameters=(), hold="zero", networks=()):
    """States are measured by outputs of their names."""
    text = ['name = "p"', f'[inputs.u]\nhold = "{hold}"']
    text += [f'[states.{name}]\nderivative = "{value}"' for name, value in states.items()]
    outputs = {name: name for name in states} if outputs is None else outputs
    text += [f'[outputs.{name}]\nvalue = "{value}"' for name, value in outputs.items()]
    text += ["[parameters]", *(f"{name} = {{ value = 1 }}" for name in parameters)]
    text += [f"[networks.{name}]\nhidden = 5" for name in networks]
    return GrayBoxPlant.untrained(parse_plant("\n".join(text), "p.toml"))


def run(name="a", **columns):
    count = len(columns["u"])
    return Run(name, "a.csv", STEP * np.arange(count), columns)


def springs(seeds, noise=NOISE, count=6000):
    """v' = u - k q^3 - c v by RK4 of half a step, z = g q; a force set anew every 1.2 s, and
    white noise in all sensors. A log per seed."""
    rngs = [np.random.default_rng(seed) for seed in seeds]
    u = np.stack([np.repeat(rng.uniform(-3, 3, count // 60), 60) for rng in rngs], axis=1)
    x, h = np.zeros((count, 2, len(rngs))), STEP / 2

    def rate(x, u):
        return np.array([x[1], u - K * x[0] ** 3 - C * x[1]])

    for k in range(count - 1):
        now = x[k]
        for _ in range(2):
            a = rate(now, u[k])
            b = rate(now + h / 2 * a, u[k])
            c = rate(now + h / 2 * b, u[k])
            now = now + h / 6 * (a + 2 * b + 2 * c + rate(now + h * c, u[k]))
        x[k + 1] = now
    logs = []
    for n, (seed, rng) in enumerate(zip(seeds, rngs, strict=True)):
        q, v = (x[..., n] + noise * rng.standard_normal((count, 2))).T
        z = G * x[:, 0, n] + noise * rng.standard_normal(count)
        logs.append(run(f"run{seed}", u=u[:, n], q=q, v=v, z=z))
    return logs


def spring(seed, **given):
    return springs([seed], **given)[0]


def prepared(body, *runs, validate=()):
    """(group, states in the weak form, material) of a plant with one group."""
    how = channels(body.spec, runs)
    (group,) = groups(body.spec, how.outputs)
    return group, weak_states(body.spec, how, group), material(body.spec, runs, validate, how, 0)


def through(monkeypatch, kernel, body, log):
    """Weak samples of all of `log` by a kernel of our own."""
    monkeypatch.setattr(samples, "choose_kernel", lambda *given: kernel)
    stretches, _ = collect(body.spec, [log], channels(body.spec, [log]))
    at = stretches[0].samples
    return weak_samples(body.signals, stretches, np.arange(len(at.x)), at)


def both_errors(body, group, states, given):
    """(weak errors, filtered errors) at every sample."""
    weak = jax.vmap(lambda each: WeakErrors(states)(body, group, each))(given.points)
    return np.asarray(given.of_group(group, states).of(weak.T).T), np.asarray(
        jax.vmap(lambda each: equation_errors(body, group, each))(given.at)
    )


def products(seed):
    """(plant, log) of x' = u and z' = p u x under a u that is set anew at every sample."""
    u = np.random.default_rng(seed).uniform(-1, 1, 80)
    x = 2 + np.concatenate([[0.0], np.cumsum(u[:-1])]) * STEP
    z = np.concatenate([[0.0], np.cumsum(u[:-1] * (x[1:] + x[:-1]) / 2)]) * STEP
    return plant({"x": "u", "z": "p*u*x"}, parameters=["p"]), run(u=u, x=x, z=z)


@pytest.mark.parametrize("kernel", [Kernel(1, 4), Kernel(2, 3), Kernel(3, 4)])
def test_exact_under_a_held_input(monkeypatch, kernel):
    """x' = u makes x, and so z' = p u x, a straight line within a step, whose middle is its
    mean."""
    body, log = products(0)
    (group,) = groups(body.spec, ["x", "z"])
    found = through(monkeypatch, kernel, body, log)
    weak, filtered = both_errors(body, group, (1,), found)
    # sums of dozens of numbers of size 1, over differences of x over a step: 1e-16 / STEP, 30 times
    assert np.max(np.abs(weak)) < 2e-13
    # the covariance of u and x inside the kernel, var(u) STEP / 4 or so, is 2e-3
    assert np.sqrt(np.mean(filtered**2)) > 1e-4


def test_mean_of_a_box_is_the_integral(monkeypatch):
    """Against SciPy's quadrature of the same right side, step by step."""
    body, log = products(1)
    (group,) = groups(body.spec, ["x", "z"])
    found = through(monkeypatch, Kernel(1, 4), body, log)
    weak, _ = both_errors(body, group, (1,), found)
    mean = (weak + found.dx[:, [1]])[10, 0]  # centred at sample 12, from 10 to 14
    u, x = log.columns["u"], log.columns["x"]

    def right(s, k):
        return u[k] * (x[k] + u[k] * s)

    whole = sum(quad(right, 0, STEP, args=(k,))[0] for k in range(10, 14))
    assert mean == pytest.approx(whole / (4 * STEP), rel=1e-12)  # quad's own rounding


@pytest.mark.parametrize("kernel", [Kernel(1, 4), Kernel(2, 3)])
def test_exact_under_a_linear_input(monkeypatch, kernel):
    """x' = p max(u, 0) for a u of straight lines that cross zero at samples."""
    u = np.interp(np.arange(90), np.arange(0, 91, 5), np.tile([0.0, 1.0, 0.0, -2.0], 5)[:19])
    right = np.maximum(u, 0)
    x = np.concatenate([[0.0], np.cumsum((right[1:] + right[:-1]) / 2)]) * STEP
    body = plant({"x": "p*max(u, 0)"}, parameters=["p"], hold="linear")
    (group,) = groups(body.spec, ["x"])
    found = through(monkeypatch, kernel, body, run(u=u, x=x))
    weak, filtered = both_errors(body, group, (0,), found)
    assert np.max(np.abs(weak)) < 2e-13  # as above
    assert np.max(np.abs(filtered)) > 0.1  # the mean of u at a crossing is not that of max(u, 0)


def test_a_linear_plant_is_fitted_alike():
    """F of means is then the mean of F: both are the linear least squares of the same samples."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2, 2, 80), 20)
    x = np.zeros(len(u))
    for k in range(len(u) - 1):
        x[k + 1] = x[k] + (1 - np.exp(-0.8 * STEP)) * (2.5 / 0.8 * u[k] - x[k])
    x += 0.05 * rng.standard_normal(len(u))
    body = plant({"x": "b*u - a*x"}, parameters=["a", "b"])
    group, states, given = prepared(body, run(u=u, x=x))
    assert len(given.weak.training.dx) == len(given.training.dx)  # a short log: none left out
    # rounding: sums over a kernel in another order
    assert gap(body, group, states, given.weak.training) < 1e-12
    rngs = [np.random.default_rng(0)]
    (filtered,), _ = fit_group(body, group, given.training, given.validation, rngs)
    (weak,), _ = fit_weak(body, group, states, *given.weak[:2], rngs, "lm")
    points = np.column_stack([-given.training.x[:, 0], given.training.u[:, 0]])
    expected = np.linalg.lstsq(points, given.training.dx[:, 0])[0]
    for fitted in (filtered, weak):
        values = [float(fitted.parameters[name]) for name in "ab"]
        np.testing.assert_allclose(values, expected, rtol=1e-7)  # where LM stops


@pytest.mark.parametrize("validate", [(), (spring(8, count=900),)])
def test_points_lie_under_their_samples(validate):
    """What the weights make of the points is the smoothed sample, in every stretch."""
    logs = [spring(0, count=1500), spring(1, count=900)]
    *_, given = prepared(plant(SPRING, parameters="kc"), *logs, validate=validate)
    for each in given.weak[:2]:
        for name in ("x", "u", "dx"):
            points, smoothed = getattr(each.points.between, name), getattr(each.at, name)
            mean = replace(each, weights=np.repeat(each.weights, points.shape[1], axis=0))
            # rounding of running sums; dx is differences over a step
            np.testing.assert_allclose(
                mean.of(jnp.asarray(points.T)).T, smoothed, atol=1e-12 / STEP
            )
            chosen = getattr(each.points.at, name)[each.first]
            np.testing.assert_array_equal(chosen, smoothed)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_rate_that_is_measured_has_its_means(hold):
    """Beside one that is taken from its state."""
    rng = np.random.default_rng(0)
    log = run(**{name: rng.standard_normal(400).cumsum() for name in ("u", "q", "v", "d_v")})
    body = plant({"q": "v", "v": "u - k*q**3"}, parameters="k", hold=hold)
    *_, given = prepared(body, log)
    each = given.weak.training
    found = replace(each, weights=np.repeat(each.weights, 2, axis=0))
    mean = found.of(jnp.asarray(each.points.between.dx.T)).T
    np.testing.assert_allclose(mean, each.at.dx, atol=1e-12 / STEP)  # rounding, as above


def test_the_constants_of_a_spring_under_a_wide_kernel():
    """Noise makes the kernel 0.4 s wide; the spring's period is 3 to 4 s."""
    body = plant(SPRING, parameters="kc")
    errors = []
    for seed in range(5):
        group, states, given = prepared(body, spring(seed))
        rngs = [np.random.default_rng(0)]
        (filtered,), _ = fit_group(body, group, given.training, given.validation, rngs)
        (weak,), _ = fit_weak(body, group, states, *given.weak[:2], rngs, "lm")
        errors.append([float(each.parameters["k"]) / K - 1 for each in (filtered, weak)])
    filtered, weak = np.array(errors).T
    # k scatters by 0.25 % from log to log: three times that around no bias, and their mean likewise
    assert np.max(np.abs(weak)) < 0.0075
    assert abs(np.mean(weak)) < 0.0075 / np.sqrt(5)
    # the kernel lets q move by about v w / sqrt(6) with w its half width of 0.2 s, and
    # mean q^3 = (mean q)^3 + 3 (mean q) var q: some per cent
    assert np.all(filtered > 2 * np.abs(weak))
    assert np.mean(filtered) > 0.01


@pytest.mark.study
def test_standard_errors_are_the_scatter():
    """Of k and c in the weak form, and of g in the filtered form beside them, which reads the noise
    of the same sensor."""
    body = plant(SPRING, {"q": "q", "v": "v", "z": "g*q"}, parameters="kcg")
    logs, known = springs(range(LOGS)), []
    for log in logs:
        how = channels(body.spec, [log])
        given = material(body.spec, [log], (), how, 0)
        weak, filtered = groups(body.spec, how.outputs)
        states, rngs = weak_states(body.spec, how, weak), [np.random.default_rng(0)]
        (fitted,), one = fit_weak(body, weak, states, *given.weak[:2], rngs, "lm")
        (fitted,), other = fit_group(fitted, filtered, given.training, given.validation, rngs)
        reports = [
            GroupReport(weak, one, np.zeros(1), 0, "weak"),
            GroupReport(filtered, other, np.zeros(1), 0),
        ]
        known.append(equation_information(fitted, how, reports, given))
    values, errors = (
        np.array([[getattr(c, key) for c in each.constants] for each in known])
        for key in ("value", "by_chance")
    )
    ratio = np.mean(errors**2, axis=0) / values.var(axis=0, ddof=1)
    # The scatter of 60 logs is a chi-square of 59, one in a thousand on either side of it: 0.6 to
    # 1.9. (600 logs: 0.91, 1.08 and 0.99, each known to 6 %. As if samples were independent, 100
    # logs said 0.20, 0.62 and 0.06.)
    low, high = (LOGS - 1) / chi2.ppf([0.999, 0.001], LOGS - 1)
    assert np.all((ratio > low) & (ratio < high))
    pairs = np.triu_indices(3, 1)
    told = np.mean([each.correlation for each in known], axis=0)[pairs]
    true = np.corrcoef(values.T)[pairs]
    # by Fisher's transform, of the scatter's own: three and a half of its standard deviations
    off = 3.5 / np.sqrt(LOGS - 3)
    np.testing.assert_allclose(np.arctanh(told), np.arctanh(true), rtol=0, atol=off)
    assert np.arctanh(true[1]) > off  # k and g: groups apart would have none


@pytest.mark.parametrize("late", [0, 6])
def test_what_the_file_lacks_is_looked_for_in_the_weak_form(late):
    """An input that acts six samples later than the file has it makes c too small by a multiple of
    what chance does, and slow motion less so than fast motion."""
    body, log = plant(SPRING, parameters="kc"), spring(0)
    log.columns["u"][:] = np.roll(log.columns["u"], -late)
    group, states, given = prepared(body, log)
    (fitted,), one = fit_weak(
        body, group, states, *given.weak[:2], [np.random.default_rng(0)], "lm"
    )
    report = GroupReport(group, one, np.zeros(1), 0, "weak")
    known = equation_information(fitted, channels(body.spec, [log]), [report], given)
    c = known.constants[1]
    assert abs(c.value - C) < 2 * c.standard_error
    assert c.contradicted == bool(late)
    if late:
        assert c.value < C - 2 * c.by_chance
        assert c.fast < c.value < c.slow < C
    else:
        assert [each.standard_error for each in known.constants] == [
            each.by_chance for each in known.constants
        ]


def test_the_form_is_chosen_by_free_run():
    body = plant(SPRING, parameters="kc")
    model, report = fit(body, [spring(0)], restarts=2)
    (group,) = report.groups
    assert group.form == "weak"
    assert model.record.metrics.groups[0]["form"] == "weak"
    # k of the weak form, by the bound above
    assert float(model.plant.parameters["k"]) == pytest.approx(K, rel=0.0075)
    k, c = (each.standard_error for each in report.information.constants)
    assert 0.001 < k / K < 0.004  # half to double of how they scatter, by 0.2 and 0.4 %
    assert 0.002 < c / C < 0.008
    assert report.warnings == []
    assert fit_sections(model, report)[0].paragraphs[-1].endswith("the better one: k, c.")


def test_where_the_form_does_not_matter_one_is_fitted(monkeypatch):
    """A spring without noise: its kernel is two samples wide."""
    monkeypatch.setattr(equation_fit, "fit_weak", lambda *given: pytest.fail("was fitted"))
    model, report = fit(plant(SPRING, parameters="kc"), [spring(0, noise=0.0)], restarts=2)
    assert report.groups[0].form == "filtered"
    assert model.record.metrics.groups[0]["form"] == "filtered"


def test_the_worse_free_run_loses(monkeypatch):
    """Of a weak form that starts to fit and is then left where it stands, say."""
    monkeypatch.setattr(
        equation_fit,
        "fit_weak",
        lambda body, group, states, training, validation, rngs, algorithm: fit_group(
            body, group, training.at._replace(dx=2 * training.dx), validation.at, rngs
        ),
    )
    _, report = fit(plant(SPRING, parameters="kc"), [spring(0)], restarts=2)
    assert report.groups[0].form == "filtered"
    assert len(report.groups[0].free_run) == 2


def test_what_must_stay_filtered():
    """d(state), and a state that is itself the derivative of a column."""
    states = {"q": "v", "v": "u - a*q**3", "w": "a*d(q)", "z": "a*w*v"}
    body = plant(states, {"q": "q", "w": "w", "z": "z"}, parameters="a")
    columns = {name: np.sin(np.arange(300) / 30) for name in "uqwz"}
    how = channels(body.spec, [run(**columns)])
    assert how.states[1] == ("q", 1)
    (group,) = groups(body.spec, how.outputs)
    assert group.states == (1, 2, 3)
    assert weak_states(body.spec, how, group) == (1,)  # v itself is not on its right side


def test_a_group_of_both_kinds(monkeypatch):
    """Equations of a d(state), of a state as measured and of an output, which share a."""
    body = plant({"w": "a*d(x)", "x": "a*x**2 + u"}, {"w": "w", "x": "x", "y": "a*x**2"}, "a")
    rng = np.random.default_rng(0)
    log = run(**{name: rng.standard_normal(60) for name in ("u", "w", "x", "y")})
    (group,) = groups(body.spec, ["w", "x", "y"])
    found = through(monkeypatch, Kernel(2, 3), body, log)
    weak, filtered = both_errors(body, group, (1,), found)
    np.testing.assert_array_equal(weak[:, [0, 2]], filtered[:, [0, 2]])
    # mean x^2 - (mean x)^2 is the weighted variance
    under = found.first[:, None] + np.arange(found.weights.shape[1])
    apart = found.points.between.x[under, 1] - found.at.x[:, [1]]
    spread = apart**2 @ found.weights[0]
    np.testing.assert_allclose(weak[:, 1] - filtered[:, 1], spread, atol=1e-12)  # rounding


def test_a_network_is_spanned_by_the_points():
    """Beyond its range it stands still, and F would be wrong where noise moves a point there."""
    body = plant({"q": "v", "v": "u - N(q) - c*v"}, parameters="c", networks="N")
    group, states, given = prepared(body, spring(0, count=1500))
    rngs = [np.random.default_rng(0)]
    (weak,), solution = fit_weak(body, group, states, *given.weak[:2], rngs, "lm")
    network, points = weak.networks["N"], given.weak.training.points.between.x[:, 0]
    reach = network.input_center + network.input_scale * np.array([-1.0, 1.0])
    np.testing.assert_allclose(reach, [points.min(), points.max()], rtol=1e-12)  # rounding
    assert np.isfinite(solution.cost[0])


def test_windows_to_choose_on_start_on_the_parabola(monkeypatch):
    """Where x is one, without error; its mean is off by x'' times half the kernel's variance."""
    t = STEP * np.arange(400)
    body = plant({"x": "p*u"}, parameters="p")
    monkeypatch.setattr(samples, "choose_kernel", lambda *given: Kernel(2, 10))
    *_, given = prepared(body, run(u=6 * t - 1, x=3 * t**2 - t))
    first = given.windows.x0 - given.weak.windows.x0
    # the variance of two boxes of width w is w^2 / 6, and the second one is a sum of trapezoids:
    # (1 + 1 / 10^2 ...) more; 2 % hold both
    np.testing.assert_allclose(first, 3 * (10 * STEP) ** 2 / 6, rtol=0.02)
    y = given.weak.windows.y[:, :1, 0]  # as measured, here without noise
    np.testing.assert_allclose(given.weak.windows.x0, y, rtol=1e-9)  # rounding of pinv
