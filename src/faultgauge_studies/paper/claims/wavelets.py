"""Wavelet post-processing of the residual where the time domain does not separate (section 4.1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.reporting.report import Section, Table
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.claims.wavelets_drawn import (
    example_figure,
    level_figure,
    matrix_figure,
    size_figure,
)
from faultgauge_studies.paper.claims.wavelets_faults import (
    CASES,
    KINDS,
    ORDER,
    SAMPLES,
    SINGLE_OR_MULTIPLE,
    residuals_of,
)
from faultgauge_studies.paper.claims.wavelets_features import (
    FEATURES,
    SETS,
    classify,
    confusion,
    energy_map,
    learn_classes,
    wilson,
)
from faultgauge_studies.paper.learning import rms
from faultgauge_studies.paper.tables import Results, span

__all__ = ["measure", "scored", "section", "verdict"]

TITLES = {
    "order": "same values",
    "natural": "own values",
    "channel": "friction or sensor",
    "size": "tone or double",
    "size_alone": "… alone in r",
}
SIZE = 0.01  # N*m RMS: a third of the wheel's Coulomb friction
SIZES = (1e-4, 3e-4, 1e-3, 3e-3, SIZE)  # across f(t), whose RMS is 4.75e-4
LEARNED, JUDGED = 40, 40  # runs of every kind
RUNS = LEARNED + JUDGED
STREAM = 43  # of random numbers
DISCERNIBLE = 0.9  # of all runs right, for "sufficiently discernible": one name in ten may err
SEEN = {"RMS": "mN·m", "peak": "mN·m", "crest": "", "kurtosis": ""}


def scored(
    x: Float[np.ndarray, "kinds runs features"], kinds: Sequence[str]
) -> tuple[dict[str, float], Float[np.ndarray, "classes classes"]]:
    """Learned on the first 40 runs of each of `kinds`, judged on the others: the share that is
    right with its 95 % interval, and the confusion matrix in shares of each true class."""
    chosen = x[[list(KINDS).index(kind) for kind in kinds]]
    classes, runs, features = chosen.shape
    k = np.repeat(np.arange(classes), LEARNED)
    model = learn_classes(chosen[:, :LEARNED].reshape(-1, features), k)
    true = np.repeat(np.arange(classes), runs - LEARNED)
    found = classify(model, chosen[:, LEARNED:].reshape(-1, features))
    counts = confusion(true, found, classes)
    right = int(np.trace(counts))
    low, high = wilson(right, len(true))
    shares = counts / counts.sum(axis=1, keepdims=True)
    return {"right": right / len(true), "low": low, "high": high}, shares


def _features(
    r: Float[np.ndarray, "kinds runs samples"],
) -> dict[str, Float[np.ndarray, "kinds runs features"]]:
    flat = r.reshape(-1, r.shape[2])
    return {name: f(flat).reshape(*r.shape[:2], -1) for name, f in FEATURES.items()}


def measure(bench: Bench) -> tuple[dict[str, Any], Traces]:
    """Every case by every set of features, and the first case for faults of other sizes."""

    def flown(size: float, matched: bool = True) -> Float[np.ndarray, "kinds runs samples"]:
        rng = np.random.default_rng([bench.seed, STREAM])
        reference = bench.learned.model.plant
        return residuals_of(bench.wheel, reference, bench.inner, size, RUNS, rng, matched)

    by_size = {size: flown(size) for size in SIZES}
    features = {size: _features(r) for size, r in by_size.items()}
    rng = np.random.default_rng([bench.seed, STREAM])
    alone = residuals_of(bench.wheel, bench.wheel, (), SIZE, RUNS, rng)
    given = dict.fromkeys(CASES, features[SIZE])
    given["natural"] = _features(flown(SIZE, matched=False))
    given["size_alone"] = _features(alone)  # the true wheel as reference, and no f(t)
    each = {
        case: {name: scored(given[case][name], kinds) for name in SETS}
        for case, kinds in CASES.items()
    }
    found = {name: shares for name, (_, shares) in each["order"].items()}
    paired = [ORDER.index(kind) for kind in SINGLE_OR_MULTIPLE]
    figures = {
        "cases": {
            case: {name: score for name, (score, _) in one.items()} for case, one in each.items()
        },
        "confusion": {
            name: {
                t: dict(zip(ORDER, map(float, row), strict=True))
                for t, row in zip(ORDER, shares, strict=True)
            }
            for name, shares in found.items()
        },
        "single_or_multiple": {
            name: float(np.diag(shares)[paired].mean()) for name, shares in found.items()
        },
        "by_size": {
            f"{size:g}": {name: scored(x[name], ORDER)[0]["right"] for name in SETS}
            for size, x in features.items()
        },
        "rms_f": _rms_f(bench),
        "values": _values(features[SIZE]["time"]),
    }
    return {"wavelets": figures}, _traces(by_size[SIZE])


def _rms_f(bench: Bench) -> float:
    t = PERIOD * np.arange(SAMPLES)
    return rms(np.sum([each.profile.sizes(t) for each in bench.inner], axis=0))


def _values(
    x: Float[np.ndarray, "kinds runs features"],
) -> dict[str, dict[str, dict[str, float]]]:
    """What of the time domain is to be the same for every kind: 10, 50 and 90 % of the runs."""
    seen = np.stack([1e3 * np.exp(x[..., 0]), 1e3 * np.exp(x[..., 1]), x[..., 3], x[..., 4]])
    percent = np.percentile(seen, [10, 50, 90], axis=2)
    return {
        kind: {
            name: {f"p{p}": float(percent[i, n, k]) for i, p in enumerate((10, 50, 90))}
            for n, name in enumerate(SEEN)
        }
        for k, kind in enumerate(ORDER)
    }


def _traces(r: Float[np.ndarray, "kinds runs samples"]) -> Traces:
    """The first judged run of each kind, its energy map, and the mean share of each level."""
    traces: Traces = {"wavelet_residuals": {"t": PERIOD * np.arange(SAMPLES)}}
    maps, levels = dict[str, Any](), dict[str, Any]()
    for kind in ORDER:
        energy = energy_map(r[list(KINDS).index(kind), LEARNED:])
        share = energy / energy.sum(axis=(1, 2), keepdims=True)
        maps[kind], levels[kind] = share[0], share.sum(axis=2).mean(axis=0)
    first = {kind: r[list(KINDS).index(kind), LEARNED] for kind in ORDER}
    traces["wavelet_residuals"] = {**traces["wavelet_residuals"], **first}
    return {**traces, "wavelet_maps": maps, "wavelet_levels": levels}


def section(results: Results, traces: Traces) -> Section:
    """The second half of the discussion in 4.1, its verdict and what it rests on."""
    found = results["wavelets"]
    return Section(
        "Wavelets where the time domain does not separate",
        (
            "The paper: “If this difference is not obvious in the time domain, a time-frequency "
            "signal-processing tool, such as wavelet analysis, is often used to post-process the "
            "GBNNM residual to make this difference sufficiently discernible.” It shows no case, "
            "so here is a hard one: six faults of the wheel's friction that are made of the same "
            "values, up to a drawn size, in another order of time. Mean, RMS, peak, crest and "
            "kurtosis of the fault are then the same by construction; amplitude, phase, onset and "
            "the wheel's path are drawn for every run. Three of them set single against multiple "
            "failure: a bearing's tone, the lubricant's wander, and both at once. The residual is "
            "that of the learned plant at the "
            f"measured momentum. The same classifier, the nearest class mean by "
            f"Mahalanobis' distance, learns from {LEARNED} runs of each kind and is judged on "
            f"{JUDGED} others, on four sets of features: time domain (mean, RMS, peak, crest, "
            "kurtosis, slope), energy shares of seven bands by Fourier transform, the same in "
            "eight windows with the evolution of the energy, and the same by wavelets (Daubechies "
            "4, six levels).",
            verdict(results).found,
            _limits(found),
        ),
        (_case_table(found), _value_table(found)),
        (
            example_figure(traces),
            level_figure(traces),
            matrix_figure(found),
            size_figure(found),
        ),
    )


def verdict(results: Results) -> Verdict:
    found = results["wavelets"]
    order, pair = found["cases"]["order"], found["single_or_multiple"]
    time, wavelet, windowed = (order[name] for name in ("time", "wavelet", "windowed"))
    blind = time["high"]["max"] < DISCERNIBLE
    better = wavelet["low"]["min"] > time["high"]["max"]
    enough = wavelet["right"]["min"] >= DISCERNIBLE
    if not blind:
        standing = "is not tested: the time domain separates these faults already"
    elif better and enough:
        standing = "holds for these faults"
    elif better:
        standing = f"holds in part: wavelets help, but not to {DISCERNIBLE:.0%} in every seed"
    else:
        standing = "does not hold for these faults"
    peer = windowed["high"]["median"] >= wavelet["low"]["median"]
    other = "do as well, so that it takes time and frequency, not wavelets" if peer else "do worse"
    return Verdict(
        "Wavelets tell faults apart where the time domain does not (4.1)",
        f"It {standing}. Right are {span(time['right'], '.0%')} of the runs by the time "
        f"domain (1 in {len(ORDER)} by chance) and {span(wavelet['right'], '.0%')} by wavelets; "
        f"95 % intervals in the median seed {_interval(time)} and {_interval(wavelet)}. Of tone, "
        f"wander and both at once, single and multiple failures, {pair['time']['median']:.0%} and "
        f"{pair['wavelet']['median']:.0%}. Fourier transforms of the whole record reach "
        f"{order['spectrum']['right']['median']:.0%}: they see which frequencies there are, not "
        f"when. Those in windows reach {windowed['right']['median']:.0%} and {other}.",
        blind and better and enough,
    )


def _limits(found: Results) -> str:
    """Where wavelets do not help, from the numbers."""
    cases = found["cases"]
    natural, channel, alone = (cases[case] for case in ("natural", "channel", "size_alone"))
    gain = natural["wavelet"]["right"]["median"] - natural["time"]["right"]["median"]
    low, high = (channel["wavelet"][end]["median"] for end in ("low", "high"))
    chance = "no better than chance" if low <= 0.5 <= high else "better than chance"
    less = alone["wavelet"]["high"]["median"] < alone["time"]["low"]["median"]
    return (
        "Other cases. Noise in the friction and the same noise in the torque sensor leave one and "
        f"the same residual, and wavelets are right in {span(channel['wavelet']['right'], '.0%')},"
        f" {chance}: no processing brings back what the residual does not hold. A tone and one "
        f"twice as large are told in {span(cases['size']['time']['right'], '.0%')} by the time "
        f"domain and in {span(cases['size']['wavelet']['right'], '.0%')} by energy shares, which "
        "are free of size but for what else the residual holds, f(t) and the model's error; where "
        "the fault stands alone in it (the true wheel as reference, no f(t)) in "
        f"{span(alone['time']['right'], '.0%')} and {span(alone['wavelet']['right'], '.0%')}: "
        f"there wavelets are {'worse' if less else 'not worse'}. With values of their own instead "
        "of the same ones, the six faults are told by the time domain in "
        f"{span(natural['time']['right'], '.0%')}, and wavelets change that by {100 * gain:+.0f} "
        "points."
    )


def _interval(score: Results) -> str:
    return f"{score['low']['median']:.0%} to {score['high']['median']:.0%}"


def _case_table(found: Results) -> Table:
    rows = tuple(
        (
            TITLES[case],
            f"{1 / len(kinds):.0%}",
            *(
                f"{found['cases'][case][name]['right']['median']:.0%} "
                f"({_interval(found['cases'][case][name])})"
                for name in SETS
            ),
        )
        for case, kinds in CASES.items()
    )
    return Table(
        ("faults", "chance", *SETS.values()),
        rows,
        f"Runs judged right at {SIZE:g} N·m RMS in the median seed (its 95 % interval, Wilson). "
        "The six faults of the same values, and with values of their own; noise in friction or in "
        "the torque sensor; a tone or one twice as large, also where the fault is alone in the "
        "residual.",
    )


def _range(percent: Results) -> str:
    low, middle, high = (percent[p]["median"] for p in ("p10", "p50", "p90"))
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def _value_table(found: Results) -> Table:
    rows = tuple(
        (kind, *(_range(row[name]) for name in SEEN)) for kind, row in found["values"].items()
    )
    header = (f"{name} ({unit})" if unit else name for name, unit in SEEN.items())
    return Table(
        ("fault", *header), rows, "Residuals of the first case: median (10 to 90 % of the runs)."
    )
