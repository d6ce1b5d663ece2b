"""Gains of linear error dynamics by pole placement in discrete time."""

import numpy as np
from jaxtyping import Complex, Float

__all__ = ["ackermann", "bandwidth_poles", "spectral_radius"]


def bandwidth_poles(
    order: int, bandwidth: float, zeta: float, dt: float
) -> Complex[np.ndarray, "order"]:
    """Discrete poles exp(s dt) of the bandwidth parameterisation, order 1 to 3.

    A pair s^2 + 2 zeta omega_o s + omega_o^2, and a real pole at -omega_o where the order is
    odd: for order 2 beta_1 = 2 zeta omega_o and beta_2 = omega_o^2 in the linear zone. Mapped
    by exp, the poles lie inside the unit circle at any omega_o dt.
    """
    root = np.emath.sqrt(zeta**2 - 1)
    pair = [-bandwidth * (zeta + root), -bandwidth * (zeta - root)]
    poles = {1: [-bandwidth], 2: pair, 3: [-bandwidth, *pair]}[order]
    return np.exp(np.array(poles, complex) * dt)


def ackermann(
    A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "n"], poles: Complex[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """L that gives A - L C the `poles`: L = p(A) O^-1 e_n, with O the observability matrix.

    Raises `numpy.linalg.LinAlgError` where (A, C) is not observable. The rows of O are scaled
    first, because the units of the states may differ by many orders.
    """
    n = len(A)
    O = np.stack([C @ np.linalg.matrix_power(A, k) for k in range(n)])  # noqa: E741
    columns = np.abs(O).max(axis=0)
    if np.any(columns == 0) or np.linalg.cond(O / columns) > 1e14:
        raise np.linalg.LinAlgError("not observable")
    last = np.zeros(n)
    last[-1] = 1.0
    p = np.zeros((n, n))
    for coefficient in np.poly(poles).real:
        p = p @ A + coefficient * np.eye(n)
    return p @ (np.linalg.solve(O / columns, last) / columns)


def spectral_radius(M: Float[np.ndarray, "points n n"]) -> float:
    """The largest |eigenvalue| over all matrices."""
    return float(np.abs(np.linalg.eigvals(M)).max())
