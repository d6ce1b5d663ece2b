"""The exported step against Python's own walk, on whole logs."""

import shutil
import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drawn_models import calibrated, log_of, walked
from faultgauge.export.compile import ExportedStep, print_step
from faultgauge.export.elementwise import TANH_ERROR
from faultgauge.export.entry import bank_of, step_of
from faultgauge.export.native import Native
from faultgauge.export.sources import header, step_source, table_source
from faultgauge.observers.eso import ExtendedStateObserver
from faultgauge.observers.observer import ObserverState
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.plant_file import read_plant_text
from faultgauge.simulation.integrators import step as integrate

# XLA and libm round exp, log and erf differently and add in another order; a filter forgets such
# errors, but the log-likelihood of a fault adds them up over a log: 1e-12 becomes 1e-10.
CLOSE = 1e-9  # of a signal's largest value
STRICT = (
    *("-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow"),
    *("-Wfloat-conversion", "-Werror"),
)


def agree(found, wanted, close=CLOSE):
    for name, said in wanted.items():
        if said.dtype.kind != "f":
            np.testing.assert_array_equal(found[name], said, err_msg=name)
            continue
        there = np.isfinite(said)
        np.testing.assert_array_equal(np.isfinite(found[name]), there, err_msg=name)
        scale = np.abs(said[there]).max(initial=0.0)
        off = np.abs(found[name] - said)[there].max(initial=0.0)
        assert off <= close * max(scale, 1e-9), (name, off, scale)


@pytest.fixture(scope="module")
def wheel():
    """A plant with a network, whose step has everything."""
    model = calibrated("reaction_wheel_network")
    return model, step_of(bank_of(model))


@pytest.fixture(scope="module")
def printed(wheel):
    return print_step(wheel[1], "wheel")


@pytest.fixture(scope="module")
def library(printed):
    """It, compiled once; of tests with a C compiler."""
    with Native(printed) as native:
        yield native


@pytest.fixture
def native(cc, library):
    """It, at its beginning."""
    library.begin()
    return library


def test_the_wheel_says_what_python_says(native, wheel):
    model, step = wheel
    samples = log_of(model, 3000, missing=0.05)
    agree(native.run(samples), walked(step, samples))


def test_a_fault_in_the_examples_is_found_and_named(native, wheel):
    """The second half of them has the fault."""
    said = native.run(wheel[1].examples(1000, np.random.default_rng(1)))
    assert said["p_friction"][450] < 0.1
    assert said["p_friction"][-1] > 0.9


@pytest.mark.study
def test_a_plant_that_comes_late_along_a_curve_says_what_python_says(cc):
    twin = '\n[faults.pump]\nenters = "input"\ntarget = "u"\nunit = "V"\n'
    model = calibrated(read_plant_text("tank") + twin, late=True)
    assert model.calibration.bank.alike  # no data tell a leak from that
    step = step_of(bank_of(model))
    samples = log_of(model, 1000, missing=0.05)
    with Native(print_step(step, "late")) as native:
        agree(native.run(samples), walked(step, samples))


@pytest.mark.study
@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("tank", 10_000), ("positioning_drive", 10_000), ("reaction_wheel_network", 10_000),
        ("hr12", 2000), ("four_tanks", 2000),
    ],
)  # fmt: skip
def test_other_plants_say_what_python_says(cc, source, count):
    model = calibrated(source)
    step = step_of(bank_of(model))
    samples = log_of(model, count, missing=0.05)
    with Native(print_step(step, "other")) as native:
        agree(native.run(samples), walked(step, samples))


# -- the state


def test_a_state_that_was_saved_goes_on_to_the_bit(native, wheel, printed):
    """Its working memory is not needed, and the code has no other (`nm`, below)."""
    samples = wheel[1].examples(400, np.random.default_rng(2))
    first, second = (
        {k: v[part] for k, v in samples.items()} for part in (slice(200), slice(200, 400))
    )
    native.run(first)
    saved = native.state.tobytes()[: printed.saved_bytes]
    whole = native.run(second)
    native.state.view("u1")[:] = 255
    native.state.view("u1")[: len(saved)] = np.frombuffer(saved, "u1")
    again = native.run(second)
    assert whole.tobytes() == again.tobytes()


def test_the_same_step_gives_the_same_bytes(wheel, printed):
    again = print_step(step_of(bank_of(calibrated("reaction_wheel_network"))), "wheel")
    for text in (header, step_source, table_source):
        assert text(again, "") == text(printed, "")


# -- single precision, and tanh


@pytest.mark.study
def test_single_precision_says_the_same_once_the_evidence_is_clear(cc, wheel):
    """Settled answers are good to 1e-6 and better. While evidence comes in, differences over small
    steps in 24 bits make a nat of it more or less: 0.25 where a probability is 0.5."""
    samples = wheel[1].examples(1000, np.random.default_rng(3))
    wanted = walked(wheel[1], samples)
    with Native(print_step(wheel[1], "wheel", single=True)) as native:
        assert native.input["t"] == np.float64  # a clock does not fit into 24 bits
        found = native.run(samples)
    for name in ("p_friction", "p_healthy", "f_friction", "x_h"):
        off = np.abs(found[name] - wanted[name]) / np.nanmax(np.abs(wanted[name]))
        assert np.nanmedian(off) < 1e-5, name
        assert np.nanmax(off) < 0.3, name
    assert np.mean(found["status"] != wanted["status"]) < 0.02


@pytest.mark.study
def test_a_clock_that_has_run_for_years_still_tells_milliseconds(cc, wheel):
    """float32 would count steps of 0.1 s as 0 from a month on. After 1e8 s the clock's own last bit
    is 1.5e-8 s, which makes other roundings in single precision: a thousandth of x_h's range."""
    samples = wheel[1].examples(300, np.random.default_rng(4))
    late = {**samples, "t": samples["t"] + 1e8}
    with Native(print_step(wheel[1], "wheel", single=True)) as native:
        now = native.run(samples)
        native.begin()
        then = native.run(late)
    near = 1e-3 * np.ptp(now["x_h"])
    np.testing.assert_allclose(then["x_h"], now["x_h"], rtol=0, atol=near)


def test_the_fast_tanh_is_as_close_as_it_says(cc):
    def one(state, given):
        return state, {"y": jnp.tanh(given["x"])}

    step = ExportedStep(one, (), {"x": jnp.zeros(())}, {})
    x = np.concatenate([np.linspace(-12, 12, 200_001), [1e300, -1e300, 0.0, 5e-324]])
    printed = print_step(step, "one", fast_tanh=True)
    assert " tanh(" not in printed.step + printed.helpers
    with Native(printed) as native:
        found = native.run({"x": x})["y"]
    assert np.abs(found - np.tanh(x)).max() < TANH_ERROR
    assert np.isnan(native_nan(printed))


def native_nan(printed):
    with Native(printed) as native:
        return native.run({"x": np.array([np.nan])})["y"][0]


# -- the C itself


@pytest.fixture(scope="module")
def folder(printed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("c")
    for name, text in ((".h", header), (".c", step_source), ("_tables.c", table_source)):
        (folder / f"wheel{name}").write_text(text(printed, ""))
    return folder


def compiled(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[:2000]
    return done.stdout


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_compilers_have_nothing_to_say(compiler, folder):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for name in ("wheel.c", "wheel_tables.c"):
        assert compiled([compiler, *STRICT, "-c", name, "-o", f"{name}.o"], folder) == ""


def test_nothing_is_called_but_mathematics(cc, folder):
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed (binutils), so symbols cannot be listed")
    for name in ("wheel", "wheel_tables"):
        compiled([cc, "-std=c99", "-O2", "-c", f"{name}.c", "-o", f"{name}.nm.o"], folder)
    listed = compiled(["nm", "-u", "wheel.nm.o"], folder)
    called = {line.split()[-1] for line in listed.splitlines()}
    called = {name for name in called if not name.startswith("wheel_c")}
    mathematics = {"exp", "expm1", "log", "log1p", "sqrt", "tanh", "erf", "erfc", "pow", "fabs"}
    assert called <= {*mathematics, "memcpy", "memmove", "memset", "_GLOBAL_OFFSET_TABLE_"}
    for name in ("wheel", "wheel_tables"):
        changing = [
            line
            for line in compiled(["nm", f"{name}.nm.o"], folder).splitlines()
            if line.split()[-2] in "BbDdCc"
        ]
        assert changing == []


# -- other steps than the bank's

TERMS = ["sin(x)", "tanh(x + u)", "-k*x", "abs(x)*u", "sqrt(abs(v) + 1)", "clip", "NN(x, v)", "x*v"]


@st.composite
def plant_files(draw):
    def rate():
        chosen = draw(st.lists(st.sampled_from(TERMS), min_size=1, max_size=3, unique=True))
        text = " + ".join(chosen).replace("clip", "min(max(v, -0.5), 0.5)")
        return text.replace("+ -", "- ")

    shape = draw(st.sampled_from(["", "\nodd = true", "\nzero_at_zero = true"]))
    first, second = rate(), rate()
    used = "NN(" in first + second
    network = f"[networks.NN]\nhidden = 3{shape}\n" if used else ""
    enters = draw(st.sampled_from(["state", "output", "gain"]))
    target = {"state": "v", "output": "y", "gain": "u"}[enters]
    return f"""
name = "drawn"
[states.x]
derivative = "{first}"
min = -3
max = 3
[states.v]
derivative = "({second} - v)/2"
[inputs.u]
min = -1
max = 1
[outputs.y]
value = "x + 0.1*u"
[parameters]
k = {{ value = 0.7 }}
{network}
[faults.fault]
enters = "{enters}"
target = "{target}"
"""


def observer(plant):
    count, outputs = len(plant.signals.states), len(plant.signals.outputs)
    gain = 0.2 * jnp.ones((count, outputs))
    return ExtendedStateObserver(plant, 0, 2, gain, 0.1 * jnp.ones(outputs), 0.5, jnp.asarray(0.1))


def alongside(plant):
    """A free run and an ESO beside each other."""
    eso = observer(plant)

    def step(state, given):
        free, x, f, last = state
        u, y, dt = (given[name] for name in ("u", "y", "dt"))
        free = integrate(plant, free, last, u, jnp.zeros(1), dt, 2)
        seen, info = eso.step(ObserverState(x, f, last), u, y, dt)
        return (free, *seen), {"free": free, "x": info.x, "f": info.f, "e": info.innovation}

    start = (jnp.zeros(2), jnp.zeros(2), jnp.zeros(()), jnp.zeros(1))
    sample = {"u": jnp.zeros(1), "y": jnp.zeros(1), "dt": jnp.zeros(())}
    return ExportedStep(step, start, sample, {})


# A plant's own states forget rounding, or stay within their limits: 1e-14 after 10,000 steps, where
# the evidence of a posterior adds it up. In single, 1e-5; a decade more for other compilers.
DRAWN, DRAWN_SINGLE = 1e-12, 1e-4
# Beyond, a drawn plant is on its way to infinity, and makes as much more of rounding.
RUNAWAY = 10.0


def compared(text, count=400, single=False):
    rng = np.random.default_rng(0)
    step = alongside(calibrated(text).plant)
    y = np.where(rng.random((count, 1)) < 0.1, np.nan, rng.standard_normal((count, 1)))
    u = rng.uniform(-2, 2, (count, 1))
    samples = {"u": u, "y": y, "dt": np.full(count, 0.05)}
    said = jax.jit(lambda: jax.lax.scan(step.step, step.state, samples)[1])()
    said = {name: np.asarray(wanted) for name, wanted in said.items()}
    rows = np.concatenate([each.reshape(count, -1) for each in said.values()], axis=1)
    tame = np.logical_and.accumulate(np.all(np.abs(rows) < RUNAWAY, axis=1))
    assert tame[0]
    # an unstable plant makes as much more of the rounding of float as of its own states
    for precision in (False, True) if single and tame.all() else (False,):
        with Native(print_step(step, "drawn", single=precision)) as native:
            found = native.run(samples)
        for name, wanted in said.items():
            off = np.abs(found[name].reshape(wanted.shape)[tame] - wanted[tame]).max()
            close = DRAWN_SINGLE if precision else DRAWN
            assert off <= close * max(np.abs(wanted[tame]).max(), 1e-9), name
    return bool(tame.all())


@settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(plant_files())
def test_drawn_plants_and_their_observers_say_what_python_says(cc, text):
    compared(text)


@pytest.mark.study
def test_two_hundred_drawn_plants_say_what_python_says(cc, capsys):
    """Over 10,000 steps, in single those that stay where they are."""
    stayed = {}

    @settings(max_examples=250, deadline=None, database=None, derandomize=True,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(plant_files())
    def each(text):
        if text not in stayed:
            stayed[text] = compared(text, 10_000, single=True)

    each()
    with capsys.disabled():
        print(f"\n{len(stayed)} plant files, {sum(stayed.values())} of them within {RUNAWAY:g}")
    assert len(stayed) >= 200


def test_a_drawn_network_is_not_zero():
    """Else the tests above would say nothing of networks."""
    plant = calibrated("reaction_wheel_network").plant
    assert all(np.any(n.weights_out != 0) for n in plant.networks.values())
    assert not np.any(load_plant("reaction_wheel_network").networks["NN1"].weights_out)
