"""The model file: the same bytes, the same model, and no damage that goes unnoticed."""

import hashlib
import json
import os
import pickle
import struct

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import safetensors.numpy

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, encoded, load_model, save_model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.record import CalibrationRecord, calibration_in, fit_in
from faultgauge.plants.settle import settle
from faultgauge.plants.shape import Shape

PLANT = """
name = "wheel"
[states.h]
derivative = "k*u - friction(h)"
[inputs.u]
[outputs.h]
value = "h"
[parameters]
k = { value = 2.5 }
J = { value = 0.84, fixed = true }
[networks.friction]
hidden = 4
"""
RECORD = {
    "max_step": 0.125,
    "sample_time": 0.25,
    "seed": 3,
    "columns": {"states": [["h", 0]], "outputs": ["T", "hm"]},
    "data": {"fit": ["ab"], "validate": []},
    "derivatives": {},
    "metrics": {"validation_free_run_nrmse": 0.01},
    "envelope": {"h": [-1.5, 2.0]},
    "envelope_points": [[-1.5, 0.1], [2.0, -0.1]],
    "note": "0.1 °C",
}


def model():
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "wheel.toml"))
    rng = np.random.default_rng(0)
    networks = jax.tree.map(lambda a: jnp.asarray(rng.normal(size=a.shape)), plant.networks)
    return Model(eqx.tree_at(lambda p: p.networks, plant, networks), fit_in(RECORD))


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "wheel.fgm"
    save_model(model(), path)
    return path


def refusal(path):
    """The message of the refusal, which has to name the file and be one sentence."""
    with pytest.raises(InputError) as failure:
        load_model(path)
    message = str(failure.value)
    assert message.startswith(f"{path}: ")
    assert message.endswith(".")
    assert "\n" not in message
    return message


def test_round_trip(saved):
    first, second = model(), load_model(saved)
    assert second.record.as_dict() == RECORD
    assert second.plant.spec == first.plant.spec
    assert second.plant.spec.text == first.plant.spec.text
    assert jax.tree.structure(second.plant) == jax.tree.structure(first.plant)
    for a, b in zip(jax.tree.leaves(first.plant), jax.tree.leaves(second.plant), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


OPEN = PLANT.replace("hidden = 4", 'odd = true\nmonotone = "increasing"')
CHOICES = {"hold": {"u": "linear"}, "hidden": {"friction": 6}}


def open_model():
    spec = settle(parse_plant(OPEN, "wheel.toml"), CHOICES["hold"], CHOICES["hidden"])
    plant = GrayBoxPlant.untrained(spec)
    rng = np.random.default_rng(1)
    networks = jax.tree.map(lambda a: jnp.asarray(rng.normal(size=a.shape)), plant.networks)
    plant = eqx.tree_at(lambda p: p.networks, plant, networks)
    return Model(plant, fit_in({**RECORD, "choices": CHOICES}))


def test_round_trip_of_shapes_and_choices(tmp_path):
    first = open_model()
    save_model(first, tmp_path / "open.fgm")
    second = load_model(tmp_path / "open.fgm")
    assert second.plant.spec == first.plant.spec
    assert second.plant.spec.text == OPEN
    assert second.plant.signals.inputs[0].hold == "linear"
    assert second.plant.networks["friction"].shape == Shape(odd=True, monotone="increasing")
    assert jax.tree.structure(second.plant) == jax.tree.structure(first.plant)
    h = jnp.asarray([0.3])
    found = second.plant.derivative(h, jnp.asarray([0.2]))
    np.testing.assert_array_equal(found, first.plant.derivative(h, jnp.asarray([0.2])))
    save_model(second, tmp_path / "again.fgm")
    assert (tmp_path / "again.fgm").read_bytes() == (tmp_path / "open.fgm").read_bytes()


@pytest.mark.parametrize(
    "choices",
    [
        {},
        [],
        {"hold": {}, "hidden": {}},
        {"hold": {"u": "cubic"}, "hidden": {"friction": 6}},
        {"hold": {"k": "linear"}, "hidden": {"friction": 6}},
        {"hold": {}, "hidden": {"friction": 7}},
    ],
)
def test_choices_that_do_not_fit_the_rest(tmp_path, choices):
    path = tmp_path / "open.fgm"
    save_model(open_model(), path)
    forged(path, record={**RECORD, "choices": choices})
    assert "damaged" in refusal(path)


def test_properties(saved):
    loaded = load_model(saved)
    assert loaded.max_step == 0.125
    assert loaded.calibration is None
    known = CalibrationRecord(observer="eso", data=[], repeats={})
    assert loaded.with_calibration(known).calibration == known
    assert loaded.record.as_dict() == RECORD


def test_same_model_same_bytes(saved, tmp_path):
    save_model(load_model(saved), tmp_path / "again.fgm")
    assert (tmp_path / "again.fgm").read_bytes() == saved.read_bytes()


def test_other_model_other_bytes(saved, tmp_path):
    save_model(Model(model().plant, fit_in({**RECORD, "seed": 4})), tmp_path / "other.fgm")
    assert (tmp_path / "other.fgm").read_bytes() != saved.read_bytes()


def test_numbers_that_json_cannot_say_are_not_written(tmp_path):
    record = fit_in({**RECORD, "note": float("nan")})
    with pytest.raises(ValueError, match="JSON"):
        save_model(Model(model().plant, record), tmp_path / "wheel.fgm")
    assert list(tmp_path.iterdir()) == []


# Damage. `parts` and `glue` take a safetensors file apart with the standard library alone.
def parts(data):
    (size,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def glue(header, body):
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def forged(saved, *, arrays=None, **changes):
    """The file with other content, sealed as a forger who read the source would."""
    data = saved.read_bytes()
    content = json.loads(parts(data)[0]["__metadata__"]["faultgauge"])
    arrays = safetensors.numpy.load(data) if arrays is None else arrays
    sha = hashlib.sha256()
    for name in sorted(arrays):
        sha.update(f"{name}{arrays[name].shape}".encode() + arrays[name].astype("<f8").tobytes())
    content |= {"sha256": sha.hexdigest(), **changes}
    content.pop("seal")
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    content["seal"] = hashlib.sha256(canonical.encode()).hexdigest()
    saved.write_bytes(safetensors.numpy.save(arrays, {"faultgauge": json.dumps(content)}))


def test_forgery_without_changes_loads(saved):
    """So that the refusals below are for what was changed, not for how it was written."""
    forged(saved)
    assert load_model(saved).record.as_dict() == RECORD


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.99])
def test_cut_short(saved, share):
    data = saved.read_bytes()
    saved.write_bytes(data[: int(len(data) * share)])
    assert "not a model file, or cut short" in refusal(saved)


def test_missing_last_byte_and_extra_byte(saved):
    data = saved.read_bytes()
    for other in (data[:-1], data + b"\0"):
        saved.write_bytes(other)
        assert "not a model file, or cut short" in refusal(saved)


def test_every_altered_byte_of_the_numbers_is_noticed(saved):
    data = bytearray(saved.read_bytes())
    body = len(parts(bytes(data))[1])
    for offset in range(len(data) - body, len(data), 37):
        altered = data.copy()
        altered[offset] ^= 1
        saved.write_bytes(altered)
        assert "numbers were altered" in refusal(saved)


@pytest.mark.parametrize(
    ("old", "new"),
    [("0.125", "0.126"), ("k*u", "k/u"), ('\\"seed\\":3', '\\"seed\\":8')],
)
def test_altered_description(saved, old, new):
    data = saved.read_bytes()
    assert old.encode() in data
    saved.write_bytes(data.replace(old.encode(), new.encode()))
    assert "description was altered" in refusal(saved)


def test_every_altered_byte_of_the_header_is_refused_or_harmless(saved):
    """No byte of the header may raise anything but a refusal, or change what is loaded."""
    data = bytearray(saved.read_bytes())
    size = struct.unpack("<Q", data[:8])[0]
    refused = 0
    for offset in range(0, 8 + size, 11):
        altered = data.copy()
        altered[offset] ^= 4
        saved.write_bytes(altered)
        try:
            assert load_model(saved).record.as_dict() == RECORD
        except InputError:
            refused += 1
    assert refused > 0.9 * size / 11


def test_foreign_safetensors(saved):
    saved.write_bytes(safetensors.numpy.save({"weight": np.zeros(3)}))
    assert "not one of faultgauge's" in refusal(saved)
    saved.write_bytes(safetensors.numpy.save({"weight": np.zeros(3)}, {"format": "pt"}))
    assert "not one of faultgauge's" in refusal(saved)


@pytest.mark.parametrize("text", ["", "[]", "7", "null", "{}", '{"seal": 1}', "[" * 50_000])
def test_description_that_is_none(saved, text):
    saved.write_bytes(safetensors.numpy.save({}, {"faultgauge": text}))
    assert "description is damaged" in refusal(saved)


def test_pickle_is_not_opened(saved, tmp_path):
    class Trap:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "trap"),))

    saved.write_bytes(pickle.dumps(Trap()))
    assert "not a model file" in refusal(saved)
    assert not (tmp_path / "trap").exists()


def test_empty_file(saved):
    saved.write_bytes(b"")
    assert "not a model file" in refusal(saved)


@pytest.mark.parametrize("size", [2**63, 2**64 - 1, 10**9])
def test_header_that_claims_to_be_huge(saved, size):
    saved.write_bytes(struct.pack("<Q", size) + saved.read_bytes()[8:])
    assert "not a model file" in refusal(saved)


def test_huge_file_is_not_read(saved):
    with open(saved, "wb") as file:
        file.truncate(100_000_001)  # sparse: takes no room
    assert "more than 100 MB" in refusal(saved)


def test_absent_file_and_folder(tmp_path):
    assert "No such file" in refusal(tmp_path / "absent.fgm")
    assert "directory" in refusal(tmp_path)


def test_other_format(saved):
    forged(saved, format=2)
    assert "format 2" in refusal(saved)


def test_wrong_shape(saved):
    arrays = dict(safetensors.numpy.load(saved.read_bytes()))
    arrays["networks/friction/bias"] = np.zeros(5)
    forged(saved, arrays=arrays)
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none(saved, value):
    arrays = dict(safetensors.numpy.load(saved.read_bytes()))
    arrays["networks/friction/weights_in"] = np.full((4, 1), value)
    forged(saved, arrays=arrays)
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize("change", ["missing", "extra", "float32", "bool"])
def test_wrong_tensors(saved, change):
    arrays = dict(safetensors.numpy.load(saved.read_bytes()))
    match change:
        case "missing":
            del arrays["parameters/k"]
        case "extra":
            arrays["parameters/z"] = np.zeros(())
        case "float32":
            arrays["parameters/k"] = arrays["parameters/k"].astype(np.float32)
        case _:
            arrays["parameters/k"] = np.zeros((), np.bool_)
    forged(saved, arrays=arrays)
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize(
    ("apart", "off"), [({}, {}), ({"k": 1.0}, {"h": 1.0}), ({}, {"h": -1.0}), ({}, {"x": 1.0})]
)
def test_what_differs_between_runs_is_of_what_varies_and_of_all_outputs(saved, apart, off):
    """Nothing varies in the wheel, whose one output is h."""
    between = {"apart": {}, "off": {"h": 1.0}, "lasting": 1.0}
    forged(saved, record={**RECORD, "between": between})
    load_model(saved)
    forged(saved, record={**RECORD, "between": {**between, "apart": apart, "off": off}})
    assert "its description is damaged" in refusal(saved)


def test_record_without_what_a_model_needs(saved):
    forged(saved, record=[])
    assert "damaged" in refusal(saved)
    forged(saved, record={"seed": 1})
    assert "damaged" in refusal(saved)


LEVEL = {
    "level": 3.0, "mtbfa_s": 9, "confidence": 0.95, "memory_s": 1.0, "alarms": 0, "blocks": 1,
    "samples": 9, "size": {}, "suspects": [["day", 0, 1.5]], "widened": 1, "judged_s": 1.0,
    "healthy_s": 1.0, "block_s": 1e-7,
}  # fmt: skip
CALIBRATION = {"observer": "bank", "data": ["ab"], "repeats": {"hm": 2}, "bank": LEVEL}


def test_a_calibration_is_written_as_it_was_read(saved):
    """Whole numbers stay whole, and what another version told besides stays, too."""
    noise = {"sigma": {"h": 1}, "shift": {"h": -0.25}, "ours": {"h": 3}}
    block = {**CALIBRATION, "noise": noise, "note": [1, 2.0, None]}
    forged(saved, record={**RECORD, "calibration": block})
    before = parts(saved.read_bytes())[0]["__metadata__"]["faultgauge"]
    loaded = load_model(saved)
    assert (loaded.calibration.bank.mtbfa_s, loaded.record.as_dict()) == (9, RECORD)
    after = parts(encoded(loaded))[0]["__metadata__"]["faultgauge"]
    assert after == json.dumps(json.loads(before), sort_keys=True, separators=(",", ":"))


@pytest.mark.parametrize(
    ("key", "value", "fits"),
    [
        ("lasting", 3.0, True),
        ("lasting", 0.0, False),
        ("settling", -1.0, False),
        ("sigma", -1e-3, False),
        ("shift", -1e-3, True),
        ("shift", 1e300, False),
        ("another", "x", False),
    ],
)
def test_levels_of_noise_that_are_none(key, value, fits):
    """Times above 0, sizes from 0 on, and numbers."""
    block = {**CALIBRATION, "noise": {key: {"h": value}}}
    if fits:
        calibration_in(block)
        return
    with pytest.raises(ValueError, match=f"calibration.noise.{key}"):
        calibration_in(block)


def test_plant_that_does_not_parse(saved):
    forged(saved, plant=PLANT.replace("k*u", "__import__('os')"))
    refusal(saved)
    forged(saved, plant=7)
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_write_that_fails_leaves_the_old_file(saved, monkeypatch, call):
    before = saved.read_bytes()

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device") as failure:
        save_model(Model(model().plant, fit_in({**RECORD, "seed": 4})), saved)
    assert str(saved) in str(failure.value)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_interrupted_write_leaves_no_draft(saved, monkeypatch):
    def interrupt(*args):
        raise KeyboardInterrupt

    before = saved.read_bytes()
    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_model(Model(model().plant, fit_in({**RECORD, "seed": 4})), saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


@pytest.mark.parametrize(
    "path",
    ["absent/m.fgm", "file/m.fgm", "", ".", "..", "/", "漢" * 300],
    ids=["absent", "file", "empty", "here", "above", "root", "long"],
)
def test_places_that_cannot_be_written(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save_model(model(), path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def ensemble():
    """The model with two members, each with weights of its own."""
    best = model()
    rng = np.random.default_rng(5)
    others = [
        jax.tree.map(lambda a: a + jnp.asarray(rng.normal(size=a.shape)), best.plant)
        for _ in range(2)
    ]
    return best.with_members(others)


def test_members_come_back_and_the_bytes_are_the_same(tmp_path):
    paths = [tmp_path / "a.fgm", tmp_path / "b.fgm"]
    for path in paths:
        save_model(ensemble(), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    first, second = ensemble(), load_model(paths[0])
    assert second.record.as_dict() == {**RECORD, "members": 2}
    assert len(second.members) == 2
    pairs = zip((first.plant, *first.members), (second.plant, *second.members), strict=True)
    for written, read in pairs:
        assert jax.tree.structure(written) == jax.tree.structure(read)
        for a, b in zip(jax.tree.leaves(written), jax.tree.leaves(read), strict=True):
            np.testing.assert_array_equal(a, b)
    names = safetensors.numpy.load(paths[0].read_bytes()).keys()
    assert "members/2/networks/friction/bias" in names


def test_calibration_keeps_the_members():
    assert len(ensemble().with_calibration(None).members) == 2


def test_members_with_sizes_of_their_own(tmp_path):
    best = open_model()
    spec = settle(parse_plant(OPEN, "wheel.toml"), CHOICES["hold"], {"friction": 3})
    save_model(best.with_members([GrayBoxPlant.untrained(spec)]), tmp_path / "a.fgm")
    (member,) = load_model(tmp_path / "a.fgm").members
    assert member.networks["friction"].bias.shape == (3,)
    assert member.spec.signals.inputs[0].hold == "linear"


@pytest.mark.parametrize("count", [0, 1, 3, -1, "2", 10**9])
def test_a_count_of_members_that_is_not_theirs_is_refused(tmp_path, count):
    path = tmp_path / "a.fgm"
    whole = ensemble()
    save_model(whole, path)
    forged(path, record={**RECORD, "members": count})
    assert "its description is damaged" in refusal(path)
