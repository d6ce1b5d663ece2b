"""`estimate --engine c`: the walk along a log by the printed step, compiled here.

It is the same walk: what is printed is `Watch.step`, and its rows go where Python's go.
"""

import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.detection.rows.prepared import Prepared
from faultgauge.detection.watch import Row, Watch, WatchState
from faultgauge.export.compile import ExportedStep, print_step
from faultgauge.export.kept import hash_of, kept
from faultgauge.export.native import Native, needed_compiler

__all__ = ["Engine"]

_State: TypeAlias = tuple[Watch, WatchState]

CHUNK = 65_536  # rows that are held twice: as the struct of C, and as arrays


class Engine:
    """Does what `Watch.along` does, in C. The folder `cache` keeps what was printed by the hash of
    the watch but for its numbers, and the compiled step by that of its source. Raises `InputError`
    where there is no C compiler.

        decide_runs(model, runs, walk=Engine(cache))
    """

    def __init__(self, cache: Path) -> None:
        needed_compiler()
        self.cache = cache
        self._known: list[tuple[Watch, _Compiled]] = []

    def __reduce__(self) -> tuple[type["Engine"], tuple[Path]]:
        return Engine, (self.cache,)

    def __call__(self, watch: Watch, state: WatchState, rows: Prepared) -> tuple[WatchState, Row]:
        """(the state after `rows`, what is said of them); NumPy arrays."""
        samples = {"t": rows.run.t, "u": rows.u, "y": rows.y}
        return self._compiled(watch).run(watch, state, samples)

    def _compiled(self, watch: Watch) -> "_Compiled":
        """One for all watches that are alike but for their numbers."""
        for known, compiled in self._known:
            if _alike(known, watch):
                return compiled
        self._known.append((watch, _Compiled(watch, self.cache)))
        return self._known[-1][1]


def _alike(one: Watch, other: Watch) -> bool:
    some, more = (eqx.partition(each, eqx.is_inexact_array) for each in (one, other))
    shapes = [[leaf.shape for leaf in jax.tree.leaves(each[0])] for each in (some, more)]
    return shapes[0] == shapes[1] and bool(eqx.tree_equal(some[1], more[1]))


class _Compiled:
    """The compiled step of a `Watch`, whose outputs are all of a `Row`.

    Its numbers are no constants but come in with the state, as they do for JAX: steps of logs
    differ by rounding, and would else be compiled one by one.
    """

    def __init__(self, watch: Watch, cache: Path) -> None:
        numbers, rest = eqx.partition(watch, eqx.is_inexact_array)

        def step(state: _State, sample: dict[str, Any]) -> tuple[_State, Row]:
            numbers, before = state
            own = eqx.combine(numbers, rest)
            after, row = own.step(before, sample["t"], sample["u"], sample["y"])
            return (numbers, after), row

        inputs, outputs = len(watch.signals.input_names), len(watch.signals.output_names)
        lengths = OrderedDict(t=(), u=(inputs,), y=(outputs,))
        sample = OrderedDict((name, jnp.zeros(shape)) for name, shape in lengths.items())
        # all that is printed of it is its shape: `run` fills it
        start = jax.tree.map(np.zeros_like, (numbers, watch.init()))

        def made() -> bytes:
            row = jax.tree.map(lambda each: each.dtype, jax.eval_shape(step, start, sample)[1])
            return pickle.dumps(
                (print_step(ExportedStep(step, start, sample, {}), "watch", inline=True), row)
            )

        shapes = [leaf.shape for leaf in jax.tree.leaves(start)]
        known = hash_of(rest, shapes)
        data = made() if known is None else kept(cache / f"{known}.step", made)
        # beside it lie the libraries that are run: it is as much trusted as they are
        self.printed, row = pickle.loads(data)
        self.dtypes, self.form = jax.tree.flatten(row)
        self.native = Native(self.printed, cache=cache)

    def run(
        self, watch: Watch, state: WatchState, samples: dict[str, np.ndarray]
    ) -> tuple[WatchState, Row]:
        members, kept = self.printed.state, self.native.state
        leaves, form = jax.tree.flatten((eqx.filter(watch, eqx.is_inexact_array), state))
        for each, leaf in zip(members, leaves, strict=True):
            if each.size:
                kept[each.name] = np.asarray(leaf).reshape(kept[each.name].shape)
        total = len(samples["t"])
        rows = [
            np.zeros((total, *each.shape), dtype)
            for each, dtype in zip(self.printed.outputs, self.dtypes, strict=True)
        ]
        for first in range(0, total, CHUNK):
            part = slice(first, first + CHUNK)
            said = self.native.run({name: values[part] for name, values in samples.items()})
            for each, row in zip(self.printed.outputs, rows, strict=True):
                if each.size:
                    row[part] = said[each.name].reshape(row[part].shape)
        after = [
            kept[each.name].reshape(each.shape).copy() if each.size else np.asarray(leaf)
            for each, leaf in zip(members, leaves, strict=True)
        ]
        return jax.tree.unflatten(form, after)[1], jax.tree.unflatten(self.form, rows)
