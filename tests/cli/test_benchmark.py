"""`faultgauge benchmark`: what is refused, and what `--json` prints."""

import pytest

from faultgauge.plants.model import Model
from faultgauge_studies.published import data, faulted, run
from faultgauge_studies.published.benchmark import BENCHMARKS, FAULTED, Records, plant_of
from faultgauge_studies.published.crazypad import Answer, Flights, case_of
from faultgauge_studies.published.crazypad import Trial as Flown
from faultgauge_studies.published.skab import PUBLISHED, WaterLoop
from faultgauge_studies.published.skab import Trial as Watched
from models import record_of


@pytest.fixture
def measured(monkeypatch):
    """A run that measured nothing but the time of its fits: seed k took k + 1 s."""

    def measure(chosen, seeds, progress):
        model = Model(plant_of(chosen), record_of())
        trials = [run.Trial(k, model, k + 1.0, {}, {}, {}, ["said once"]) for k in seeds]
        return run.Found(chosen, Records((), ()), trials, {"jax_sysid": "skipped: for a reason."})

    monkeypatch.setattr(run, "measure", measure)


def test_json_is_one_object_and_nothing_else(call, measured):
    outcome = call("benchmark", "emps", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.json == {
        "benchmark": "emps",
        "unit": "mm",
        "splits": {},
        "fit_s": {"median": 3.0, "min": 1.0, "max": 5.0},  # five seeds where none are asked for
        "peers": {"jax_sysid": "skipped: for a reason."},
    }
    assert outcome.err.count("said once") == 1


def test_a_table_a_report_and_a_skipped_peer(call, measured, tmp_path):
    page = tmp_path / "emps.html"
    outcome = call("benchmark", "emps", "--seeds", "2", "--report", page)
    assert outcome.code == 0, outcome.err
    assert "1.5" in outcome.out  # median of 1 s and 2 s
    assert "for a reason" in outcome.err
    assert BENCHMARKS["emps"].title in page.read_text()


@pytest.mark.parametrize("name", ["silver_box", ""])
def test_an_unknown_name_is_one_sentence(call, name):
    outcome = call("benchmark", name)
    assert outcome.code == 2
    assert outcome.err.count("\n") == 1
    assert all(each in outcome.err for each in (*BENCHMARKS, *FAULTED))


def test_absent_data_are_one_sentence(call, tmp_path, monkeypatch):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    monkeypatch.setattr(data, "_loaded", lambda name: None)
    outcome = call("benchmark", "cascaded_tanks", "--json")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    assert "cascaded_tanks/train.csv.gz" in outcome.err


def test_a_report_that_could_not_be_written_is_refused_before_the_work(call, tmp_path):
    outcome = call("benchmark", "emps", "--report", tmp_path / "no" / "page.html")
    assert outcome.code == 2
    assert "page.html" in outcome.err


def watched(seeds, progress):
    """One seed that got what T-squared has published, with a log refused."""
    own = PUBLISHED["T-squared"]
    trials = [Watched(k, own, own, 0.25, {"other/5": "too short."}, 3.0, 4.0) for k in seeds]
    return WaterLoop(trials, {"T-squared": own}, 100)


def flown(seeds, progress):
    """One flight with 3 mm cut off, where M3 is named."""
    flight = "cut_propeller_M3_3mm_log00"
    answer = Answer(
        flight, case_of(flight), {"M3": 0.99}, {"M3": (0.1, 0.05, 0.15)}, 0.1, 0.05, 0.15, 1.0
    )
    return Flights([Flown(k, [answer], 1.0, 2.0, 3.0) for k in seeds])


@pytest.mark.parametrize(
    ("name", "measure", "shown"),
    [
        ("skab", watched, ("0.660", "42.6", "25.0", "Conv-AE")),
        ("crazypad", flown, ("cut_propeller_M3_3mm_log00", "M3", "0.100 (0.050 to 0.150)")),
    ],
)
def test_decisions_on_real_faults_are_shown_reported_and_printed(
    call, monkeypatch, tmp_path, name, measure, shown
):
    monkeypatch.setattr(faulted, "MEASURES", {name: measure})
    monkeypatch.setenv("COLUMNS", "160")
    page = tmp_path / "page.html"
    outcome = call("benchmark", name, "--seeds", "1", "--report", page)
    assert outcome.code == 0, outcome.err
    assert all(each in outcome.out for each in shown)
    assert all(each in page.read_text() for each in shown)
    assert "Seed 0" in outcome.err
    plain = call("benchmark", name, "--seeds", "2", "--json").json
    assert plain["benchmark"] == name


def test_absent_flights_are_one_sentence(call, tmp_path, monkeypatch):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    outcome = call("benchmark", "crazypad", "--json")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
