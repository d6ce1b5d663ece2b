"""A log under alarm from its beginning on: said of a file, and of a stream in time."""

import io
import json

import numpy as np
import pytest

from faultgauge.detection.answer.misfit import Alarmed
from faultgauge.detection.answer.reliance import errs_by
from faultgauge.plants.model import Model, load_model, save_model
from faultgauge.plants.record import CalibrationRecord, Metrics

SAID = "a fault already there when the log begins, or the model of another plant"


@pytest.fixture
def stream(call, workshop, tmp_path, monkeypatch):
    """Rows of the suspect log into `estimate -`: (outcome, the lines of --events)."""

    def streaming(first, last):
        header, *rows = workshop.suspect.read_text().splitlines()
        text = "\n".join([header, *rows[first:last]]) + "\n"
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        events = tmp_path / "events.ndjson"
        said = call("estimate", workshop.calibrated, "-", "--events", events)
        assert said.code == 0, said.err
        return said, [json.loads(line) for line in events.read_text().splitlines()]

    return streaming


def test_a_stream_that_begins_under_the_fault_is_warned_of_once(stream, workshop):
    said, lines = stream(320, 600)  # the leak began at row 300
    (warning,) = (line for line in said.err.splitlines() if SAID in line)
    assert warning.startswith("warning: run stream: alarm in ")
    (event,) = (line for line in lines if line["said"] == "warning")
    assert warning == f"warning: {event['text']}."
    assert event["run"] == "stream"
    block = load_model(workshop.calibrated).calibration.bank.block_s
    held = 1.0  # s: 10 samples
    # as many rows as a block has, 20 at least; two rows of 0.1 s for the ends of either
    assert event["t"] - 32.0 - held == pytest.approx(max(block, 2.0), abs=0.2)


def test_a_fault_that_comes_later_is_none(stream):
    said, lines = stream(150, 600)
    assert {line["said"] for line in lines} == {"alarm", "event"}
    assert SAID not in said.err


def test_a_short_stream_is_told_at_its_end_what_its_file_is(call, workshop, stream, tmp_path):
    header, *rows = workshop.suspect.read_text().splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join([header, *rows[320:375]]) + "\n")
    whole = call("estimate", workshop.calibrated, short, "--out", tmp_path / "rows.csv")
    said, _ = stream(320, 375)
    of_file, of_stream = (
        [line.replace("run short", "run stream") for line in each.err.splitlines() if SAID in line]
        for each in (whole, said)
    )
    assert of_file == of_stream
    assert len(of_stream) == 1


def test_a_stream_of_a_doubtful_model_says_so_with_every_alarm(
    call, workshop, tmp_path, monkeypatch
):
    """The model's error is 2.5 times what it explains, and does not change: the leak shows all the
    same. JSON of the file has the same doubt."""
    model = load_model(workshop.calibrated)
    told = model.calibration.as_dict()
    size, lasting = told["noise"]["size"], told["noise"]["lasting"]
    for state, share in errs_by(model).items():
        size[state], lasting[state] = 2.5 * size[state] / share, 1e9
    path = tmp_path / "doubtful.fgm"
    metrics = Metrics(validation_free_run_nrmse=0.8)
    model = Model(model.plant, model.record.model_copy(update={"metrics": metrics}))
    save_model(model.with_calibration(CalibrationRecord(**told)), path)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(workshop.suspect.read_bytes())))
    events = tmp_path / "events.ndjson"
    said = call("estimate", path, "-", "--events", events)
    assert said.code == 0, said.err
    lines = [json.loads(line) for line in events.read_text().splitlines()]
    whole = json.loads(call("estimate", path, workshop.suspect, "--json").out)
    assert whole["doubt"].startswith(
        "little to rely on, as the model does not follow its own healthy logs: its free run is "
    )
    assert lines
    assert {line["doubt"] for line in lines} == {whole["doubt"]}
    heads = [line for line in said.err.splitlines() if "Little to rely on" in line]
    assert len(heads) == len(lines)
    assert f"warning: {whole['doubt']}." in said.err  # once, before all alarms


BOTH = {"almost all": (1, 4, True), "too few": (0, 79, False), "too late": (6, 94, False),
        "at once": (5, 95, True), "never": (10, 0, False)}  # fmt: skip


@pytest.mark.parametrize("case", BOTH)
def test_the_criterion_by_hand(case):
    """From within the first twentieth on, and four fifths; what is not judged does not count."""
    calm, alarms, wanted = BOTH[case]
    status = ["NOT_JUDGED"] * 30 + ["HEALTHY"] * calm + ["FAULT"] * alarms
    if case == "too few":
        status += ["HEALTHY"] * 21
    if case == "almost all":
        status = ["FAULT", *["HEALTHY"], *["FAULT"] * 3, "STALE"]  # 4 of 5
    found = Alarmed("log")
    for each in status:
        found.add([each], np.zeros(1, bool))
    assert found.throughout == wanted


def test_quiet_rows_in_which_no_fault_would_show_count_as_calm():
    """Half a log without a word of a fault, then an alarm: not from the beginning on."""
    found = Alarmed("log")
    found.add(["NOT_JUDGED"] * 50 + ["FAULT"] * 50, np.arange(100) < 50)
    assert not found.throughout
