"""Events of the exported step: by hand, and against what a stream tells of the same samples."""

import jax.numpy as jnp
import numpy as np
import pytest

from drawn_models import calibrated, log_of, walked
from faultgauge.detection.posterior.events import Alarm, BankEvent, Unnamed
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.detection.posterior.verdicts import STATUS, Reason, Verdict
from faultgauge.detection.rows.intake import Taken
from faultgauge.detection.stream import Stream
from faultgauge.detection.watch import Row
from faultgauge.export.entry import UNNAMED, bank_of, step_of
from faultgauge.export.ongoing import EventPhase, Ongoing
from faultgauge.telemetry.stream import Sample

NONE, BEGINS, LASTS, OVER = (int(each) for each in EventPhase)
NOTHING = Taken(*[jnp.zeros(1)] * len(Taken._fields))
FAULT, HEALTHY, NOT_JUDGED, PASSIVE = "FAULT", "HEALTHY", "NOT_JUDGED", int(Reason.PASSIVE)


def row(status, p=0.0, named=(0, 0), healthy=None, reason=0):
    """Of one declared fault of probability `p` and something undeclared of none."""
    healthy = jnp.asarray(1 - p if healthy is None else healthy)
    one, pair, none = jnp.array([p]), jnp.zeros((1, 2)), jnp.asarray(0.0)
    found = Posterior(
        *(one, one, one, one, healthy, none, healthy, one),
        *(pair > 1, jnp.asarray(0), none[None], pair, one, none > 1),
    )
    at, alarm = jnp.asarray(STATUS.index(status)), jnp.asarray(status == FAULT)
    verdict = Verdict(at, jnp.asarray(reason), alarm, jnp.array(named, bool))
    return Row(found, verdict, *jnp.zeros((4, 2)), NOTHING)


def told(rows, passive=False):
    """Events of the fault, of something undeclared and of an alarm without a name, row by row;
    two quiet rows do not end one."""
    ongoing = Ongoing(0.5, 1e-6, 2, np.array([passive, False]))
    state, said = ongoing.init(), []
    for each in rows:
        state, events = ongoing.step(state, each)
        said.append(events.tolist())
    return [list(each) for each in zip(*said, strict=True)]


def test_a_fault_that_is_named_lasts_until_it_was_quiet_for_long_enough():
    named, quiet = row(FAULT, 0.99, (1, 0)), row(HEALTHY, 0.01)
    not_sampled = row(NOT_JUDGED, np.nan)
    rows = [quiet, named, quiet, quiet, named, quiet, not_sampled, quiet, quiet, quiet, named]
    leak, unknown, unnamed = told(rows)
    assert leak == [NONE, BEGINS, LASTS, LASTS, LASTS, LASTS, LASTS, LASTS, OVER, NONE, BEGINS]
    assert set(unknown) == set(unnamed) == {NONE}


def test_an_alarm_without_a_name_is_told_once_and_not_after_one():
    alarm, named = row(FAULT, 0.4), row(FAULT, 0.99, (1, 0))
    quiet = row(HEALTHY, 0.01)
    leak, _, unnamed = told([alarm, alarm, named, quiet, quiet, quiet, named, alarm])
    assert leak == [NONE, NONE, BEGINS, LASTS, LASTS, OVER, BEGINS, LASTS]
    assert unnamed == [BEGINS, LASTS, LASTS, LASTS, LASTS, OVER, NONE, NONE]


def test_what_is_named_without_an_alarm_is_told_only_if_it_raises_none():
    named = row(NOT_JUDGED, 0.99, (1, 1), reason=PASSIVE)
    assert [each[0] for each in told([named], passive=True)] == [BEGINS, NONE, NONE]
    assert [each[0] for each in told([named])] == [NONE] * 3


def test_the_alarm_s_level_and_a_likely_fault_keep_an_event():
    named, level = row(FAULT, 0.99, (1, 0)), row(HEALTHY, 0.3, healthy=1e-6)
    likely, below = row(HEALTHY, 0.5), row(HEALTHY, 0.49)
    for each in (level, likely):
        assert told([named, each, each, each, each])[0][-1] == LASTS
    assert told([named, below, below, below])[0][-1] == OVER


@pytest.mark.study
def test_a_stream_tells_the_same_at_the_same_samples():
    """A small leak that ends, after which the posterior takes a while to be sure of nothing."""
    model = calibrated("tank")
    samples, leak = (log_of(model, 2400, seed=2, size=size) for size in (0.0, 0.03))
    effect = (leak["level"] - samples["level"])[1200:2300]
    samples["level"][300:1400] += effect
    samples["level"][np.random.default_rng(2).random(2400) < 0.02] = np.nan
    step = step_of(bank_of(model))
    said = walked(step, samples)
    names = {"leak": "event_leak", "unknown": "event_unknown", None: UNNAMED}
    begins, over = set(), set()
    stream = Stream(model)
    rows = [
        dict(zip(samples, values, strict=True)) for values in zip(*samples.values(), strict=True)
    ]
    for k, values in enumerate(rows):
        for each in stream.push(Sample(values.pop("t"), values)):
            if isinstance(each, Alarm):
                begins.add((float(each.start), names[each.fault]))
                if each.size is not None:
                    size = said["f_leak"][k] / said["p_leak"][k]
                    assert size == pytest.approx(each.size, rel=1e-9)
            if isinstance(each, BankEvent | Unnamed):
                over.add(k)
    found = {
        (float(samples["t"][k]), name)
        for name in names.values()
        for k in np.flatnonzero(said[name] == BEGINS)
    }
    assert found == begins
    assert {name for _, name in found} == set(names.values())
    ends = [np.flatnonzero(said[name] == OVER) for name in names.values()]
    assert set(np.concatenate(ends).tolist()) == over
    assert over
