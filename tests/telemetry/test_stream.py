"""A stream is read as the file of the same rows is, and refused in the same words."""

import json
from datetime import UTC, datetime
from itertools import chain

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import read_telemetry
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.logs import Before
from faultgauge.telemetry.stream import Sample, read_stream

HEAD = "t,wheel rpm,u,note\n"


def rows(count=200):
    rng = np.random.default_rng(0)
    return [
        f"{0.1 * k!r},{1e3 * rng.normal()!r},{'' if k % 17 == 3 else repr(rng.normal())},ok"
        for k in range(count)
    ]


def read(text, **options):
    pieces = read_stream([text.splitlines(keepends=True)], **options)
    samples = [sample for piece in pieces for sample in piece]
    return np.array([s.t for s in samples]), {
        name: np.array([s.values[name] for s in samples]) for name in samples[0].values
    }


MAPS = (
    "h=wheel_rpm*0.104720*0.84",
    "e=exp(u) + tanh(wheel_rpm/500) + sin(u)**3 + sqrt(abs(u)) + log(2 + cos(u))",
    "t=t*60",
)


def test_every_bit_is_that_of_the_file(tmp_path):
    text = HEAD + "\n".join(rows()) + "\n"
    (tmp_path / "log.csv").write_text(text)
    (run,) = read_telemetry(tmp_path / "log.csv", maps=MAPS, names=["h", "u"], optional=["e", "x"])
    t, columns = read(text, maps=MAPS, names=["h", "u"], optional=["e", "x"])
    np.testing.assert_array_equal(t, run.t)
    assert list(columns) == list(run.columns)
    for name, values in run.columns.items():
        np.testing.assert_array_equal(columns[name], values)


@pytest.mark.parametrize(
    "text",
    [
        "t;u;x\n0;-0,25;3\n1,5;1e-3;\n2;7;4\n",
        "t;u;x\n0;-0.25;3\n1.5;1e-3;\n2;7;4\n",
        "t\tu\tx\n0\t-,25\t3\n1,5\t1E-3\t\n2\t7\t4\n",
        "t|u|x\n0|-0.25|3\n1.5|1e-3|\n2|7|4\n",
        't;u;x\n"0";"-0,25";3\n"1,5";0,001;\n2;7;4\n',
        "sep=;\nt;u;x\ns;V;m\n0;-0,25;3\n1,5;1e-3;\n2;7;4\n",
        "t;u [°C];x\n0;-0,25;3\n1,5;1e-3;\n2;7;4\n",
        "t;T;u;x\ns;°C;V;m\n0;1;-0,25;3\n1,5;1;1e-3;\n2;1;7;4\n",
    ],
)
def test_a_dialect_is_that_of_the_file(tmp_path, text):
    """Read and said as the file is, in Windows' encoding, too."""
    path, told = tmp_path / "log.csv", []
    path.write_bytes(text.encode("cp1252"))
    (run,) = read_telemetry(path, names=["u", "x"])
    lines = text.encode("cp1252").splitlines(keepends=True)
    come = [line.decode(errors="surrogateescape") for line in lines]
    pieces = read_stream([come], names=["u", "x"], note=told.append)
    samples = [sample for piece in pieces for sample in piece]
    np.testing.assert_array_equal([s.t for s in samples], run.t)
    for name in ("u", "x"):
        np.testing.assert_array_equal([s.values[name] for s in samples], run.columns[name])
    assert sorted(told) == sorted(each.replace(str(path), "standard input") for each in run.notes)


def test_decimals_are_known_from_the_first_number_that_has_any():
    """Whole numbers before it are the same in each dialect; text with commas is text."""
    told = []
    text = "t;u;mode\n0;1;a,b\n1;2;3,\n2;2,5;c\n3;3,5;d\n"
    _, columns = read(text, names=["u"], note=told.append)
    assert columns["u"].tolist() == [1.0, 2.0, 2.5, 3.5]
    assert told == [
        "standard input: cells are separated by semicolons, numbers have decimal commas."
    ]


def test_text_that_is_not_utf_8_is_refused_by_row():
    left_out = []
    text = "t,u,note\n0,1,a\n1,2,\udcb0\n2,3,b\n"
    t, _ = read(text, names=["u"], skip=left_out.append)
    assert t.tolist() == [0, 2]
    assert "row 3: the text is not UTF-8" in str(left_out[0])


def test_ndjson_is_the_same_telemetry():
    text = HEAD + "\n\n".join(rows(30)) + "\n"
    names = ["t", "wheel rpm", "u", "note"]
    lines = []
    for row in rows(30):
        cells = dict(zip(names, row.split(","), strict=True))
        numbers = {n: float(c) if c and n != "note" else c or None for n, c in cells.items()}
        lines.append(json.dumps({n: c for n, c in numbers.items() if c is not None or n == "t"}))
    found = read("\n".join([*lines, ""]), names=["wheel_rpm", "u"])
    expected = read(text, names=["wheel_rpm", "u"])
    np.testing.assert_array_equal(found[0], expected[0])
    for name, values in expected[1].items():
        np.testing.assert_array_equal(found[1][name], values)


def test_timestamps_are_seconds_since_the_first():
    text = "when,u\n2026-01-01T00:00:00Z,1\n2026-01-01T00:00:00.250000Z,2\n2026-01-01T00:01:00Z,3\n"
    assert read(text, time="when", names=["u"])[0].tolist() == [0.0, 0.25, 60.0]
    lines = [text.splitlines(keepends=True)]
    samples = list(chain(*read_stream(lines, time="when", names=["u"])))
    assert {each.clock for each in samples} == {Clock(datetime(2026, 1, 1, tzinfo=UTC))}


def test_a_time_since_1970_goes_on_as_one():
    """1767225600 s is 2026-01-01: as milliseconds, and then a row of another kind."""
    text = "t,u\n1767225600000,1\n1767225600250,2\n7,3\n1767225660000,4\n"
    left_out = []
    lines = [text.splitlines(keepends=True)]
    samples = list(chain(*read_stream(lines, names=["u"], skip=left_out.append)))
    assert [each.t for each in samples] == [0.0, 0.25, 60.0]
    assert {each.clock for each in samples} == {Clock(datetime(2026, 1, 1, tzinfo=UTC))}
    assert "row 4: the time 7 is not of the kind of the first row's" in str(left_out[0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,u\n0,1\n1,x\n", "row 3, column 'u': 'x' is not a number"),
        ("t,u\n0,1\n1,inf\n", "row 3, column 'u': inf is not a finite number"),
        ("t,u\n0,1\n1,2,3\n", "row 3: 3 cells where the header has 2"),
        ("t,u\n0,1\n,2\n", "row 3, column 't': the time is empty"),
        ("t,u\n0,1\n0,2\n", "row 3: time is the same again"),
        ("t,u\n0,1\n1,1\n2,1\n1.5,2\n", "row 5: time runs backwards"),
        ("t;u\n0;0,5\n1;1.5\n", "row 3, column 'u': '1.5' has a point where"),
        ("t;u\n0;0,5\n1;1.234,5\n", "row 3, column 'u': '1.234,5' has a point where"),
        ("0,1\n1,2\n", "numbers where column names belong"),
        ("time,u\n0,1\n", "no time column 't'"),
        ("t,v\n0,1\n", "has no column 'u'"),
        ("t,u,run\n0,1,a\n1,2,b\n", "row 3: a new run, 'b', begins"),
        ('{"t": 0, "u": 1}\n{"t": 1, "u"\n', 'row 2: \'{"t": 1, "u"\' is not a JSON object'),
        ('{"t": 0, "u": 1}\n{"t": 1, "u": [2]}\n', "row 2, column 'u': '[2]' is not a number"),
        ('{"t": 0, "u": 1}\n{"t": 1, "u": true}\n', "row 2, column 'u': 'true' is not a number"),
    ],
)
def test_refusals_name_the_row(text, said):
    with pytest.raises(InputError) as refusal:
        read(text, names=["u"])
    assert said in str(refusal.value)
    assert str(refusal.value).startswith("standard input")


def test_what_is_left_out_is_handed_over_and_the_first_row_may_be_it():
    text = "when,u\nx,0\n2026-01-01T00:00:00Z,1\n2026-01-01T00:00:01Z,inf\n2026-01-01T00:00:02Z,3\n"
    left_out = []
    t, columns = read(text, time="when", names=["u"], skip=left_out.append)
    assert (t.tolist(), columns["u"].tolist()) == ([0.0, 2.0], [1.0, 3.0])
    assert ["row 2" in str(left_out[0]), "row 4" in str(left_out[1])] == [True, True]


@pytest.mark.parametrize(
    "text", ["time,u\n0,1\n", "t,v\n0,1\n", "t;v\n0;1\n", "t,u,run\n0,1,a\n1,2,b\n"]
)
def test_what_is_wrong_with_all_rows_is_refused_all_the_same(text):
    with pytest.raises(InputError):
        read(text, names=["u"], skip=lambda wrong: None)


def test_samples_are_there_as_soon_as_their_lines_are():
    taken = []

    def lines():
        for several in (["t,u\n"], [], ["0,1\n", "x,1\n", "\n", "1,2\n"], ["2,3\n"]):
            taken.append(several)
            yield several

    left_out = []
    samples = read_stream(lines(), names=["u"], skip=left_out.append)
    assert [next(samples), next(samples)] == [[], []]
    # the usual step is known from the second of them on: until then the next one has to come
    assert next(samples) == [Sample(0.0, {"u": 1.0})]
    assert len(taken) == 3
    assert next(samples) == [Sample(1.0, {"u": 2.0}), Sample(2.0, {"u": 3.0})]
    (wrong,) = left_out
    assert "row 3" in str(wrong)


def test_what_came_before_a_refusal_is_given():
    samples = read_stream([["t,u\n", "0,1\n", "1,x\n", "2,1\n"]], names=["u"])
    assert next(samples) == [Sample(0.0, {"u": 1.0})]
    with pytest.raises(InputError, match="row 3"):
        next(samples)


def test_units_and_what_was_said_before_are_those_of_the_file(tmp_path):
    text = "Zeit [ms],T [degF],u (mV)\n[ms],[degF],[mV]\n0,32,500\n250,50,1000\n500,212,-250\n"
    (tmp_path / "log.csv").write_text(text)
    options = {
        "names": ["x", "u"],
        "units": {"x": "degC", "u": "V"},
        "before": Before(time="Zeit", maps=("x=T", "y=missing*2")),
    }
    (run,) = read_telemetry(tmp_path / "log.csv", **options)
    notes = []
    t, columns = read(text, note=notes.append, **options)
    assert t.tolist() == run.t.tolist() == [0, 0.25, 0.5]
    np.testing.assert_array_equal(columns["x"], run.columns["x"])
    np.testing.assert_allclose(columns["x"], [0, 10, 100], atol=1e-12)  # rounding
    np.testing.assert_allclose(columns["u"], [0.5, 1, -0.25], rtol=1e-15)
    assert notes == [
        'standard input: read as the logs of the fit, with --time Zeit --map "x=T"; give the '
        "option anew to say otherwise."
    ]


def test_a_time_format(tmp_path):
    text = "when,u\n22/11/2026 14:03:07,1\n22/11/2026 14:03:09,2\n"
    form = "%d/%m/%Y %H:%M:%S"
    assert read(text, time="when", time_format=form, names=["u"])[0].tolist() == [0, 2]
    before = Before(time="when", time_format=form)
    assert read(text, before=before, names=["u"])[0].tolist() == [0, 2]


def left_out_of(times, **options):
    """(times that are read, rows that are left out) of a stream of so many."""
    wrong = []
    text = "t,u\n" + "".join(f"{t},{k}\n" for k, t in enumerate(times))
    t, columns = read(text, names=["u"], skip=lambda each: wrong.append(str(each)), **options)
    assert [times[int(u)] for u in columns["u"]] == t.tolist()
    rows = {int(text.split("row ")[1].split(":")[0].split(",")[0]) for text in wrong}
    assert len(t) + len(rows) == len(times)
    return t.tolist(), sorted(row - 2 for row in rows)


def test_a_row_far_ahead_is_the_wrong_one_where_time_goes_on_from_before_it():
    even = [0.5 * k for k in range(30)]
    for wrong in (0, 1, 2, 17, 28):
        times = [1e9 if k == wrong else t for k, t in enumerate(even)]
        assert left_out_of(times) == ([t for t in even if t != even[wrong]], [wrong])
    assert left_out_of([*even[:29], 1e9]) == ([*even[:29], 1e9], []), "nothing comes after it"


def test_behind_a_gap_time_goes_on():
    """The row behind it waits for the next; one that comes again, or late, does not count."""
    times = [0, 1, 2, 3, 1000, 1000, 2.5, 1001, 1002, 5000, 7000, 7001]
    assert left_out_of(times) == ([0, 1, 2, 3, 1000, 1001, 1002, 5000, 7000, 7001], [5, 6])
    assert left_out_of([0, 1, 2, 3, 1000, 4, 2000, 5, 6]) == ([0, 1, 2, 3, 4, 5, 6], [4, 6])


def test_only_rows_behind_a_gap_wait():
    lines = [["t,u\n"], *([f"{t},1\n"] for t in (0, 1, 2, 3, 6, 10, 11, 12))]
    found = [[s.t for s in samples] for samples in read_stream(lines, names=["u"])]
    assert found == [[], [], [0], [1, 2], [3], [6], [], [10, 11], [12], []]


def test_strictly_a_row_far_ahead_is_refused_by_name():
    samples = read_stream([["t,u\n", "0,1\n", "1,1\n", "2,1\n", "9e9,1\n", "3,1\n"]], names=["u"])
    assert [s.t for s in next(samples)] == [0, 1, 2]
    with pytest.raises(InputError, match=r"row 5: time \(9e\+09 s\) is ahead of what comes after"):
        next(samples)


def test_timestamps_count_from_the_first_row_that_is_right():
    text = "when,u\n2098-01-01T00:00:00Z,1\n2026-01-01T00:00:00Z,2\n2026-01-01T00:00:01Z,3\n"
    wrong = []
    t, columns = read(text, time="when", names=["u"], skip=wrong.append)
    assert (t.tolist(), columns["u"].tolist()) == ([0, 1], [2, 3])
    assert "row 2" in str(wrong[0])
