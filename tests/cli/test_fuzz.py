"""Nonsense in: exit 0 or 2, a sentence, no traceback. `make fuzz` runs many cases, the tests few.

Cases are drawn from a seed; a failure names kind and number of its case and leaves its files.
"""

import hashlib
import io
import json
import os
import random
import sys

import pytest

from faultgauge.plants.model import load_model

CASES = int(os.environ.get("FAULTGAUGE_FUZZ", "30"))
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
    for case in range(CASES):
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
            attempt(case, "fit", draft, tmp_path / "none.csv", "--out", tmp_path / "m.fgm")
        if case % WHOLE == 0:
            attempt(case, "evaluate", workshop.model, log)


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
    assert load_model(path).record["seed"] == 0
