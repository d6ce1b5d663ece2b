"""What the bank knows across a gap: closed forms of the chain, the walk and the first sample."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.bank import build_fault_bank
from faultgauge.detection.course import Course, resumed
from faultgauge.detection.decisions import decide
from faultgauge.detection.judged import Past, Start
from faultgauge.detection.noise import Noise
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

LAG = """
name = "lag"
[states.x]
derivative = "u - 0.2*x"
[inputs.u]
[outputs.x]
value = "x"
[faults.push]
enters = "state"
target = "x"
[faults.bias]
enters = "output"
target = "x"
"""
STEP, SIGMA, COUNT = 0.5, 0.02, 800
NOISE = Noise(np.array([SIGMA]), np.array([1e-3]), np.zeros(0))


def model():
    points = np.random.default_rng(0).uniform([-6, -1], [6, 1], (60, 2))
    record = {
        "max_step": 1.0,
        "envelope_points": points.tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
    return Model(GrayBoxPlant.untrained(parse_plant(LAG)), record)


def log(seed, push=0.0, bias=0.0):
    """Exact under the hold; the fault from the middle on."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 20), 20)
    acts = np.arange(COUNT) >= COUNT // 2
    fade, x = np.exp(-0.2 * STEP), np.zeros(COUNT)
    for j in range(COUNT - 1):
        x[j + 1] = fade * x[j] + (1 - fade) / 0.2 * (u[j] + push * acts[j])
    y = x + bias * acts + SIGMA * rng.standard_normal(COUNT)
    return Run(f"run{seed}", "lag.csv", STEP * np.arange(COUNT), {"u": u, "x": y})


GAP = 400.0


@pytest.fixture(scope="module")
def begun():
    """(bank, its modes, their first state) with the fault `bias` certain and 0.3 +- 0.05."""
    bank = build_fault_bank(model(), [log(0)], NOISE)
    start = Start(bank.model.plant, np.array([1.0]), 0)
    modes, state = Course(bank, ("u", "x")).begin(start, np.array([0.0]))
    m = bank.sets.index((1,))
    belief = state.belief._replace(
        mean=state.belief.mean.at[m, 1].set(0.3), root=state.belief.root.at[m, 1, 1].set(0.05)
    )
    p = jnp.full_like(state.p, 1e-12).at[m].set(1.0)
    return bank, modes, state._replace(p=p, belief=belief), m


def after(begun, gap):
    bank, modes, state, m = begun
    past = Past(modes, state, gap)
    return bank, m, resumed(bank, past, np.array([2.0]), np.array([0.5]), ("u", "x"))


def test_a_fault_goes_on_with_its_prior_rates(begun):
    """Out of the bias alone: exp(-recovery T); what changes returns within 10 samples, and the
    other ways out are a thousand times rarer. Into the pair: onset T."""
    bank, m, state = after(begun, GAP)
    levels, p = bank.levels, np.asarray(state.p)
    stays = np.exp(-levels.recovery * GAP)
    assert p[m] == pytest.approx(stays, rel=1e-3)
    assert p[0] == pytest.approx(1 - stays, rel=0.02)
    assert p[bank.sets.index((0, 1))] == pytest.approx(levels.onset[0] * GAP, rel=0.03)
    assert p.sum() == pytest.approx(1.0, abs=1e-12)


def test_size_and_variance_go_on_and_the_first_sample_fits_the_fault(begun):
    bank, m, state = after(begun, GAP)
    mean = np.asarray(state.belief.mean)[m]
    root = np.asarray(state.belief.root)[m]
    P = root @ root.T
    walked = 0.05**2 + bank.levels.walk[1] ** 2 * GAP
    assert mean[1] == pytest.approx(0.3, rel=1e-3)  # mixed with what may have just begun, at 0
    assert P[1, 1] == pytest.approx(walked, rel=0.05)
    # the sensor reads 2.0, of which 0.3 is the fault's; together they are known as the sample is
    assert mean[0] == pytest.approx(2.0 - mean[1], rel=1e-12)
    assert P[0, 0] + 2 * P[0, 1] + P[1, 1] == pytest.approx((2 * SIGMA) ** 2, rel=1e-9)


@pytest.mark.parametrize("fault", ["push", "bias"])
def test_a_fault_outlasts_a_gap_and_the_hold_off_after_it_is_not_judged(fault):
    """120 s of nothing, 24 time constants: the state is forgotten, the fault is not. Without what
    was known before, a bias would be taken for the state's own start and never be seen again."""
    run = log(6, push=0.1) if fault == "push" else log(6, bias=0.3)
    t = run.t + 120.0 * (np.arange(COUNT) >= 600)
    run = Run(run.name, run.source, t, run.columns)
    bank = build_fault_bank(model(), [run], NOISE)
    decision = decide(bank, run)
    k = ["push", "bias"].index(fault)
    found = decision.posterior
    assert found.p[599, k] > 0.99
    assert np.all(found.p[600:, k] > 0.9)
    assert decision.status[600:610] == ["NOT_JUDGED"] * 10
    assert decision.status[611:] == ["FAULT"] * (COUNT - 611)
    before, after = ((found.hi - found.lo)[at, k] for at in (599, 601))
    assert before < after < 2 * before  # a sample after the gap tells less than the gap took
    event = next(e for e in decision.events if e.fault == fault)
    assert event.start < t[599]
    assert event.end == t[-1]
