"""Best published results, with the papers.

The values are those that lists of results for these benchmarks pass on; `where` says so, since
the papers' own tables could not be read here.
"""

from dataclasses import dataclass

__all__ = ["PUBLISHED", "Published"]

LISTED = "as listed for this benchmark with this method; the paper's own table was not read"
BASELINE = (
    "M. D. Champneys, G. I. Beintema, R. Toth, M. Schoukens, T. J. Rogers, Baseline Results for "
    "Selected Nonlinear System Identification Benchmarks, 2024, arXiv:2405.10779"
)
PNLSS = (
    "J. Paduart, L. Lauwers, J. Swevers, K. Smolders, J. Schoukens, R. Pintelon, Identification of "
    "the Silverbox Benchmark Using Nonlinear State-Space Models"
)
SUBNET = (
    "G. I. Beintema, M. Schoukens, R. Toth, Deep Subspace Encoders for Nonlinear System "
    "Identification, 2022, arXiv:2210.14816"
)
DYNONET = (
    "M. Forgione, D. Piga, dynoNet: A neural network architecture for learning dynamical "
    "systems, 2020, arXiv:2006.02250"
)
GRAY_BOX = "gray-box models of the tanks, 0.18 to 0.19 V (T. J. Rogers and others)"


@dataclass(frozen=True)
class Published:
    """A root-mean-square error in the benchmark's unit, the method, its source, where it stands."""

    rmse: float
    by: str
    source: str
    where: str = LISTED


_ARROW = Published(0.26, "PNLSS", PNLSS)
_TANKS = Published(0.18, "gray-box model", GRAY_BOX)
_WH = Published(0.241, "DT-SUBNET", SUBNET)

PUBLISHED: dict[tuple[str, str], Published] = {
    ("emps", "pulses"): Published(2.64, "dynoNet", DYNONET),
    ("cascaded_tanks", "window_50"): _TANKS,
    ("cascaded_tanks", "window_5"): _TANKS,
    ("silverbox", "arrow_full"): _ARROW,
    ("silverbox", "arrow_no_extrapolation"): Published(0.259, "GP-NARX", BASELINE),
    ("silverbox", "multisine"): Published(0.301, "GP-NARX", BASELINE),
    ("wiener_hammerstein_2009", "test"): _WH,
    ("wiener_hammerstein_2009", "test_steady"): _WH,
}
