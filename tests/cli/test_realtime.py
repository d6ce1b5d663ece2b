"""`simulate --realtime` and `estimate -`: commands in, rows out, and the same answers as files."""

import csv
import io
import json
import re
import signal
import subprocess
import sys

import pytest

import faultgauge as fg
from faultgauge.cli.app import run
from faultgauge.cli.commands import follow_file, follow_stdin

FAULTGAUGE = [sys.executable, "-c", "from faultgauge.cli import main; main()"]
SCENARIO = """name = "tank on the bench"
plant = "model.fgm"
seconds = 40
step = 0.1
seed = 7
[inputs.u]
source = "noise"
sigma = 0.8
low = 0.01
high = 1
[noise]
x = 0.002
"""


@pytest.fixture
def scenario(workshop, tmp_path):
    (tmp_path / "model.fgm").write_bytes(workshop.calibrated.read_bytes())
    path = tmp_path / "scenario.toml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture
def pipe(call, monkeypatch):
    """Call the command line with `text` on standard input."""

    def piping(text, *arguments):
        stdin = io.TextIOWrapper(io.BytesIO(text.encode(errors="surrogateescape")))
        monkeypatch.setattr(sys, "stdin", stdin)
        return call(*arguments)

    return piping


def ndjson(text):
    return [json.loads(line) for line in text.splitlines()]


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def without_run(text):
    return [{name: cell for name, cell in row.items() if name != "run"} for row in rows(text)]


def test_a_stream_is_answered_as_its_file(pipe, workshop, tmp_path):
    out, events = tmp_path / "e.csv", tmp_path / "events.ndjson"
    eso = ("--observer", "eso")
    pipe("", "estimate", workshop.limited, workshop.suspect, "--out", out, *eso)
    text = workshop.suspect.read_text()
    piped = pipe(text, "estimate", workshop.limited, "-", "--events", events, *eso)
    assert piped.code == 0, piped.err
    assert without_run(piped.out) == without_run(out.read_text())
    assert events.read_text() == "", "an observer alone decides nothing"
    assert piped.err.startswith("An observer alone gives an estimate, no decision")


def sampled_once(k):
    return f"{k / 10},{k // 10 % 2},{0.3 if k == 7 else ''}"


def flickering(k):
    return f"{k / 10},5,{k % 2}"


@pytest.mark.parametrize("row", [sampled_once, flickering])
def test_a_sensor_that_says_next_to_nothing_is_answered_in_numbers(pipe, workshop, tmp_path, row):
    events = tmp_path / "events.ndjson"
    text = "\n".join(["t,u,x", *map(row, range(300)), ""])
    said = pipe(text, "estimate", workshop.calibrated, "-", "--events", events)
    assert said.code == 0, said.err
    assert len(rows(said.out)) == 300
    for each in (said.out, said.err, events.read_text()):
        assert not re.search(r"\b(nan|inf|infinity)\b", each, re.IGNORECASE)


def test_ndjson_answers_hold_every_bit_and_maps_act(pipe, workshop, tmp_path):
    log = tmp_path / "log.csv"
    lines = workshop.suspect.read_text().splitlines()[:150]
    log.write_text("\n".join(["seconds,u,double", *lines[1:]]) + "\n")
    maps = ["x=double*0.5+double/2"]
    piped = pipe(
        log.read_text(), "estimate", workshop.calibrated, "-", "--stream", "ndjson",
        "--map", maps[0], "--time", "seconds",
    )  # fmt: skip
    assert piped.code == 0, piped.err
    runs = fg.read_telemetry(log, time="seconds", maps=maps, names=["u"], optional=["x"])
    (judged,) = fg.estimate(workshop.calibrated, runs).decisions
    found = ndjson(piped.out)
    assert [row["t"] for row in found] == judged.run.t.tolist()
    assert [row["f_leak"] for row in found] == judged.posterior.f[:, 0].tolist()
    assert [row["p_leak"] for row in found] == judged.posterior.p[:, 0].tolist()
    assert [row["r_x"] for row in found] == judged.residuals["x"].tolist()
    assert [row["status"] for row in found] == judged.status


def test_rows_that_are_no_telemetry_are_left_out_and_counted(pipe, workshop):
    """And the rest is answered as if they had not come."""
    head, *lines = workshop.healthy.read_text().splitlines()[:60]
    bad = ["text", "6,1,inf", "6,1,text", "0.1,1,1", lines[30], "\udcff,1,1", '"6,1,1', "6,1"]
    dirty = [head, bad[2], *lines[:40], *bad, *lines[40:], "300,6.1,0"]  # and no newline
    eso = ("estimate", workshop.limited, "-", "--observer", "eso")
    clean = pipe("\n".join([head, *lines, ""]), *eso)
    piped = pipe("\n".join(dirty), *eso)
    assert piped.code == 0, piped.err
    assert piped.out == clean.out
    alone, first, last = piped.err.splitlines()
    assert alone.startswith("An observer alone gives an estimate, no decision")
    assert first.startswith(
        "warning: standard input, row 2, column 'x': 'text' is not a number; correct the cell"
    )
    assert "--strict" in first
    assert last == "warning: standard input: 10 rows were left out."


def test_a_stream_that_ends_within_a_number_has_no_such_row(pipe, workshop):
    lines = workshop.healthy.read_text().splitlines()[:40]
    eso = ("estimate", workshop.limited, "-", "--observer", "eso")
    whole, cut = ("\n".join([*lines, "300,6.1,0" + rest]) for rest in (".95\n", ""))
    assert len(rows(pipe(whole, *eso).out)) == 40
    piped = pipe(cut, *eso)
    assert len(rows(piped.out)) == 39
    assert "row 41: the stream ends within '300,6.1,0', with no newline" in piped.err
    piped = pipe(cut, *eso, "--strict")
    assert piped.code == 2


def test_a_bad_line_of_ndjson_is_left_out(pipe, workshop):
    head, *lines = workshop.healthy.read_text().splitlines()[:40]
    names = head.split(",")
    cells = [dict(zip(names, map(float, line.split(",")), strict=True)) for line in lines]
    texts = [json.dumps(each) for each in cells]
    eso = ("estimate", workshop.limited, "-", "--observer", "eso")
    clean = pipe("\n".join([*texts, ""]), *eso)
    bad = ['{"t": 3', "[]", "null", '{"t": 1e999, "u": 1, "x": 1}', '{"t": [], "u": 1}']
    piped = pipe("\n".join([bad[0], *texts[:30], *bad, *texts[30:], ""]), *eso)
    assert piped.out == clean.out
    assert "6 rows were left out" in piped.err


def test_a_line_that_does_not_end_and_no_input_at_all_are_refused(
    pipe, call, workshop, monkeypatch
):
    eso = ("estimate", workshop.limited, "-", "--observer", "eso")
    piped = pipe("t,u,x\n" + "1" * 1_000_001, *eso)
    assert piped.code == 2
    assert "row 2: longer than 1 MB" in piped.err
    monkeypatch.setattr(sys, "stdin", None)
    said = call(*eso)
    assert said.code == 2
    assert "standard input is closed" in said.err


def test_a_strict_stream_refuses_a_bad_row_after_those_before_it(pipe, workshop):
    lines = workshop.suspect.read_text().splitlines()[:60]
    text = "\n".join([*lines, "6,1,text", ""])
    piped = pipe(text, "estimate", workshop.calibrated, "-", "--strict")
    assert piped.code == 2
    assert len(rows(piped.out)) == 59
    assert piped.err == (
        "faultgauge: standard input, row 61, column 'x': 'text' is not a number; correct the "
        "cell, or leave it empty where nothing was sampled.\n"
    )


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (("--out", "e.csv"), "--out does not go with -"),
        (("--json",), "--json does not go with -"),
        (("--where", "u > 0"), "--where does not go with -"),
        (("--view",), "--view draws on standard error"),
        (("--events", "no/e.ndjson"), "the folder no does not exist"),
    ],
)
def test_what_does_not_go_with_a_stream_is_refused(pipe, workshop, extra, said):
    piped = pipe("t,u,x\n", "estimate", workshop.calibrated, "-", *extra)
    assert piped.code == 2
    assert said in piped.err
    assert piped.err.count("\n") == 1


def test_the_sentence_needs_no_table(call, workshop):
    said = call("estimate", workshop.calibrated, workshop.suspect)
    assert said.code == 0, said.err
    assert said.out.startswith("leak +")
    assert "wrote" not in said.err


def test_what_goes_with_a_stream_only_is_refused_with_files(call, workshop, scenario, tmp_path):
    files = ("estimate", workshop.calibrated, workshop.suspect)
    out = tmp_path / "e.csv"
    for extra in (("--stream", "csv"), ("--events", "e.ndjson"), ("--view",), ("--strict",)):
        said = call(*files, "--out", out, *extra)
        assert said.code == 2
        assert f"{extra[0]} goes with standard input only" in said.err
    said = call("simulate", scenario, "--out", out, "--stream", "csv")
    assert "--stream goes with --realtime only" in said.err
    said = call("simulate", scenario, "--out", out, "--realtime", "--stream", "csv", "--json")
    assert "choose one of them" in said.err
    assert not out.exists()


def test_an_injected_fault_is_in_record_log_estimate_and_events(call, pipe, scenario, tmp_path):
    control, log = tmp_path / "commands", tmp_path / "log.csv"
    control.write_text("inject leak 0\nbogus\n")
    ran = call(
        "simulate", scenario, "--realtime", "1e6", "--control", control, "--out", log,
        "--stream", "csv",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    assert "command 'bogus': is no command" in ran.err
    assert "overruns" in ran.err
    assert ran.out == log.read_text(), "what is streamed is what is logged"
    injected, end = ndjson((tmp_path / "log.injections.ndjson").read_text())
    assert (injected["sample"], injected["name"], injected["size"]) == (0, "leak", 0)
    assert (end["did"], end["samples"]) == ("end", 400)
    assert end["jitter_ms"].keys() == {"p50", "p99", "max"}


def test_json_tells_what_was_injected_and_how_well_time_was_kept(call, scenario, tmp_path):
    control, log = tmp_path / "commands", tmp_path / "log.csv"
    control.write_text('{"do": "inject", "name": "leak", "size": 0.5}\n')
    report = tmp_path / "r.html"
    ran = call("simulate", scenario, "--realtime=1e6", "--control", control, "--out", log,
               "--report", report, "--json")  # fmt: skip
    assert ran.code == 0, ran.err
    found = ran.json
    assert (found["rows"], found["samples"]) == (400, 400)
    assert found["columns"] == ["t", "u", "x", "true_leak"]
    (injected,) = found["injections"]
    assert (injected["t"], injected["size"], injected["unit"]) == (0.0, 0.5, "m/s")
    assert {row["true_leak"] for row in rows(log.read_text())} == {"0.5"}
    assert "1 fault injected" in report.read_text()


def test_the_pair_end_to_end(scenario, tmp_path):
    """As one types it: a pipe, a command while it runs, and the same onset everywhere."""
    log, events, answers = (tmp_path / name for name in ("log.csv", "events.ndjson", "answers.csv"))
    command = ["simulate", scenario, "--realtime", "25", "--stream", "ndjson", "--out", log]
    estimate = ["estimate", "model.fgm", "-", "--events", events]
    with (
        open(answers, "w") as file,
        subprocess.Popen(
            [*FAULTGAUGE, *map(str, command)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as first,
        subprocess.Popen(
            [*FAULTGAUGE, *map(str, estimate)], stdin=subprocess.PIPE, stdout=file, cwd=tmp_path
        ) as second,
    ):
        assert first.stdin is not None
        assert first.stdout is not None
        assert second.stdin is not None
        for k, line in enumerate(iter(first.stdout.readline, b"")):
            if k == 150:
                first.stdin.write(b"inject leak 0.5\n")
                first.stdin.flush()
            second.stdin.write(line)
        second.stdin.close()
        assert first.wait(60) == 0
        assert second.wait(60) == 0
    injected = ndjson(log.with_name("log.injections.ndjson").read_text())[0]
    truth = [float(row["true_leak"]) for row in rows(log.read_text())]
    k = injected["sample"]
    assert k > 150
    assert truth == [0.0] * k + [0.5] * (len(truth) - k)
    estimates = [float(row["f_leak"]) for row in rows(answers.read_text())]
    assert len(estimates) == 400
    # healthy, the estimate is 0; the fault is followed within 10 samples and named 10 later
    assert max(map(abs, estimates[50:k])) < 0.05
    assert sum(estimates[k + 50 :]) / len(estimates[k + 50 :]) == pytest.approx(0.5, rel=0.05)
    event = ndjson(events.read_text())[-1]
    assert event["onset"] == pytest.approx(injected["t"], abs=0.5)
    assert event["size"] == pytest.approx(0.5, rel=0.05)


# signals as a program has them there: `nohup` and a shell's `&` have some ignored
IN_THE_FOREGROUND = [
    sys.executable,
    "-c",
    "import signal as s; s.signal(s.SIGINT, s.default_int_handler); "
    "s.signal(s.SIGTERM, s.SIG_DFL); s.signal(s.SIGHUP, s.SIG_DFL); "
    "from faultgauge.cli import main; main()",
]


# below, all three signals end as interrupts
@pytest.mark.parametrize("sent", [pytest.param("SIGINT", marks=pytest.mark.study), "SIGHUP"])
def test_an_interrupt_leaves_a_whole_log(scenario, tmp_path, sent):
    """By Ctrl-C, and by a terminal that closes, which tells so twice."""
    log = tmp_path / "log.csv"
    # long enough for a busy machine, which may take its time to the first rows and then hurry
    scenario.write_text(SCENARIO.replace("seconds = 40", "seconds = 4000"))
    command = [*IN_THE_FOREGROUND, "simulate", str(scenario), "--realtime", "--stream", "csv"]
    with subprocess.Popen(
        [*command, "--out", str(log)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    ) as running:  # fmt: skip
        assert running.stdout is not None
        for _ in range(4):
            running.stdout.readline()
        running.send_signal(signal.Signals[sent])
        running.send_signal(signal.Signals[sent])
        _, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "Traceback" not in err
    assert "interrupted" in err
    assert 3 <= len(rows(log.read_text())) < 40_000
    assert not list(tmp_path.glob(".*")), "no draft stays behind"


def test_a_stream_that_is_ended_keeps_its_rows(workshop, tmp_path):
    """By `kill`."""
    # the first 20 rows wait for each other
    lines = workshop.suspect.read_text().splitlines(keepends=True)[:31]
    command = [*IN_THE_FOREGROUND, "estimate", str(workshop.limited), "-", "--observer", "eso"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        assert running.stderr is not None
        running.stdin.write("".join(lines))
        running.stdin.flush()
        answers = [running.stdout.readline() for _ in range(4)]
        running.send_signal(signal.SIGTERM)
        more, err = running.stdout.read(), running.stderr.read()
        assert running.wait(60) == 130
    assert "Traceback" not in err
    assert 20 <= len(rows("".join(answers) + more)) <= 30


def test_what_a_program_was_begun_to_ignore_it_ignores():
    """As under `nohup`."""
    code = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from faultgauge.cli.streaming import Interrupt, end_as_interrupts\n"
        "end_as_interrupts()\n"
        "with Interrupt(): signal.raise_signal(signal.SIGHUP)\n"
        "signal.raise_signal(signal.SIGHUP); print('done')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "done\n"


@pytest.mark.parametrize("sent", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_an_interrupt_that_a_finalizer_swallows_comes_once_more(sent):
    code = (
        "import signal as s, time, weakref\n"
        "from faultgauge.cli.streaming import end_as_interrupts\n"
        "s.signal(s.SIGINT, s.default_int_handler)\n"
        "s.signal(s.SIGTERM, s.SIG_DFL); s.signal(s.SIGHUP, s.SIG_DFL)\n"
        "end_as_interrupts()\n"
        "class Thing: pass\n"
        "thing = Thing()\n"
        f"weakref.finalize(thing, s.raise_signal, s.{sent})\n"
        "try:\n"
        "    del thing\n"
        "    for _ in range(1000): time.sleep(0.05)\n"
        "except KeyboardInterrupt: print('interrupted')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


def test_an_interrupt_while_a_compiled_module_starts_waits_for_that():
    """Exceptions within abort some of them. What starts it is held while the signal comes."""
    code = (
        "import _imp, signal as s, time\n"
        "from faultgauge.cli.streaming import end_as_interrupts\n"
        "s.signal(s.SIGTERM, s.SIG_DFL)\n"
        "end_as_interrupts()\n"
        "start, said = _imp.create_dynamic, []\n"
        "def starting(*given):\n"
        "    if not said: s.raise_signal(s.SIGTERM)\n"
        "    said.append(given[0].name)\n"
        "    return start(*given)\n"
        "_imp.create_dynamic = starting\n"
        "try:\n"
        "    import numpy.linalg\n"  # a slow machine may still be at its other parts by then
        "    for _ in range(1000): time.sleep(0.05)\n"
        "except KeyboardInterrupt: print('loaded', len(said) > 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("loaded True\n", "")


def test_an_interrupt_that_compiled_code_prints_is_not_told_twice():
    """`PyErr_Print` in the interpreter, as NumPy's `import_array` does; others are told."""
    code = (
        "import ctypes, signal as s\n"
        "from faultgauge.cli.streaming import end_as_interrupts\n"
        "s.signal(s.SIGTERM, s.SIG_DFL)\n"
        "end_as_interrupts()\n"
        "api = ctypes.PyDLL(None)\n"
        "api.PyRun_SimpleString(b'import signal; signal.raise_signal(signal.SIGTERM)')\n"
        "api.PyRun_SimpleString(b'1 / 0')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "KeyboardInterrupt" not in done.stderr
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


def interrupted_import(folder, more=""):
    """`inspect`, sent SIGTERM while numpy is loaded, which takes it for its own failure."""
    log = folder / "log.csv"
    log.write_text("t,x\n0,1\n1,2\n2,4\n")
    code = (
        "import signal as s, sys; from faultgauge.cli import main, options\n"
        "s.signal(s.SIGTERM, s.SIG_DFL); s.signal(s.SIGHUP, s.SIG_DFL)\n"
        "class Compiled:\n"
        "    @staticmethod\n"
        "    def find_spec(name, *_):\n"
        "        if name == 'numpy':\n"
        "            try: s.raise_signal(s.SIGTERM)\n"
        "            except KeyboardInterrupt: pass\n"
        "            raise ImportError('initialization failed')\n"
        f"sys.meta_path.insert(0, Compiled)\n{more}\n"
        f"sys.argv = ['faultgauge', 'inspect', {str(log)!r}]; main()"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_an_interrupt_that_an_import_takes_for_its_own_failure_is_one(tmp_path):
    """As compiled modules do while they are loaded."""
    done = interrupted_import(tmp_path)
    assert done.returncode == 130, done.stderr
    assert done.stderr == "faultgauge: interrupted; nothing was written half-way.\n"


def test_a_second_interrupt_while_the_first_is_told_is_none(tmp_path):
    """A terminal that closes tells so twice."""
    done = interrupted_import(tmp_path, "options.say = lambda text: s.raise_signal(s.SIGHUP)")
    assert (done.returncode, done.stderr) == (130, "")


def test_an_interrupt_after_the_end_changes_nothing():
    code = (
        "import atexit, signal, sys; from faultgauge.cli import main\n"
        "for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):\n"
        "    signal.signal(each, signal.SIG_DFL)\n"
        "    atexit.register(signal.raise_signal, each)\n"
        "sys.argv = ['faultgauge', '--version']; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


class Gone(io.StringIO):
    """Standard output whose reader leaves after three lines."""

    def write(self, text):
        if self.getvalue().count("\n") + text.count("\n") > 3:
            raise BrokenPipeError(32, "Broken pipe")
        return super().write(text)


def test_a_reader_that_leaves_ends_it_quietly(pipe, workshop, scenario, tmp_path, monkeypatch):
    log, control = tmp_path / "log.csv", tmp_path / "none"
    monkeypatch.setattr(sys, "stdout", Gone())
    said = pipe(workshop.suspect.read_text(), "estimate", workshop.calibrated, "-")
    assert (said.code, said.err) == (0, "")
    monkeypatch.setattr(sys, "stdout", Gone())
    ran = call_quietly(
        "simulate", scenario, "--realtime", "1e6", "--stream", "csv", "--control", control,
        "--out", log,
    )  # fmt: skip
    assert ran == 0
    assert len(rows(log.read_text())) == 3, "the log so far is whole"


def call_quietly(*arguments):
    return run([str(each) for each in arguments])


def test_a_followed_file_gives_whole_lines_only(tmp_path):
    path = tmp_path / "commands"
    poll = follow_file(path)
    assert poll() == [], "it may come into being later"
    path.write_bytes(b"one\ntw")
    assert poll() == ["one"]
    with open(path, "ab") as file:
        file.write(b"o\n\xff\n")
    assert poll() == ["two", "�"]
    assert poll() == []
    path.write_bytes(b"new\n")
    assert poll() == ["new"], "cut short, it begins anew"


def test_no_standard_input_is_no_command(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    assert follow_stdin()() == []


def test_the_view_draws_what_it_is_given(workshop):
    from rich.console import Console

    from faultgauge.cli.view import View

    view = View(fg.load_model(workshop.calibrated))
    text = io.StringIO()
    view.live.console = Console(file=text, width=100)
    row = {
        "t": 3.5,
        "r_x": 0.25,
        "f_leak": 0.61,
        "f_leak_hi": 0.62,
        "p_leak": 0.9999,
        "status": "FAULT",
        "reason": "",
    }
    for k in range(40):
        view.rows([{**row, "f_leak": 0.61 * k / 39}])
    view.live.console.print(view.table())
    shown = text.getvalue()
    for part in (
        "t = 3.5 s",
        "FAULT",
        "r_x",
        "0.25",
        "f_leak",
        "0.61",
        "0.01",
        "> 0.999",
        "m/s",
        "▁",
        "█",
    ):
        assert part in shown


def test_help_speaks_of_the_bench(call):
    assert "--realtime" in call("simulate", "--help").out
    assert "standard input" in call("estimate", "--help").out
