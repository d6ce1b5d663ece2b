"""What `check` says by a model that its fit holds for useless: one thing, in every view."""

import numpy as np
import pytest

from faultgauge.reporting.report import render
from faultgauge.telemetry import Run
from faultgauge.verbs.check import check

FLOAT = """
name = "float"
[states.x]
unit = "m"
derivative = "a*u"
[inputs.u]
unit = "m/s"
[outputs.x]
unit = "m"
value = "x"
[parameters]
a = { value = 1, min = 0.1, max = 10 }
[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
"""
STEP, COUNT = 0.5, 2000


def log(seed, moves, stray, leak=0.0):
    """x' = u + d, the command u being a step of about `moves` every 10 s, and d something that the
    file lacks, of the size `stray` and as slow as 200 s; a `leak` from the middle on."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(COUNT)
    u = np.repeat(moves * rng.standard_normal(COUNT // 20), 20)
    fade, d = np.exp(-STEP / 200), stray * rng.standard_normal()
    x = np.zeros(COUNT)
    for k in range(COUNT - 1):
        x[k + 1] = x[k] + STEP * (u[k] + d + leak * (k >= COUNT // 2))
        d = fade * d + np.sqrt(1 - fade**2) * stray * rng.standard_normal()
    x += 0.02 * rng.standard_normal(COUNT)
    return Run(f"run{seed}", f"run{seed}.csv", t, {"u": u, "x": x})


@pytest.mark.study
@pytest.mark.parametrize(("moves", "stray", "doubted"), [(0.3, 0.1, False), (0.02, 0.1, True)])
def test_a_fit_of_no_use_by_its_free_run_heads_the_answer_or_is_no_reason_to_doubt_it(
    moves, stray, doubted
):
    """What the file lacks carries every free run away. Where the command moves the plant by more
    than that, faults are judged beside the sensor all the same."""
    healthy = [log(k, moves, stray) for k in (1, 2, 3)]
    found = check(healthy, log(9, moves, stray, leak=1.0), FLOAT)
    assert found.model.record.metrics.free_run_error > 0.5
    plain, page = found.as_dict(), render(found.page())
    said = " ".join(found.warnings)
    heads = [each.startswith("Little to rely on: ") for each in found.sentences]
    assert all(heads) if doubted else not any(heads)
    assert (plain["doubt"] is not None) == doubted
    assert [each["sentence"].startswith("Little to") for each in plain["events"]] == [
        doubted for _ in plain["events"]
    ]
    assert ("do not use this model" in said or "little to rely on" in said) == doubted
    assert ("faults are judged beside the sensors" in said) == (not doubted)
    assert ("Little to rely on: " in page) == doubted
