"""What a refinement fits and what it validates on."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.simulation_error.drift import SlowWalk
from faultgauge.identification.simulation_error.records import (
    Piece,
    Record,
    cut_windows,
    output_scale,
    pieces_of,
)
from faultgauge.identification.simulation_error.window_fit import (
    Fitted,
    Ridge,
    Rows,
    WindowBatch,
    fit_starts,
    fit_windows,
    simulated,
)
from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Signals

__all__ = ["BUDGET", "FIRST_SIGMA", "Data", "prepare", "unseen_errors", "validation_error"]

SHORT, SHORT_SHARE, SHORT_MOST = (64, 512), 1 / 20, 16  # samples and number of short windows
# Longer runs are cut: what a plant does beside its model adds up along a window, and over a long
# one its slow drift is all that the fit sees.
LONGEST, LONG_WINDOW = 2048, 1024  # samples
LONGEST_WHOLE, LONG_PART = 25_000, 4096  # the same where a run has values of its own
BUDGET, MOST = 20_000, 100_000  # samples that a search goes through, and its best in the end
OUTLIER = 5.0  # standard deviations: errors beyond count as that where outliers are expected
FIRST_SIGMA = 0.1  # of the outputs' spread: errors expected of a first guess
LEAD = 500  # samples that set the start of a window that was not fitted
# Of the outputs' spread: a free run that is off by that much tells nothing, however far it is off.
LOST = 1.0
DIVERGED = 1e3  # the same for a fit, which is then no candidate
FEWEST = 25  # samples of a window


@dataclass
class Data:
    """Records to fit and to validate on, and windows cut from them."""

    signals: Signals
    records: list[Record]
    masks: list[Bool[np.ndarray, "_"]]
    substeps: int
    scale: Float[np.ndarray, "outputs"]
    guesses: list[Float[np.ndarray, "_ states"]]
    sd: Float[np.ndarray, "states"]
    robust: bool = False
    drift: SlowWalk = field(default_factory=lambda: SlowWalk.over(0, 1, 1))
    whole: list[Piece] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)  # those that are worked on
    alone: list[Piece] = field(default_factory=list)
    prior: float = 1.0  # samples that count as one, where a fleet's prior is to be believed

    def windows(
        self, pieces: Sequence[Piece], masks: Sequence[Bool[np.ndarray, "_"]] | None = None
    ) -> WindowBatch:
        return cut_windows(
            self.signals,
            self.records,
            pieces,
            self.masks if masks is None else masks,
            self.guesses,
            self.sd,
            self.substeps,
            self.scale,
            self.drift,
        )

    def fit(
        self,
        plant: GrayBoxPlant,
        unknowns: Unknowns,
        thetas: Float[np.ndarray, "starts unknowns"],
        *,
        pieces: Sequence[Piece] | None = None,
        after: Sequence[Fitted] = (),
        sigma: float,
        ridge: Ridge = 1.0,
        trials: int = 60,
        tolerance: float = 1e-4,
        claims: Rows | None = None,
    ) -> list[Fitted]:
        """`fit_windows` over the pieces that are worked on, or others.

        `after` are fits over the same pieces, one to a start: windows start where they did.
        """
        windows = self.windows(self.pieces if pieces is None else pieces)
        z = np.stack([self.starts(windows, each) for each in after]) if after else None
        found = fit_windows(
            plant,
            unknowns,
            thetas,
            windows,
            self.substeps,
            z=z,
            sigma=sigma,
            ridge=ridge,
            prior=self.prior,
            trials=trials,
            tolerance=tolerance,
            robust=self.robust,
            claims=claims,
        )
        return [_centred(plant, unknowns, each, windows) if each.usable else each for each in found]

    def afresh(self) -> "Data":
        """The same without the guesses of hidden states that fits have left."""
        initial = [state.initial for state in self.signals.states]
        guesses = [np.tile(np.array(initial, float), (len(each), 1)) for each in self.guesses]
        return replace(self, guesses=guesses)

    def fit_starts(
        self, plant: GrayBoxPlant, unknowns: Unknowns, theta: Float[np.ndarray, "unknowns"]
    ) -> Fitted:
        """Only the starts of the pieces that are worked on."""
        windows = self.windows(self.pieces)
        return fit_starts(
            plant, unknowns, theta, windows, self.substeps, sigma=FIRST_SIGMA, robust=self.robust
        )

    def with_held_out(self) -> "Data":
        """The same pieces, and what was held out of them to be fitted, too."""
        return replace(self, masks=[np.ones(len(mask), bool) for mask in self.masks])

    def split(self, length: int) -> list[Piece]:
        """Pieces of about `length` with samples to fit."""
        pieces = _from_fitted_samples(pieces_of(self.records, length), self.masks)
        return [piece for piece in pieces if self.fitted_samples(piece) >= FEWEST]

    def starts(self, windows: WindowBatch, fitted: Fitted) -> Float[np.ndarray, "windows local"]:
        """What is local to the windows, where a fit over such as begin alike found it."""
        states = windows.center.shape[1]
        x0 = (fitted.x[:, 0] - np.asarray(windows.center)) / np.asarray(windows.sd)
        z = np.concatenate([x0, fitted.z[:, states:]], axis=1)
        return self.drift.lengthened(z, fitted.x.shape[1], windows.dt.shape[1])

    def free_runs(self, fitted: Fitted) -> tuple[list[Piece], Float[np.ndarray, "runs local"]]:
        """(free runs over whole records, each from the start of a fitted window, what is local to
        the window); those of long records begin anew after `LONGEST_WHOLE` samples, or, where
        parameters drift, with every window."""
        starts = self.starts(self.windows(self.pieces), fitted)
        longest = 0 if self.drift.scale.size else LONGEST_WHOLE
        found, local = list[Piece](), list[Float[np.ndarray, "local"]]()
        for piece, own in zip(self.pieces, starts, strict=True):
            last = found[-1] if found else None
            if last is not None and last.record == piece.record:
                if piece.start - last.start < longest:
                    continue
                found[-1] = last._replace(stop=piece.start)
            found.append(Piece(piece.record, piece.start, len(self.masks[piece.record])))
            local.append(own)
        return found, np.stack(local)

    def lead_ins(self) -> tuple[list[Piece], list[Piece]]:
        """For pieces that were not fitted: samples that set their start, and those with the piece.

        A start is set on the samples just before; where there are none, on first samples.
        """
        first, whole = [], []
        for k, start, stop in self.alone:
            begin = max(0, start - LEAD)
            end = start if begin < start else start + min(LEAD, (stop - start) // 4)
            first.append(Piece(k, begin, end))
            whole.append(Piece(k, begin, stop))
        return first, whole

    def short(self) -> list[Piece]:
        longest = max(len(record.t) for record in self.records)
        length = int(np.clip(longest * SHORT_SHARE, *SHORT))
        pieces = [p for p in pieces_of(self.records, length) if self.fitted_samples(p)]
        kept = np.linspace(0, len(pieces) - 1, min(SHORT_MOST, len(pieces))).round().astype(int)
        return [pieces[k] for k in np.unique(kept)]

    def fitted_samples(self, piece: Piece) -> int:
        return int(np.sum(self.masks[piece.record][piece.start : piece.stop]))

    def reach(self, plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted) -> None:
        """Take the states of a fit as first guesses in between its windows, too: each goes on to
        the next one."""
        follows = [*self.pieces[1:], None]
        longer = [
            Piece(
                p.record,
                p.start,
                n.start if n is not None and n.record == p.record else len(self.masks[p.record]),
            )
            for p, n in zip(self.pieces, follows, strict=True)
        ]
        windows = self.windows(longer)
        x, _ = simulated(
            plant, unknowns, fitted.theta, self.starts(windows, fitted), windows, self.substeps
        )
        self.remember(longer, x)

    def remember(self, pieces: Sequence[Piece], x: Float[np.ndarray, "windows _ states"]) -> None:
        """Take the states of fitted windows as first guesses of hidden ones."""
        for (k, start, stop), path in zip(pieces, x, strict=True):
            path = path[: stop - start]
            if np.all(np.isfinite(path)):
                self.guesses[k][start:stop] = path


def prepare(
    signals: Signals,
    records: list[Record],
    masks: list[Bool[np.ndarray, "_"]],
    held: list[Record],
    substeps: int,
    robust: bool,
    unknowns: Unknowns,
) -> Data:
    """Windows of at most some thousand samples, or as long as runs where values per run ask for
    it."""
    initial = np.array([state.initial for state in signals.states])
    ranges = np.array([state.max - state.min for state in signals.states])
    for record in held:
        if len(record.t) < FEWEST:
            raise InputError(
                f"run {record.run!r} has {len(record.t)} samples in a row, too few to validate on; "
                f"a run needs {FEWEST} at least, so leave it out or give a longer one."
            )
    longest = max(len(record.t) for record in (*records, *held))
    whole_runs = bool(unknowns.varying)
    most, part = (LONGEST_WHOLE, LONG_PART) if whole_runs else (LONGEST, LONG_WINDOW)
    length = part if longest > most else longest
    data = Data(
        signals,
        [*records, *held],
        [*masks, *(np.zeros(len(record.t), bool) for record in held)],
        substeps,
        output_scale(records),
        [np.tile(initial, (len(record.t), 1)) for record in (*records, *held)],
        np.where(np.isfinite(ranges), ranges / 4, np.maximum(np.abs(initial), 1.0)),
        robust,
    )
    data.whole = data.split(length)
    alone = {k for k, mask in enumerate(data.masks) if not mask.any()}
    data.alone = [p for p in pieces_of(data.records, LONGEST_WHOLE) if p.record in alone]
    if not data.whole:
        longest = max(int(np.sum(mask)) for mask in masks)
        raise InputError(
            f"run {records[0].run!r}: {longest} samples are left to fit beside what is held out, "
            f"and simulation error needs {FEWEST} in a row at least; give a longer log."
        )
    data.whole = _some(data.whole, max(MOST, longest if longest <= most else 0))
    data.pieces = _some(data.whole, BUDGET) if longest > most else data.whole
    longest = max(piece.stop - piece.start for piece in data.whole)
    data.drift = SlowWalk.over(len(unknowns.slow), longest, len(data.whole))
    return data


def _centred(
    plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted, windows: WindowBatch
) -> Fitted:
    """The same fit with the common value of every varying parameter in the middle of the windows'
    own, the means along them: nothing but a weak prior tells the fit where it is, and new runs are
    looked for around it."""
    first, states = unknowns.weights(plant), windows.center.shape[1]
    theta, z, (lower, upper) = fitted.theta.copy(), fitted.z.copy(), unknowns.bounds(plant)
    walk = np.asarray(windows.walk)
    increments = z[:, states + len(unknowns.varying) :].reshape(len(z), *walk.shape[2:])
    drift = np.einsum("wnks,wks->wns", walk, increments)
    inside = np.asarray(windows.dt) > 0
    for j, k in enumerate(unknowns.varying):
        own = z[:, states + j].copy()
        if k in unknowns.slow:
            course = drift[..., unknowns.slow.index(k)]
            own += np.sum(course * inside, axis=1) / np.maximum(np.sum(inside, axis=1), 1)
        at = first + k
        moved = np.clip(theta[at] + np.mean(own), lower[at], upper[at]) - theta[at]
        theta[at] += moved
        z[:, states + j] -= moved
    return fitted._replace(theta=theta, z=z)


def _some(pieces: list[Piece], budget: int) -> list[Piece]:
    """Pieces spread evenly that make up `budget` samples; all of them where they fit into it."""
    total = sum(piece.stop - piece.start for piece in pieces)
    count = max(1, round(len(pieces) * min(1.0, budget / max(total, 1))))
    return [pieces[k] for k in np.linspace(0, len(pieces) - 1, count).round().astype(int)]


def _from_fitted_samples(
    pieces: list[Piece], masks: Sequence[Bool[np.ndarray, "_"]]
) -> list[Piece]:
    """Pieces that do not begin among samples left out: their start would not be known there."""
    starts = []
    for k, start, stop in pieces:
        fitted = np.flatnonzero(masks[k][start:stop])
        starts.append(start + int(fitted[0]) if start and fitted.size else start)
    moved = []
    for j, (k, _, stop) in enumerate(pieces):
        follows = j + 1 < len(pieces) and pieces[j + 1].record == k
        moved.append(Piece(k, starts[j], starts[j + 1] if follows else stop))
    return moved


def unseen_errors(
    data: Data, plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted
) -> Float[np.ndarray, "samples"]:
    """Free-run errors at all samples that were not fitted, as shares of the outputs' spread.

    Where a run was fitted in part it goes on from there, through all its samples: what is off by
    little adds up, and no window of a fit sees it. Runs of their own start from first samples.
    """
    found = []
    left = [~mask for mask in data.masks]
    runs, local = data.free_runs(fitted)
    windows = data.windows(runs, left)
    local = data.drift.lengthened(local, fitted.x.shape[1], windows.dt.shape[1])
    if np.any(windows.weight > 0):
        errors = simulated(plant, unknowns, fitted.theta, local, windows, data.substeps)[1]
        found.append(errors[windows.weight > 0])
    if data.alone:
        first, whole = data.lead_ins()
        rest = [mask.copy() for mask in left]
        for k, start, stop in first:
            rest[k][start:stop] = False
        starts = fit_starts(
            plant,
            unknowns,
            fitted.theta,
            data.windows(first, [np.ones(len(mask), bool) for mask in left]),
            data.substeps,
            sigma=expected_error(fitted),
            robust=data.robust,
        )
        windows = data.windows(whole, rest)
        local = data.drift.lengthened(starts.z, starts.x.shape[1], windows.dt.shape[1])
        errors = simulated(plant, unknowns, fitted.theta, local, windows, data.substeps)[1]
        found.append(errors[windows.weight > 0])
    return np.concatenate([np.zeros(0), *found])


def expected_error(fitted: Fitted) -> float:
    return float(np.clip(np.sqrt(fitted.mse), 1e-6, None))


def validation_error(data: Data, fitted: Fitted, errors: Float[np.ndarray, "samples"]) -> float:
    """RMS of `errors`; where `data` are robust, none counts for more than a few expected ones.

    Infinite where every sample is lost, or the fit itself.
    """
    if not fitted.mse < DIVERGED**2 or not errors.size:
        return np.inf
    bound = min(OUTLIER * expected_error(fitted), LOST) if data.robust else LOST
    error = float(np.sqrt(np.mean(np.fmin(np.abs(errors), bound) ** 2)))
    return error if error < bound else np.inf
