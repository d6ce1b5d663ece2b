"""The truths behind the benchmarks of model error, and how their figures are scored."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from faultgauge.detection.posterior.events import BankEvent


@pytest.fixture(scope="module")
def load():
    """Imports a module of benchmarks/ by its name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        yield importlib.import_module


@pytest.fixture(scope="module")
def truths(load):
    """(truth, the largest error in its outputs) per case.

    Runge-Kutta's own error is far below the noise (0.02 to 0.1); the servo's friction is not
    smooth where the speed changes sign, and its encoder has steps of 1.5e-3 rad. The exchanger's
    fastest rate is 0.36/s: one step of 1 s errs by 0.36^5/120 = 5e-5 of what is still to go. The
    battery's is 0.16/s: 1e-6 of it. A step of the quadrotor is a fifth of its rotors' lag, and one
    of the air handling unit three eighths of its stem's: errors of (1/5)^5/120 and (3/8)^5/120 of a
    jump, 3e-6 and 6e-5 (of 2 rad/s, of 10 K). The valve's stem starts and stops with kinks (noise
    0.06), the cylinder's spool has one at its middle (0.4 bar). The heater board's fastest rate is
    0.06/s: one step of 1 s errs by 0.06^5/120 = 6e-9 of what is still to go. A step of the DC motor
    is a third of its filter's lag: (1/3)^5/120 = 3e-5 of a change of 1 rad/s. Half a sample of the
    wheel is its electronics' lag: 9e-3 of a change of torque, which is some 0.1 rad/s. The pump's
    check valve has a kink (noise 0.02 L/s), and so have the ends of the two-mass drive's play (1e-4
    rad), and the gimbal's bristles where they turn (noise 2.5e-3 rad/s). A step of the furnace is a
    fifth of its thermocouple's lag: 3e-6 of some K. The motor of the pump station's valve stops
    with a kink (noise 0.7 kPa). Steps of the helicopter and the cold room are a sixth and an eighth
    of their sensors' lags: 1e-6 of some 100 rad/s and 3e-7 of some 10 K; the ball's beam has a kink
    where its teeth meet (noise 1e-4 rad).
    """
    rng = np.random.default_rng(0)
    return {
        "heaters": (load("mismatch.heaters").heaters().truth(rng), 1e-6),
        "equal": (load("mismatch.heaters").equal().truth(rng), 1e-6),
        "tanks": (load("mismatch.tanks").tanks("tanks", 0.02).truth(rng), 1e-6),
        "lag": (load("mismatch.lag").lag().truth(rng), 1e-6),
        "slow_sensor": (load("mismatch.slow_sensor").slow_sensor().truth(rng), 1e-6),
        "servo": (load("mismatch.servo").servo().truth(rng), 2e-4),
        "exchanger": (load("mismatch.exchanger").exchanger().truth(rng), 1e-3),
        "battery": (load("mismatch.battery").battery().truth(rng), 1e-5),
        "quad": (load("mismatch.quad").quad().truth(rng), 1e-5),
        "ahu": (load("mismatch.ahu").ahu().truth(rng), 1e-3),
        "valve": (load("mismatch.valve").valve().truth(rng), 1e-3),
        "cylinder": (load("mismatch.cylinder").cylinder().truth(rng), 2e-4),
        "bench_heaters": (load("mismatch.bench_heaters").bench_heaters().truth(rng), 1e-6),
        "dc_motor": (load("mismatch.dc_motor").dc_motor().truth(rng), 1e-4),
        "reaction_wheel": (load("mismatch.reaction_wheel").reaction_wheel().truth(rng), 1e-3),
        "pump_loop": (load("mismatch.pump_loop").pump_loop().truth(rng), 1e-3),
        "furnace": (load("mismatch.furnace").furnace().truth(rng), 1e-4),
        "two_mass": (load("mismatch.two_mass").two_mass().truth(rng), 1e-5),
        "heated_tank": (load("mismatch.heated_tank").heated_tank().truth(rng), 1e-5),
        "fan_drive": (load("mismatch.fan_drive").fan_drive().truth(rng), 1e-4),
        "gimbal": (load("mismatch.gimbal").gimbal().truth(rng), 1e-4),
        "pump_station": (load("mismatch.pump_station").pump_station().truth(rng), 1e-2),
        "helicopter": (load("mismatch.helicopter").helicopter().truth(rng), 5e-4),
        "cold_room": (load("mismatch.cold_room").cold_room().truth(rng), 1e-5),
        "ball_beam": (load("mismatch.ball_beam").ball_beam().truth(rng), 1e-5),
    }


@pytest.mark.parametrize(
    "case",
    [
        "heaters",
        "equal",
        "tanks",
        "lag",
        "slow_sensor",
        "servo",
        "exchanger",
        "battery",
        "quad",
        "ahu",
        "valve",
        "cylinder",
        "bench_heaters",
        "heated_tank",
        "fan_drive",
        "dc_motor",
        "reaction_wheel",
        "pump_loop",
        "pump_station",
        "furnace",
        "two_mass",
        "gimbal",
        "helicopter",
        "cold_room",
        "ball_beam",
    ],
)
def test_a_truth_is_what_scipy_integrates(load, truths, case):
    drawn, tolerance = truths[case]
    samples = 120
    quiet = replace(
        drawn,
        disturbances=drawn.disturbances[:samples],
        noise=np.zeros_like(drawn.noise[:samples]),
        quantum=(0.0,) * len(drawn.quantum),
    )
    u, y = load("mismatch.truth").simulate(quiet)
    x, found = np.array(quiet.start), []
    for k in range(samples):
        held = tuple(u[k]), tuple(quiet.disturbances[k])
        found.append(
            [x[each] if isinstance(each, int) else each(x, held[1]) for each in quiet.sensors]
        )
        step = solve_ivp(
            lambda t, x, held: quiet.rates(tuple(x), *held),
            (0.0, quiet.step),
            x,
            rtol=1e-9,
            atol=1e-11,
            args=(held,),
        )
        x = step.y[:, -1]
    np.testing.assert_allclose(y, found, atol=tolerance, rtol=0)


def test_faults_enter_where_a_plant_file_has_them(load):
    """An integrator, dx = u, from 0 under u = 2, limits -1 to 3: all by hand."""
    module = load("mismatch.truth")
    integrator = module.Truth(
        rates=lambda x, u, d: (u[0],),
        states=("x",),
        start=(0.0,),
        sensors=(0,),
        command=lambda k, y: (2.0,),
        limits=((-1.0, 3.0),),
        disturbances=np.zeros((4, 1)),
        noise=np.zeros((4, 1)),
        quantum=(0.0,),
        step=1.0,
        substeps=1,
    )

    def outputs(*faults, **changes):
        return module.simulate(replace(integrator, **changes), faults)[1][:, 0]

    def fault(enters, size, **more):
        return module.Acting(enters, 0, size, 1.0, **more)

    assert outputs() == pytest.approx([0, 2, 4, 6])
    assert outputs(fault("state", 0.5)) == pytest.approx([0, 2, 4.5, 7])
    assert outputs(fault("input", 0.5)) == pytest.approx([0, 2, 4.5, 7])
    assert outputs(fault("input", 5.0)) == pytest.approx([0, 2, 5, 8])  # cut off at 3
    assert outputs(fault("gain", 0.25)) == pytest.approx([0, 2, 3.5, 5])
    assert outputs(fault("gain", 0.5), fault("input", 1.0)) == pytest.approx([0, 2, 4, 6])
    assert outputs(fault("output", 10.0)) == pytest.approx([0, 12, 14, 16])
    assert outputs(fault("output", 10.0, grows=True)) == pytest.approx([0, 2, 14, 26])
    assert outputs(fault("output_gain", 0.25)) == pytest.approx([0, 1.5, 3, 4.5])
    assert outputs(fault("output_gain", 0.5), fault("output", 1.0)) == pytest.approx([0, 2, 3, 4])
    assert outputs(quantum=(1.5,)) == pytest.approx([0, 1.5, 4.5, 6])
    assert outputs(fault("state", 0.5, end=2.0)) == pytest.approx([0, 2, 4.5, 6.5])
    pushed = {"rates": lambda x, u, d: (u[0] + d[0],), "sensors": (lambda x, d: 2 * x[0] - d[0],)}
    assert outputs(fault("disturbance", 0.5), **pushed) == pytest.approx([0, 3.5, 8.5, 13.5])


def test_coloured_noise_has_its_spread_and_its_correlation(load):
    found = load("mismatch.truth").coloured(np.random.default_rng(0), 100_000, 1.0, (2.0,), 10.0)
    x = found[:, 0]
    # 100000 s hold 5000 independent pieces of 2 tau: 2 % (one sigma: 1 %) of the spread
    assert x.std() == pytest.approx(2.0, rel=0.03)
    assert np.corrcoef(x[:-10], x[10:])[0, 1] == pytest.approx(np.exp(-1), abs=0.04)


def test_a_slow_sensor_has_its_own_samples(load):
    case = load("mismatch.slow_sensor").slow_sensor()
    run = case.log("a", np.random.default_rng(0))
    rows = np.flatnonzero(run.sampled["shell"])
    assert set(np.diff(rows)) == {10}
    assert run.own("shell")[rows] % 0.5 == pytest.approx(0.0, abs=1e-9)


def test_a_log_with_a_fault_is_the_healthy_one_until_the_onset(load):
    injected = load("mismatch.case").Injected
    case = load("mismatch.heaters").heaters()
    drawn = [
        case.log("a", np.random.default_rng(5), faults).columns["S2"]
        for faults in ((), [("sensor2_bias", injected(6.0, 400.0))])
    ]
    at = int(400.0 / 4.0)
    np.testing.assert_array_equal(drawn[0][:at], drawn[1][:at])
    np.testing.assert_allclose(drawn[1][at:] - drawn[0][at:], 6.0, atol=1e-9)  # 20 steps of 0.3 K


def test_a_fault_that_jumps_has_its_sizes_one_after_the_other(load):
    """A sensor's bias of each, over an output that shows no less, and the healthy log around."""
    stairs, case = load("mismatch.stairs"), load("mismatch.heaters").heaters()
    name, sizes = stairs.drawn_stairs(case, 4, 750, 4.0)  # the fifth of its faults
    assert name == "sensor1_bias"
    assert [each.end for each in sizes[:-1]] == [each.onset for each in sizes[1:]]
    drawn = [
        case.log("a", np.random.default_rng(5), faults).columns["S1"]
        for faults in ((), [(name, each) for each in sizes])
    ]
    for each in sizes:
        at = int(each.onset / 4.0)
        # until the loop has answered for some rows; 0.3 K steps
        assert drawn[1][at] - drawn[0][at] == pytest.approx(each.size, abs=3.0)
    before = slice(int(sizes[0].onset / 4.0))
    np.testing.assert_array_equal(drawn[1][before], drawn[0][before])


def test_every_set_and_rule_has_its_turn(load):
    harness = load("mismatch.harness")
    case = load("mismatch.heaters").heaters()
    found = harness.draws(case, 2 * 45)  # 15 pairs by 3 rules, and as many singles
    singles, pairs = found[::2], found[1::2]
    assert {len(each.faults) for each in singles} == {1}
    assert len({(each.faults, each.rule) for each in pairs}) == 45
    assert {(each.faults, each.rule) for each in singles} == {
        ((name,), rule) for name in case.sizes for rule in harness.RULES
    }


def test_sizes_follow_their_rule_as_far_as_they_make_sense(load):
    harness = load("mismatch.harness")
    case = load("mismatch.servo").servo()  # 20 rad/s^2 per volt
    smallest = {"load": 4.0, "encoder_offset": None, "amplifier_loss": 0.3}

    def sized(name, rule):
        said, found = harness.injections(case, harness.Draw((name,), rule), smallest, 0)
        onset = found[name].onset
        assert 0.25 * 15.0 <= onset <= 0.6 * 15.0
        assert onset / 0.01 == pytest.approx(round(onset / 0.01))
        return said, abs(found[name].size)

    assert sized("load", "x8") == ("x8", 32.0)
    assert sized("voltage_bias", "x4") == ("x4", pytest.approx(4 * 4.0 / 20))
    assert sized("amplifier_loss", "x4") == ("largest", 0.8)
    said, size = sized("encoder_offset", "x4")
    assert said == "engineering"
    assert 0.1 <= size <= 0.2


def event(fault, start, end, size=(1.0, 0.9, 1.1), onset=(0.0, 100.0)):
    """`size`: estimate and interval; `onset`: its interval."""
    f, lo, hi = size
    first, last = onset
    return BankEvent("a", fault, start, end, f, lo, hi, 0.99, first, first, last, ())


def judged(events, status, p):
    run = SimpleNamespace(name="a", t=np.arange(len(status)) * 10.0)
    posterior = SimpleNamespace(p=np.array([p]))
    return SimpleNamespace(run=run, events=events, status=status, posterior=posterior)


STATUS = ["NOT_JUDGED"] + ["HEALTHY"] * 4 + ["FAULT"] * 5  # t = 0 to 90 s


def test_a_fault_named_and_sized_is_scored_so(load):
    injected = load("mismatch.case").Injected
    events = [
        event("a", 50.0, 60.0, onset=(30.0, 45.0)),
        event("a", 70.0, 90.0, (1.9, 1.5, 2.3), onset=(60.0, 65.0)),
    ]
    scored = load("mismatch.scoring").scored(
        judged(events, STATUS, [0.9, 0.1]), ("a", "b"), {"a": injected(2.0, 40.0)}, "x4"
    )
    assert (scored.exact, scored.exact_at_end, scored.wrong, scored.missed) == (
        True,
        True,
        False,
        0,
    )
    assert (scored.unknown, scored.early, scored.nameless) == (False, False, False)
    assert scored.not_judged == pytest.approx(0.1)
    (found,) = scored.found.values()
    assert found.error == pytest.approx(-0.05)  # of the last event: 1.9 for 2
    assert found.half == pytest.approx(0.2)
    assert (found.sized, found.dated) == (True, True)  # dated by the first one
    assert found.delay == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("events", "p", "expected"),
    [
        # named before it began: a wrong name, and an alarm too early
        ([event("a", 10.0, 20.0)], [0.9, 0.1], {"wrong": True, "missed": 1, "exact": False}),
        ([event("b", 50.0, 90.0)], [0.1, 0.9], {"wrong": True, "missed": 1, "exact": False}),
        (
            [event("a", 50.0, 90.0), event("unknown", 50.0, 60.0, (None, None, None))],
            [0.9, 0.1],
            {"wrong": False, "missed": 0, "exact": False, "unknown": True, "exact_at_end": True},
        ),
        ([], [0.1, 0.1], {"missed": 1, "nameless": True, "exact": False, "exact_at_end": False}),
    ],
)
def test_what_is_wrong_is_told_apart(load, events, p, expected):
    injected = load("mismatch.case").Injected
    scored = load("mismatch.scoring").scored(
        judged(events, STATUS, p), ("a", "b"), {"a": injected(2.0, 40.0)}, "x4"
    )
    assert {name: getattr(scored, name) for name in expected} == expected


def test_a_fault_told_anew_after_its_end_is_a_wrong_name(load):
    injected = load("mismatch.case").Injected
    events = [event("a", 50.0, 60.0), event("a", 80.0, 90.0, onset=(75.0, 80.0))]
    for end, wrong in ((70.0, True), (76.0, False)):
        scored = load("mismatch.scoring").scored(
            judged(events, STATUS, [0.1, 0.1]), ("a", "b"), {"a": injected(2.0, 40.0, end)}, "x4"
        )
        assert (scored.wrong, scored.exact, scored.exact_at_end) == (wrong, not wrong, True)


def test_what_is_not_declared_is_rightly_told_as_unknown(load):
    injected = load("mismatch.case").Injected
    told = [event("unknown", 50.0, 90.0, (None, None, None), onset=(30.0, 45.0))]
    for events, exact in ((told, True), ([event("a", 50.0, 90.0)], False)):
        scored = load("mismatch.scoring").scored(
            judged(events, STATUS, [0.1]), ("a",), {"unknown": injected(2.0, 40.0)}, "x4"
        )
        assert (scored.exact, scored.wrong, scored.unknown) == (exact, not exact, False)
        assert scored.missed == (0 if exact else 1)
    figures = load("mismatch.scoring").figures([], [scored])
    assert figures["size_error"]["median"] is None


def test_faults_in_turn_end_before_the_next_begins(load):
    case = load("mismatch.servo").servo()
    drawn = load("mismatch.windows").drawn_windows
    for seed in range(5):
        found = drawn(case, seed, 1500, 0.01)
        assert sorted(found) == sorted(case.sizes)  # four of them
        ends = [0.0, *(time for each in found.values() for time in (each.onset, each.end)), 15.0]
        assert ends == sorted(ends)
        assert ends[1] >= 0.12 * 15.0


def test_a_window_is_exact_where_its_fault_alone_is_told_of_it(load):
    case, injected = load("mismatch.servo").servo(), load("mismatch.case").Injected
    acts = {"load": injected(1.0, 30.0, 50.0), "voltage_bias": injected(0.05, 70.0, 80.0)}

    def scored(*events):
        module = load("mismatch.windows")
        windows, false = module.scored_windows(case, judged(list(events), STATUS, [0.1]), acts)
        return windows, false

    right = event("load", 40.0, 50.0, onset=(29.0, 31.0))
    second = event("load", 75.0, 80.0, onset=(70.0, 71.0))  # that is what a bias of it looks like
    (first, last), false = scored(right, second)
    assert (first.exact, first.named, first.sized, first.dated, first.open) == (
        *(True, True, True, True),
        pytest.approx(1 / 3),  # of the rows at 30, 40 and 50 s the last is under alarm
    )
    assert (last.exact, last.injected.size, last.sized, false) == (True, 1.0, True, 0)
    (first, last), false = scored(right, event("encoder_offset", 45.0, 48.0, onset=(44.0, 45.0)))
    assert (first.exact, first.named, last.named, false) == (False, True, False, 0)
    (first, last), false = scored(event("load", 60.0, 62.0, onset=(58.0, 60.0)))
    assert (first.named, last.named, false) == (False, False, 1)


def test_an_alarm_on_a_healthy_log_counts(load):
    module = load("mismatch.scoring")
    alarmed = module.scored(judged([], STATUS, [0.1]), ("a",), {}, "")
    quiet = module.scored(judged([], ["HEALTHY"] * 10, [0.1]), ("a",), {}, "")
    found = module.figures([alarmed, quiet], [])
    assert (found["healthy_alarm"]["hits"], found["healthy_alarm"]["of"]) == (1, 2)
    assert found["exact"]["share"] is None


def test_the_interval_of_a_share_is_wilsons(load):
    """(p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n) for 8 of 10."""
    found = load("mismatch.scoring").wilson([True] * 8 + [False] * 2)
    z, n, p = 1.959964, 10, 0.8
    middle = p + z**2 / (2 * n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert found["lo"] == pytest.approx((middle - half) / (1 + z**2 / n), rel=1e-6)
    assert found["hi"] == pytest.approx((middle + half) / (1 + z**2 / n), rel=1e-6)


@pytest.mark.parametrize("name", ["lag", "motor"])
def test_the_step_of_the_rates_truth_is_exact(load, name):
    """Against SciPy's integration of the plant and the integral of the noise's covariance."""
    rates = load("rates")
    body, h = rates.BODIES[name](), 0.05
    exact = rates.discrete(body, h)
    start, u, f = np.arange(1.0, len(body.A) + 1), 0.7, -1.3
    found = solve_ivp(
        lambda t, z: body.A @ z + body.B * u + body.E * f,
        (0, h),
        start,
        rtol=1e-11,
        atol=1e-13,
    ).y[:, -1]
    np.testing.assert_allclose(exact.F @ start + exact.G * u + exact.L * f, found, rtol=1e-8)
    density = np.zeros_like(body.A)
    density[1, 1] = 2 * rates.WIND**2 / rates.WIND_TIME
    Q = quad_vec(lambda s: expm(body.A * s) @ density @ expm(body.A * s).T, 0, h)[0]
    np.testing.assert_allclose(exact.S @ exact.S.T, Q, atol=1e-12 * Q.max())


def test_logs_of_all_rates_are_one_physical_log(load, monkeypatch):
    rates = load("rates")
    monkeypatch.setattr(rates, "SECONDS", 3.0)
    monkeypatch.setattr(rates, "ONSET", 1.0)
    record = rates.physical(rates.motor(), rates.TEST, [0, 1], [0.0, 2.0])
    fine, slow = (rates.at_rate(record, rate)[1] for rate in (1000, 10))
    np.testing.assert_array_equal(fine.t[::100], slow.t)
    np.testing.assert_array_equal(fine.columns["u"][::100], slow.columns["u"])
    noise = slow.columns["y"] - record.y[1, ::100]
    np.testing.assert_allclose(noise, record.noise[1].reshape(-1, 100).mean(axis=1), atol=1e-12)
    pushed = rates.physical(rates.motor(), rates.TEST, [1], [0.0])
    np.testing.assert_allclose(pushed.y[0, :1000], record.y[1, :1000], atol=1e-12)
    assert record.y[1, 1500] - pushed.y[0, 1500] > 0.05  # 2 rad/s^2 for 0.5 s: 0.18 rad at most


def test_bisection_finds_the_smallest_size_that_is_told(load):
    rates = load("rates")
    asked = []

    class Known(rates.Search):
        """Seed s is told from place 5 + s on, seed 2 never."""

        def judge(self, places):
            asked.append(len(places))
            told = {seed: seed < 2 and at >= 5 + seed for seed, at in places.items()}
            return {seed: rates.Judged(each, False, 0.0) for seed, each in told.items()}

    search = Known(rates.lag(), None, 10)
    found = search.smallest(3, lambda each: each.online)
    assert found == [search.sizes[5], search.sizes[6], np.inf]
    assert len(asked) <= 7  # 33 sizes
    assert search.sizes[-1] == pytest.approx(search.body.largest)


def test_ratios_across_rates(load):
    found = [
        {"online": [1.0, 2.0, 3.0], "hindsight": [1.0], "half": [0.1]},
        {"online": [4.0], "hindsight": [2.0], "half": [0.15]},
    ]
    ratios = load("rates").ratios(found)
    assert ratios == pytest.approx(
        {"online": 2.0, "hindsight": 2.0, "half": 1.5, "online_over_hindsight": 2.0}
    )
    found[0]["online"] = [np.inf]
    assert load("rates").ratios(found)["online_over_hindsight"] == np.inf


def test_a_drifting_thermometer_is_scored(load):
    drift = load("drift")
    acting = load("mismatch.truth").Acting("output", 0, drift.DRIFT, 40.0, grows=True)
    size = drift.DRIFT * 50.0  # K, at 90 s
    events = [event("thermometer", 60.0, 90.0, (size, 0.9 * size, 1.1 * size), (30.0, 50.0))]
    found = drift.scored(judged(events, STATUS, [0.9]), acting)
    assert (found["named"], found["exact"], found["wrong"]) == (True, True, False)
    assert (found["dated"], found["sized"], found["delay"]) == (True, True, 20.0)
    assert not drift.scored(judged([], STATUS, [0.1]), acting)["named"]
