"""The peer of `faultgauge fit` as a process: read a CSV, fit one 2-10-1 network with SciPy.

    python scipy_fit.py LOG.csv {analytic|2-point} STARTS

The last 15 % of the log stop the search: six iterations without a better validation cost, or 50.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

HIDDEN, MOST, PATIENCE = 10, 50, 6


def values(theta: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
    W, b, v, c = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40], theta[40]
    return np.tanh(p @ W.T + b) @ v + c - y


def jacobian(theta: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
    W, b, v = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40]
    a = np.tanh(p @ W.T + b)
    inner = v * (1 - a * a)
    outer = (inner[:, :, None] * p[:, None, :]).reshape(len(p), -1)
    return np.concatenate([outer, inner, a, np.ones((len(p), 1))], axis=1)


def fit(p: np.ndarray, y: np.ndarray, jac: str, seed: int) -> float:
    """Best validation cost from one start."""
    first = int(0.85 * len(y))
    best, fails = np.inf, 0

    def watch(intermediate_result: object) -> None:
        nonlocal best, fails
        cost = np.sum(values(intermediate_result.x, p[first:], y[first:]) ** 2)
        best, fails = (cost, 0) if cost < best else (best, fails + 1)
        if fails >= PATIENCE:
            raise StopIteration

    least_squares(
        values,
        np.random.default_rng(seed).normal(size=41),
        jacobian if jac == "analytic" else "2-point",
        args=(p[:first], y[:first]),
        method="trf",
        max_nfev=MOST,
        callback=watch,
    )
    return best


def main(path: str, jac: str, starts: str) -> None:
    t, u, h = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    p = np.stack([(h[1:] + h[:-1]) / 2, u[:-1]], axis=1)  # the mean over each sample interval
    y = np.diff(h) / np.diff(t)
    p, y = p / np.abs(p).max(axis=0), y / np.abs(y).max()
    print(min(fit(p, y, jac, seed) for seed in range(int(starts))))


if __name__ == "__main__":
    main(*sys.argv[1:])
