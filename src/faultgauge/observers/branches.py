"""What is known of branches: each is a filter with the faults of one set in its state, beside which
the signatures of one more change of every fault run, for some onsets of it."""

from typing import NamedTuple

from jaxtyping import Array, Float, Int

from faultgauge.observers.divided_difference import Belief

__all__ = [
    "NEVER",
    "SCALES",
    "BranchInfo",
    "BranchState",
    "Changes",
    "Lanes",
    "Prior",
    "Probe",
    "Sums",
]

SCALES = (1.0, 0.15, 0.02)  # of a size's widest prior
NEVER = -1e30  # the logarithm of no probability: finite, so that sums stay numbers


class Prior(NamedTuple):
    """What is known before: `size` of a step and of a growth rate (widest standard deviation),
    `low` and `high` limits of the fault and by how much beyond each its size may seem to lie, as
    the model's answers are off (`soft`, standard deviations), `onset` and `recovery` rates [1/s],
    `common` share of onsets that bring a second fault, `unknown` rate [1/s]; `first`, ln of the
    probability that a fault is there when a log begins; `changed`, how much likelier than onsets
    changes are."""

    size: Float[Array, "kinds"]
    low: Float[Array, "kinds"]
    high: Float[Array, "kinds"]
    soft: Float[Array, "two kinds"]
    onset: Float[Array, "kinds"]
    recovery: Float[Array, "faults"]
    common: Float[Array, ""]
    unknown: Float[Array, ""]
    first: Float[Array, "kinds"]
    changed: Float[Array, ""]


class Lanes(NamedTuple):
    """Signatures of a unit change of each kind at some onsets, beside every branch: `score` and
    `info` of its size, `gain` in ln L by each of `SCALES`; `sudden` and `sharp` are the score and
    the info of the first sample alone; `shared` scores and `J` are in the branch's own noise, and
    so tell what one change explains of another; `row` is where in `J` each stands, for as long as
    it is kept. `mass` is ln of how likely each onset is before the data, and `went` the part of it
    (ln) for which what came may have gone there: none where that is a branch of its own."""

    eta: Float[Array, "branches n kinds onsets"]
    score: Float[Array, "branches kinds onsets"]
    info: Float[Array, "branches kinds onsets"]
    gain: Float[Array, "branches scales kinds onsets"]
    sudden: Float[Array, "branches kinds onsets"]
    sharp: Float[Array, "branches kinds onsets"]
    shared: Float[Array, "branches kinds onsets"]
    J: Float[Array, "branches lanes lanes"]
    row: Int[Array, "branches kinds onsets"]
    mass: Float[Array, "branches kinds onsets"]
    went: Float[Array, "branches kinds onsets"]
    onset: Float[Array, "branches kinds onsets"]


class Probe(NamedTuple):
    """What a fault of each direction (down, up) would have done to the leading branch since two
    onsets, and how clearly it would have shown; `age` [s] is that of the later onset."""

    eta: Float[Array, "n faults two onsets"]
    J: Float[Array, "faults two onsets"]
    age: Float[Array, "faults"]


class BranchState(NamedTuple):
    """A checkpoint. Branches come first, unknown ones behind; `which` set each is, `weight` ln of
    its posterior (up to a constant), `since` when each fault of it began (mean and variance),
    `ever` whether it has held each fault at any time, and how large it clearly was at `most`,
    `sudden` and `sharp` the score and the info of each in its first sample, `told` what had been
    told of it (ln L) before another that acts on the plant came beside it, `quick` the info of a
    change in the sample after it, `begun` when the filter began [s]; `nis` the sum of its squared
    innovations in standard deviations, each fading within one of the windows."""

    belief: Belief
    weight: Float[Array, "filters"]
    which: Int[Array, "filters"]
    since: Float[Array, "filters faults two"]
    ever: Float[Array, "filters faults"]
    most: Float[Array, "filters faults"]
    sudden: Float[Array, "filters faults"]
    sharp: Float[Array, "filters faults"]
    told: Float[Array, "filters faults"]
    quick: Float[Array, "faults"]
    begun: Float[Array, "filters"]
    nis: Float[Array, "filters windows"]
    lanes: Lanes
    probe: Probe
    u: Float[Array, "inputs"]
    t: Float[Array, ""]


class BranchInfo(NamedTuple):
    """What one sample leaves: the posterior of every set and, last, of the unknown; mean and
    standard deviation of every fault in each set; the states; how clearly each fault would have
    shown, downwards and upwards; how long ago it began, if it is there (mean and standard deviation
    [s]), the probability that it is or was there, and how large it clearly was at most; the score
    and the info of every fault in each set in its first sample, what had been told of it before
    another came beside it, and the info of a change of each in the sample after it; the posterior
    of every unknown filter; how badly the likeliest branch fits lately (`nis`, 1 where all errors
    are as large as they should be), in the mean of each window, and whether it has a fault."""

    p: Float[Array, "sets"]
    f: Float[Array, "sets faults"]
    sd: Float[Array, "sets faults"]
    x: Float[Array, "states"]
    seen: Float[Array, "faults two"]
    onset: Float[Array, "faults two"]
    ever: Float[Array, "faults"]
    most: Float[Array, "faults"]
    sudden: Float[Array, "sets faults"]
    sharp: Float[Array, "sets faults"]
    told: Float[Array, "sets faults"]
    quick: Float[Array, "faults"]
    alien: Float[Array, "unknown"]
    nis: Float[Array, "windows"]
    faulty: Float[Array, ""]


class Changes(NamedTuple):
    """Every change that a branch may have had: `ell`, ln of its prior times its likelihood; of each
    kind the largest of these, `top`, ln of their sum, `total`, and the `share` of each onset in
    that; the size and the variance of that. First steps and growths, then recoveries of the
    faults."""

    ell: Float[Array, "branches kinds onsets"]
    top: Float[Array, "branches kinds"]
    total: Float[Array, "branches kinds"]
    share: Float[Array, "branches kinds onsets"]
    f: Float[Array, "branches kinds onsets"]
    V: Float[Array, "branches kinds onsets"]


class Sums(NamedTuple):
    """Over the changes that a branch may have had, by how likely they are: how likely each set is;
    of the likely onsets alone that again, and times a fault's size, its square, the score and the
    info of its first sample, and what had been told of it; the states; how likely each fault is
    there, times when it began, and its square; how likely each has been."""

    p: Float[Array, "branches sets"]
    held: Float[Array, "branches sets"]
    mean: Float[Array, "branches sets faults"]
    square: Float[Array, "branches sets faults"]
    sudden: Float[Array, "branches sets faults"]
    sharp: Float[Array, "branches sets faults"]
    told: Float[Array, "branches sets faults"]
    x: Float[Array, "branches states"]
    past: Float[Array, "branches faults three"]
    ever: Float[Array, "branches faults"]
