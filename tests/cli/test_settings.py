"""`calibrate --plant`: faults and what judges them change without a new fit, and nothing else."""

import numpy as np
import pytest

from faultgauge.plants.model import load_model, tensors
from tanks import PLANT

MORE = """
[faults.gauge]
enters = "output"
target = "x"
unit = "m"
monitor = "passive"
prior_per_hour = 0.5

[detection]
persistence = 0.5
max_simultaneous = 1

[observer]
bandwidth = 2
"""
ESO = ("--observer", "eso")  # quick to calibrate: where the bank's figures are not asked for


def given(folder, text):
    path = folder / "other.toml"
    path.write_text(text)
    return path


def evaluated(call, model, log):
    return call("evaluate", model, log, "--json").json


TEXT = PLANT.replace("b*u - a*x", "b*u  -  (a*x)").replace(  # spaces are no difference
    'target = "x"\nunit = "m/s"', 'target = "x"\nunit = "m/s"\nmin = -1\nmax = 2'
)


def test_faults_and_what_judges_them_are_taken(call, workshop, tmp_path):
    """By the bank: test_faults_that_no_data_tell_apart_are_named, and below."""
    out, plant = tmp_path / "m.fgm", given(tmp_path, TEXT + MORE)
    args = (workshop.model, workshop.healthy2, "--plant", plant, *ESO, "--out", out)
    said = call("calibrate", *args)
    assert said.code == 0, said.err
    before, after = load_model(workshop.model), load_model(out)
    signals = after.plant.signals
    assert signals.fault_names == ("leak", "gauge")
    assert (signals.faults[0].min, signals.faults[0].max) == (-1.0, 2.0)
    assert (signals.faults[1].monitor, signals.faults[1].prior_per_hour) == ("passive", 0.5)
    assert (signals.detection.persistence, signals.max_simultaneous) == (0.5, 1)
    assert signals.observation.bandwidth == 2
    assert after.calibration.bandwidth == 2

    weights, same = tensors(before.plant), tensors(after.plant)
    assert {k: v.tobytes() for k, v in weights.items()} == {k: v.tobytes() for k, v in same.items()}
    assert after.record == before.record
    assert evaluated(call, out, workshop.suspect) == evaluated(
        call, workshop.model, workshop.suspect
    )


@pytest.mark.study
def test_a_bank_judges_by_the_faults_that_were_taken(call, workshop, tmp_path):
    out, table = tmp_path / "m.fgm", tmp_path / "rows.csv"
    plant = given(tmp_path, TEXT + MORE)
    args = (workshop.model, workshop.healthy2, "--plant", plant, "--out", out, "--json")
    assert set(call("calibrate", *args).json["bank"]["size"]) == {"leak", "gauge"}
    assert call("estimate", out, workshop.suspect, "--out", table).code == 0
    header, *rows = (line.split(",") for line in table.read_text().splitlines())
    assert {"p_leak", "p_gauge"} <= set(header)
    size = np.array([float(row[header.index("f_leak")]) for row in rows[-50:]])
    assert size == pytest.approx(workshop.leak, abs=0.05)  # 2 mm noise at bandwidths of 1/s


def test_what_is_trusted_needs_no_new_fit(call, workshop, tmp_path):
    out = tmp_path / "m.fgm"
    text = PLANT.replace("[states.x]", "[states.x]\nexact = true\ntrusted = [-1, 9]")
    text = text.replace("[inputs.u]", "[inputs.u]\ntrusted = [0, 4]")
    text = text.replace("[outputs.x]", "[outputs.x]\ntrusted = [0, 5.5]")
    plant = ("--plant", given(tmp_path, text))
    said = call("calibrate", workshop.model, workshop.healthy2, *plant, *ESO, "--out", out)
    assert said.code == 0, said.err
    signals, before = load_model(out).plant.signals, load_model(workshop.model).plant.signals
    assert (signals.states[0].exact, signals.states[0].trusted) == (True, (-1.0, 9.0))
    assert (signals.inputs[0].trusted, signals.outputs[0].trusted) == ((0.0, 4.0), (0.0, 5.5))
    assert signals.inputs[0].hold == before.inputs[0].hold


def test_the_file_of_the_fit_changes_nothing(call, workshop, tmp_path):
    out = tmp_path / "m.fgm"
    args = (workshop.model, workshop.healthy2, "--plant", workshop.plant, *ESO, "--out", out)
    assert call("calibrate", *args).code == 0
    assert out.read_bytes() == workshop.limited.read_bytes()


OTHER = {  # what is replaced by what, and what must be named
    "derivative": ("b*u - a*x", "b*u - x", ["[states.x] derivative", "'b*u - x'", "'b*u - a*x'"]),
    "unit": ('unit = "V"', 'unit = "mV"', ["[inputs.u] unit", "'mV'", "'V'"]),
    "sigma": ('value = "x"', 'value = "x"\nsigma = 1', ["[outputs.x] sigma", "left out"]),
    "limit": ("min = 0", "min = 0.5", ["[parameters.a] min", "0.5", "0.0"]),
    "left out": ("value = 1.0, min = 0", "value = 1.0", ["[parameters.a] min", "left out"]),
    "fixed": ("b = { value = 1.0 }", "b = { value = 1.0, fixed = true }", ["[parameters.b] fixed"]),
    "more": ("[parameters]", "[parameters]\nc = {value = 1}", ["[parameters.c] is not in"]),
    "renamed": ("[outputs.x]", "[outputs.level]", ["[outputs.level]", "not in the model"]),
    "name": ('name = "tank"', 'name = "boiler"', ["name", "'boiler'", "'tank'"]),
    "less": ("b = { value = 1.0 }", "", ["'b'"]),  # an expression uses it
    "misspelt": ("[faults.leak]", "[faultz.leak]", ["faultz"]),
}  # fmt: skip


@pytest.mark.parametrize("case", OTHER)
def test_another_plant_is_refused(call, workshop, tmp_path, case):
    old, new, naming = OTHER[case]
    plant, out = given(tmp_path, PLANT.replace(old, new)), tmp_path / "m.fgm"
    said = call("calibrate", workshop.model, workshop.healthy2, "--plant", plant, "--out", out)
    assert said.code == 2
    assert said.out == ""
    assert not out.exists()
    assert said.err.count("\n") == 1
    for word in (str(plant), *naming):
        assert word in said.err


def test_a_missing_table_and_another_order_are_refused(call, workshop, tmp_path):
    two = PLANT.replace("[outputs.x]", '[outputs.y]\nvalue = "2*x"\n\n[outputs.x]')
    plant, model = given(tmp_path, two), tmp_path / "two.fgm"
    assert call("fit", plant, workshop.healthy, "--out", model).code == 0
    before = model.read_bytes()
    swapped = PLANT.replace("[parameters]", '[outputs.y]\nvalue = "2*x"\n\n[parameters]')
    for text, words in (
        (PLANT, "[outputs.y] of the model is missing"),
        (swapped, "[outputs] x, y stand in the model as y, x"),
    ):
        plant.write_text(text)
        said = call("calibrate", model, workshop.healthy2, "--plant", plant)
        assert said.code == 2
        assert words in said.err
        assert model.read_bytes() == before


def test_a_plant_file_that_is_not_there(call, workshop, tmp_path):
    missing = tmp_path / "no.toml"
    said = call("calibrate", workshop.model, workshop.healthy2, "--plant", missing)
    assert said.code == 2
    assert str(missing) in said.err
