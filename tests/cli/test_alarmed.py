"""`fit` and data under alarm."""


def test_fit_refuses_logs_under_alarm_unless_told(call, workshop, tmp_path):
    model = tmp_path / "m.fgm"
    model.write_bytes(workshop.calibrated.read_bytes())
    args = ("fit", workshop.plant, workshop.suspect, "--out", model)
    refused = call(*args)
    assert refused.code == 2
    assert str(workshop.suspect) in refused.err
    assert "alarms from" in refused.err
    assert model.read_bytes() == workshop.calibrated.read_bytes()
    assert call(*args, "--despite-alarms").code == 0
    assert model.read_bytes() != workshop.calibrated.read_bytes()


def test_fit_refuses_a_log_whose_status_column_says_fault(call, workshop, tmp_path):
    lines = workshop.healthy.read_text().splitlines()
    marked = [f"{lines[0]},status"]
    marked += [f"{row},{'FAULT' if 50 <= k < 60 else 'HEALTHY'}" for k, row in enumerate(lines[1:])]
    log = tmp_path / "joined.csv"
    log.write_text("\n".join(marked) + "\n")
    refused = call("fit", workshop.plant, log, "--out", tmp_path / "n.fgm")
    assert refused.code == 2
    assert f"{log}: column 'status' says FAULT from " in refused.err
    assert not (tmp_path / "n.fgm").exists()
    kept = call("fit", workshop.plant, log, "--out", tmp_path / "n.fgm", "--where", "t > 10")
    assert kept.code == 0
