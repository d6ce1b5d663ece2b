"""When a fault began: against the exact posterior of a linear plant, written out here in NumPy."""

import numpy as np
import pytest
from scipy.stats import binom

from faultgauge.detection.bank import build_fault_bank
from faultgauge.detection.decisions import decide
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
hold = "zero"
min = 0
max = 2
[outputs.x]
value = "x"
[faults.leak]
enters = "state"
target = "x"
[faults.pump]
enters = "input"
target = "u"
[faults.gauge]
enters = "output"
target = "x"
"""
STEP, COUNT, SIGMA, PROCESS = 0.5, 500, 0.05, 0.01
FADE = np.exp(-0.2 * STEP)
GAIN = (1 - FADE) / 0.2


def log(seed, leak=0.0, onset=np.inf, gauge=0.0, second=np.inf, u=None, pump=0.0):
    """Exact under the hold, an onset between samples too."""
    rng = np.random.default_rng([seed, 5])
    u = np.repeat(rng.uniform(0.2, 1.8, COUNT // 20), 20) if u is None else u
    t = STEP * np.arange(COUNT)
    x = np.full(COUNT, u[0] / 0.2)
    for k in range(COUNT - 1):
        late = np.clip(t[k + 1] - onset, 0, STEP)
        acting = np.clip(u[k] + pump * (t[k] >= onset), 0, 2)
        x[k + 1] = FADE * x[k] + GAIN * acting + leak * -np.expm1(-0.2 * late) / 0.2
        x[k + 1] += PROCESS * np.sqrt(STEP) * rng.standard_normal()
    y = x + gauge * (t >= second) + SIGMA * rng.standard_normal(COUNT)
    return Run(f"{seed}", "lag.csv", t, {"u": u, "x": y})


def bank_of(*faults):
    text = LAG
    for name in {"leak", "pump", "gauge"} - set(faults):
        start = text.index(f"[faults.{name}]")
        stop = text.find("[faults", start + 1)
        text = text[:start] + (text[stop:] if stop > 0 else "")
    record = {
        "max_step": 1.0,
        "envelope_points": np.random.default_rng(0).uniform([0, 0], [10, 2], (60, 2)).tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
    model = Model(GrayBoxPlant.untrained(parse_plant(text)), record)
    noise = Noise(np.array([SIGMA]), np.array([PROCESS]), np.zeros(0))
    return build_fault_bank(model, [log(0)], noise)


@pytest.fixture(scope="module")
def both():
    return bank_of("leak", "gauge")


def exact(run, prior):
    """Posterior of the sample from which a constant leak ~ N(0, prior^2) shows, and of its size;
    all samples at once, y ~ N(m, R) with an unknown first state."""
    u, y = run.columns["u"], run.columns["x"]
    driven, lag = np.zeros(COUNT), np.subtract.outer(np.arange(COUNT), np.arange(COUNT))
    for k in range(COUNT - 1):
        driven[k + 1] = FADE * driven[k] + GAIN * u[k]
    spread = np.where((lag >= 0) & (np.arange(COUNT) > 0), FADE ** np.maximum(lag, 0), 0.0)
    first = 10.0 * FADE ** np.arange(COUNT)
    R = PROCESS**2 * STEP * spread @ spread.T + np.outer(first, first) + SIGMA**2 * np.eye(COUNT)
    answers = GAIN * spread @ np.tril(np.ones((COUNT, COUNT)))  # column n: shows from sample n on
    root = np.linalg.cholesky(R)
    M, e = np.linalg.solve(root, answers), np.linalg.solve(root, y - driven)
    score, information = M.T @ e, np.sum(M**2, axis=0)
    variance = 1 / (information + prior**-2)
    weight = (score**2 * variance - np.log1p(information * prior**2)) / 2
    return np.exp(weight - np.logaddexp.reduce(weight))


def test_an_onset_is_told_as_by_the_exact_posterior_of_the_whole_log(both):
    for seed, size in ((1, 0.2), (2, -0.1), (3, 0.1)):
        run = log(seed, size, 120.3)
        (event,) = decide(both, run).events
        density = exact(run, both.levels.size[0])
        before = np.append(run.t[0], run.t[:-1])
        low, high = np.searchsorted(np.cumsum(density), [0.025, 0.975])
        # The bank sees a window around the alarm, the formula all: the size is known a little
        # better there, which moves an end by a sample at most.
        assert event.onset == pytest.approx(density @ (before + run.t) / 2, abs=0.5 * STEP)
        assert event.onset_lo == pytest.approx(before[low], abs=1.01 * STEP)
        assert event.onset_hi == pytest.approx(run.t[high], abs=1.01 * STEP)


def test_the_interval_holds_as_many_onsets_as_it_says(both):
    """Sizes and onsets at random, between samples too."""
    rng, inside, named, widths = np.random.default_rng(17), 0, 0, []
    for seed in range(100, 150):
        size, onset = rng.choice([-1, 1]) * 10 ** rng.uniform(-1.3, -0.5), rng.uniform(60, 190)
        events = [e for e in decide(both, log(seed, size, onset)).events if e.end >= onset]
        if events:
            named += 1
            inside += events[0].onset_lo <= onset <= events[0].onset_hi
            widths.append(events[0].onset_hi - events[0].onset_lo)
    assert named >= 40
    # 95 % of them, or more where a sample is as long as the interval; 1 in 1000 to fail by chance
    assert inside >= binom.ppf(1e-3, named, 0.95)
    assert np.median(widths) <= 10 * STEP


def test_what_a_limit_cuts_off_dates_nothing():
    """The pump stands at its limit from 100 s to 120 s: a bias up that begins there shows at 120 s,
    and may have begun at any time since 100 s."""
    u = np.full(COUNT, 1.0)
    u[np.arange(COUNT) % 40 < 20] = 1.4
    u[200:240] = 2.0
    (event,) = decide(bank_of("pump"), log(1, u=u, pump=0.5, onset=110.0)).events
    assert event.onset_lo <= 101.0
    assert 110.0 <= event.onset_hi <= 122.0


def test_faults_that_lie_close_are_dated_beside_each_other(both):
    """The second one begins before the first one is told."""
    run = log(1, leak=-0.3, onset=120.0, gauge=0.8, second=126.0)
    events = {e.fault: e for e in decide(both, run).events}
    for name, onset in (("leak", 120.0), ("gauge", 126.0)):
        assert events[name].onset_lo <= onset <= events[name].onset_hi
        assert events[name].onset_hi - events[name].onset_lo <= 6 * STEP
