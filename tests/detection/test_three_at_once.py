"""Three faults that overlap, where the plant file lets three be there together."""

import numpy as np
import pytest

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import decide
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.reporting.words.answer import answers
from faultgauge.telemetry import Run
from models import as_stated

STATE = """
[states.{0}]
derivative = "u - 0.2*{0}"
[outputs.{0}]
value = "{0}"
[faults.leak_{0}]
enters = "state"
target = "{0}"
min = -0.5
max = 0.5
"""
LIMITS = """
[inputs.u]
min = 0
max = 2
[detection]
max_simultaneous = {most}
"""
PLANT = 'name = "three tanks"' + "".join(map(STATE.format, "abc")) + LIMITS
STEP, COUNT, SIGMA = 0.5, 600, 0.02
ONSETS, LEAK = dict(zip("abc", (60.0, 120.0, 180.0), strict=True)), -0.1
NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA] * 3, [1e-3] * 3, [], [1e-4] * 3, [100.0] * 3, [1e-3], [5.0], [], []
    ))
)  # fmt: skip
POINTS = np.random.default_rng(0).uniform(0, [12, 12, 12, 2], (60, 4))


def log(seed, leak=0.0):
    """Exact under the hold; the tanks lose `leak` [1/s] one after the other."""
    random = np.random.default_rng(seed)
    t, u = STEP * np.arange(COUNT), np.repeat(random.uniform(0.5, 1.5, COUNT // 20), 20)
    fade, columns = np.exp(-0.2 * STEP), {"u": u}
    for name, onset in ONSETS.items():
        x = np.full(COUNT, u[0] / 0.2)
        for k in range(COUNT - 1):
            driven = u[k] + leak * (t[k] >= onset)
            x[k + 1] = fade * x[k] + (1 - fade) / 0.2 * driven
        columns[name] = x + SIGMA * random.standard_normal(COUNT)
    return Run("run", "tanks.csv", t, columns)


@pytest.mark.parametrize("most", [pytest.param(2, marks=pytest.mark.study), 3])
def test_as_many_are_told_at_once_as_the_plant_file_says(most):
    text = PLANT.replace("{most}", str(most))
    model = as_stated(text, POINTS, [(name, 0) for name in "abc"], "abc")
    bank = build_fault_bank(model, [log(0)], NOISE)
    said = decide(bank, log(1, LEAK))
    told = [each.fault for each in said.events]
    assert told == ["leak_a", "leak_b", "leak_c" if most == 3 else UNKNOWN]
    for each in said.events[:most]:
        onset = ONSETS[each.fault[-1]]
        assert each.onset_lo <= onset <= each.onset_hi
        assert each.lo <= LEAK <= each.hi
    if most == 3:
        assert {each.end for each in said.events} == {said.run.t[-1]}
    else:
        # the third one is nothing that two explain
        assert all(180 < each.end < 200 for each in said.events[:2])
        for line, name in zip(answers(bank, [said]), ("leak_a", "leak_b"), strict=False):
            assert (
                "where something undeclared came, beside which no fault is followed, so "
                f"{name} may have gone on" in line
            )
