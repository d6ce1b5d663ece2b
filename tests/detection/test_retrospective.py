"""Change-point smoothing: against the dense algebra of a Gaussian record, and on a tank."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import decide
from faultgauge.detection.onset import change_points
from faultgauge.detection.onset.retrospective import (
    as_dicts,
    retrospect,
    shares_in_hindsight,
)
from faultgauge.detection.onset.shocks import KnownStretch, Shocks, shocks
from faultgauge.detection.onset.window import Window, causes_in
from faultgauge.observers import divided_difference as dd
from faultgauge.observers.branches import SCALES
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.reporting.decision_chapter import decision_report
from faultgauge.reporting.report import render
from faultgauge.reporting.words.hindsight import sentences
from faultgauge.telemetry import Run
from warm import COUNT as LONG
from warm import SIGMA as NOISE
from warm import STEP as PACE
from warm import TANK, model

LAG = """
name = "lag"
[states.x]
derivative = "u - 0.5*x"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[faults.bias]
enters = "output"
target = "x"
[faults.leak]
enters = "state"
target = "x"
[faults.alien]
enters = "state"
target = "x"
"""
STEP, SIGMA, PROCESS, START, SIZE, JUMP = 0.4, 0.3, 0.2, 1.5, 0.7, 0.9
COUNT = 24
MISSING = [7, 8, 15]


def dense():
    """(first state, process noise, effects of a bias and of a leak by onset, of a jump) on y, and
    R: the record written out, y = free + noise."""
    z = -0.5 * STEP
    fade = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24  # of one classical Runge-Kutta step
    gain = (fade - 1) / -0.5
    k = np.arange(COUNT)
    lag = np.subtract.outer(k, k)
    decay = np.where(lag >= 0, fade ** np.maximum(lag, 0), 0.0)
    from_first = fade ** k.astype(float)
    noise = decay[:, 1:] * PROCESS * np.sqrt(STEP)  # between samples, none before the first
    R = START**2 * np.outer(from_first, from_first) + noise @ noise.T + SIGMA**2 * np.eye(COUNT)
    steps = decay * np.where(k > 0, gain, 0.0)  # what the step into each sample adds, by then
    bias = (lag >= 0).astype(float)
    leak = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]
    jump = decay * np.where(k > 0, fade, 1.0)
    return from_first, R, bias, leak, jump


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    # no sample is so far off that it would count as an outlier
    y = 0.4 * rng.standard_normal(COUNT) + np.where(np.arange(COUNT) >= 11, 0.4, 0.0)
    y[MISSING] = np.nan
    return y


def lane(text, process):
    base = GrayBoxPlant.untrained(parse_plant(text))
    nothing = Error(*[jnp.zeros(0)] * 3)
    plant = Disturbed.of(base, (), (), nothing, (), jnp.zeros(0), jnp.zeros((0, 0)))
    noise = dd.FilterNoise(jnp.array([process]), jnp.zeros(3), jnp.array([SIGMA]))
    filter = dd.DividedDifferenceFilter(plant, jnp.ones(1), jnp.full(3, SIZE), (), 1)
    return filter, noise


def found(y, f=None):
    filter, noise = lane(LAG, PROCESS)
    dt = np.full(COUNT, STEP)
    dt[0] = 0.0
    f = np.zeros((COUNT, 3)) if f is None else f
    arrays = (np.zeros((COUNT, 1)), y[:, None], dt, f, np.zeros((COUNT, 3)))
    record = KnownStretch(*(jnp.asarray(a) for a in arrays))
    return shocks(
        filter, noise, filter.begin(jnp.zeros(1), jnp.array([START])), record, jnp.array([JUMP])
    )


def test_score_and_information_of_every_onset_are_those_of_the_dense_record(record):
    _, R, bias, leak, _ = dense()
    seen = np.isfinite(record)
    y, R = record[seen], R[np.ix_(seen, seen)]
    answer = found(record)
    for column, effect in enumerate((bias[seen], leak[seen])):
        # forty Kalman steps against one solve, and slopes by differences: rounding
        np.testing.assert_allclose(
            answer.score[:, column], effect.T @ np.linalg.solve(R, y), rtol=1e-6, atol=1e-7
        )
        information = np.diagonal(effect.T @ np.linalg.solve(R, effect))
        np.testing.assert_allclose(answer.information[:, column], information, rtol=1e-6, atol=1e-7)
    expected = multivariate_normal(np.zeros(len(y)), R).logpdf(y)
    assert float(answer.base) == pytest.approx(expected, rel=1e-7)


def test_an_unknown_shock_gains_the_likelihood_of_the_dense_record(record):
    _, R, _, _, jump = dense()
    seen = np.isfinite(record)
    y, R, jump = record[seen], R[np.ix_(seen, seen)], jump[seen]
    answer = found(record)
    healthy = multivariate_normal(np.zeros(len(y)), R).logpdf(y)
    for onset in (0, 5, 11, 20):
        jumped = R + JUMP**2 * np.outer(jump[:, onset], jump[:, onset])
        gain = multivariate_normal(np.zeros(len(y)), jumped).logpdf(y) - healthy
        np.testing.assert_allclose(answer.unknown[onset], gain, rtol=1e-6, atol=1e-7)


def test_on_a_linear_plant_it_does_not_matter_where_it_is_linearised(record):
    told = np.zeros((COUNT, 3))
    told[9:, 0] = 0.8
    plain, around = found(record), found(record, told)
    for name in ("score", "information", "unknown", "base"):
        np.testing.assert_allclose(
            getattr(around, name), getattr(plain, name), rtol=1e-6, atol=1e-7
        )
    np.testing.assert_allclose(around.white + around.fit, plain.white, rtol=1e-6, atol=1e-7)


def test_a_mean_that_changes_in_known_noise_is_the_textbook_one():
    """x stands still and is known, so y_k ~ N(f [k >= n], SIGMA^2): the size after an onset at n is
    the mean of what follows, its information the number of samples over SIGMA^2."""
    rng = np.random.default_rng(1)
    y = SIGMA * rng.standard_normal(COUNT) + np.where(np.arange(COUNT) >= 10, 1.0, 0.0)
    filter, noise = lane(LAG.replace("u - 0.5*x", "u"), 0.0)
    arrays = (np.zeros((COUNT, 1)), y[:, None], np.full(COUNT, STEP), *np.zeros((2, COUNT, 3)))
    record = KnownStretch(*(jnp.asarray(a) for a in arrays))
    begin = filter.begin(jnp.zeros(1), jnp.zeros(1))
    answer = shocks(filter, noise, begin, record, jnp.array([JUMP]))
    left = COUNT - np.arange(COUNT)
    means = np.cumsum(y[::-1])[::-1] / left
    np.testing.assert_allclose(answer.information[:, 0], left / SIGMA**2, rtol=1e-7)
    np.testing.assert_allclose(answer.score[:, 0] / answer.information[:, 0], means, rtol=1e-6)


@pytest.mark.parametrize("size", [0.0, 0.7])
def test_a_fault_that_enters_with_a_late_input_is_told_as_such(record, size):
    """The dense record again, wherever it is linearised: from an onset on a unit of the leak acts
    with the v that begins with it, which acts with its mean in a step."""
    leaning, lean = 0.5, -0.8
    text = LAG.replace('[faults.leak]\nenters = "state"\ntarget = "x"',
                       '[faults.leak]\nenters = "input"\ntarget = "u"')  # fmt: skip
    base, none = GrayBoxPlant.untrained(parse_plant(text)), jnp.zeros(0)
    error = Error(none, none, none, leaning=jnp.array([leaning]), lean=jnp.array([lean]))
    plant = Disturbed.of(base, (), (), error, (), none, jnp.zeros((0, 0)), leaning=(0,))
    filter = dd.DividedDifferenceFilter(plant, jnp.ones(2), jnp.full(3, SIZE), (), 1)
    noise = dd.FilterNoise(jnp.array([PROCESS, 0.0]), jnp.zeros(3), jnp.array([SIGMA]))
    dt, guess = np.where(np.arange(COUNT) > 0, STEP, 0.0), np.zeros((COUNT, 3))
    guess[9:, 1] = size
    arrays = np.zeros((COUNT, 1)), record[:, None], dt, guess, np.zeros((COUNT, 3))
    begin = filter.begin(jnp.zeros(2), jnp.array([START, 0.0]))
    stretch = KnownStretch(*(jnp.asarray(a) for a in arrays))
    answer = shocks(filter, noise, begin, stretch, jnp.array([JUMP, 0.0]))
    _, R, _, effect, _ = dense()
    steps = effect - np.append(effect[:, 1:], np.zeros((COUNT, 1)), axis=1)  # into a sample
    for n in range(COUNT):
        now = lean
        for k in range(n, COUNT):
            span = dt[k] / leaning
            effect[:, n] += steps[:, k] * now * ((1 - np.exp(-span)) / span if span else 1.0)
            now *= np.exp(-span)
    seen = np.isfinite(record)
    y, R, effect = record[seen], R[np.ix_(seen, seen)], effect[seen]
    wanted = effect.T @ np.linalg.solve(R, y)
    np.testing.assert_allclose(answer.score[:, 1], wanted, rtol=1e-6, atol=1e-6)
    wanted = np.diagonal(effect.T @ np.linalg.solve(R, effect))
    np.testing.assert_allclose(answer.information[:, 1], wanted, rtol=1e-6, atol=1e-7)


def test_a_fault_that_an_input_at_its_limit_hides_shows_to_the_other_side():
    """x' = u, known at the start, and u stands at its limit, 1: more of it changes nothing; less
    from n on changes x_k by the steps into the samples n to k; there is none into the first. The
    guess is the truth, so that no sample counts as an outlier."""
    text = LAG.replace("u - 0.5*x", "u").replace('hold = "zero"', 'hold = "zero"\nmax = 1')
    text = text.replace('[faults.leak]\nenters = "state"\ntarget = "x"',
                        '[faults.leak]\nenters = "input"\ntarget = "u"')  # fmt: skip
    filter, noise = lane(text, 0.0)
    dt, k = np.where(np.arange(COUNT) > 0, STEP, 0.0), np.arange(COUNT)
    found = []
    for guess in (-0.5, 0.5):
        f = np.zeros((COUNT, 3))
        f[:, 1] = guess
        x = STEP * k[:, None] * min(1 + guess, 1)
        arrays = np.ones((COUNT, 1)), x, dt, f, np.zeros((COUNT, 3))
        record = KnownStretch(*(jnp.asarray(a) for a in arrays))
        begin = filter.begin(jnp.zeros(1), jnp.zeros(1))
        found.append(shocks(filter, noise, begin, record, jnp.array([JUMP])).information[:, 1])
    steps = np.clip(np.add.outer(1 - np.maximum(k, 1), k), 0, None)  # onset by sample
    wanted = np.sum((STEP * steps / SIGMA) ** 2, axis=1)
    np.testing.assert_allclose(found[0], wanted, rtol=1e-6)
    np.testing.assert_array_equal(found[1], 0.0)


@pytest.fixture(scope="module")
def bank():
    levels = [NOISE], [1e-3], [1e-4], [1e-4], [100.0], [1e-3], [5.0], [], []
    noise = Noise(*(np.array(each) for each in levels))  # next to no error of the model
    return build_fault_bank(model(), [log(0)], noise)


def log(seed, pump=0.0, u=None, start=400, stop=LONG, weak=0.0):
    """The tank exactly, its pump off by `pump`, inside its limits, from sample to sample; from
    sample 550 on it is `weak`."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.5, 1.5, LONG // 20), 20) if u is None else np.full(LONG, u)
    k = np.arange(LONG)
    left = np.where(k >= 550, 1 - weak, 1.0)
    applied = np.clip(left * u + pump * ((k >= start) & (k < stop)), 0, 2)
    fade = np.exp(-0.2 * PACE)
    x = np.full(LONG, (u[0] + 0.1) / 0.2)
    for n in range(LONG - 1):
        x[n + 1] = fade * x[n] + (1 - fade) / 0.2 * (applied[n] + 0.1)
    y = x + NOISE * rng.standard_normal(LONG)
    return Run(f"run{seed}", "tank.csv", PACE * k, {"u": u, "x": y})


@pytest.fixture(scope="module")
def biased(bank):
    decision = decide(bank, log(1, pump=0.1))
    return decision, retrospect(bank, decision)


def test_a_pump_that_is_off_is_told_from_a_weak_one_sized_and_dated(biased):
    (seen,) = biased[1]
    assert seen.cause == "pump"
    assert seen.p > 0.95
    assert seen.lo < 0.1 < seen.hi
    # 400 samples at a drift that is as good as none: online, the last 100 to 1000 count
    assert seen.hi - seen.lo < 0.02
    assert seen.onset_lo <= 200.0 <= seen.onset_hi
    # 0.1 bends x by 0.05 a sample, two and a half times its noise
    assert seen.onset_hi - seen.onset_lo <= 4 * PACE
    assert dict(seen.alternatives)["weak"] > 20
    assert seen.told.start == next(e.start for e in biased[0].events if e.fault == "pump")
    assert seen.density.sum() == pytest.approx(1.0)
    assert seen.least["pump"] < 0.1


def test_a_healthy_log_holds_no_fault_and_says_what_would_not_have_shown(bank):
    decision = decide(bank, log(2))
    seen = retrospect(bank, decision)
    assert [each.cause for each in seen] == ["healthy"]
    assert seen[0].onset is None
    assert seen[0].size is None
    assert "no fault; pump below 0.0" in sentences(bank, [decision], seen)[0]


# between the two others, which are of no fault and of a sure one
BETWEEN = (pytest.param(each, marks=pytest.mark.study) for each in (0.5, 0.7))


@pytest.mark.parametrize("share", [0.3, *BETWEEN, 1.0])
def test_odds_and_p_add_up_however_weak_the_evidence(bank, share):
    """A rival of odds o has p / o, and all rivals together have what p leaves; what is told is the
    likeliest of all."""
    size = retrospect(bank, decide(bank, log(2)))[0].least["pump"]
    (seen,) = retrospect(bank, decide(bank, log(11, pump=share * size)))
    rest = sum(seen.p / odds for _, odds in seen.alternatives)
    # the weights of a weaker rival are those beside no other change
    assert rest == pytest.approx(1 - seen.p, rel=0.1, abs=1e-4)
    assert all(odds >= 1 for _, odds in seen.alternatives)


def test_what_a_limit_cuts_off_would_not_have_shown(bank):
    decision = decide(bank, log(3, u=0.0))
    (seen,) = retrospect(bank, decision)
    assert seen.least["weak"] is None  # a gain takes nothing away from 0
    assert "nor would weak of any size to be expected" in sentences(bank, [decision], [seen])[0]


def test_a_fault_from_before_a_gap_is_there_from_the_first_sample_after_it(bank):
    run = log(4, pump=0.15, start=300)
    run.columns["u"][400:430] = np.nan
    run.columns["x"][[350, 500, 501]] = np.nan
    first, second = retrospect(bank, decide(bank, run))
    assert (first.cause, second.cause) == ("pump", "pump")
    assert first.onset_lo <= 150.0 <= first.onset_hi
    assert second.onset_lo == second.start == 430 * PACE
    assert second.lo < 0.15 < second.hi


def test_a_fault_that_went_ends_its_window(bank):
    decision = decide(bank, log(5, pump=0.15, start=200, stop=450))
    seen = retrospect(bank, decision)
    assert [each.cause for each in seen] == ["pump", "healthy"]
    assert seen[0].lo < 0.15 < seen[0].hi
    assert seen[0].end <= 225.0
    assert "pump" in render(decision_report(bank, [decision], seen))


def test_two_faults_are_sized_and_dated_beside_each_other(bank):
    decision = decide(bank, log(7, pump=0.2, start=250, weak=0.3))
    seen = retrospect(bank, decision)
    assert [each.cause for each in seen] == ["pump", "weak"]
    for each, size, onset in zip(seen, (0.2, 0.3), (125.0, 275.0), strict=True):
        assert each.lo < size < each.hi
        assert each.onset_lo <= onset <= each.onset_hi
        assert each.hi - each.lo < 0.1
    assert "Onset of weak" in render(decision_report(bank, [decision], seen))
    # both are there: what is less likely is that the other is there alone
    pump, weak = sentences(bank, [decision], seen)
    assert "; weak alone is more than 1000 times less likely;" in pump
    assert "; pump alone is more than 1000 times less likely;" in weak


@pytest.mark.study
def test_a_fault_that_is_not_constant_is_not_given_one_size(bank):
    """A ramp of the pump: 0.4 in the course of 200 s."""
    decision = decide(bank, log(8, pump=np.clip((np.arange(LONG) - 300) * 1e-3, 0, None), start=0))
    seen = retrospect(bank, decision)
    assert seen[0].cause != "healthy"
    assert all(each.cause != "weak" for each in seen)
    assert seen[0].cause == "unknown"
    assert "something undeclared or not constant" in sentences(bank, [decision], seen)[0]
    # the posterior dates its likeliest jump, and what is told is as old as the alarm
    page = render(decision_report(bank, [decision], seen))
    assert "In hindsight: something undeclared or not constant" in page
    assert "Onset of something undeclared" not in page


def test_another_cause_that_was_told_online_is_said(bank, biased):
    decision, _ = biased
    (event,) = decision.events
    (seen,) = retrospect(bank, replace(decision, events=[replace(event, fault="weak")]))
    assert (seen.cause, seen.told.start, seen.told.other) == ("pump", None, ("weak", event.start))
    (sentence,) = sentences(bank, [decision], [seen])
    assert f"; online you would have been told weak at {event.start:.6g} s" in sentence


def test_a_fault_is_over_where_a_later_part_of_its_log_does_not_show_it(bank, biased):
    (seen,) = biased[1]
    healthy = replace(seen, cause="healthy", start=900.0, onset=None, onset_lo=None, onset_hi=None)
    for then in (healthy, replace(seen, cause="weak", start=900.0)):
        assert " until 900 s (p " in sentences(bank, [biased[0]], [seen, then])[0]
    untold = replace(seen.told, size=None)
    undeclared = replace(seen, cause="unknown", size=None, start=900.0, told=untold)
    for other in (undeclared, replace(healthy, run="another"), replace(seen, start=900.0)):
        assert " until " not in sentences(bank, [biased[0]], [seen, other])[0]


def test_what_is_no_more_than_likely_is_said_to_be_so(bank, biased):
    (sentence,) = sentences(bank, [biased[0]], [replace(biased[1][0], p=0.6)])
    assert sentence.startswith("In hindsight undecided; the likeliest is pump +")


def test_what_is_undecided_says_between_what(bank, biased):
    """At p 0.97 a rival of odds 32 is what leaves it open; beside p 0.999 nobody asks."""
    decision, (seen,) = biased
    rivals = (("unknown", 32.0), ("healthy", 45.0))
    for p, said in ((0.97, True), (0.999, False)):
        (line,) = sentences(bank, [decision], [replace(seen, p=p, alternatives=rivals)])
        assert ("; something undeclared is only 32 times less likely" in line) == said
        assert ("; no fault is 45 times less likely" in line) == said


def test_samples_outside_the_training_envelope_say_nothing(bank):
    decision = decide(bank, log(6))
    decision.run.columns["x"][300:310] += 5.0  # as if the model were wrong there
    decision.posterior.outside[300:310] = 1
    (seen,) = retrospect(bank, decision)
    assert seen.cause == "healthy"


def test_a_fault_so_large_that_the_filter_is_lost_around_it_is_told_from_where_there_is_none(
    bank, monkeypatch
):
    decision = decide(bank, log(0, pump=0.3))
    window = next(change_points.windows_of(bank, decision))
    plain = change_points.shocks_of(bank, window)
    wanted = causes_in(bank, window, plain)
    assert change_points.total(wanted.weight[:, 0]) > 0  # it asks for more

    def lost(bank, window, f=None, span=None):
        nothing = Shocks(*(jnp.nan * each for each in plain))
        return plain if f is None else nothing

    monkeypatch.setattr(change_points, "shocks_of", lost)
    told = change_points.causes_of(bank, window)
    np.testing.assert_array_equal(told.weight, wanted.weight)
    np.testing.assert_array_equal(told.mean, wanted.mean)
    assert told.seen[0] is plain


def said_of(bank, run):
    """A run in hindsight: its sentences, and what was judged of it."""
    decision = decide(bank, run)
    seen = retrospect(bank, decision)
    return sentences(bank, [decision], seen), shares_in_hindsight(decision, seen), decision


def test_hindsight_says_of_which_share_it_speaks(bank):
    """A quarter of the log without samples: 200 of 800 rows."""
    run = log(2)
    run.columns["u"][300:500] = np.nan
    (line,), shares, _ = said_of(bank, run)
    assert shares.judged == pytest.approx(0.75)
    assert [(each.start, each.end, each.reason) for each in shares.silent] == [
        (150.0, 249.5, "not sampled")
    ]
    assert line.startswith(
        "In hindsight: no fault in the 75 % of the log that could be judged; not judged from 150 s "
        "to 249.5 s (not sampled); pump below 0.0"
    )
    assert line.endswith(" would not have shown there")
    faulty = log(4, pump=0.15, start=100)
    faulty.columns["u"][300:500] = np.nan
    (first, *_, last), shares, _ = said_of(bank, faulty)
    assert shares.judged == pytest.approx(0.75)
    assert first.startswith("In hindsight: pump +")
    assert last == (
        "In hindsight 75 % of the log could be judged; not judged from 150 s to 249.5 s (not "
        "sampled)"
    )


def test_of_several_runs_hindsight_speaks_of_each(bank):
    """One with a fault, one without, and one that has no samples."""
    runs = [log(1, pump=0.1), log(2), log(3)]
    runs[2].columns["x"][15:] = np.nan
    decisions = [decide(bank, run) for run in runs]
    seen = [each for one in decisions for each in retrospect(bank, one)]
    first, second, third = sentences(bank, decisions, seen)
    assert first.startswith("In hindsight: pump +")
    assert second.startswith("In hindsight: no fault in run run2; pump below 0.0")
    assert third.startswith("In hindsight: nothing of run run3 could be judged: ")


def test_where_nothing_would_show_hindsight_judged_nothing(bank):
    """A sensor that is a thousand times as noisy as the one that the healthy window had: no size
    of a fault would show, so that none showed says nothing."""
    decision = decide(bank, log(2))
    (seen,) = retrospect(bank, decision)
    blind = replace(seen, least=dict.fromkeys(seen.least), judged=0.0)
    (line,) = sentences(bank, [decision], [blind])
    assert line == (
        "In hindsight: nothing could be judged: from 0 s to 399.5 s (no declared fault of any size "
        "to be expected would show)"
    )
    (plain,) = as_dicts([blind])
    assert (plain["cause"], plain["p"], plain["judged"]) == (None, None, 0.0)


def test_what_a_window_without_a_fault_leaves_possible_is_said(bank):
    """A rival of odds 3 beside p 0.6 has p 0.2; one of p 0.01 goes without saying."""
    decision = decide(bank, log(2))
    (seen,) = retrospect(bank, decision)
    likely = replace(seen, p=0.6, alternatives=(("weak", 3.0), ("pump", 60.0)))
    (line,) = sentences(bank, [decision], [likely])
    assert line.endswith("; there may be weak (p 0.2)")
    told = replace(seen.told, other=("pump", 120.5))
    (line,) = sentences(bank, [decision], [replace(likely, told=told)])
    assert line.endswith("; online you would have been told pump at 120.5 s")
    other = decide(bank, log(2))
    both = [decision, replace(other, run=replace(other.run, name="b"))]
    (line,) = sentences(bank, both, [likely, replace(seen, run="b", alternatives=())])
    assert line.endswith("; there may be weak (p 0.2, run run2)")
    (line,) = sentences(bank, [decision], [replace(likely, p=0.99, alternatives=(("weak", 90.0),))])
    assert "there may be" not in line


def test_sentence_json_and_report_say_the_same(bank, biased):
    decision, seen = biased
    (sentence,) = sentences(bank, [decision], seen)
    assert sentence.startswith(f"In hindsight: pump +{seen[0].size:.4f} l/s (+{seen[0].lo:.4f} to ")
    assert ") since " in sentence
    assert "; weak is " in sentence
    assert f"online you would have been told at {seen[0].told.start:.6g} s" in sentence
    (plain,) = json.loads(json.dumps(as_dicts(seen), allow_nan=False))
    assert plain["size"] == seen[0].size
    assert plain["told"]["start"] == seen[0].told.start
    assert {each["cause"] for each in plain["alternatives"]} == {"weak", "unknown", "healthy"}
    page = render(decision_report(bank, [decision], seen))
    assert "In hindsight" in page
    assert "Onset of pump" in page


def test_the_size_given_an_onset_is_its_part_of_the_mixture(biased):
    """At the true onset, 200 s: what acts from sample 400 on is an onset at sample 401."""
    seen = biased[1][0]
    assert seen.density @ seen.given == pytest.approx(seen.size, rel=1e-6)
    assert seen.given[np.searchsorted(seen.t, 200.0) + 1] == pytest.approx(0.1, abs=0.01)


def limited(bank, low, high):
    """`bank` with these limits of its pump's fault, and nothing else changed."""
    limits = f'unit = "l/s"\nmin = {low}\nmax = {high}'
    spec = parse_plant(TANK.replace('unit = "l/s"', limits))
    return replace(bank, model=replace(bank.model, plant=GrayBoxPlant.untrained(spec)))


def test_no_size_is_told_beyond_the_limit_of_its_fault(bank, biased):
    """The pump is off by 0.1, of which the file allows 0.095."""
    (seen,) = retrospect(limited(bank, -1.0, 0.095), biased[0])
    assert seen.cause == "pump"
    assert 0 < seen.lo <= seen.size <= seen.hi <= 0.095


@pytest.mark.parametrize("limits", [(-1e9, 1e9), (0.0, 1e9), (-1e9, 0.0), (-0.05, 0.1)])
@pytest.mark.parametrize("score", [-30.0, 0.0, 30.0])
def test_evidence_for_a_fault_is_that_of_the_sizes_it_may_have(bank, limits, score):
    """By SciPy's quadrature: exp(score f - information f^2 / 2) over the normal prior of each
    width, cut off at the limits."""
    information, (low, high) = 400.0, limits
    size, length = float(bank.size[0]), 3
    count = bank.modes.filter.faults
    nothing = np.zeros((length, 1))
    scores, known = np.zeros((length, count)), np.full((length, count), information)
    scores[:, 0] = score
    found = Shocks(
        *(jnp.asarray(a) for a in (scores, known, np.zeros(length), 0.0, nothing, nothing))
    )
    weight = causes_in(limited(bank, low, high), a_window(bank, length), found).weight[1:, 0]

    def share(s):
        a, b = max(low, -9 * s), min(high, 9 * s)
        mass = norm.cdf(high, 0, s) - norm.cdf(low, 0, s)
        peak = float(np.clip(score / (information + s**-2), a, b))
        top = score * peak - information * peak**2 / 2

        def density(f):
            return np.exp(score * f - information * f**2 / 2 - top) * norm.pdf(f, 0, s)

        width = 9 / np.sqrt(information)
        ends = max(a, peak - width), min(b, peak + width)
        return quad(density, *ends, points=[peak], limit=200)[0] * np.exp(top) / mass

    wanted = np.log(np.mean([share(scale * size) for scale in SCALES]))
    # a mass below a thousandth of a side is taken for that of the nearer limit alone
    np.testing.assert_allclose(weight - np.log(bank.onset[0] * PACE), wanted, rtol=1e-6, atol=1e-6)


def a_window(bank, length):
    """So many samples in which nothing is said of inputs and outputs."""
    dt, nothing = np.full(length, PACE), np.zeros((length, 1))
    faults = np.zeros((length, bank.modes.filter.faults))
    record = KnownStretch(*(jnp.asarray(a) for a in (nothing, nothing, dt, faults, faults)))
    start = jnp.zeros(bank.modes.filter.states)
    belief = bank.modes.filter.begin(start, start)
    return Window(belief, record, PACE * np.arange(length), slice(0, length))


def test_before_any_data_something_undeclared_is_a_hundred_times_rarer_than_a_fault(bank):
    """As the method says: at the start of a log, at any time in it, and, with the log in hand, at
    every onset behind its first sample. The tank's gauge may be off undeclared, or it is no fault
    of a kind that anyone thought of: a hundredth each online, and both together in hindsight."""
    prior = bank.modes.prior
    # of a fault that has several kinds of step, all together
    owner, steps = bank.modes.owner, bank.modes.grows == 0
    rate, first = (
        np.bincount(owner[steps], np.asarray(each)[steps])
        for each in (prior.onset, np.exp(prior.first))
    )
    for undeclared, declared in (
        (rate[2], rate[:2]),
        (prior.unknown, rate[:2]),
        (first[2], first[:2]),
    ):
        np.testing.assert_allclose(undeclared / declared, 0.01, rtol=1e-9)
    faults, count = bank.modes.filter.faults, 4
    nothing = (count, faults), (count, faults), count, (), (count, 1), (count, 1)
    found = Shocks(*(jnp.asarray(np.zeros(shape)) for shape in nothing))
    weight = causes_in(bank, a_window(bank, count), found).weight[1:]
    undeclared = np.logaddexp.reduce(weight[:, 2:], axis=1)
    np.testing.assert_allclose(np.exp(undeclared[:, None] - weight[:, :2]), 0.01, rtol=1e-9)
