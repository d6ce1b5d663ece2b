"""Energies by Parseval, classes and intervals by hand, faults by what they must have in common."""

import numpy as np
import pytest
from scipy.stats import binomtest

from faultgauge.plants.gray_box import load_plant
from faultgauge_studies.paper.claims import wavelets
from faultgauge_studies.paper.claims.wavelets_faults import (
    CASES,
    KINDS,
    ORDER,
    SAMPLES,
    fault,
    reordered,
    residuals_of,
)
from faultgauge_studies.paper.claims.wavelets_features import (
    BANDS,
    FEATURES,
    PARTS,
    SETS,
    classify,
    confusion,
    energy_map,
    fourier_map,
    learn_classes,
    map_features,
    time_features,
    wilson,
)

PERIOD = 0.25  # s


@pytest.fixture
def records():
    return np.random.default_rng(3).standard_normal((5, SAMPLES))


@pytest.mark.parametrize("transform", [energy_map, lambda r: fourier_map(r, PARTS)])
def test_the_energies_sum_to_that_of_the_record(records, transform):
    """Parseval; db4's coefficients are tabulated to 1e-12 or so, six levels."""
    found = transform(records)
    assert found.shape == (5, BANDS, PARTS)
    np.testing.assert_allclose(found.sum(axis=(1, 2)), np.sum(records**2, axis=1), rtol=1e-9)


@pytest.mark.parametrize("band", range(1, BANDS - 1))
@pytest.mark.parametrize("transform", [energy_map, lambda r: fourier_map(r, PARTS)])
def test_a_tone_shows_in_the_level_of_its_frequency_and_when_it_sounds(band, transform):
    """At a level's middle at least two thirds are in it: db4's filters overlap at the edges."""
    t = PERIOD * np.arange(SAMPLES)
    r = np.sin(2 * np.pi * 2.0 * 0.75 / 2**band * t)[None]
    r[:, : SAMPLES // 2] = 0.0
    share = transform(r)[0] / np.sum(r**2)
    assert share[band].sum() > 2 / 3
    assert share[:, PARTS // 2 :].sum() > 0.95  # a filter reaches a little across the onset


def test_white_noise_has_the_energy_of_each_band_by_its_width(records):
    """Half above half the Nyquist frequency, and so on; 10,240 samples: 2 % is three sd."""
    for energy in (energy_map(records), fourier_map(records, 1)):
        share = energy.sum(axis=(0, 2)) / energy.sum()
        np.testing.assert_allclose(share, [*0.5 ** np.arange(1, BANDS), 2.0**-6], atol=0.02)


def test_features_of_a_map_by_hand():
    energy = np.array([[[1.0, 0.0], [2.0, 1.0]]])  # two bands, two parts
    shares, evolution = np.log([0.25, 0.75]), [-0.5 * 0.75 + 0.5 * 0.25, np.log(0.625)]
    np.testing.assert_allclose(map_features(energy), [[*shares, *evolution]], rtol=1e-12)
    np.testing.assert_allclose(map_features(energy.sum(axis=2)[..., None]), [shares], rtol=1e-12)


def test_time_features_by_hand():
    """1, 1, -1, 3: mean 1, RMS sqrt 3, deviations 0, 0, -2, 2: kurtosis 8 / 4, rise 1.2."""
    r = np.array([[1.0, 1.0, -1.0, 3.0]])
    size = np.sqrt(3.0)
    # t = -1/2, -1/6, 1/6, 1/2: slope = (-2/6 + 2/2) / (20/36)
    expected = [np.log(size), np.log(3.0), 1 / size, 3 / size, 2.0, 1.2 / size]
    np.testing.assert_allclose(time_features(r), [expected], rtol=1e-12)
    np.testing.assert_allclose(time_features(-r), [expected], rtol=1e-12)  # either sign


def test_classes_and_their_distance_by_hand():
    """Deviations (1, 0), (-1, 0), (0, 2), (0, -2) in both of two classes: covariance over 8 - 2
    degrees of freedom diag(4, 16)/6."""
    off = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 2.0], [0.0, -2.0]])
    x = np.concatenate([off, off + np.array([4.0, 4.0])])
    found = learn_classes(x, np.repeat([0, 1], 4))
    np.testing.assert_allclose(found.means, [[0.0, 0.0], [4.0, 4.0]], atol=1e-12)
    np.testing.assert_allclose(found.precision, np.diag([6 / 4, 6 / 16]), atol=1e-12)
    # (1.5, 5): 1.5*2.25 + 0.375*25 = 12.75 to the first, 1.5*6.25 + 0.375*1 = 9.75 to the second;
    # (1, 5): 1.5 + 9.375 = 10.875 and 13.5 + 0.375 = 13.875, though (4, 4) is nearer by the ruler
    assert classify(found, np.array([[1.5, 5.0], [1.0, 5.0]])).tolist() == [1, 0]


def test_a_feature_that_repeats_another_changes_nothing(records):
    k = np.array([0, 1, 0, 1, 1])
    x = records[:, :2]
    twice = np.concatenate([x, x[:, :1]], axis=1)
    one, two = (classify(learn_classes(each, k), each) for each in (x, twice))
    assert one.tolist() == two.tolist()


def test_confusion_by_hand():
    found = confusion(np.array([0, 0, 1, 1]), np.array([0, 1, 1, 1]), 2)
    assert found.tolist() == [[1, 1], [0, 2]]


@pytest.mark.parametrize(("right", "runs"), [(0, 40), (23, 80), (237, 240), (240, 240)])
def test_the_interval_is_wilsons(right, runs):
    expected = binomtest(right, runs).proportion_ci(0.95, method="wilson")
    # Z95 has seven digits
    assert wilson(right, runs) == pytest.approx((expected.low, expected.high), abs=1e-6)


def test_the_reordered_have_the_same_values_in_the_order_given(records):
    found = [reordered(x) for x in records]
    for x, y in zip(records, found, strict=True):
        assert np.array_equal(np.argsort(x), np.argsort(y))
        np.testing.assert_array_equal(np.sort(y), np.sort(found[0]))
    # mean 0 and RMS 1 to rounding; a Laplace distribution has a kurtosis of 6, its outermost
    # 1/2048 cut off somewhat less
    assert abs(found[0].mean()) < 1e-12
    assert np.mean(found[0] ** 2) == pytest.approx(1.0)
    assert 5.5 < np.mean(found[0] ** 4) < 6.0


@pytest.mark.parametrize("kind", ORDER)
def test_matched_faults_have_one_shape_of_values(kind):
    """From the onset on RMS within 0.01 times 0.7 to 1.4, crest and kurtosis the Laplace ones."""
    x = fault(np.random.default_rng(1), kind, 0.01, matched=True)
    onset = np.flatnonzero(x)[0]
    active = x[onset:]
    size = np.sqrt(np.mean(active**2))
    assert onset < 512
    assert 0.01 / np.sqrt(2) <= size <= 0.01 * np.sqrt(2)
    same = np.sort(reordered(np.arange(float(len(active)))))
    np.testing.assert_allclose(np.sort(active) / size, same, atol=1e-12)


def test_beside_the_true_wheel_friction_and_sensor_faults_are_the_residual():
    """h and u are known, so that r = d in both channels, drawn again in the same order; rounding
    of the wheel's own torque."""
    wheel = load_plant("reaction_wheel")
    r = residuals_of(wheel, wheel, (), 0.01, 1, np.random.default_rng(7))
    rng = np.random.default_rng(7)
    for kind, (found,) in zip(KINDS, r, strict=True):
        rng.uniform(size=4)  # swing, cycle, phase of the path, phase of f(t)
        expected = fault(rng, kind, 0.01, matched=True)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_classes_far_apart_are_all_right_and_equal_ones_half():
    rng = np.random.default_rng(2)
    runs = wavelets.LEARNED + wavelets.JUDGED
    x = rng.standard_normal((len(KINDS), runs, 2))
    x[list(KINDS).index("tone")] += 20.0
    score, shares = wavelets.scored(x, ("noise", "tone"))
    assert score["right"] == 1.0
    np.testing.assert_array_equal(shares, np.eye(2))
    score, _ = wavelets.scored(x, ("noise", "noise in sensor"))
    assert score["low"] < 0.5 < score["high"]


def test_wavelets_tell_growing_from_fading_which_no_spectrum_of_the_whole_can():
    """A record and its reverse have the same power spectrum, to the rounding of the transform."""
    rng = np.random.default_rng(4)
    envelope = 20.0 ** np.linspace(0.0, 1.0, SAMPLES)
    growing = np.stack([reordered(x * envelope) for x in rng.standard_normal((80, SAMPLES))])
    fading = growing[:, ::-1]
    spectrum = FEATURES["spectrum"]
    np.testing.assert_allclose(spectrum(growing), spectrum(fading), rtol=0, atol=1e-9)
    k = np.repeat([0, 1], 80)
    learned = np.arange(160) % 2 == 0
    for name in ("windowed", "wavelet"):
        x = np.concatenate([FEATURES[name](growing), FEATURES[name](fading)])
        found = classify(learn_classes(x[learned], k[learned]), x[~learned])
        assert found.tolist() == k[~learned].tolist()


def over(value):
    """One number as it comes over seeds that agree."""
    return {"median": value, "min": value, "max": value}


def score(right):
    return {"right": over(right), "low": over(right - 0.05), "high": over(right + 0.05)}


def made_up(time, wavelet):
    """Results in which two sets are right this often, and traces of little."""
    each = {name: score(time) for name in SETS} | {"wavelet": score(wavelet)}
    percent = {p: over(1.0) for p in ("p10", "p50", "p90")}
    shares = {t: {n: over(float(t == n)) for n in ORDER} for t in ORDER}
    found = {
        "cases": dict.fromkeys(CASES, each),
        "confusion": dict.fromkeys(SETS, shares),
        "single_or_multiple": {name: over(0.5) for name in SETS},
        "by_size": {"0.001": {n: over(0.5) for n in SETS}, "0.01": {n: over(0.6) for n in SETS}},
        "rms_f": over(5e-4),
        "values": {k: dict.fromkeys(("RMS", "peak", "crest", "kurtosis"), percent) for k in ORDER},
    }
    t = PERIOD * np.arange(32)
    traces = {
        "wavelet_residuals": {"t": t, **{kind: np.sin(t) for kind in ORDER}},
        "wavelet_maps": {kind: np.full((BANDS, PARTS), 1 / 56) for kind in ORDER},
        "wavelet_levels": {kind: np.full(BANDS, 1 / 7) for kind in ORDER},
    }
    return {"wavelets": found}, traces


@pytest.mark.parametrize(
    ("time", "wavelet", "verdict"),
    [
        (0.3, 0.98, "It holds for these faults."),
        (0.3, 0.6, "It holds in part"),
        (0.3, 0.35, "It does not hold"),  # 95 % intervals overlap
        (0.95, 0.99, "It is not tested"),
    ],
)
def test_the_verdict_follows_the_numbers(time, wavelet, verdict):
    section = wavelets.section(*made_up(time, wavelet))
    assert section.paragraphs[1].startswith(verdict)
    assert len(section.tables) == 2
    assert len(section.figures) == 4
