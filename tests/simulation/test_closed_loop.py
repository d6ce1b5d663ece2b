"""The closed loop against scipy, closed forms and arithmetic by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop, with_faults
from faultgauge.simulation.schedules import Constant, Schedule, Steps, grid, inject

SUBSTEPS = 4


def plant(derivative="u", limits="", hold="zero"):
    text = f"""name = "plant"
[states.x]
derivative = "{derivative}"
[inputs.u]
hold = "{hold}"
{limits}
[outputs.y]
value = "x"
"""
    return GrayBoxPlant.untrained(parse_plant(text))


def run(body, dt, *, uf=0.0, r=0.0, kp=0.0, ki=0.0, x0=0.0, noise=0.0, schedules=(), samples=None):
    """The record (NumPy) of a plant with one state, input and output."""
    shape = np.broadcast_shapes(np.shape(uf), np.shape(r), np.shape(noise), (samples or 1,))
    count = shape[0]

    def column(values):
        return jnp.asarray(np.broadcast_to(np.asarray(values, float), shape)[:, None])

    happens = inject(schedules, body.signals, grid(count, dt, SUBSTEPS))
    conditions = Conditions(
        column(uf),
        column(r),
        column(noise),
        jnp.asarray(happens.f),
        jax.tree.map(jnp.asarray, happens.stuck),
        jnp.asarray(happens.dropped[:, 0]),
    )
    controller = Controller(jnp.full((1, 1), float(kp)), jnp.full((1, 1), float(ki)))
    body = with_faults(body, happens.faults)
    record = closed_loop(body, controller, jnp.full(1, float(x0)), conditions, dt)
    return type(record)(*(np.asarray(field)[:, 0] for field in record))


def test_pi_control_of_a_first_order_plant_is_its_closed_form():
    """x' = u - x with u = (1 - x) + integral of (1 - x): the loop is 1/(s + 1), so 1 - exp(-t).

    Holding the input costs an error of the order of the sample time, so half of it at half."""
    worst = []
    for dt, samples in ((0.02, 250), (0.01, 500)):
        record = run(plant("u - x"), dt, r=np.ones(samples), kp=1, ki=1)
        exact = 1 - np.exp(-dt * np.arange(samples))
        worst.append(np.abs(record.x - exact).max())
    assert worst[1] < 0.005  # half a sample late at the steepest slope, which is 1
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.05)  # first order in dt


def test_pi_control_sample_by_sample():
    """The same loop as a recursion that is exact under a held input."""
    dt, samples, kp, ki = 0.1, 200, 2.0, 1.5
    noise = 0.01 * np.random.default_rng(0).standard_normal(samples)
    reference = np.where(np.arange(samples) < 100, 1.0, -0.5)
    record = run(plant("2*u - 3*x"), dt, r=reference, kp=kp, ki=ki, x0=0.2, noise=noise)
    x, z, decay = 0.2, 0.0, np.exp(-3 * dt)
    for k in range(samples):
        # RK4 with 4 steps of rate*h = 0.075: 0.075^5/120 = 2e-8 each, kept for 1/0.3 samples
        assert record.measured[k] == pytest.approx(x + noise[k], abs=1e-6)
        error = reference[k] - (x + noise[k])
        u = kp * error + z
        assert record.u[k] == pytest.approx(u, abs=2e-6)  # kp times that
        z += dt * ki * error
        x = decay * x + (1 - decay) * 2 / 3 * u


def test_a_nonlinear_plant_with_faults_against_scipy():
    dt, samples = 0.5, 60
    schedules = [
        Schedule("leak", "state", "x", Steps((5.0, 20.0), (-0.05, -0.1))),
        Schedule("bias", "output", "y", Constant(0.1, 10.0)),
        Schedule("weak", "gain", "u", Constant(0.25, 15.0)),
        Schedule("extra", "input", "u", Constant(0.2, 25.0)),
    ]
    body = plant("0.5*u - 0.3*sqrt(max(x, 0))", limits="min = 0\nmax = 1.1")
    reference = np.full(samples, 1.2)
    record = run(body, dt, uf=0.5, r=reference, kp=1.0, ki=0.3, x0=1.0, schedules=schedules)
    x, z = 1.0, 0.0
    for k in range(samples):
        t = k * dt
        error = 1.2 - (x + 0.1 * (t >= 10))
        wanted = 0.5 + error + z
        u = np.clip(wanted, 0, 1.1)
        winds = (wanted > 1.1 and error > 0) or (wanted < 0 and error < 0)
        z += 0.0 if winds else dt * 0.3 * error
        assert record.u[k] == pytest.approx(u, abs=1e-6)
        assert record.x[k] == pytest.approx(x, abs=1e-6)  # RK4: rate*h < 0.05, 3e-9 a step
        applied = np.clip((1 - 0.25 * (t >= 15)) * u + 0.2 * (t >= 25), 0, 1.1)
        f = -0.05 * (5 <= t < 20) - 0.1 * (t >= 20)

        def rate(_, x, applied=applied, f=f):
            return 0.5 * applied - 0.3 * np.sqrt(np.maximum(x, 0)) + f

        x = solve_ivp(rate, (0, dt), [x], rtol=1e-10, atol=1e-12).y[0, -1]
    assert record.u.max() == 1.1, "the limit was met"


def test_an_integral_comes_back_from_a_limit_as_soon_as_the_error_turns():
    """Integral control alone; 2 cannot be reached with u <= 1, and 0.5 can."""
    reference = np.where(np.arange(600) < 300, 2.0, 0.5)
    record = run(plant("u - x", limits="max = 1"), 0.1, r=reference, ki=1.0)
    assert (record.u[100:300] == 1.0).all()
    # Past the limit by one step of at most 0.1*1*(2 - 0), back by 0.1*1*0.5 a sample: 4 and 1 more.
    assert (record.u[305:] < 1.0).all()
    assert record.u[-1] == pytest.approx(0.5, abs=1e-4)  # poles at -1/2 +- 0.87i for 30 s: 3e-7


def test_an_integral_does_not_wind_up():
    """However long the limit lasts, the way back is the same."""
    ways = []
    for wait in (50, 400):
        reference = np.where(np.arange(wait + 100) < wait, 5.0, 0.5)
        record = run(plant("u - x", limits="max = 1"), 0.1, r=reference, kp=1.0, ki=1.0, x0=1.0)
        ways.append(record.u[wait:])
    np.testing.assert_allclose(ways[0], ways[1], rtol=1e-9)  # rounding of another start


NOISE = np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6])


def held(enters, effect):
    target = {"state": "x", "input": "u", "output": "y"}[enters]
    return [Schedule("f", enters, target, Constant(0.25, 2.0, 4.0), effect)]


@pytest.mark.parametrize(
    ("enters", "effect", "x"),
    [
        ("state", "stuck", [0, 1, 2, 2.25, 2.5, 3.5]),
        ("state", "dropout", [0, 1, 2, 2, 2, 3]),
        ("input", "stuck", [0, 1, 2, 2.25, 2.5, 3.5]),
        ("input", "dropout", [0, 1, 2, 2, 2, 3]),
        ("output", "stuck", [0, 1, 2, 3, 4, 5]),
        ("output", "dropout", [0, 1, 2, 3, 4, 5]),
    ],
)
def test_what_holds_on_an_integrator_under_an_input_of_one(enters, effect, x):
    record = run(plant(), 1.0, uf=np.ones(6), noise=NOISE, schedules=held(enters, effect))
    np.testing.assert_allclose(record.x, x, atol=1e-12)  # sums of quarters, in quarter steps
    np.testing.assert_array_equal(record.u, 1.0)  # the command does not know
    measured = np.array(x) + NOISE
    if enters == "output":
        measured[2:4] = 0.25 if effect == "stuck" else np.nan
    np.testing.assert_allclose(record.measured, measured, atol=1e-12)


def test_the_controller_keeps_the_last_sample_while_none_comes():
    record = run(plant(), 1.0, uf=np.ones(6), kp=0.5, schedules=held("output", "dropout"))
    x, seen = 0.0, 0.0
    for k in range(6):
        seen = x if k not in (2, 3) else seen
        u = 1.0 - 0.5 * seen
        assert record.u[k] == pytest.approx(u, abs=1e-12)
        x += u


def test_a_fault_may_begin_between_samples():
    """From a quarter of the second sample on: the integrator loses three quarters of it."""
    leak = Schedule("leak", "state", "x", Constant(-1.0, 1.25))
    record = run(plant(), 1.0, uf=np.ones(4), schedules=[leak])
    np.testing.assert_allclose(record.x, [0, 1, 1.25, 1.25], atol=1e-12)


@pytest.mark.parametrize(("hold", "x"), [("zero", [0, 0, 1, 3]), ("linear", [0, 0.5, 2, 4.5])])
def test_between_samples_an_input_is_held_as_the_plant_says(hold, x):
    """u = 0, 1, 2, 3 into an integrator: sums, or the trapezoids under straight lines."""
    record = run(plant(hold=hold), 1.0, uf=np.arange(4.0))
    np.testing.assert_allclose(record.x, x, atol=1e-12)
