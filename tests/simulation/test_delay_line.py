"""Dead time in simulation: exact solutions, and the way back through a log."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant, presets
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop
from faultgauge.simulation.delay_line import acting, taps
from faultgauge.simulation.free_run import free_run
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import parse_scenario
from faultgauge.simulation.schedules import grid, inject
from faultgauge.telemetry.dead_time import delayed

TANK = """name = "tank"
[states.T]
derivative = "(q - 0.2*T + 0.5*w)/3"
initial = 1.0
[inputs.q]
hold = "HOLD"
delay = DELAY
[inputs.w]
hold = "zero"
[outputs.T]
value = "T"
[outputs.flow]
value = "2*q + T"
"""
SUBSTEPS = 20


def tank(delay, hold="zero"):
    return TANK.replace("DELAY", str(delay)).replace("HOLD", hold)


def test_taps_by_hand():
    """Four steps to a sample of 1 s: 0.5 s are two steps, 1.25 s are five."""
    line = taps([0.0, 0.5, 1.25], 1.0, 4)
    assert line.back.T.tolist() == [[0, 0, 0, 0], [1, 1, 0, 0], [2, 1, 1, 1]]
    assert line.begin.T.tolist() == [
        [0, 0.25, 0.5, 0.75],
        [0.5, 0.75, 0, 0.25],
        [0.75, 0, 0.25, 0.5],
    ]
    np.testing.assert_array_equal(line.end, line.begin + 0.25)
    assert line.depth == 3
    assert taps([], 1.0, 4).depth == 1


def test_a_ramp_comes_late_by_the_delay():
    line = taps([0.7], 1.0, 10)
    past = jnp.array([[[5.0], [6.0]], [[4.0], [5.0]]])  # u(t) = t, the newest sample is at t = 5
    begin, end = acting(line, past)
    t = 5 + np.arange(10) / 10
    np.testing.assert_allclose(begin[:, 0], t - 0.7, rtol=1e-15)  # rounding
    np.testing.assert_allclose(end[:, 0], t + 0.1 - 0.7, rtol=1e-15)


@pytest.mark.parametrize("delay", [0.35, 0.5, 2.0])
def test_a_step_acts_after_the_delay(delay):
    """x' = u - x after a unit step at 1 s: 1 - exp(-(t - 1 - delay)), from then on."""
    text = f"""name = "lag"
[states.x]
derivative = "u - x"
[inputs.u]
delay = {delay}
[outputs.y]
value = "x"
"""
    body, dt, samples = GrayBoxPlant.untrained(parse_plant(text)), 0.5, 12
    happens = inject([], body.signals, grid(samples, dt, SUBSTEPS))
    t = dt * np.arange(samples)
    u = np.where(t >= 1, 1.0, 0.0)[:, None]
    conditions = Conditions(
        jnp.asarray(u),
        jnp.zeros((samples, 1)),
        jnp.zeros((samples, 1)),
        jnp.asarray(happens.f),
        jax.tree.map(jnp.asarray, happens.stuck),
        jnp.asarray(happens.dropped[:, 0]),
    )
    controller = Controller(jnp.zeros((1, 1)), jnp.zeros((1, 1)))
    record = closed_loop(body, controller, jnp.zeros(1), conditions, dt)
    np.testing.assert_array_equal(record.u, u)  # as commanded
    since = np.maximum(t - 1 - delay, 0)
    # the delays are whole integration steps of 0.025 s; RK4 errs by 0.025^5/120 = 8e-11 in each
    np.testing.assert_allclose(record.x[:, 0], 1 - np.exp(-since), rtol=0, atol=1e-8)


LOOP = """
[inputs.q.feedback.T]
kp = 0.8
ki = 0.1
[references.T]
source = "constant"
size = 0.4
"""


def scenario(folder, delay, hold, *, feedback=True):
    (folder / "tank.toml").write_text(tank(delay, hold))
    path = folder / "run.toml"
    path.write_text(
        f"""name = "run"
plant = "tank.toml"
seconds = 30.0
step = 0.25
substeps = {SUBSTEPS}
[inputs.q]
source = "multisine"
sigma = 1.0
low = 0.01
high = 0.5
[inputs.w]
source = "multisine"
sigma = 0.5
low = 0.01
high = 0.5
{LOOP if feedback else ""}"""
    )
    return path


@pytest.mark.parametrize(
    ("hold", "feedback", "delay"),
    [("zero", True, 0.75), ("zero", False, 0.25), ("linear", False, 1.5), ("zero", True, 0.0)],
)
def test_a_log_of_a_delayed_plant_is_reproduced_from_its_delayed_inputs(
    tmp_path, hold, feedback, delay
):
    log = simulate(scenario(tmp_path, delay, hold, feedback=feedback))
    body = GrayBoxPlant.untrained(parse_plant(tank(delay, hold)))
    signals = body.signals
    held = [each.name for each in signals.inputs if each.hold == "zero"]
    seen = delayed(log, {each.name: each.delay for each in signals.inputs}, held)
    first = round(delay / log.step)
    assert np.isnan(seen.columns["q"]).sum() == first
    u = np.stack([seen.columns[name][first:] for name in signals.input_names], axis=1)
    x0 = jnp.array([log.columns["T"][first]])
    dt, f = jnp.full(len(u), log.step), jnp.zeros((len(u), 0))
    again = free_run(body, x0, jnp.asarray(u), dt, f, SUBSTEPS)
    for j, name in enumerate(signals.output_names):
        # the same RK4 steps; 1e4 of them, each rounding values of order 1
        np.testing.assert_allclose(again.y[:, j], log.columns[name][first:], rtol=0, atol=1e-11)
    if delay:  # and not without it
        u[:, 0] = log.columns["q"][first:]
        other = free_run(body, x0, jnp.asarray(u), dt, f, SUBSTEPS)
        assert np.max(np.abs(other.y[:, 0] - log.columns["T"][first:])) > 0.01


def test_a_delay_as_long_as_the_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"delay of input 'q', 40 s, leaves nothing of a run of"):
        simulate(scenario(tmp_path, 40.0, "zero"))


def test_a_flight_with_a_delay_is_refused(tmp_path):
    wheel = presets()["reaction_wheel"].replace("[inputs.u]", "[inputs.u]\ndelay = 0.5")
    (tmp_path / "wheel.toml").write_text(wheel)
    text = """name = "flight"
plant = "wheel.toml"
seconds = 300
step = 0.25
[satellite]
axis = "roll"
"""
    with pytest.raises(InputError, match=r"input 'u' has a delay, which the flight of a satellite"):
        simulate(parse_scenario(text, "flight.toml", tmp_path))
