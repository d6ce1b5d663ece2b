"""What the bank knows across a gap."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.start import Start
from faultgauge.detection.decisions import decide
from faultgauge.telemetry import Run
from lags import COUNT, NOISE, SIGMA, log, model

GAP = 400.0


def test_over_a_gap_faults_go_on_and_the_first_sample_fits_them():
    """The bias is 0.3 +- 0.05 in every branch; the sensor reads 2.0 behind the gap."""
    bank = build_fault_bank(model(), [log(0)], NOISE)
    begin = Start.of(bank)
    state = begin.init(bank.modes)
    at = bank.modes.filter.states + 1
    belief = state.belief._replace(
        mean=state.belief.mean.at[:, at].set(0.3), P=state.belief.P.at[:, at, at].set(0.05**2)
    )
    gap, u, y = (jnp.asarray(each) for each in (GAP, [0.5], [2.0]))

    @eqx.filter_jit
    def over(state):
        before = begin.anew(bank.modes, state, gap, u, y)
        return before, bank.modes.step(before, u, y, jnp.asarray(0.0))[0]

    before, after = over(state._replace(belief=belief))
    assert float(before.t) == GAP
    np.testing.assert_array_equal(before.weight, state.weight)
    mean, P = np.asarray(after.belief.mean)[0], np.asarray(after.belief.P)[0]
    # a state that may be anywhere in an envelope of +-6 tells 1 / 14000 of the bias' variance
    assert mean[at] == pytest.approx(0.3, rel=1e-4)
    assert P[at, at] == pytest.approx(0.05**2, rel=1e-3)
    # of the 2.0, 0.3 is the fault's; together they are known as the sample is
    assert mean[0] == pytest.approx(1.7, rel=1e-4)
    assert P[0, 0] + 2 * P[0, at] + P[at, at] == pytest.approx(SIGMA**2, rel=1e-4)


def test_over_a_gap_signatures_of_faults_keep_what_the_plant_keeps():
    """Of states that may be anywhere nothing is left of what a fault did to them, of a
    discrepancy what has not faded, and the onset is as much older as the gap is long."""
    bank = build_fault_bank(model(), [log(0)], NOISE)
    begin = Start.of(bank)
    state = begin.init(bank.modes)
    probe = state.probe._replace(eta=jnp.ones_like(state.probe.eta))
    gap, u, y = (jnp.asarray(each) for each in (3.0, [0.5], [2.0]))
    after = begin.anew(bank.modes, state._replace(probe=probe), gap, u, y).probe
    states = len(begin.mean)
    assert np.all(after.eta[:states] == 0)
    fading = np.flatnonzero(np.isfinite(begin.lasting))
    assert len(fading)
    for k in fading:
        np.testing.assert_allclose(after.eta[k], np.exp(-3.0 / begin.lasting[k]), rtol=1e-12)
    np.testing.assert_allclose(after.age, np.asarray(probe.age) + 3.0)


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
    # a sample after the gap tells less than the gap took, up to rounding of what lies beside it
    assert 0.999 * before < after < 2 * before
    event = next(e for e in decision.events if e.fault == fault)
    assert event.start < t[599]
    assert event.end == t[-1]
