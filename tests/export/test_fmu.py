"""The FMUs of a model, driven as a host would."""

import ctypes
import json
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path

import numpy as np
import pytest

from drawn_models import calibrated, walked
from faultgauge.cli.app import run
from faultgauge.export import fmu
from faultgauge.export.entry import bank_of, step_of
from faultgauge.plants.model import save_model

pytestmark = pytest.mark.study

CLOSE = 1e-9  # of a signal's largest value, as of the C itself (test_watch)
COUNT = 260
STEP = 0.1


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """A folder with a model file and its FMUs."""
    folder = tmp_path_factory.mktemp("shop")
    save_model(calibrated("tank"), folder / "tank.fgm")
    assert run(["export", str(folder / "tank.fgm"), "--to", "fmu", "--out", str(folder / "f")]) == 0
    return folder / "f"


@pytest.fixture(scope="module")
def flight():
    """(samples with a fault in their second half, what Python says of them)."""
    step = step_of(bank_of(calibrated("tank")))
    samples = step.examples(COUNT, np.random.default_rng(0))
    return samples, walked(step, samples)


def opened(shop, version):
    return zipfile.ZipFile(shop / f"tank_fmi{version}.fmu")


def description(shop, version):
    return ET.fromstring(opened(shop, version).read("modelDescription.xml"))


# -- what is inside


@pytest.mark.parametrize("version", [2, 3])
def test_variables_and_structure_are_as_the_standard_asks(shop, version):
    root = description(shop, version)
    assert root.get("fmiVersion") == f"{version}.0"
    assert root.get("guid" if version == 2 else "instantiationToken", "").startswith("{")
    order = [each.tag for each in root]
    assert order == ["CoSimulation", "UnitDefinitions", "TypeDefinitions", "LogCategories",
                     "DefaultExperiment", "ModelVariables", "ModelStructure"]  # fmt: skip
    assert root.find("CoSimulation").get("modelIdentifier") == "tank"
    assert float(root.find("DefaultExperiment").get("stepSize")) == STEP
    variables = list(root.find("ModelVariables"))
    if version == 2:
        assert {each.tag for each in variables} == {"ScalarVariable"}
        assert all(len(each) == 1 for each in variables)
        places = {name: str(k + 1) for k, name in enumerate(v.get("name") for v in variables)}
        typed = [each[0].attrib | each.attrib for each in variables]
    else:
        assert {each.tag for each in variables} == {"Float64", "Int32", "Boolean", "Enumeration"}
        places = {each.get("name"): each.get("valueReference") for each in variables}
        typed = [dict(each.attrib) for each in variables]
    assert len({each["name"] for each in typed}) == len(typed)
    assert len({each["valueReference"] for each in typed}) == len(typed)
    by = {each["name"]: each for each in typed}
    assert by["time"]["causality"] == "independent"
    assert {n for n, v in by.items() if v["causality"] == "input"} == {"u", "level"}
    for each in typed:
        # a start is there where the standard asks for one, and nowhere else
        assert ("start" in each) == (each["causality"] == "input")
        assert ("initial" in each) == (each["causality"] == "output")
        assert each["description"]
    units = {each.get("name"): each for each in root.find("UnitDefinitions")}
    assert {v["unit"] for v in typed if "unit" in v} <= set(units)
    assert by["f_leak"]["unit"] == "m/s"
    assert units["m/s"].find("BaseUnit").attrib == {"m": "1", "s": "-1"}
    types = {each.get("name"): each for each in root.find("TypeDefinitions")}
    status = types[by["status"]["declaredType"]]
    items = [each.attrib for each in status.iter("Item")]
    assert items[1] == {"name": "FAULT", "value": "1"}
    for name in ("event_leak", "event_unknown", "unnamed_event"):
        items = [each.attrib for each in types[by[name]["declaredType"]].iter("Item")]
        assert items[3] == {"name": "OVER", "value": "3"}
    outputs = {n for n, v in by.items() if v["causality"] == "output"}
    structure = root.find("ModelStructure")
    key = "index" if version == 2 else "valueReference"
    for kind in ("Outputs", "InitialUnknowns") if version == 2 else ("Output", "InitialUnknown"):
        group = structure.find(kind) if version == 2 else structure.findall(kind)
        assert [each.get(key) for each in group] == [places[n] for n in by if n in outputs]


def test_the_files_of_an_archive_are_where_hosts_look(shop):
    second, third = (set(opened(shop, version).namelist()) for version in (2, 3))
    listed = {f"sources/{each.get('name')}" for each in description(shop, 2).iter("File")}
    assert {"modelDescription.xml", *listed} <= second
    build = ET.fromstring(opened(shop, 3).read("sources/buildDescription.xml"))
    assert {f"sources/{each.get('name')}" for each in build.iter("SourceFile")} <= third
    assert ("binaries/linux64/tank.so" in second) == fmu.binary_here()
    assert ("binaries/x86_64-linux/tank.so" in third) == fmu.binary_here()


def test_the_same_model_gives_the_same_bytes(shop, tmp_path, capsys):
    save_model(calibrated("tank"), tmp_path / "tank.fgm")
    command = ["export", str(tmp_path / "tank.fgm"), "--to", "fmu", "--out", str(tmp_path / "f")]
    assert run([*command, "--json"]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert set(files) == {"tank_fmi2.fmu", "tank_fmi3.fmu", "README.md"}
    for name in files[:2]:
        one, other = (zipfile.ZipFile(folder / name) for folder in (shop, tmp_path / "f"))
        assert one.namelist() == other.namelist()
        for each in one.namelist():
            if not each.endswith(".so"):
                assert one.getinfo(each).date_time == other.getinfo(each).date_time
                assert one.read(each) == other.read(each)


def test_without_a_compiler_there_are_sources_and_a_word_of_it(monkeypatch, tmp_path, capsys):
    save_model(calibrated("tank"), tmp_path / "tank.fgm")
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    command = ["export", str(tmp_path / "tank.fgm"), "--to", "fmu", "--out", str(tmp_path / "f")]
    assert run(command) == 0
    assert "no C compiler was found" in capsys.readouterr().err
    assert "no binary" in (tmp_path / "f" / "README.md").read_text()
    names = opened(tmp_path / "f", 2).namelist()
    assert "sources/tank_fmi2.c" in names
    assert not [each for each in names if each.endswith(".so")]


@pytest.mark.parametrize("version", [2, 3])
def test_sources_compile_by_themselves_without_a_word(cc, shop, version, tmp_path):
    """As a host does that builds them: the listed files, and nothing else."""
    opened(shop, version).extractall(tmp_path)
    sources = sorted((tmp_path / "sources").glob("*.c"))
    flags = ["-std=c99", "-O0", "-Wall", "-Wpedantic", "-Wconversion", "-Werror"]
    command = [cc, *flags, "-fPIC", "-shared", *map(str, sources), "-o", str(tmp_path / "f.so")]
    done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]


# -- hosts


OLD = {
    "Real": ("Real", c_double), "Integer": ("Integer", c_int),
    "Enumeration": ("Integer", c_int), "Boolean": ("Boolean", c_int),
}  # fmt: skip
NEW = {
    "Float64": ("Float64", c_double), "Int32": ("Int32", c_int),
    "Enumeration": ("Int64", c_int64), "Boolean": ("Boolean", c_bool),
}  # fmt: skip


class Host:
    """What a host does with an instance; `said` are the errors that were logged."""

    def __init__(self, shop, version, folder):
        if not fmu.binary_here():
            pytest.skip("no binary here: FMUs are built on Linux on x86-64 with a C compiler")
        archive = opened(shop, version)
        library = next(each for each in archive.namelist() if each.endswith(".so"))
        self.c = ctypes.CDLL(archive.extract(library, folder))
        self.root, self.said = description(shop, version), []
        self.places = {}
        for each in self.root.find("ModelVariables"):
            tag = each[0].tag if version == 2 else each.tag
            self.places[each.get("name")] = (tag, int(each.get("valueReference")))
        self.instance = c_void_p(self.made())
        assert self.instance.value is not None

    def call(self, name, *arguments):
        return getattr(self.c, f"{self.prefix}{name}")(self.instance, *arguments)

    def get(self, name):
        tag, place = self.places[name]
        function, kind = self.types[tag]
        value = kind()
        count = () if self.prefix == "fmi2" else (c_size_t(1),)
        given = (byref(c_uint32(place)), c_size_t(1), byref(value), *count)
        assert self.call(f"Get{function}", *given) == 0
        return value.value

    def put(self, name, value):
        count = () if self.prefix == "fmi2" else (c_size_t(1),)
        given = (byref(c_uint32(self.places[name][1])), c_size_t(1), byref(c_double(value)), *count)
        return self.call("SetFloat64" if self.prefix == "fmi3" else "SetReal", *given)

    def fly(self, samples, part):
        """What is said of the samples, as a host reads it after every step."""
        names = [n for n, (_, v) in self.places.items() if n not in ("time", *samples)]
        rows = {name: [] for name in names}
        for k in range(part.start, part.stop):
            for name in samples:
                if name != "t":
                    assert self.put(name, samples[name][k]) == 0
            assert self.step(samples["t"][k], STEP) == 0
            for name in names:
                rows[name].append(self.get(name))
        return {name: np.array(values) for name, values in rows.items()}


class Host2(Host):
    prefix = "fmi2"
    types = OLD

    class Callbacks(ctypes.Structure):
        _fields_ = [(n, c_void_p) for n in ("log", "allocate", "free", "finished", "environment")]

    def __init__(self, shop, folder):
        super().__init__(shop, 2, folder)

    def made(self):
        kind = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_char_p)
        self.log = kind(lambda e, n, s, c, form, text: self.said.append(text.decode()))
        self.host = self.Callbacks(log=ctypes.cast(self.log, c_void_p))
        self.c.fmi2Instantiate.restype = c_void_p
        token = self.root.get("guid").encode()
        return self.c.fmi2Instantiate(b"one", 1, token, b"", byref(self.host), 0, 0)

    def begin(self):
        assert self.call("SetupExperiment", 0, c_double(0), c_double(0), 0, c_double(0)) == 0
        assert self.call("EnterInitializationMode") == 0
        assert self.call("ExitInitializationMode") == 0

    def step(self, t, h):
        return self.call("DoStep", c_double(t), c_double(h), 1)

    names = ("FMUstate", "SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate")


class Host3(Host):
    prefix = "fmi3"
    types = NEW

    def __init__(self, shop, folder):
        super().__init__(shop, 3, folder)

    def made(self):
        kind = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
        self.log = kind(lambda e, s, c, text: self.said.append(text.decode()))
        make = self.c.fmi3InstantiateCoSimulation
        make.restype = c_void_p
        token = self.root.get("instantiationToken").encode()
        off = [c_bool(False)] * 4
        return make(b"one", token, None, *off, None, c_size_t(0), None, self.log, None)

    def begin(self):
        off = c_bool(False)
        given = (off, c_double(0), c_double(0), off, c_double(0))
        assert self.call("EnterInitializationMode", *given) == 0
        assert self.call("ExitInitializationMode") == 0

    def step(self, t, h):
        event, end, early, reached = c_bool(), c_bool(), c_bool(), c_double()
        told = (byref(each) for each in (event, end, early, reached))
        status = self.call("DoStep", c_double(t), c_double(h), c_bool(True), *told)
        if status == 0:
            assert reached.value == t + h
            assert [event.value, end.value, early.value] == [False] * 3
        return status

    names = ("FMUState", "SerializedFMUStateSize", "SerializeFMUState", "DeserializeFMUState")


@pytest.fixture(params=[Host2, Host3])
def host(request, shop, tmp_path):
    made = request.param(shop, tmp_path)
    yield made
    free = getattr(made.c, f"{made.prefix}FreeInstance")
    free.restype = None
    free(made.instance)


def agree(found, wanted):
    for name, said in wanted.items():
        if said.dtype.kind != "f":
            np.testing.assert_array_equal(found[name], said, err_msg=name)
            continue
        limit = CLOSE * max(np.nanmax(np.abs(said), initial=0.0), 1e-9)
        np.testing.assert_allclose(found[name], said, rtol=0, atol=limit, err_msg=name)


def test_a_flight_says_what_python_says(host, flight):
    samples, said = flight
    assert host.get("status") == 2  # NOT_JUDGED
    assert np.isnan(host.get("p_leak"))
    host.begin()
    found = host.fly(samples, slice(0, COUNT))
    assert set(found) == set(said)
    agree(found, said)
    assert host.get("time") == samples["t"][-1] + STEP
    assert host.get("u") == samples["u"][-1]
    assert host.call("Terminate") == 0
    assert host.step(0.0, STEP) == 3  # an error: it has ended
    assert host.said == ["a function was called out of turn"]


def test_a_state_that_was_kept_goes_on_to_the_bit(host, flight):
    """Kept in memory, and as bytes that another instance takes."""
    samples, _ = flight
    host.begin()
    host.fly(samples, slice(0, 100))
    state, size = c_void_p(), c_size_t()
    whole, measure, pack, unpack = host.names
    assert host.call(f"Get{whole}", byref(state)) == 0
    assert host.call(measure, state, byref(size)) == 0
    packed = (ctypes.c_ubyte * size.value)()
    assert host.call(pack, state, packed, size) == 0
    first = host.fly(samples, slice(100, 160))
    assert host.call(f"Set{whole}", state) == 0
    again = host.fly(samples, slice(100, 160))
    assert host.call("Reset") == 0
    other = c_void_p()
    assert host.call(unpack, packed, size, byref(other)) == 0
    assert host.call(f"Set{whole}", other) == 0
    bytewise = host.fly(samples, slice(100, 160))
    for name, values in first.items():
        np.testing.assert_array_equal(again[name], values)
        np.testing.assert_array_equal(bytewise[name], values)
    packed[0] ^= 1
    broken = c_void_p()
    assert host.call(unpack, packed, size, byref(broken)) == 3
    assert "those of another FMU" in host.said[-1]
    for each in (state, other):
        assert host.call(f"Free{whole}", byref(each)) == 0
        assert each.value is None


def test_reset_begins_anew(host, flight):
    samples, said = flight
    host.begin()
    host.fly(samples, slice(0, 50))
    assert host.call("Reset") == 0
    host.begin()
    found = host.fly(samples, slice(0, 50))
    agree(found, {name: values[:50] for name, values in said.items()})


def test_parts_of_a_step_take_a_sample_where_one_is_due(host, flight):
    """Half the time between samples: every other step takes one, and the answers stay."""
    samples, said = flight
    host.begin()
    for k in range(60):
        for name in ("u", "level"):
            host.put(name, samples[name][k])
        assert host.step(samples["t"][k], STEP / 2) == 0
        assert host.step(samples["t"][k] + STEP / 2, STEP / 2) == 0
        wanted = said["x_level"][k]
        assert host.get("x_level") == pytest.approx(wanted, rel=CLOSE, nan_ok=True)


def test_what_is_wrong_is_refused_in_a_sentence(host):
    host.begin()
    assert host.step(0.0, 2 * STEP) == 3
    assert "longer than the time between samples, 0.1 s" in host.said[-1]
    assert host.put("p_leak", 0.5) == 3
    assert "no input has that value reference" in host.said[-1]
    host.places["nobody"] = ("Real", 10_000)
    assert host.put("nobody", 0.5) == 3
    assert host.call("GetString", None, c_size_t(0), None, c_size_t(0)) == 3
    assert "this FMU has none of that" in host.said[-1]


def test_an_fmu_of_another_model_is_not_taken(host):
    name = "guid" if host.prefix == "fmi2" else "instantiationToken"
    host.root.set(name, "{another}")
    assert host.made() is None
    assert "that of another FMU" in host.said[-1]


FMPY = """
import sys
import fmpy, numpy
from fmpy.validation import validate_fmu
path, given, wanted, step = sys.argv[1:]
assert validate_fmu(path) == [], validate_fmu(path)
given = numpy.load(given)
names = [name for name in given.files if name != "t"]
kinds = [("time", float)] + [(name, float) for name in names]
rows = zip(given["t"], *[given[name] for name in names])
found = fmpy.simulate_fmu(
    path, start_time=0.0, stop_time=len(given["t"]) * float(step), step_size=float(step),
    output_interval=float(step), input=numpy.array(list(rows), dtype=kinds),
    output=numpy.load(wanted).files,
)
numpy.savez(wanted, **{name: found[name][1:] for name in found.dtype.names if name != "time"})
"""


@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_finds_nothing_wrong_and_says_the_same(shop, version, flight, tmp_path):
    """It lives apart, as other packages decide which versions of its own it gets."""
    python = Path(__file__).parents[2] / ".venv-fmpy" / "bin" / "python"
    if not python.exists():
        pytest.skip("FMPy is not installed: make emulators installs it")
    samples, said = flight
    np.savez(tmp_path / "given.npz", **samples)
    np.savez(tmp_path / "said.npz", **said)
    path = str(shop / f"tank_fmi{version}.fmu")
    command = [python, "-c", FMPY, path, tmp_path / "given.npz", tmp_path / "said.npz", str(STEP)]
    subprocess.run(command, check=True)
    agree(np.load(tmp_path / "said.npz"), said)
