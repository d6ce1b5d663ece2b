"""The bank over a log: probabilities, intervals, silence and events of a tank whose truth is
known."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.bank_calibration import calibrate_bank, calibrated
from faultgauge.detection.decisions import as_dicts, decide, decide_runs, table
from faultgauge.detection.posterior.events import Judged, _onset, _Stretch
from faultgauge.detection.posterior.uncalibrated import prior_of
from faultgauge.detection.posterior.verdicts import Verdict
from faultgauge.errors import InputError
from faultgauge.reporting.run_overview import run_overview
from faultgauge.reporting.words.answer import answers
from faultgauge.telemetry import Run
from warm import COUNT, SIGMA, STEP, TANK, model

NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA], [1e-3], [1e-3],
        *([1e-4], [100.0], [1e-3], [5.0]),  # next to no error of the model
        [], [],
    ))
)  # fmt: skip


@pytest.fixture(scope="module")
def bank():
    return build_fault_bank(model(), [log(0)], NOISE)


def log(seed, pump=0.0, u=None, onset=COUNT // 2):
    """Exact under the hold; the pump is off by `pump`, inside its limits, from `onset` on."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.5, 1.5, COUNT // 20), 20) if u is None else np.full(COUNT, u)
    applied = np.clip(u + pump * (np.arange(COUNT) >= onset), 0, 2)
    fade = np.exp(-0.2 * STEP)
    x = np.full(COUNT, (u[0] + 0.1) / 0.2)
    for k in range(COUNT - 1):
        x[k + 1] = fade * x[k] + (1 - fade) / 0.2 * (applied[k] + 0.1)
    y = x + SIGMA * rng.standard_normal(COUNT)
    return Run(f"run{seed}", "tank.csv", STEP * np.arange(COUNT), {"u": u, "x": y})


def test_a_pump_that_is_off_is_named_sized_and_dated(bank):
    decision = decide(bank, log(1, pump=0.2))
    found = decision.posterior
    event = next(e for e in decision.events if e.end == STEP * (COUNT - 1))
    onset = STEP * COUNT // 2
    assert event.fault == "pump"
    assert event.lo < 0.2 < event.hi
    assert event.hi - event.lo < 0.1  # and not by saying nothing
    # 0.2 moves x by 0.1 a sample, five times its noise: seen within a few samples, and told from
    # a weak pump when u changes, which it does every 20 samples; a name waits for 10 more
    assert onset < event.start <= onset + 35 * STEP
    assert event.onset_lo <= onset + STEP
    assert abs(event.onset - onset) <= 5 * STEP
    assert set(decision.status[-100:]) == {"FAULT"}
    assert {"HEALTHY"} == set(decision.status[200 : COUNT // 2])
    pairs = found.p.sum(axis=1) - (1 - found.healthy - found.unknown)  # counted twice
    assert np.all(pairs > -1e-9)
    assert np.all(np.isfinite(found.lo))
    assert np.all((found.lo <= found.f + 1e-9) & (found.f <= found.hi + 1e-9))


@pytest.mark.parametrize("ago", [0.0, 0.25 * STEP, 0.5 * STEP, 7.0])  # of an onset, at the telling
@pytest.mark.parametrize("sd", [0.0, 0.1 * STEP, 3.0])
def test_an_onset_is_not_told_more_closely_than_a_step_nor_after_its_fault(bank, ago, sd):
    """Of what lies between two samples nothing is known, however sure the filter is."""
    run, told, last = log(1), 400, 410
    found = prior_of(bank.model, run)
    found.onset[last, 0] = run.t[last] - run.t[told] + ago, sd
    nothing = np.zeros((COUNT, 3), bool)
    judged = Judged(
        run,
        found,
        Verdict(*np.zeros((2, COUNT), int), nothing[:, 0], nothing),
        *np.zeros((3, COUNT, 1)),
    )
    mean, low, high = _onset(bank, judged, _Stretch(0, 390, told, last + 1), last, 0.0)
    assert high - low >= STEP * (1 - 1e-9)
    assert low <= mean <= high <= run.t[told]


def test_a_bias_that_the_limit_cuts_off_has_an_interval_as_wide_as_its_prior(bank):
    """Upwards at the upper limit nothing shows, so nothing is claimed; downwards it would."""
    decision = decide(bank, log(2, pump=0.5, u=2.0))
    assert "FAULT" not in decision.status
    assert decision.events == []
    assert decision.posterior.hi[-1, 0] == pytest.approx(1.96 * bank.size[0], rel=1e-3)
    assert decision.posterior.lo[-1, 0] > -0.1


def test_a_gain_fault_without_excitation_is_not_judged_alone(bank):
    """At u = 0 a lost gain takes nothing away; at the limit 0 a bias still shows upwards, and the
    status speaks of it."""
    decision = decide(bank, log(3, u=0.0))
    assert (decision.status[-1], decision.reason[-1]) == (
        "HEALTHY", "weak would not show: u does not excite it",
    )  # fmt: skip
    assert decision.posterior.lo[-1, 1] == pytest.approx(-1.96 * bank.size[1], rel=1e-3)
    assert decision.posterior.hi[-1, 1] == pytest.approx(1.96 * bank.size[1], rel=1e-3)


def test_old_data_are_stale_and_what_was_not_sampled_is_not_judged(bank):
    run = log(4)
    run.columns["x"][500:600] = np.nan
    run.columns["u"][700:] = np.nan
    decision = decide(bank, run)
    assert decision.status[505] == "HEALTHY"
    assert set(decision.status[520:600]) == {"STALE"}
    assert decision.status[610] != "STALE"
    assert set(decision.status[700:]) == {"NOT_JUDGED"}
    assert set(decision.reason[700:]) == {"not sampled"}
    assert np.isnan(decision.posterior.f[700:]).all()


def test_outside_the_training_envelope_nothing_is_judged(bank):
    run = log(5)
    far = run.columns | {"x": run.columns["x"] + np.where(run.t > 300, 30.0, 0.0)}
    decision = decide(bank, Run("far", "far.csv", run.t, far))
    late = np.array(decision.status)[-50:]
    assert set(late) <= {"NOT_JUDGED", "FAULT"}
    assert "HEALTHY" not in set(decision.status[610:])


def test_a_healthy_tank_with_a_slow_nuisance_stays_healthy(bank):
    """The warmth drifts by half of its value, which is no fault."""
    run = log(6)
    slow = 0.05 * np.sin(2 * np.pi * run.t / 400)
    shift = np.convolve(slow, 0.1 * np.exp(-0.2 * STEP * np.arange(60)) * 5 * STEP)[:COUNT]
    decision = decide(
        bank, Run("warm", "w.csv", run.t, run.columns | {"x": run.columns["x"] + shift})
    )
    assert "FAULT" not in decision.status
    assert decision.events == []


def test_an_overview_says_what_drifts_beside_a_model_that_holds_it(bank):
    """1e-3 per root second over 399.5 s: 0.02."""
    decision = decide(bank, log(0))
    said = "The healthy model holds warm at one value; in a log as long as this one it drifts by"
    assert f"{said} about 0.02." in run_overview(bank, decision).caption.replace("\u00a0", " ")
    still = replace(bank, noise=bank.noise._replace(drift=np.zeros(1)))
    assert "holds warm" not in run_overview(still, decision).caption


def test_the_table_and_the_events_are_those_of_the_contract():
    found = calibrate_bank(model(), [log(8), log(9)], NOISE)
    known = calibrated(model(), found._replace(noise=NOISE))
    decisions, bank = decide_runs(known, [log(1, pump=0.2), log(7)])
    columns = table(decisions, bank.model.plant.signals.fault_names)
    assert list(columns) == [
        "run", "t", "r_x", "f_pump", "f_pump_lo", "f_pump_hi", "p_pump", "f_weak", "f_weak_lo",
        "f_weak_hi", "p_weak", "p_healthy", "p_unknown", "status", "reason",
    ]  # fmt: skip
    assert {len(cells) for cells in columns.values()} == {2 * COUNT}
    events = as_dicts([event for each in decisions for event in each.events])
    assert all(
        {"run", "fault", "start", "end", "size", "lo", "hi", "p"} <= e.keys() for e in events
    )
    assert any(line.startswith("pump +0.") for line in answers(bank, decisions))


def test_a_plant_without_faults_is_refused():
    bare = model(TANK[: TANK.index("[faults.pump]")])
    with pytest.raises(InputError, match=r"declares no \[faults\]"):
        build_fault_bank(bare, [log(0)], NOISE)
