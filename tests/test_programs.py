"""Programs that are kept answer as those that are compiled anew, and only where nothing changed."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import faultgauge as fg
from faultgauge import programs
from faultgauge.programs import program
from faultgauge.simulation.free_run import Trajectory, simulate
from tanks import PLANT


class Own(eqx.Module):
    """What a user writes: nothing tells when it changes."""

    gain: float = eqx.field(static=True)

    def of(self, x: Array) -> Array:
        return self.gain * x


def scaled(x: Any, by: Any) -> dict[str, Any]:
    return {"x": by * x, "what": ("by", by if isinstance(by, float) else None), "rows": x.shape[0]}


def applied(own: Own, x: Any) -> Array:
    return own.of(x)


def labelled(x: Any, label: tuple[str, str]) -> dict[str, Any]:
    return {"x": 2 * x, "label": label}


def factor(a: Any) -> Array:
    return jnp.linalg.cholesky(a)


def called(x: Any) -> Array:
    return jax.pure_callback(np.cos, jax.ShapeDtypeStruct(x.shape, x.dtype), x)


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FAULTGAUGE_PROGRAMS", str(tmp_path))
    return tmp_path


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.program"))


def run(flow: Any) -> Trajectory:
    """A tank, by `simulate` as `flow` has it."""
    plant = fg.plant(PLANT)
    u = np.linspace(0.1, 0.5, 8)[:, None]
    return flow(plant, jnp.full(1, 0.7), jnp.asarray(u), jnp.full(8, 0.5), jnp.zeros((8, 1)), 2)


def test_what_is_loaded_says_the_same_to_the_bit(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = run(program(simulate))
    assert len(files(kept)) == 1
    monkeypatch.setattr(programs._Program, "_made", None)  # from here on nothing may be traced
    loaded = run(program(simulate))
    monkeypatch.delenv("FAULTGAUGE_PROGRAMS")
    usual = run(eqx.filter_jit(simulate))
    for one, two, three in zip(made, loaded, usual, strict=True):
        assert np.array_equal(one, two)
        assert np.array_equal(one, three)


def test_what_is_no_array_is_part_of_the_program_and_of_its_answer(kept: Path) -> None:
    x = np.arange(3.0)
    for by in (2.0, 3.0, np.asarray(4.0)):
        for anew in (program(scaled), program(scaled)):
            found = anew(x, by)
            assert np.array_equal(found["x"], by * x)
            assert found["rows"] == 3
            assert found["what"] == ("by", by if isinstance(by, float) else None)
    assert len(files(kept)) == 3  # one for each of the numbers, one for any array
    program(scaled)(x, 2)
    program(scaled)(x[:2], 2.0)
    program(scaled)(x.astype(np.float32), 2.0)
    assert len(files(kept)) == 6


def test_other_code_is_another_program(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(scaled)(np.ones(2), 2.0)
    monkeypatch.setattr(programs, "_files", lambda: ("another file",))
    program(scaled)(np.ones(2), 2.0)
    monkeypatch.setenv("XLA_FLAGS", "--xla_another=1")
    program(scaled)(np.ones(2), 2.0)
    monkeypatch.setattr(programs, "_machine", lambda: ("another processor",))
    program(scaled)(np.ones(2), 2.0)
    assert len(files(kept)) == 4


def test_code_of_users_is_not_kept(kept: Path) -> None:
    assert np.array_equal(program(applied)(Own(3.0), np.ones(2)), [3.0, 3.0])
    assert not files(kept)


def test_a_program_that_calls_python_is_not_kept(kept: Path) -> None:
    assert np.array_equal(program(called)(np.zeros(2)), [1.0, 1.0])
    assert not files(kept)


def test_inside_another_program_nothing_is_kept(kept: Path) -> None:
    inner = program(scaled)
    assert np.array_equal(jax.jit(lambda x: inner(x, 2.0)["x"])(np.ones(2)), [2.0, 2.0])
    assert not files(kept)


@pytest.mark.parametrize("damage", [lambda b: b[:-1], lambda b: b"", lambda b: b[:40] + b[41:]])
def test_a_damaged_file_is_made_anew(kept: Path, damage: Any) -> None:
    program(scaled)(np.ones(2), 2.0)
    (file,) = files(kept)
    file.write_bytes(damage(file.read_bytes()))
    assert programs._read(file) is None
    assert np.array_equal(program(scaled)(np.ones(2), 2.0)["x"], [2.0, 2.0])
    assert programs._read(file) is not None


def test_what_nobody_asked_for_in_a_month_goes(kept: Path) -> None:
    program(scaled)(np.ones(2), 2.0)
    program(scaled)(np.ones(2), 3.0)
    old, used = files(kept)
    for each in (old, used):
        os.utime(each, (0, 0))
    assert programs._read(used) is not None
    program(scaled)(np.ones(2), 4.0)
    assert used in files(kept)
    assert old not in files(kept)


def test_where_nothing_can_be_written_it_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("FAULTGAUGE_PROGRAMS", str(blocked))
    assert np.array_equal(program(scaled)(np.ones(2), 2.0)["x"], [2.0, 2.0])


def test_lapack_is_there_for_what_is_loaded_in_another_process(kept: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import numpy as np; from faultgauge import programs; import test_programs\n"
        "if sys.argv[2:]: programs._Program._made = None\n"
        "print(programs.program(test_programs.factor)(np.array([[4.0, 2.0], [2.0, 3.0]])))"
    )
    call = [sys.executable, "-c", code, str(Path(__file__).parent)]
    for more in ([], ["load"]):
        found = subprocess.run([*call, *more], capture_output=True, text=True)
        assert "1.41421356" in found.stdout, found.stderr  # sqrt(3 - 1)
    assert len(files(kept)) == 1


def test_what_is_equal_is_one_program(kept: Path) -> None:
    words = ["".join(["a", "b"]) for _ in range(3)]  # three objects
    program(labelled)(np.ones(2), (words[0], words[0]))
    program(labelled)(np.ones(2), (words[1], words[2]))
    assert len(files(kept)) == 1


def test_of_threads_that_ask_for_one_program_one_makes_it(kept: Path) -> None:
    made = []

    def doubled(x: Any) -> Any:
        made.append(x)
        time.sleep(0.2)  # long enough for all to ask
        return 2 * x

    doubled.__qualname__ = "scaled"  # one of a module, as all that are kept
    shared = program(doubled)
    with ThreadPoolExecutor(4) as pool:
        told = list(pool.map(lambda k: float(shared(jnp.asarray(1.0 * k))), range(4)))
    assert told == [0.0, 2.0, 4.0, 6.0]
    assert len(made) == 1


def test_threads_that_make_programs_leave_the_settings_as_they_were(kept: Path) -> None:
    name = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.values[name]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda by: program(scaled)(np.ones(2), by)["x"], [1.0, 2.0, 3.0]))
    assert np.array_equal(found, [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    assert len(files(kept)) == 3
    assert jax.config.values[name] == before
