"""A plant that is not its model: the discrepancy, what follows an input, and constants."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from faultgauge.observers.divided_difference import DividedDifferenceFilter, FilterNoise
from faultgauge.plants.disturbed import Disturbed, Error, dynamic_states, shared_inputs
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.signals import Fault

CART = """
name = "cart"
[states.q]
derivative = "v"
[states.v]
derivative = "k*u - c*v"
[inputs.u]
min = -2
max = 2
[outputs.q]
value = "q"
[outputs.a]
value = "d(v)"
[parameters]
k = { value = 3 }
c = { value = 0.5 }
[faults.push]
enters = "input"
target = "u"
"""
TAU, SETTLING, SHARE = 4.0, 0.8, 0.6
OFFSET, W = np.array([0.2, -0.1]), np.array([[0.3, 0.0], [0.05, 0.02]])
X = np.array([1.0, 2.0, 0.7, -0.8, 5 / 6, 1.0, -2.0])  # q, v, d, r, h, xi: e = -0.4
U = np.array([1.5])


@pytest.fixture(scope="module")
def plant():
    base = GrayBoxPlant.untrained(parse_plant(CART))
    error = Error(*(jnp.array([each]) for each in (TAU, SETTLING, SHARE)))
    more = (Fault("undeclared q", "output", "q"),)
    return Disturbed.of(
        base, (1,), (0,), error, ("k", "c"), jnp.asarray(OFFSET), jnp.asarray(W), more
    )


def test_only_what_is_not_kinematics_may_err(plant):
    assert dynamic_states(plant.base) == (1,)
    assert plant.signals.state_names == ("q", "v", "d(v)", "r(u)", "h(u)", "xi(0)", "xi(1)")
    assert plant.signals.fault_names == ("push", "undeclared q")
    exact = CART.replace('"k*u - c*v"', '"k*u - c*v"\nexact = true')
    assert dynamic_states(GrayBoxPlant.untrained(parse_plant(exact))) == ()


def test_derivative_and_output_by_hand(plant):
    """k = 3 + 0.2 + 0.3 = 3.5; c = 0.5 - 0.1 + 0.05 - 0.04 = 0.41; u is by 0.4
    short, which acts as on the usual plant, whose k is 3.2."""
    dx = np.asarray(plant.derivative(jnp.asarray(X), jnp.asarray(U)))
    wanted = [
        2.0,
        3.5 * 1.5 - 3.2 * 0.4 - 0.41 * 2.0 + 0.7,
        -0.7 / TAU,
        0.8 / SETTLING,
        -5 / 6 / SETTLING,
        0,
        0,
    ]
    np.testing.assert_allclose(dx, wanted, rtol=1e-12)
    y = plant.output(jnp.asarray(dx), jnp.asarray(X), jnp.asarray(U))
    np.testing.assert_allclose(y, [1.0, wanted[1]], rtol=1e-12)


@pytest.mark.parametrize(
    ("before", "now", "push", "change"),
    [(0.5, 1.5, 0.0, 1.0), (1.5, 1.5, 0.0, 0.0), (0.5, 3.0, 0.0, 1.5), (0.5, 1.5, 1.0, 0.5)],
)
def test_where_an_input_was_lately_follows_its_changes(plant, before, now, push, change):
    """Of u as it acts, inside its limits, with the fault; a fault that begins changes nothing."""
    f = jnp.array([push, 0.0])
    jump = plant.leans(jnp.array([before]), jnp.array([now]), 0 * f, f)
    np.testing.assert_allclose(jump, [0, 0, 0, 0, change, 0, 0], atol=1e-12)


def test_what_an_inputs_change_does_besides_fades_twice_as_fast(plant):
    """r and h fade as exp(-t / SETTLING): in the mean of 0.8 s, e = -0.4 is (1 - e^-2) / 2 times
    that; d fades by itself."""
    t = np.array([0.0, SETTLING])
    forces = plant.forces(jnp.asarray(X), jnp.asarray(U), jnp.zeros(2), jnp.asarray(t))
    wanted = 0.7 * np.exp(-t / TAU) - 3.2 * 0.4 * (1 - np.exp(-2)) / 2
    np.testing.assert_allclose(forces[:, 1], wanted, rtol=1e-12)


def test_an_input_may_have_changed_before_a_log(plant):
    assert not np.any(plant.lately)
    moved = eqx.tree_at(lambda p: p.error, plant, plant.error._replace(before=jnp.array([2.5])))
    np.testing.assert_array_equal(moved.lately, [0, 0, 0, 0, 2.5, 0, 0])


def test_an_input_that_changed_unseen_did_so_at_any_time(plant):
    """k = 3.5 times a change of 1 for anything between 0 and 0.6 s: 2.1 / sqrt(3) m/s."""
    u, none = jnp.array([0.5]), jnp.zeros(2)
    sd = plant.jumps(jnp.asarray(X), u, u + 1, none, none, 0.6)
    wanted = [0, 2.1 / np.sqrt(3), 0, 0, 0, 0, 0]
    np.testing.assert_allclose(sd, wanted, atol=1e-12)


LEANING = (0.5, -0.9)  # s; of an input's change


@pytest.fixture(scope="module")
def late():
    base = GrayBoxPlant.untrained(parse_plant(CART))
    tau, settling, share, leaning, lean = (
        jnp.array([each]) for each in (TAU, SETTLING, SHARE, *LEANING)
    )
    error = Error(tau, settling, share, leaning=leaning, lean=lean)
    nothing = jnp.zeros(0), jnp.zeros((0, 0))
    more = (Fault("undeclared q", "output", "q"),)
    return Disturbed.of(base, (1,), (0,), error, (), *nothing, more, leaning=(0,))


def test_an_input_that_comes_late_by_hand(late):
    """u is by 0.4 short, and by 0.2 of e = 0.6 * 0.5 * 2 / 3 too much:
    3 * (1.5 + 0.2 - 0.4) - 0.5 * 2 + 0.7."""
    assert late.signals.state_names[-4:] == ("d(v)", "r(u)", "v(u)", "h(u)")
    x = jnp.array([1.0, 2.0, 0.7, 0.5, -0.4, 2 / 3])
    dx = late.derivative(x, jnp.array([1.5]))
    wanted = [2.0, 3 * 1.3 - 1.0 + 0.7, -0.7 / TAU]
    wanted += [-0.5 / SETTLING, 0.4 / LEANING[0], -2 / 3 / SETTLING]
    np.testing.assert_allclose(dx, wanted, rtol=1e-12)
    np.testing.assert_allclose(
        late.lasting(jnp.asarray(0.3), x, x),
        np.exp(-0.3 / np.array([TAU, SETTLING, LEANING[0], SETTLING])),
    )


def test_a_change_comes_late_by_a_share_of_what_reaches_the_plant(plant, late):
    """-0.9 of the change of u within its limits of +-2, with a push of 1."""
    f = jnp.array([1.0, 0.3])
    for before, now, change in ((0.2, 0.7, 0.5), (0.2, 1.7, 0.8), (1.2, 1.7, 0.0)):
        jump = late.leans(jnp.array([before]), jnp.array([now]), f, f)
        np.testing.assert_allclose(jump, [0, 0, 0, 0, -0.9 * change, change], atol=1e-12)
    none = jnp.zeros(2)
    jump = late.leans(jnp.array([1.5]), jnp.array([1.5]), none, f)
    np.testing.assert_allclose(jump, [0, 0, 0, 0, -0.9 * 0.5, 0], atol=1e-12)
    assert not np.any(plant.leans(jnp.array([1.0]), jnp.array([1.0]), none, none))


def test_by_what_a_unit_of_a_fault_comes_late(plant, late):
    """Where u is at its upper limit, a push acts downwards alone; a sensor's fault not at all."""
    by, none = jnp.array([0.4, 0.4]), jnp.zeros(2)
    for u in (0.0, 2.0, 3.0):
        wanted = np.zeros((6, 2))
        wanted[4, 0] = 0.0 if u == 3.0 else -0.9
        found = late.enters(jnp.zeros(6), jnp.array([u]), none, by)
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert not np.any(plant.enters(jnp.zeros(7), jnp.array([0.0]), none, by))


def test_errors_of_outputs_by_hand():
    """b and l stand beside q and a whatever the fault; an input's change of 0.5 moves a by
    3.2 * 0.5 = 1.6, and l by 70 % of that, up or down."""
    base = GrayBoxPlant.untrained(parse_plant(CART))
    one, none = np.array([1.0]), np.zeros(0)
    error = Error(none, none, none, 5.0 * one, 2.0 * one, 0.7 * one)
    plant = Disturbed.of(
        base, (), (), error, ("k",), jnp.array([0.2]), jnp.array([[0.3]]), (), (0,), (1,)
    )
    assert plant.signals.state_names == ("q", "v", "b(q)", "l(a)", "xi(0)")
    x, u = jnp.array([1.0, 2.0, 0.25, -0.5, 0.0]), jnp.array([1.5])
    dx, y = respond(plant, x, u, jnp.array([0.1]))
    np.testing.assert_allclose(dx, [2.0, 3.2 * 1.6 - 1.0, -0.25 / 5, 0.5 / 2, 0.0], rtol=1e-12)
    np.testing.assert_allclose(y, [1.25, 3.2 * 1.6 - 1.0 - 0.5], rtol=1e-12)
    still = jnp.zeros(1)
    sd = plant.jumps(x, u, u + 0.5, still, still)
    np.testing.assert_allclose(sd, [0, 0, 0, 0.7 * 1.6, 0], atol=1e-12)  # rounding
    left = plant.lasting(jnp.asarray(3.0), x, x)
    np.testing.assert_allclose(left, [np.exp(-3 / 5), np.exp(-3 / 2), 1.0], rtol=1e-12)


def test_a_sensor_that_trails_by_hand():
    """q = 1 moves by v = 2 a second, and what its sensor shows is 0.5 below: that fades within 4 s,
    and grows by what q moves. From q = 1 to 1.6 in 2 s it is moved by -0.6, of which the mean of
    exp(-t / 4 s) is left. The plant itself is as it was."""
    base = GrayBoxPlant.untrained(parse_plant(CART))
    none = np.zeros(0)
    error = Error(none, none, none, trail=np.array([4.0]))
    nothing = jnp.zeros(0), jnp.zeros((0, 0))
    plant = Disturbed.of(base, (), (), error, (), *nothing, trailing=(0,))
    assert plant.signals.state_names == ("q", "v", "g(q)")
    x, u, f = jnp.array([1.0, 2.0, -0.5]), jnp.array([1.5]), jnp.array([0.1])
    dx, y = respond(plant, x, u, f)
    own, shown = respond(base, x[:2], u, f)
    np.testing.assert_allclose(dx, [*own, 0.5 / 4 - 2.0], rtol=1e-12)
    np.testing.assert_allclose(y, [shown[0] - 0.5, shown[1]], rtol=1e-12)
    stages = jnp.stack([u] * 3)
    moved = plant.trails(base, x, jnp.array([1.6, 2.0]), stages, u + 1, f, jnp.asarray(2.0))
    np.testing.assert_allclose(moved, [-0.6 * 4 / 2 * (1 - np.exp(-2 / 4))], rtol=1e-12)


def test_a_sensor_that_trails_what_reads_an_input():
    """A motor's current, (u - k w) / R, behind a lag of 0.3 s, an input that jumps and is held:
    what the filter predicts is what an exact integration of plant and sensor shows, but for the
    speed's being even within a row: over 0.05 s it is 5 * 0.05^2 / 8 of a jump of 2 off a straight
    line, and the sensor a sixth of that. A push of the input jumps, too, and a sensor's own fault
    does not."""
    text = """
name = "motor"
[states.w]
derivative = "4*(u - w) - w"
[inputs.u]
[outputs.i]
value = "2*(u - 0.5*w)"
[faults.push]
enters = "input"
target = "u"
[faults.bias]
enters = "output"
target = "i"
"""
    base = GrayBoxPlant.untrained(parse_plant(text))
    none, dt, lag = np.zeros(0), 0.05, 0.3
    error = Error(none, none, none, trail=np.array([lag]))
    nothing = jnp.zeros(0), jnp.zeros((0, 0))
    plant = Disturbed.of(base, (), (), error, (), *nothing, trailing=(0,))
    filtering = DividedDifferenceFilter(plant, jnp.ones(2), jnp.ones(2), (), 1)
    quiet = FilterNoise(jnp.zeros(2), jnp.zeros(2), jnp.ones(1))
    belief = filtering.begin(jnp.zeros(2), jnp.zeros(2))

    @eqx.filter_jit
    def one(belief, before, now):
        belief, _ = filtering.predict(belief, quiet, before, now, jnp.asarray(dt))
        return belief, filtering.look(belief, now)[0]

    before, exact, u = jnp.zeros(1), np.zeros(2), 0.0
    for row in range(1, 60):
        now = float(row // 7 % 3)
        # the sensor s' = (i - s) / lag beside the speed, under the input of before
        held = [[-5.0, 0, 4 * u], [-1 / lag, -1 / lag, 2 * u / lag], [0, 0, 0]]
        exact = (expm(np.array(held) * dt) @ np.append(exact, 1.0))[:2]
        belief, shown = one(belief, before, jnp.array([now]))
        assert shown[0] == pytest.approx(exact[1], abs=4e-3)
        before, u = jnp.array([now]), now
    jump = plant.enters(belief.mean[:2], before, jnp.zeros(2), jnp.array([0.1, 0.1]))
    np.testing.assert_allclose(jump, [[0.0, 0.0], [-2.0, 0.0]], atol=1e-12)


def test_a_bent_curve_by_hand():
    """Between -1 and 4 the input is 0.1 * 5 more in the middle, at 1.5, and at 2.75, three quarters
    of the way, 3/4 of that; at the ends it is what it was, and beyond it goes on at their slopes,
    1 + 4 * 0.1 and 1 - 4 * 0.1. A push of 1 goes along the curve, which a fault does not change."""
    base = GrayBoxPlant.untrained(parse_plant(CART.replace("min = -2\nmax = 2\n", "")))
    none = np.zeros(0)
    ends = {"low": np.array([-1.0]), "high": np.array([4.0])}
    error = Error(none, none, none, bend=np.array([0.1]), **ends)
    nothing = jnp.zeros(0), jnp.zeros((0, 0))
    plant = Disturbed.of(base, (), (), error, (), *nothing, bending=(0,))
    x, none = jnp.array([1.0, 2.0]), jnp.zeros(1)
    for u, acts in (
        (1.5, 2.0),
        (2.75, 2.75 + 0.375),
        (-1.0, -1.0),
        (4.0, 4.0),
        (6.0, 5.2),
        (-2.0, -2.4),
    ):
        bent = respond(plant, x, jnp.array([u]), none)
        straight = respond(base, x, jnp.array([acts]), none)
        for one, other in zip(bent, straight, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)
    pushed = respond(plant, x, jnp.array([1.75]), jnp.array([1.0]))[0]
    np.testing.assert_allclose(pushed, respond(base, x, jnp.array([3.125]), none)[0], rtol=1e-12)


def test_an_input_that_strays_does_so_wherever_it_acts():
    """u = 1.5 - 0.3 moves v by 3.2 * 1.2 - 1 and shows in a; half of what is left of -0.3 after
    4 ln 2 s acts in the mean over that time: the mean of exp(-t / 4) is 0.5 / ln 2."""
    base = GrayBoxPlant.untrained(parse_plant(CART))
    none, times = np.zeros(0), np.array([4.0])
    error = Error(none, none, none, straying=times)
    plant = Disturbed.of(
        base, (), (), error, ("k",), jnp.array([0.2]), jnp.array([[0.3]]), straying=(0,)
    )
    assert plant.signals.state_names == ("q", "v", "a(u)", "xi(0)")
    x, u = jnp.array([1.0, 2.0, -0.3, 0.0]), jnp.array([1.5])
    dx, y = respond(plant, x, u, jnp.zeros(1))
    np.testing.assert_allclose(dx, [2.0, 3.2 * 1.2 - 1.0, 0.3 / 4, 0.0], rtol=1e-12)
    np.testing.assert_allclose(y, [1.0, 3.2 * 1.2 - 1.0], rtol=1e-12)
    forces = plant.forces(x, u, jnp.zeros(1), jnp.array([0.0, 4 * np.log(2.0)]))
    np.testing.assert_allclose(forces, [[0.0, -3.2 * 0.3 * 0.5 / np.log(2.0)]] * 2, rtol=1e-12)
    own = plant.own_at(x).derivative(x[:2], u)
    np.testing.assert_allclose(own, [2.0, 3.2 * 1.5 - 1.0], rtol=1e-12)


def test_a_state_that_sticks_is_held_near_rest_and_not_in_motion():
    """v' = 3.2 * 1.5 - 0.4 v + q / (1 + (v / 0.5)^2): all of q = -6 at rest, half at 0.5, a 17th at
    2. q itself fades within 4 s at rest; at 0.5 half of its way counts, so that 0.5 * 0.5 * 2 s of
    a travel of 0.25 take exp(-2) more of it, and what is new in its variance is 1 - exp(-5)."""
    base = GrayBoxPlant.untrained(parse_plant(CART))
    none, time, slip, travel = np.zeros(0), *np.array([[4.0], [0.5], [0.25]])
    error = Error(none, none, none, gripping=time, slip=slip, travel=travel)
    offset, nothing = jnp.array([0.2, -0.1]), jnp.zeros((2, 0))
    plant = Disturbed.of(base, (), (), error, ("k", "c"), offset, nothing, sticking=(1,))
    assert plant.signals.state_names == ("q", "v", "q(v)")
    for v, left in ((0.0, 1.0), (0.5, 0.5), (-0.5, 0.5), (2.0, 1 / 17)):
        x, u = jnp.array([1.0, v, -6.0]), jnp.array([1.5])
        rate = 3.2 * 1.5 - 0.4 * v - 6.0 * left
        dx, y = respond(plant, x, u, jnp.zeros(1))
        fades = 6.0 * (1 / 4 + abs(v) * (1 - left) / 0.25)
        np.testing.assert_allclose(dx, [v, rate, fades], rtol=1e-12)
        np.testing.assert_allclose(y, [1.0, rate], rtol=1e-12)
        own = plant.own_at(x).derivative(x[:2], u)
        np.testing.assert_allclose(own, [v, rate], rtol=1e-12)
    two, rest, moves = jnp.asarray(2.0), *jnp.array([[1.0, 0.0, -6.0], [1.0, -0.5, -6.0]])
    np.testing.assert_allclose(plant.lasting(two, rest, rest), [np.exp(-0.5)], rtol=1e-12)
    np.testing.assert_allclose(plant.lasting(two, moves, -moves), [np.exp(-2.5)], rtol=1e-12)
    times = plant.doubts(u, u, moves, -moves, two)
    new = times**2 * 2 / 4 * 2  # of a variance of 1, by which q moves 2 / 4 a second
    np.testing.assert_allclose(new, [1.0, 1.0, 1 - np.exp(-5.0)], rtol=1e-12)


def doubted_cart(where, low, high):
    """3 times as much acts at random where [u, q, v][where] lies between `low` and `high`."""
    base, none = GrayBoxPlant.untrained(parse_plant(CART)), np.zeros(0)
    place = {"doubt": 3.0, "above": low, "below": high}
    place = {name: np.array([each]) for name, each in place.items()}
    error = Error(np.array([5.0]), none, none, **place)
    theirs = jnp.array([0.2]), jnp.array([[0.3]])
    plant = Disturbed.of(base, (1,), (), error, ("k",), *theirs, doubted=(where,))
    assert plant.signals.state_names == ("q", "v", "d(v)", "xi(0)")
    return plant


def test_what_acts_at_random_is_larger_where_the_model_is_doubted():
    """u between 1 and 2, 3 times, at one end of a step at least; nothing acts on xi."""
    plant, x = doubted_cart(0, 1.0, 2.0), jnp.zeros(4)
    for u_before, u, larger in ((0.0, 2.5, 1.0), (0.0, 1.5, 3.0), (1.5, 0.0, 3.0), (1.2, 1.8, 3.0)):
        found = plant.doubts(jnp.array([u_before]), jnp.array([u]), x, x, jnp.ones(()))
        np.testing.assert_array_equal(found, [larger, larger, larger, 1.0])


def test_a_state_that_passes_where_the_model_is_doubted_was_there():
    """v between -1 and 2, or on its way from one side to the other; not what lies behind it."""
    plant, u = doubted_cart(2, -1.0, 2.0), jnp.ones(1)
    for v_before, v, larger in (
        (-3.0, 5.0, 3.0),
        (5.0, 1.9, 3.0),
        (3.0, 2.1, 1.0),
        (0.0, 0.1, 3.0),
    ):
        ends = (jnp.array([0.0, each, 0.5, 0.5]) for each in (v_before, v))
        found = plant.doubts(u, u, *ends, jnp.ones(()))
        np.testing.assert_array_equal(found, [larger, larger, larger, 1.0])


def test_inputs_are_shared_by_what_reads_them():
    """u moves v, which a shows; without a it acts in one place alone."""
    assert shared_inputs(GrayBoxPlant.untrained(parse_plant(CART))) == (0,)
    alone = CART.replace('[outputs.a]\nvalue = "d(v)"\n', "")
    assert shared_inputs(GrayBoxPlant.untrained(parse_plant(alone))) == ()


def test_a_positive_constant_stays_positive():
    """v' = k u - c v with k = 3.5 and c = 0.5, each known to 1.5: 3 standard deviations down, k is
    3.5^2 / (3.5 + 4.5), and c is what it would be."""
    base = GrayBoxPlant.untrained(parse_plant(CART))
    error = Error(*[np.zeros(0)] * 3)
    offset, unsure = jnp.array([0.5, 0.0]), 1.5 * jnp.eye(2)
    plant = Disturbed.of(base, (), (), error, ("k", "c"), offset, unsure, positive=(0,))

    def told(k, c):
        return [
            float(respond(plant, jnp.array([0.0, v, k, c]), jnp.array([u]))[0][1])
            for v, u in ((0.0, 1.0), (-1.0, 0.0))
        ]

    assert told(-3.0, -3.0) == pytest.approx([3.5**2 / 8, 0.5 - 4.5])
    assert told(2.0, 1.0) == pytest.approx([3.5 + 3, 0.5 + 1.5])
    # what is well known it does not change: to the second order of xi
    assert told(-1e-4, 0.0)[0] == pytest.approx(3.5 - 1.5e-4, abs=2e-8)


@pytest.mark.parametrize(
    ("values", "count"),
    [(("q", "v"), 2), (("k*q", "v"), 4), (("q - u", "v"), 7), (("q", "d(v)"), 9)],
)
def test_what_own_states_and_outputs_depend_on(values, count):
    """As the Jacobians say: x alone where outputs are states, with xi where they read a constant,
    with r, a and v where they read an input, and with d and q where a derivative."""
    text = CART.replace('[outputs.q]\nvalue = "q"', f'[outputs.y]\nvalue = "{values[0]}"')
    text = text.replace('value = "d(v)"', f'value = "{values[1]}"')
    base = GrayBoxPlant.untrained(parse_plant(text))
    one = np.ones(1)
    error = Error(*(jnp.array([each]) for each in (TAU, SETTLING, SHARE)))._replace(
        wandering=one, lag=one, late=one, straying=one, leaning=one, lean=-one, trail=one,
        gripping=one, slip=one, travel=one,
    )  # fmt: skip
    every = {"wandering": (1,), "lagging": (0,), "straying": (0,), "leaning": (0,)}
    every |= {"trailing": (0,), "zeroed": (0, 1), "sticking": (1,)}
    shapes = ((1,), (0,), error, ("k", "c"), jnp.asarray(OFFSET), jnp.asarray(W))
    plant = Disturbed.of(base, *shapes, **every)
    x = jnp.asarray(np.random.default_rng(0).normal(size=len(plant.signals.states)))
    dx, dy = jax.jacfwd(lambda x: respond(plant, x, jnp.asarray(U)))(x)
    h = np.arange(plant.parts.h.start, plant.parts.h.stop)  # known whatever comes
    moving = np.flatnonzero(np.any(dx[: plant.count] != 0, axis=0))
    assert set(np.delete(moving, np.isin(moving, h))) <= set(plant.stirring)
    assert not set(plant.stirring) & {*h}
    rest = np.delete(np.arange(len(x)), [*plant.shown, *h])
    np.testing.assert_array_equal(np.asarray(dy)[:, rest], plant.added[:, rest])
    assert np.all(plant.added[:, plant.shown] == 0)
    assert len(plant.shown) == count
