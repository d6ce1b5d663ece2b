"""Other plants with the same linear dynamics: where a chain of blocks may share out its poles anew.

A cascade's transfer function says which poles and zeros there are, not which block has them; only
a nonlinearity between the blocks can tell. So from one fit of the linear part follow starts with
every other assignment (Wiener-Hammerstein systems: L. Lauwers, R. Pintelon and J. Schoukens,
"Modelling of Wiener-Hammerstein systems via the best linear approximation", SYSID 2009).
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse.csgraph import connected_components

from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond

__all__ = ["equivalents"]

FREQUENCIES = 60  # of the spectra that are compared
DECADES = 1.0  # below the slowest and above the fastest pole
TRIES = 6  # starts per assignment: zeros move between blocks, too
MOST = 24  # assignments
CLOSE = 1e-3  # largest error of an equivalent's poles and responses, relative
HELD = 1e-5  # weight of staying where the unknowns are, where they do not matter
SAME = 0.05  # prior standard deviations


def equivalents(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "unknowns"],
    x: Float[np.ndarray, "states"],
    u: Float[np.ndarray, "inputs"],
    rng: np.random.Generator,
) -> list[Float[np.ndarray, "unknowns"]]:
    """Unknowns of plants whose linearisation at (x, u) responds as that of `theta` does, with its
    poles assigned to other blocks, or its zeros to other places. Empty where there is one block."""

    @jax.jit
    def matrices(theta: Array) -> tuple[Array, Array, Array, Array]:
        at = unknowns.assemble(plant, theta)
        A, B = jax.jacfwd(lambda *p: respond(at, *p)[0], (0, 1))(jnp.asarray(x), jnp.asarray(u))
        C, D = jax.jacfwd(lambda *p: respond(at, *p)[1], (0, 1))(jnp.asarray(x), jnp.asarray(u))
        return A, B, C, D

    A = np.asarray(matrices(jnp.asarray(theta))[0])
    blocks = _blocks(A)
    if len(blocks) < 2 or not np.all(np.isfinite(A)):
        return []
    poles = [np.linalg.eigvals(A[np.ix_(b, b)]) for b in blocks]
    speeds = np.abs(np.concatenate(poles))
    if np.any(speeds == 0):
        return []
    low, high = np.log10(speeds.min()) - DECADES, np.log10(speeds.max()) + DECADES
    s = 1j * np.logspace(low, high, FREQUENCIES)

    @jax.jit
    def seen(theta: Array) -> tuple[Array, Array]:
        """(responses, characteristic polynomials of the blocks), scaled to order one."""
        A, B, C, D = matrices(theta)
        G = C @ jnp.linalg.solve(s[:, None, None] * jnp.eye(len(A)) - A, B + 0j) + D
        parts = zip(blocks, poles, strict=True)
        return G, jnp.concatenate([_characteristic(A[np.ix_(b, b)] / _speed(p)) for b, p in parts])

    target = np.asarray(seen(jnp.asarray(theta))[0])
    size = np.max(np.abs(target), axis=0) + 1e-300

    def residual(theta: Array, wanted: Array) -> Array:
        G, monic = seen(theta)
        off = ((G - target) / size).ravel()
        return jnp.concatenate([off.real, off.imag, monic - wanted, HELD * theta])

    goals = [
        np.concatenate(
            [np.real(np.poly(a / _speed(p)))[1:] for a, p in zip(assigned, poles, strict=True)]
        )
        for assigned in _assignments(poles)
    ]
    return _solutions(residual, goals, theta, unknowns.bounds(plant), rng)


def _solutions(
    residual: Callable[[Array, Array], Array],
    goals: Sequence[Float[np.ndarray, "coefficients"]],
    theta: Float[np.ndarray, "unknowns"],
    bounds: tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]],
    rng: np.random.Generator,
) -> list[Float[np.ndarray, "unknowns"]]:
    """Unknowns about `theta`, unlike it and each other, that solve `residual` for one of `goals`;
    its last rows, one to each unknown, hold those that do not matter and need not vanish."""
    from scipy.optimize import least_squares  # a fifth of a second to load, which few fits need

    jacobian = jax.jit(jax.jacfwd(residual))
    error = jax.jit(residual)
    lower, upper = bounds
    found = [theta]
    for wanted in goals:
        for _ in range(TRIES):
            start = np.clip(theta + rng.standard_normal(len(theta)), lower + 1e-9, upper - 1e-9)
            with np.errstate(over="ignore"):  # a step too far: infinite cost, and it is shortened
                solved = least_squares(
                    lambda t, to: np.asarray(error(t, to)),
                    start,
                    lambda t, to: np.asarray(jacobian(t, to)),  # pyright: ignore[reportArgumentType]
                    bounds=(lower, upper),
                    max_nfev=200,
                    args=(wanted,),
                )
            exact = np.max(np.abs(solved.fun[: -len(theta)])) < CLOSE
            new = all(np.max(np.abs(solved.x - other)) > SAME for other in found)
            if exact and new:
                found.append(solved.x)
    return found[1:]


def _blocks(A: Float[np.ndarray, "states states"]) -> list[np.ndarray]:
    """States in groups that act on each other, by the strongly connected parts of A."""
    count, label = connected_components(A != 0, directed=True, connection="strong")
    return [np.flatnonzero(label == k) for k in range(count)]


def _speed(poles: np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(np.abs(poles)))))


def _characteristic(A: Array) -> Array:
    """Coefficients of det(s I - A) after the first (Faddeev and LeVerrier)."""
    M, found = jnp.eye(len(A)), []
    for k in range(1, len(A) + 1):
        product = A @ M
        found.append(-jnp.trace(product) / k)
        M = product + found[-1] * jnp.eye(len(A))
    return jnp.stack(found)


def _assignments(poles: Sequence[np.ndarray]) -> Iterator[list[np.ndarray]]:
    """Every way to fill the blocks with the poles that there are, conjugate pairs together."""
    every = np.concatenate(poles)
    units = [np.array([p]) for p in every if abs(p.imag) < 1e-9 * abs(p)]
    units += [np.array([p, p.conj()]) for p in every if p.imag >= 1e-9 * abs(p)]
    sizes, seen = [len(p) for p in poles], set()
    for order in permutations(range(len(units))):
        filled, left = [], list(order)
        for size in sizes:
            chosen: list[int] = []
            while left and sum(len(units[k]) for k in chosen) < size:
                chosen.append(left.pop(0))
            if sum(len(units[k]) for k in chosen) != size:
                break
            filled.append(frozenset(chosen))
        key = tuple(filled)
        if len(filled) == len(sizes) and key not in seen:
            seen.add(key)
            yield [np.concatenate([units[k] for k in sorted(group)]) for group in filled]
            if len(seen) == MOST:
                return
