"""What SKAB's list of results has by process statistics: T-squared, and T-squared with Q.

Both as the set's authors run them, so that their published figures say whether our scores are
theirs: columns scaled by the training rows, limits at 0.999, statistics by the median of the last
five rows.

H. Hotelling, Multivariate quality control, 1947; J. E. Jackson and G. S. Mudholkar, Control
procedures for residuals associated with principal component analysis, Technometrics 21, 1979.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import f as fisher
from scipy.stats import norm

__all__ = ["t_squared", "t_squared_q"]

LEVEL = 0.999
WINDOW = 5  # rows
EXPLAINED = 0.85  # of the variance, by the components that are kept
TWICE = 2.0  # T-squared alone alarms at twice its limit


def t_squared(
    train: Float[np.ndarray, "rows sensors"], test: Float[np.ndarray, "others sensors"]
) -> Bool[np.ndarray, "others"]:
    """Alarms of  T2 = z' C^-1 z  beyond twice its limit, z scaled, C their covariance."""
    z, other = _scaled(train, test)
    inverse = np.linalg.inv(np.cov(z.T))
    statistic = np.einsum("ri,ij,rj->r", other, inverse, other)
    return _median(statistic) > TWICE * _t_squared_limit(*z.shape)


def t_squared_q(
    train: Float[np.ndarray, "rows sensors"], test: Float[np.ndarray, "others sensors"]
) -> Bool[np.ndarray, "others"]:
    """Alarms of T2 over the principal components that explain 85 %, or of Q, the squares that they
    leave.

    The limit of Q is that of Jackson and Mudholkar with the published code's sums: of the
    eigenvalues as the solver returns them, unsorted, and powers of their sum in place of sums of
    their powers.
    """
    z, other = _scaled(train, test)
    found = np.linalg.eig(np.cov(z.T))
    as_found = np.real(found.eigenvalues)
    order = np.argsort(as_found)[::-1]
    values, vectors = as_found[order], np.real(found.eigenvectors)[:, order]
    kept = int(np.searchsorted(np.cumsum(values) / values.sum(), EXPLAINED) + 1)
    scores = other @ vectors[:, :kept]
    t2 = np.sum(scores**2 / values[:kept], axis=1)
    q = np.sum((other - scores @ vectors[:, :kept].T) ** 2, axis=1)
    alarm = _median(t2) > _t_squared_limit(len(z), kept)
    left = float(as_found[kept:].sum())
    return alarm | (_median(q) > _q_limit(left)) if left > 0 else alarm


def _scaled(
    train: Float[np.ndarray, "rows sensors"], test: Float[np.ndarray, "others sensors"]
) -> tuple[Float[np.ndarray, "rows kept"], Float[np.ndarray, "others kept"]]:
    """Both in standard deviations of `train` about its means; without what never moves there."""
    mean, spread = train.mean(axis=0), train.std(axis=0)
    moves = spread > 0
    return tuple(((x - mean) / np.where(moves, spread, 1.0))[:, moves] for x in (train, test))


def _t_squared_limit(rows: int, dimensions: int) -> float:
    n, k = rows, dimensions
    return k * (n - 1) * (n + 1) / (n * (n - k)) * float(fisher.ppf(LEVEL, k, n - k))


def _q_limit(left: float) -> float:
    """With  theta_i = left^i  it is  left (1 + sqrt(2) c h + h (h - 1))^(1 / h),  h = 1/3."""
    h, c = 1 / 3, float(norm.ppf(LEVEL))
    return left * (1 + np.sqrt(2) * c * h + h * (h - 1)) ** (1 / h)


def _median(statistic: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"]:
    """Of the last five rows; NaN, no alarm, before there are five."""
    found = np.full(len(statistic), np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(statistic, WINDOW)
    found[WINDOW - 1 :] = np.median(windows, axis=1)
    return found
