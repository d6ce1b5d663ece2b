"""A whole rehearsal on a plant that is known exactly, and what of its input is refused."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from faultgauge.cli.app import run as command
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.rehearsal import rehearse


@pytest.fixture
def call(capsys):
    def calling(*arguments):
        capsys.readouterr()
        code = command(["rehearse", *(str(each) for each in arguments)])
        return code, *capsys.readouterr()

    return calling


@pytest.fixture
def refuse(call):
    """Call, and check that it was refused in one line that names all of `naming`."""

    def refusing(*arguments, naming):
        code, out, err = call(*arguments)
        assert (code, out) == (2, ""), err
        assert err.count("\n") == 1, err
        for word in naming:
            assert word in err
        return err

    return refusing


def test_a_rehearsal_end_to_end(tank, log):
    """Faults from a quarter to 16 times what the model foretells, in logs it has not seen."""
    said = []
    found = rehearse(tank.calibrated, [log(7), log(8)], trials=44, progress=said.append)
    assert found.warnings == ()
    assert found.windows == {"h7": 400, "h8": 400}
    assert len(found.trials) == 44 - 2
    assert said[-1].endswith("of 44 logs judged")
    assert sorted(trial.window for trial in found.trials) == [e.window for e in found.trials]
    assert [each.name for each in found.faults] == ["bias", "drift"]
    for each in found.faults:
        sizes = [row.size for row in each.by_size]
        assert sizes == pytest.approx(each.predicted * np.geomspace(0.25, 16, 8))
        # At a quarter of what would be named nothing is; at 16 times an alarm misses no fault.
        assert each.by_size[0].found.count == 0
        assert each.by_size[-1].alarmed.value == 1.0
        # nine in ten onsets leave less of a window than its middle or little more
        assert 0.8 < (each.along or 0.0) / (each.predicted or 1.0) < 2
    assert all(each.times in (4.0, 8.0) for each in found.pairs)
    pooled = [t for t in found.trials if len(t.answers) == 1 and t.answers[0].times >= 4 - 1e-9]
    assert (found.exact.count, found.exact.total) == (sum(t.exact for t in pooled), len(pooled))
    # 400 rows of 0.1 s, less the hold-off of ten samples and what is to be seen first, twice
    assert 0.8 * 80 / 3600 < found.false_alarms.hours <= 2 * (400 - 10) * 0.1 / 3600
    json.dumps(found.as_dict(), allow_nan=False)
    rows = found.table()
    assert {len(column) for column in rows.values()} == {
        sum(len(trial.answers) for trial in found.trials)
    }


def test_faults_of_a_given_size_are_found_named_and_sized(tank, log):
    """A bias of 0.2 V, a hundred times the noise it makes: 0.2 V within 5 %."""
    found = rehearse(tank.calibrated, [log(7)], sizes={"bias": 0.2}, trials=7)
    (bias,) = found.faults
    assert [row.size for row in bias.by_size] == [0.2]
    assert found.pairs == ()
    assert found.exact.count == found.exact.total == 6
    assert bias.smallest is not None
    assert bias.smallest.at_most
    for trial in found.trials:
        assert trial.answers[0].estimate == pytest.approx(0.2, rel=0.05)
    # the true size is inside its 95 % interval but by a chance of 5 %: 3 of 6 at least, p > 0.99
    assert bias.large.size_covered.count >= 3


def test_the_command_writes_three_files_and_warns_of_a_log_it_knows(tank, call, tmp_path):
    out = tmp_path / "rehearsal"
    model, known = tank.folder / "calibrated.fgm", tank.folder / "h2.csv"
    code, printed, err = call(
        model, known, tank.folder / "h5.csv", "--size", "bias=0.2", "--trials", 4, "--out", out
    )
    assert code == 0, err
    assert "warning: h2: also used in the calibration" in err
    assert "h5: 100 samples are too few" in err
    assert printed.splitlines()[1].startswith("bias ")
    content = json.loads((out / "rehearsal.json").read_text())
    assert content["faults"][0]["large"]["found"]["total"] == 3
    with open(out / "trials.csv") as file:
        assert [row["size"] for row in csv.DictReader(file)] == ["0.2"] * 3
    page = (out / "report.html").read_text()
    assert "bias, by size" in page
    assert "Foretold and found" in page
    assert page.count("<svg") == 2
    code, printed, _ = call(model, known, "--size", "bias=0.2", "--trials", 2, "--json")
    assert code == 0
    assert json.loads(printed)["exact"]["total"] == 1


def test_bad_input_is_refused_in_one_sentence(tank, refuse):
    fitted, model = tank.folder / "fitted.fgm", tank.folder / "calibrated.fgm"
    log, short = tank.folder / "h4.csv", tank.folder / "h5.csv"
    refuse(fitted, log, naming=("not calibrated", "faultgauge calibrate"))
    refuse(model, log, "--size", "bias=0", naming=("'bias' of size 0 is none",))
    refuse(model, log, "--size", "bias=nan", naming=("'bias' of size nan",))
    refuse(model, log, "--size", "bios=1", naming=("'bios'", "did you mean 'bias'?"))
    refuse(model, log, "--size", "bias", naming=("--size bias", "--size friction=0.1"))
    refuse(model, log, "--size", "drift=2", naming=("outside its limits", "-inf to 1"))
    refuse(model, log, "--trials", 1, naming=("trials", "2"))
    refuse(model, short, naming=("h5.csv", "100 samples are too few", "200"))
    refuse(model, log, "--size", "bias=9", naming=("bias", "would leave its limits"))
    refuse(tank.folder / "none.fgm", log, naming=("none.fgm",))


def test_a_model_whose_faults_cannot_be_rehearsed_is_refused(tank, log):
    text = tank.calibrated.plant.spec.text
    none = text.replace('unit = "V"\n\n[faults.drift]', 'monitor = "disabled"\n[faults.drift]')
    none = none.replace("max = 1.0", 'monitor = "disabled"')
    plant = GrayBoxPlant.untrained(parse_plant(none, "tank.toml"))
    plant = replace(plant, parameters=tank.calibrated.plant.parameters)
    with pytest.raises(InputError, match=r"no fault can be rehearsed .* disabled"):
        rehearse(replace(tank.calibrated, plant=plant), [log(7)])
