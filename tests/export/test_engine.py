"""`estimate --engine c` against the Python engine: the same rows, and so the same events."""

import csv
from dataclasses import replace

import jax
import numpy as np
import pytest

from drawn_models import calibrated, log_of
from faultgauge.cli.app import run
from faultgauge.detection.decisions import decide
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.watch import Watch
from faultgauge.export import engine as module
from faultgauge.export import native
from faultgauge.export.engine import Engine
from faultgauge.export.entry import bank_of
from faultgauge.export.kept import hash_of
from faultgauge.plants.model import save_model
from faultgauge.telemetry import Run

pytestmark = pytest.mark.study

CLOSE = 1e-9  # of a column's largest value, as of the C itself (test_watch)
# of a fault whose onset is compared: of one that is excluded it is a mean over weights of 1e-300
THERE = 1e-9
COUNT = 2000


def flight(model, count=COUNT):
    """A run with a fault from its middle on, missing samples and a gap."""
    columns = dict(log_of(model, count, missing=0.02))
    return Run("flight", "flight.csv", columns.pop("t"), columns)


def close(found, wanted, name=""):
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert found.dtype == wanted.dtype, name
    if wanted.dtype.kind != "f":
        np.testing.assert_array_equal(found, wanted, err_msg=name)
        return
    limit = CLOSE * max(np.nanmax(np.abs(wanted), initial=0.0), 1e-9)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=limit, err_msg=name)


def compared(model, engine):
    """The decision of the C engine, as Python's."""
    bank, log = bank_of(model), flight(model)
    found, wanted = decide(bank, log, None, engine), decide(bank, log, None)
    for name in wanted.posterior._fields:
        one, other = (getattr(each.posterior, name) for each in (found, wanted))
        if name == "onset":
            there = wanted.posterior.ever > THERE
            assert there.any()
            one, other = (np.where(there[..., None], a, 0.0) for a in (one, other))
        close(one, other, name)
    assert (found.status, found.reason) == (wanted.status, wanted.reason)
    for name, values in wanted.used.run.columns.items():
        np.testing.assert_array_equal(found.used.run.columns[name], values)
    assert len(found.events) == len(wanted.events)
    for one, other in zip(found.events, wanted.events, strict=True):
        assert (one.fault, one.start, one.end) == (other.fault, other.start, other.end)
        assert (one.size is None) == (other.size is None)
        assert one.size is None or one.size == pytest.approx(other.size, rel=CLOSE)
        assert one.onset == pytest.approx(other.onset, rel=CLOSE)
    return found


@pytest.fixture(scope="module")
def tank():
    return calibrated("tank")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where compiled steps are kept."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def engine(folder):
    if native.compiler() is None:
        pytest.skip("no C compiler is installed: install gcc or clang, or set CC")
    return Engine(folder)


def test_rows_and_events_are_python_s(tank, engine):
    decision = compared(tank, engine)
    assert [each.fault for each in decision.events] == ["leak"]


@pytest.mark.parametrize("source", ["reaction_wheel_network", "positioning_drive", "hr12"])
def test_rows_of_other_plants_are_python_s(cc, source, tmp_path):
    compared(calibrated(source), Engine(tmp_path))


def test_a_log_in_parts_is_the_log_to_the_bit(tank, engine):
    """The state that goes on is Python's own, so either engine may take the next rows."""
    bank, log = bank_of(tank), flight(tank)
    watch = Watch(tank, tuple(log.columns), bank.step, bank=bank)
    rows = prepared(watch.signals, log)
    end, whole = engine(watch, watch.init(), rows)
    state, parts = watch.init(), []
    for part in (slice(0, 1), slice(1, 700), slice(700, COUNT)):
        state, row = engine(watch, state, rows.cut(part))
        parts.append(row)
    joined = jax.tree.map(lambda *a: np.concatenate(a), *parts)
    for one, other in zip(jax.tree.leaves((state, joined)), jax.tree.leaves((end, whole)),
                          strict=True):  # fmt: skip
        np.testing.assert_array_equal(one, other)
    middle, _ = engine(watch, watch.init(), rows.cut(slice(0, 700)))
    _, rest = watch.along(middle, rows.cut(slice(700, COUNT)))
    close(rest.posterior.p, whole.posterior.p[700:])


def test_a_compiled_step_is_kept_and_a_damaged_one_made_anew(tank, engine, folder, monkeypatch):
    """Also for logs whose step is another, as it is by rounding already."""
    bank, log = bank_of(tank), flight(tank, 60)
    log = replace(log, t=log.t * (1 + 1e-12))
    decide(bank, log, None, engine)
    (kept,) = folder.glob("*.so")
    compiled = []
    monkeypatch.setattr(native, "built", lambda *a: compiled.append(a) or whole)
    whole = kept.read_bytes()[:-32]
    decide(bank, log, None, Engine(folder))
    assert compiled == []
    kept.unlink()  # not written over: it is loaded
    kept.write_bytes(whole[: len(whole) // 2])
    decide(bank, log, None, Engine(folder))
    assert len(compiled) == 1
    assert kept.read_bytes()[:-32] == whole


def test_what_was_printed_is_kept_and_not_traced_again(tank, engine, folder, monkeypatch):
    bank, log = bank_of(tank), flight(tank, 60)
    wanted = decide(bank, log, None, engine)
    monkeypatch.setattr(module, "print_step", lambda *a, **k: pytest.fail("printed again"))
    found = decide(bank, log, None, Engine(folder))
    np.testing.assert_array_equal(found.posterior.p, wanted.posterior.p)


def test_a_plant_of_others_is_printed_anew(tank):
    """Of whose code only the name is known."""

    class Own:
        pass

    assert hash_of(tank.plant) == hash_of(tank.plant)
    assert hash_of(tank.plant, 1) != hash_of(tank.plant, 2)
    assert hash_of(tank.plant, Own) is None


# -- the command


@pytest.fixture
def shop(tank, tmp_path, monkeypatch):
    """A model file and a log."""
    save_model(tank, tmp_path / "tank.fgm")
    log = flight(tank)
    with open(tmp_path / "log.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", *log.columns])
        for row in zip(log.t, *log.columns.values(), strict=True):
            writer.writerow(["" if v != v else repr(float(v)) for v in row])
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_command_says_and_writes_the_same(shop, engine, folder, monkeypatch, capsys):
    said = {}
    monkeypatch.setenv("XDG_CACHE_HOME", str(shop / "cache"))
    kept = shop / "cache" / "faultgauge"
    kept.mkdir(parents=True)
    (kept / "c").symlink_to(folder)
    for who in ("python", "c"):
        command = ["estimate", "tank.fgm", "log.csv", "--out", f"{who}.csv"]
        assert run([*command, "--engine", who]) == 0
        captured = capsys.readouterr()
        said[who] = (captured.out + captured.err).replace(f"{who}.csv", "")
    assert said["c"] == said["python"]
    one, other = (
        list(csv.DictReader((shop / f"{n}.csv").read_text().splitlines())) for n in ("c", "python")
    )
    assert len(one) == len(other) == COUNT
    for name in other[0]:
        cells = [[row[name] for row in rows] for rows in (one, other)]
        if name in ("run", "status", "reason"):
            assert cells[0] == cells[1]
        else:
            close(*(np.array([float(c or "nan") for c in column]) for column in cells), name)


def test_without_a_compiler_it_is_refused_before_anything_is_read(shop, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    command = ["estimate", "tank.fgm", "log.csv", "--out", "c.csv", "--engine", "c"]
    assert run(command) == 2
    assert "no C compiler was found" in capsys.readouterr().err
    assert not (shop / "c.csv").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["-"], "--engine c does not go with -"),
        (["log.csv", "--out", "c.csv", "--observer", "eso"], "--engine c rests on the bank's"),
    ],
)
def test_what_it_does_not_go_with_is_refused(shop, more, said, capsys):
    assert run(["estimate", "tank.fgm", *more, "--engine", "c"]) == 2
    assert said in capsys.readouterr().err
