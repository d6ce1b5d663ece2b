"""`estimate --engine c`: the walk along a log by the printed step, compiled here.

It is the same walk: what is printed is `Watch.step`, and its rows go where Python's go.
"""

from collections import OrderedDict
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.detection.judged import arrays_of
from faultgauge.detection.watch import Row, Watch, WatchState
from faultgauge.export.compile import Step, print_step
from faultgauge.export.native import Native, needed_compiler
from faultgauge.telemetry import Run

__all__ = ["Engine"]

CHUNK = 65_536  # rows that are held twice: as the struct of C, and as arrays


class Engine:
    """Does what `Watch.along` does, in C; a compiled step is kept in the folder `cache` by the hash
    of its source. Raises `InputError` where there is no C compiler.

        decide_runs(model, runs, walk=Engine(cache))
    """

    def __init__(self, cache: Path) -> None:
        needed_compiler()
        self.cache = cache
        self._known: list[tuple[Watch, _Compiled]] = []

    def __call__(self, watch: Watch, state: WatchState, rows: Run) -> tuple[WatchState, Row]:
        """(the state after `rows`, what is said of them); NumPy arrays."""
        u, y = arrays_of(watch.signals, rows, slice(0, len(rows.t)))
        return self._compiled(watch).run(state, {"t": rows.t, "u": u, "y": y})

    def _compiled(self, watch: Watch) -> "_Compiled":
        """One for all runs that are alike but for their rows."""
        for known, compiled in self._known:
            if _alike(known, watch):
                return compiled
        self._known.append((watch, _Compiled(watch, self.cache)))
        return self._known[-1][1]


def _alike(one: Watch, other: Watch) -> bool:
    """Also where NaN stands for what is disabled."""
    (some, form), (more, forms) = jax.tree.flatten(one), jax.tree.flatten(other)
    return form == forms and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(some, more, strict=True)
    )


class _Compiled:
    """The compiled step of a `Watch`, whose outputs are all of a `Row`."""

    def __init__(self, watch: Watch, cache: Path) -> None:
        def step(state: WatchState, sample: dict[str, Any]) -> tuple[WatchState, Row]:
            return watch.step(state, sample["t"], sample["u"], sample["y"])

        inputs, outputs = len(watch.signals.input_names), len(watch.signals.output_names)
        lengths = OrderedDict(t=(), u=(inputs,), y=(outputs,))
        sample = OrderedDict((name, jnp.zeros(shape)) for name, shape in lengths.items())
        start = watch.init()
        leaves, self.form = jax.tree.flatten(jax.eval_shape(step, start, sample)[1])
        self.printed = print_step(Step(step, start, sample, {}, dict), "watch")
        self.dtypes = [each.dtype for each in leaves]
        self.native = Native(self.printed, kept=cache)

    def run(self, state: WatchState, samples: dict[str, np.ndarray]) -> tuple[WatchState, Row]:
        members, kept = self.printed.state, self.native.state
        leaves, form = jax.tree.flatten(state)
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
        return jax.tree.unflatten(form, after), jax.tree.unflatten(self.form, rows)
