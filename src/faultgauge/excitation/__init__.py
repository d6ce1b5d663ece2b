"""Experiment design: what to do to a plant so that a model can be learned from the record."""

from faultgauge.excitation.coverage import Coverage, coverage, sentence
from faultgauge.excitation.experiment import Excitation, Experiment, Sweep, design
from faultgauge.excitation.multisine import multisine
from faultgauge.excitation.noise import band_limited_noise
from faultgauge.excitation.sweep import triangles

__all__ = [
    "Coverage",
    "Excitation",
    "Experiment",
    "Sweep",
    "band_limited_noise",
    "coverage",
    "design",
    "multisine",
    "sentence",
    "triangles",
]
