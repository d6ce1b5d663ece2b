"""`faultgauge detectability`: what it prints, writes and refuses."""

import numpy as np
import pytest


def test_the_sheet_of_a_tank(call, workshop, tmp_path):
    page = tmp_path / "sheet.html"
    said = call("detectability", workshop.calibrated, workshop.suspect, "--report", page)
    assert said.code == 0, said.err
    assert said.out.splitlines()[1].split()[0] == "fault"
    assert "leak" in said.out
    assert "wrote" in said.err
    text = page.read_text()
    for words in ("size of leak (m/s)", "time since the onset (s)", "Detectability: tank"):
        assert words in text


def test_one_object_with_units_and_no_infinity(call, workshop):
    said = call("detectability", workshop.calibrated, workshop.healthy2, "--json")
    assert said.code == 0, said.err
    assert said.out.count("\n") == 1
    (run,) = said.json["runs"]
    (leak,) = run["faults"]
    assert leak["unit"] == "m/s"
    assert run["pairs"] == []
    assert run["help"] == []
    # a thirtieth of the leak that every test here finds: noise of 0.002 m at 300 rows
    assert 0 < leak["smallest"]["1"] < workshop.leak / 5
    assert np.all(np.diff([size for size in leak["delay"]["sizes"]["1"] if size]) <= 1e-12)


@pytest.mark.parametrize(("model", "words"), [("model", "calibrate"), ("limited", "calibrate")])
def test_a_model_without_noise_is_refused(call, workshop, model, words):
    said = call("detectability", getattr(workshop, model), workshop.healthy2)
    assert (said.code, said.out) == (2, "")
    assert said.err.count("\n") == 1
    assert words in said.err


def test_a_plant_without_faults_is_refused(call, workshop, tmp_path):
    plant, model = tmp_path / "plant.toml", tmp_path / "model.fgm"
    plant.write_text(workshop.plant.read_text().split("[faults")[0])
    assert call("fit", plant, workshop.healthy, "--out", model).code == 0
    said = call("detectability", model, workshop.healthy2)
    assert (said.code, said.out) == (2, "")
    assert "declares no [faults]" in said.err
