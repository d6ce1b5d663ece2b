"""Nonsense in: exit 0 or 2, a sentence, no traceback. `make fuzz` runs many cases, the tests few.

Cases are drawn from a seed; a failure names kind and number of its case and leaves its files.
FAULTGAUGE_FUZZ is their number, or from where to where: 871-2000.
"""

import hashlib
import io
import json
import os
import random
import sys
import zipfile
from datetime import datetime, timedelta

import pytest

from faultgauge.plants.model import load_model
from faultgauge.plants.plant_file import parse_plant
from telemetry.workbooks import write_workbook

*FROM, CASES = map(int, os.environ.get("FAULTGAUGE_FUZZ", "30").split("-"))
WHOLE = 15  # of so many cases one goes through a whole command, which takes a second
NUMBERS = ["0", "-1", "1e300", "-1e300", "1e-300", "nan", "inf", "-inf", "1e9", "0x" + "f" * 3600]
TEXTS = ["", " ", "=1+1", "\x1b[31m", "[/red]", "\udcff", "x" * 300, "t", "run", "d(x)", "é", "\0"]
TREES = [None, True, 10**400, 2**70, [], {}, [[1]], {"a": 1}, -1, 0, 1e300, 1e-300, 1e99, "x"]


def mutated(rng, text):
    """A few characters, words or lines of `text` changed, moved, doubled or cut off."""
    for _ in range(rng.randint(1, 4)):
        lines = text.split("\n")
        k = rng.randrange(len(lines))
        cells = lines[k].split(",") if "," in lines[k] else lines[k].split(" ")
        j = rng.randrange(len(cells))
        match rng.randrange(8):
            case 0:
                cells[j] = rng.choice(NUMBERS + TEXTS)
                lines[k] = ("," if "," in lines[k] else " ").join(cells)
            case 1:
                del lines[k]
            case 2:
                lines.insert(rng.randrange(len(lines)), lines[k])
            case 3:
                lines[k] = lines[k][: rng.randrange(len(lines[k]) + 1)]
            case 4:
                lines[k] += rng.choice([",", '"', "]", "=", "\r", *TEXTS])
            case 5:
                text = "\n".join(lines)
                lines = text[: rng.randrange(len(text) + 1)].split("\n")
            case 6:
                at = rng.randrange(len(lines[k]) + 1)
                lines[k] = lines[k][:at] + chr(rng.randrange(0x250)) + lines[k][at:]
            case _:
                key, equals, _ = lines[k].partition("=")
                lines[k] = (
                    key + equals + rng.choice([*NUMBERS, *map(json.dumps, TEXTS), "[]", "{}"])
                )
        text = "\n".join(lines) or "\n"
    return text


def places(tree, place=()):
    """Every place in JSON; of a list its first items."""
    if place:
        yield place
    items = tree.items() if isinstance(tree, dict) else ()
    if isinstance(tree, list):
        items = enumerate(tree[:3])
    for key, each in items:
        yield from places(each, (*place, key))


def resealed(rng, data):
    """A model file with nonsense in its record, and a seal that is right."""
    size = int.from_bytes(data[:8], "little")
    head = json.loads(data[8 : 8 + size])
    content = json.loads(head["__metadata__"]["faultgauge"])
    del content["seal"]
    if rng.random() < 0.2:
        content["plant"] = mutated(rng, content["plant"]).encode(errors="replace").decode()
    else:
        *outer, key = rng.choice(list(places(content["record"])))
        tree = content["record"]
        for each in outer:
            tree = tree[each]
        if rng.random() < 0.2:
            del tree[key]
        else:
            tree[key] = rng.choice(TREES)

    def dump(tree):
        return json.dumps(tree, sort_keys=True, separators=(",", ":"))

    content["seal"] = hashlib.sha256(dump(content).encode()).hexdigest()
    head["__metadata__"]["faultgauge"] = dump(content)
    raw = json.dumps(head).encode()
    return len(raw).to_bytes(8, "little") + raw + data[8 + size :]


@pytest.fixture
def attempt(call, tmp_path, monkeypatch):
    """Call; what comes of it must be an answer or a refusal."""

    def attempting(case, *arguments, stdin=""):
        given = io.TextIOWrapper(io.BytesIO(stdin.encode(errors="surrogateescape")))
        monkeypatch.setattr(sys, "stdin", given)
        said = call(*arguments)
        assert said.code in (0, 2), (case, said.err)
        assert "Traceback" not in said.err, case
        assert "\x1b" not in said.out + said.err, case
        assert len(said.err) < 100_000, case
        assert not list(tmp_path.glob(".*")), case

    return attempting


def drawn(kind):
    for case in range(*FROM, CASES):
        yield case, random.Random(f"{kind} {case}")


def write(path, text):
    path.write_bytes(text.encode(errors="surrogateescape"))
    return path


@pytest.mark.fuzz
def test_logs(attempt, workshop, tmp_path):
    text = "\n".join(workshop.suspect.read_text().split("\n")[:41])
    for case, rng in drawn("log"):
        log = write(tmp_path / "log.csv", mutated(rng, text))
        draft = tmp_path / "draft.toml"
        draft.unlink(missing_ok=True)
        attempt(case, "inspect", log, "--init-plant", draft)
        attempt(case, "inspect", log, "--json")
        if draft.exists():
            parse_plant(draft.read_text())
            attempt(case, "fit", draft, tmp_path / "none.csv", "--out", tmp_path / "m.fgm")
        if case % WHOLE == 0:
            attempt(case, "evaluate", workshop.model, log)


def dialects(lines):
    """The same log as other programs write it, by their names, with the options to read it."""
    cells = [line.split(",") for line in lines]
    head, rows = cells[0], cells[1:]
    begun = datetime(2026, 10, 25, 2, 59, 59)  # as summer time ends
    clocks = [begun + timedelta(seconds=float(row[0])) for row in rows]
    dotted = [f"{at:%d.%m.%Y %H:%M:%S}.{at.microsecond:06}" for at in clocks]
    local = [[at, *row[1:]] for at, row in zip(dotted, rows, strict=True)]
    epoch = [[str(1_792_890_000_000 + int(1e3 * float(row[0]))), *row[1:]] for row in rows]

    def text(rows, separator=",", point="."):
        return "\n".join(separator.join(row).replace(".", point) for row in rows) + "\n"

    return {
        "decimal commas": (text(cells, ";", ","), ()),
        "tabs": (text(cells, "\t"), ()),
        "a row of units": (text([head, ["s", "%", "cm"], *rows]), ()),
        "units in the header": (text([["t [s]", "u [V]", "x [mm]"], *rows], ";", ","), ()),
        "milliseconds since 1970": (text([head, *epoch]), ()),
        "a local clock": (
            text([["Zeit", *head[1:]], *local], ";"),
            ("--time", "Zeit", "--time-format", "%d.%m.%Y %H:%M:%S.%f"),
        ),
    }


@pytest.mark.fuzz
def test_dialects(attempt, workshop, tmp_path):
    drafts = dialects(workshop.suspect.read_text().split("\n")[:41])
    for case, rng in drawn("dialect"):
        text, options = drafts[rng.choice(list(drafts))]
        nonsense = mutated(rng, text) if case else text
        log = write(tmp_path / "log.csv", nonsense)
        attempt(case, "inspect", log, *options)
        if case % WHOLE == 0:
            attempt(case, "evaluate", workshop.model, log, *options)
            eso = ("estimate", workshop.limited, "-", "--observer", "eso", *options)
            attempt(case, *eso, stdin=nonsense)


@pytest.mark.fuzz
def test_workbooks(attempt, workshop, tmp_path):
    lines = [line.split(",") for line in workshop.suspect.read_text().split("\n")[:41]]
    rows = [[float(cell) for cell in line] for line in lines[1:]]
    units = [None, "V", "m"]
    book = write_workbook(tmp_path / "sound.xlsx", {"a": [lines[0], units, *rows]}, "A1:A2")
    with zipfile.ZipFile(book) as file:
        parts = {name: file.read(name).decode() for name in file.namelist()}
    for case, rng in drawn("workbook"):
        path = tmp_path / "log.xlsx"
        if rng.random() < 0.8:
            name = rng.choice([*parts, *["xl/worksheets/s1.xml"] * 4])
            with zipfile.ZipFile(path, "w") as file:
                for each, text in parts.items():
                    split = mutated(rng, text.replace("><", ">\n<")) if each == name else text
                    file.writestr(each, split.encode(errors="surrogateescape"))
        else:
            data = bytearray(book.read_bytes())
            for _ in range(rng.randint(1, 4)):
                data[rng.randrange(len(data))] = rng.randrange(256)
            path.write_bytes(data[: rng.randrange(len(data)) if rng.random() < 0.3 else None])
        attempt(case, "inspect", path)


@pytest.mark.fuzz
def test_plant_files(attempt, workshop, tmp_path):
    for case, rng in drawn("plant"):
        plant = write(tmp_path / "plant.toml", mutated(rng, workshop.plant.read_text()))
        log = workshop.healthy if case % (4 * WHOLE) == 0 else tmp_path / "none.csv"
        attempt(case, "fit", plant, log, "--out", tmp_path / "m.fgm", "--restarts", 1)


SCENARIO = """name = "tank"
plant = "plant.toml"
seconds = 4
step = 0.1
seed = 7
[inputs.u]
source = "noise"
sigma = 0.8
low = 0.01
high = 1
[faults.leak]
profile = "step"
size = 0.5
start = 2.0
[noise]
x = 0.002
"""


@pytest.mark.fuzz
def test_scenarios(attempt, workshop, tmp_path):
    write(tmp_path / "plant.toml", workshop.plant.read_text())
    for case, rng in drawn("scenario"):
        scenario = write(tmp_path / "s.toml", mutated(rng, SCENARIO))
        read_only = ("--realtime", "1e-300")  # which is refused after the scenario
        attempt(case, "simulate", scenario, "--out", tmp_path / "log.csv", *read_only)


@pytest.mark.fuzz
def test_streams(attempt, workshop, tmp_path):
    text = "\n".join(workshop.suspect.read_text().split("\n")[:41])
    for case, rng in drawn("stream"):
        if case % 3 == 0:
            strict = ["--strict"] if rng.random() < 0.5 else []
            eso = ("estimate", workshop.limited, "-", "--observer", "eso")
            attempt(case, *eso, *strict, stdin=mutated(rng, text))


@pytest.mark.fuzz
def test_resealed_models(attempt, workshop, tmp_path):
    log = write(tmp_path / "log.csv", "\n".join(workshop.suspect.read_text().split("\n")[:61]))
    for case, rng in drawn("model"):
        for observer in ("bank", "eso"):
            path = tmp_path / "m.fgm"
            path.write_bytes(resealed(rng, workshop.judging(observer).read_bytes()))
            whole = log if case % WHOLE == 0 else tmp_path / "none.csv"
            out = ("--out", tmp_path / "e.csv", "--observer", observer)
            attempt(case, "estimate", path, whole, *out)


def test_what_is_resealed_unchanged_is_read(workshop, tmp_path):
    """The nonsense is refused for itself, not for its seal."""

    class Nothing(random.Random):
        def random(self):
            return 0.5

        def choice(self, of):
            return ("seed",) if ("seed",) in of else 0

    path = tmp_path / "m.fgm"
    path.write_bytes(resealed(Nothing(), workshop.model.read_bytes()))
    assert load_model(path).record.as_dict()["seed"] == 0
