"""The benchmarks of decisions: scores by hand arithmetic, rules by published figures."""

import gzip

import numpy as np
import pytest

from faultgauge.detection.posterior.events import BankEvent
from faultgauge.errors import InputError
from faultgauge.telemetry import Run
from faultgauge_studies.published import crazypad, skab
from faultgauge_studies.published.benchmark import plant_named
from faultgauge_studies.published.crazypad import Answer, Case, case_of
from faultgauge_studies.published.faulted_data import flights, water_loop
from faultgauge_studies.published.skab_baselines import t_squared, t_squared_q


@pytest.fixture
def records(monkeypatch, data_dir):
    """`records(NAME)`: the data folder, or a skip where it holds no such set."""

    def present(name):
        if not (data_dir / name).is_dir():
            pytest.skip(f"no {name}/ in the data folder; set FAULTGAUGE_DATA to one that has it")
        monkeypatch.setenv("FAULTGAUGE_DATA", str(data_dir))

    return present


@pytest.mark.parametrize(
    ("flight", "kind", "motors", "cut"),
    [
        ("normal_flight_log03", "healthy", (), 0),
        ("cut_propeller_M3_0.5mm_46.5mm_log01", "cut", ("M3",), 0.5),  # one tip; 46.5 mm are left
        ("cut_propeller_M3_2mm_1.5mm_43.5mm_log00", "cut", ("M3",), 3.5),
        ("cut_propeller_M3_3mm_log02", "cut", ("M3",), 3),  # the older series
        ("tape_on_propeller_M1_M3_M4_log00", "tape", ("M1", "M3", "M4"), 0),
        ("add_weight_W1_near_M3_M4_log02", "weight", (), 0),  # no motor is damaged
        ("weight_on_string_W2_near_M3_log02", "weight", (), 0),
    ],
)
def test_a_flights_name_says_what_was_done(flight, kind, motors, cut):
    assert case_of(flight) == Case(kind, motors, float(cut))


def answer(flight, named=None, loss=0.0):
    named = named or {}
    sizes = dict.fromkeys(named, (0.1, 0.0, 0.2))
    return Answer(flight, case_of(flight), named, sizes, loss, 0.0, 1.0, 1.0)


def test_flights_are_counted_by_what_is_wrong_for_their_kind():
    found = crazypad.score(
        [
            answer("normal_flight_log00"),
            answer("normal_flight_log01", {"M2": 0.6}),  # wrong, however unsure
            answer("cut_propeller_M3_1mm_log00", loss=0.02),
            answer("cut_propeller_M3_2mm_log00", {"M1": 0.9}, loss=0.01),  # wrong
            answer("cut_propeller_M3_3mm_log00", {"M3": 0.9}, loss=0.10),
            answer(
                "cut_propeller_M3_2mm_2mm_43mm_log00", {"M3": 0.9, "M4": 0.8}, loss=0.20
            ),  # both
            answer("tape_on_propeller_M3_M4_log00", {"M4": 0.9}),  # taped
            answer("tape_on_propeller_M3_log00", {"M4": 0.9}),  # not taped
            answer("add_weight_W1_near_M4_log00", {"M4": 0.94}),  # not certain
            answer("add_weight_W1_near_M4_log01", {"M4": 0.95}),
        ]
    )
    # cuts 1, 2, 3, 4 mm have ranks 1 2 3 4, their losses 2 1 3 4: 1 - 6 (1 + 1) / (4 * 15)
    assert found.pop("spearman") == pytest.approx(0.8, rel=1e-12)
    assert found == {
        "plain": 2,
        "plain_named": 2,
        "cut": 4,
        "cut_wrong": 2,
        "tape": 2,
        "tape_wrong": 1,
        "weight": 2,
        "weight_wrong": 1,
        "healthy": 2,
        "healthy_wrong": 1,
    }


def test_equal_losses_have_no_rank_correlation():
    cuts = [answer("cut_propeller_M3_1mm_log00"), answer("cut_propeller_M3_2mm_log00")]
    assert crazypad.score(cuts)["spearman"] is None


def test_an_answer_is_the_surest_event_of_a_motor_and_the_end_of_the_flight():
    def event(fault, p, size):
        lo, hi = (None, None) if size is None else (size - 0.1, size + 0.1)
        return BankEvent("", fault, 0.0, 1.0, size, lo, hi, p, 0.0, 0.0, 0.0, ())

    events = [event("loss_m3", 0.7, 0.2), event("loss_m3", 0.9, 0.5), event("unknown", 1.0, None)]
    status = ["NOT_JUDGED", "FAULT", "FAULT", "FAULT"]
    nan = np.nan  # the last row was not sampled
    estimate = np.array([[0.1, 0, 1], [0.2, 0, 1], [0.3, 0.2, 0.4], [nan, nan, nan]])
    found = crazypad.answer_of("cut_propeller_M3_3mm_log00", events, status, estimate)
    assert found.named == {"M3": 0.9}
    assert found.sizes == {"M3": (0.5, 0.4, 0.6)}
    assert (found.loss, found.lo, found.hi, found.judged) == (0.3, 0.2, 0.4, 0.75)


def test_scores_by_hand():
    alarm = np.array([True, True, True, False, False, False, False, False])
    anomalous = np.array([True, True, False, True, False, False, False, False])
    found = skab.score(alarm, anomalous)  # TP 2, FP 1, FN 1, TN 4
    assert found == pytest.approx((4 / 6, 20.0, 100 / 3), rel=1e-12)


def test_scores_of_nothing_are_undefined():
    none = np.zeros(3, bool)
    found = skab.score(none, none)
    assert (found.far_percent, np.isnan(found.f1), np.isnan(found.mar_percent)) == (0, True, True)


def test_published_statistics_get_their_published_scores(records):
    """Whoever gets the figures of the list of results by its methods scores as it does."""
    records("skab")
    experiments = water_loop()
    assert len(experiments) == 34
    anomalous = np.concatenate([each.anomalous[skab.TRAIN :] for each in experiments.values()])
    for name, alarms in (("T-squared", t_squared), ("T-squared + Q", t_squared_q)):
        found = [alarms(*skab._rows(each)) for each in experiments.values()]
        scored = skab.score(np.concatenate(found), anomalous)
        published = skab.PUBLISHED[name]
        assert scored.f1 == pytest.approx(published.f1, abs=0.005)  # as rounded there
        assert scored[1:] == pytest.approx(published[1:], abs=0.05)


def test_a_refused_log_is_not_judged(monkeypatch):
    def refuse(*_, **__):
        raise InputError("too short.")

    monkeypatch.setattr(skab, "fit", refuse)
    run = Run("a", "", np.arange(410.0), {"flow": np.zeros(410)})
    found = skab.judge(plant_named("skab"), run, seed=0)
    assert (found.status, found.refused) == (["NOT_JUDGED"] * 10, "too short.")


def test_a_file_of_another_kind_is_refused_by_name(monkeypatch, tmp_path):
    (tmp_path / "skab" / "valve1").mkdir(parents=True)
    with gzip.open(tmp_path / "skab" / "valve1" / "0.csv.gz", "wt") as file:
        file.write("t,u\n0,1\n")
    for part in ("valve2", "other"):
        (tmp_path / "skab" / part).mkdir()
        (tmp_path / "skab" / part / "0.csv.gz").touch()
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    with pytest.raises(InputError, match=r"valve1/0\.csv\.gz: not as SKAB exports it"):
        water_loop()


@pytest.mark.parametrize(("read", "folder"), [(flights, "crazypad"), (water_loop, "skab")])
def test_absent_records_are_told(monkeypatch, tmp_path, read, folder):
    monkeypatch.setenv("FAULTGAUGE_DATA", str(tmp_path))
    with pytest.raises(InputError, match=f"folder that holds {folder}/"):
        read()


def test_flights_are_those_in_hover(records):
    records("crazypad")
    found = flights()
    kinds = [case_of(name).kind for name in found]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {
        "healthy": 5,
        "cut": 57,
        "tape": 9,
        "weight": 12,
    }
    # the share of M3 in the mean command of the worst cut, as the set's description has it: 1.37
    worst = found["cut_propeller_M3_3.5mm_3.5mm_40mm_log00"].columns
    mean = {m: np.nanmean(worst[m]) for m in ("m1", "m2", "m3", "m4")}
    assert mean["m3"] / np.mean(list(mean.values())) == pytest.approx(1.37, abs=0.01)


@pytest.mark.parametrize(
    ("name", "faults"),
    [
        ("crazypad", ("loss_m1", "loss_m2", "loss_m3", "loss_m4")),
        ("skab", ("shaking1", "shaking2", "load", "blocking", "supply", "throttling")),
    ],
)
def test_the_plant_files_are_shipped(name, faults):
    assert plant_named(name).signals.fault_names == faults
