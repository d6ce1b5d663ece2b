"""The sheet end to end on a lag: what it says of pairs, delays and help, and what it refuses."""

import json

import numpy as np
import pytest

from faultgauge.detection.words import duration
from faultgauge.errors import InputError
from faultgauge.foresight import detectability
from faultgauge.foresight.sheet import levels_off
from faultgauge.reporting.detectability_chapter import detectability_report
from faultgauge.reporting.report import render


@pytest.fixture(scope="module")
def sheet(modelled, log):
    moving = np.where(np.arange(600) % 100 < 50, 3.0, 1.0)
    return detectability(modelled(), [log(np.full(600, 2.0), "still"), log(moving, "moving")])


def test_a_still_input_parts_nothing_and_a_moving_one_does(sheet):
    still, moving = sheet.runs
    assert still.pair("push", "loss").share < 1e-2
    assert moving.pair("push", "loss").share > 10 * still.pair("push", "loss").share
    assert not still.pair("push", "loss").structural  # they enter at the same place
    push = still.faults[0]
    assert push.seen_from is not None
    assert push.smallest[1.0] is None or push.smallest[1.0] > 2 * push.seen_from
    assert push.like == "loss"
    named = [each.smallest[1.0] for each in moving.faults]
    assert all(size is not None for size in named)


def test_sizes_fall_with_the_delay_and_rise_with_rarer_alarms(sheet):
    for fault in sheet.runs[1].faults:
        for rarer, sizes in fault.delay.sizes.items():
            known = [size for size in sizes if size is not None]
            # the more is seen the less is needed, but for the Occam factor's logarithm
            assert known[-1] < known[0], rarer
        at_end = [fault.smallest[rarer] for rarer in sheet.rarer]
        assert at_end == sorted(at_end)
        assert all(np.all(np.diff(each) >= 0) for each in np.array(fault.information))


def test_what_a_still_log_hides_a_test_input_would_tell(sheet):
    (help,) = [each for each in sheet.runs[0].help if {each.fault, each.other} == {"push", "loss"}]
    assert help.test is not None
    assert help.test.told.reaches(help.size)
    assert help.sensors == ()  # whatever is measured, they enter at the same place
    said = str(sheet)
    assert f"would be told from {help.other}" in said
    assert f" on u for {duration(help.test.seconds)}" in said


def test_the_sheet_as_json_and_as_a_page(sheet):
    plain = json.loads(json.dumps(sheet.as_dict(), allow_nan=False))
    assert plain["runs"][1]["faults"][0]["smallest"].keys() == {"1", "10", "100"}
    page = render(detectability_report(sheet))
    for words in ("time since the onset (s)", "size of push (V)", "information (1/V²)", "moving"):
        assert words in page
    assert "nan" not in page.split("<svg")[0]


def test_where_a_standard_deviation_levels_off():
    t = np.geomspace(1, 1000, 200)
    assert levels_off(t, t**-0.5) is None  # white noise alone
    # 1 / t + 1 / 100: its logarithm falls to the end's by a quarter of white noise's where
    # ln (1/t + 0.01) / (1/1000 + 0.01) = ln (1000 / t) / 4, solved by bisection
    sd = np.sqrt(1 / t + 0.01)
    low, high = 1.0, 900.0
    for _ in range(60):
        middle = (low + high) / 2
        over = np.log((1 / middle + 0.01) / 0.011) > np.log(1000 / middle) / 4
        low, high = (middle, high) if over else (low, middle)
    assert levels_off(t, sd) == pytest.approx(low, rel=0.05)  # of a grid of 3.5 %


@pytest.mark.parametrize(
    ("faults", "calibrated", "level", "words"),
    [
        ("[faults.push]\nenters = 'input'\ntarget = 'u'\n", False, 2.0, "not calibrated"),
        ("", True, 2.0, "declares no [faults]"),
        ("[faults.loss]\nenters = 'gain'\ntarget = 'u'\n", True, 0.0, "no information"),
    ],
)
def test_what_cannot_be_foreseen_is_said_in_a_sentence(
    modelled, log, faults, calibrated, level, words
):
    with pytest.raises(InputError) as refusal:
        detectability(modelled(faults, calibrated), [log(np.full(200, level))])
    assert words in str(refusal.value)
    assert str(refusal.value).endswith(".")
    assert "\n" not in str(refusal.value)


def test_a_log_that_is_too_short_is_refused(modelled, log):
    with pytest.raises(InputError, match="too few"):
        detectability(modelled(), [log(np.full(10, 2.0))])
