"""Rows that hold measurements before the command that answers them."""

import numpy as np
import pytest

import faultgauge as fg
from faultgauge.identification.fit import fit
from faultgauge.identification.row_order import rows_late
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

TANK = """
name = "tank"
[states.h]
unit = "m"
derivative = "(q - k*h)/2"
[inputs.q]
unit = "m**3/s"
hold = "zero"
KEY
[outputs.h]
value = "h"
[outputs.flow]
value = "q"
[parameters.k]
value = 0.3
min = 0
"""
STEP, COUNT, SIGMA = 0.5, 600, 0.02
K = 0.5  # of the loop that answers the flow meter


def looped(after: bool, seed: int = 0) -> Run:
    """A tank whose pump holds a flow by its meter, exact under the hold. A row is written `after`
    the command that answers its measurements, or with the command that they show."""
    rng = np.random.default_rng(seed)
    want = np.repeat(rng.uniform(0.5, 1.5, COUNT // 30), 30)
    q, h, columns = 1.0, 3.0, {name: np.zeros(COUNT) for name in ("q", "h", "flow")}
    fade = np.exp(-0.3 / 2 * STEP)
    for k in range(COUNT):
        flow = q + SIGMA * rng.standard_normal()
        shown = h + SIGMA * rng.standard_normal()
        answer = q + K * (want[k] - flow)
        for name, value in zip(columns, (answer if after else q, shown, flow), strict=True):
            columns[name][k] = value
        if after:
            q = answer
        h = fade * h + (1 - fade) / 0.3 * q
        q = answer
    return Run(f"{seed}", "tank.csv", STEP * np.arange(COUNT), columns)


def tank(key: str = "") -> GrayBoxPlant:
    return GrayBoxPlant.untrained(parse_plant(TANK.replace("KEY", key), "tank.toml"))


@pytest.mark.parametrize("after", [True, False])
def test_a_command_behind_its_measurements_is_a_row_late_and_another_is_not(after):
    """In rows written behind the command the flow shows that of the row before; what the row's own
    does with it is the loop's answer to noise, -1 / K times a change, which explains it but is no
    flow."""
    late = rows_late(tank().spec, [looped(after, seed) for seed in range(2)])
    assert late == ({"q": STEP} if after else {})


def test_who_says_a_delay_has_it():
    assert rows_late(tank("delay = 0").spec, [looped(True)]) == {}


def test_rows_of_several_rates_and_inputs_that_never_move_tell_nothing():
    run = looped(True)
    kept = np.delete(np.arange(COUNT), np.arange(100, 200, 2))
    uneven = Run("0", "tank.csv", run.t[kept], {n: a[kept] for n, a in run.columns.items()})
    assert rows_late(tank().spec, [uneven]) == {}
    still = Run("0", "tank.csv", run.t, run.columns | {"q": np.ones(COUNT)})
    assert rows_late(tank().spec, [still]) == {}


def test_a_log_without_noise_or_of_few_rows_has_none():
    """Rounding of what the own row shows in full is nothing that shows later."""
    for seed in range(8):
        run = looped(False, seed)
        exact = Run("0", "tank.csv", run.t, run.columns | {"flow": 1.7 * run.columns["q"] / 1.7})
        assert rows_late(tank().spec, [exact]) == {}
    short = Run("0", "tank.csv", run.t[:3], {n: a[:3] for n, a in run.columns.items()})
    assert rows_late(tank().spec, [short]) == {}
    del short.columns["flow"]
    assert rows_late(tank().spec, [looped(True), short]) == {"q": STEP}


def test_fit_takes_the_row_says_so_and_the_model_file_keeps_it(tmp_path):
    runs = [looped(True, seed) for seed in range(2)]
    model, account = fit(tank(), runs)
    (said,) = [each for each in account.warnings if "in its own row nothing" in each]
    assert said.startswith("flow: in its own row nothing of a change of q shows")
    assert "delay = 0.5 (a row) in [inputs.NAME]" in said
    fg.save_model(model, tmp_path / "m.fgm")
    for each in (model, fg.load_model(tmp_path / "m.fgm")):
        assert [u.delay for u in each.plant.signals.inputs] == [STEP]
    # h moves by 0.3 in 600 samples with noise of 0.02: k to some percent
    assert float(model.plant.parameters["k"]) == pytest.approx(0.3, rel=0.05)
    plain, _ = fit(tank("delay = 0"), runs)
    assert [u.delay for u in plain.plant.signals.inputs] == [0.0]
