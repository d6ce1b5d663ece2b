"""The peer, alone in its own interpreter: jax-sysid on one benchmark, data and answers by file.

Called as `python jax_sysid_peer.py FOLDER SEED` by `peers.py`. jax-sysid pins versions of JAX and
SciPy that faultgauge cannot live with, so this file imports nothing of faultgauge. FOLDER holds
`task.json` (candidates, starts of each, thinning) and `data.npz` (of the test runs all inputs,
and the first outputs alone); the answer is `seed_K.npz` and `seed_K.json`.

The set-up is that of jax-sysid's documentation: scaled signals, x' = A x + B u + f(x, u),
y = C x + g(x) with one-layer networks, A, B and C first fitted as a linear model, then Adam and
L-BFGS; the initial state of a test run by `learn_x0` on its first samples. Of the candidates the
best free run on the last part of the training runs is kept and trained on with that part.
"""

import json
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax_sysid.models import LinearModel, Model  # pyright: ignore[reportMissingImports]

HELD_OUT = 0.2  # of each training run, its end: chooses among candidates
START = 50  # first samples of the held-out part: find its initial state, not scored
SMALL = 0.1  # spread of the first weights of a network's output, so that the start is near linear


def state(x, u, params):  # jax-sysid calls its third argument by this name
    A, B, _, W, V, U, a, b, *_ = params
    return A @ x + B @ u + W @ jnp.tanh(V @ x + U @ u + a) + b


def output(x, u, params):
    *_, W, V, a, b = params
    return params[2] @ x + W @ jnp.tanh(V @ x + a) + b


def linear(candidate, y, u, seed):
    """(A, B, C) and the initial states of a linear model, trained from A = `first_pole` I on."""
    sigma, epochs = candidate["first_pole"], candidate["linear_epochs"]
    model = LinearModel(candidate["states"], y[0].shape[1], u[0].shape[1], sigma=sigma, seed=seed)
    model.loss(rho_x0=1e-4, rho_th=1e-6)
    model.optimization(adam_epochs=0, lbfgs_epochs=epochs, iprint=-1)
    model.fit(list(y), list(u))
    return model.params[:3], model.x0


def begin(candidate, y, u, seed):
    """First parameters and initial states: the linear model, and networks that are near nothing."""
    rng = np.random.default_rng(seed)
    nx, hidden, nu, ny = candidate["states"], candidate["hidden"], u[0].shape[1], y[0].shape[1]
    (A, B, C), x0 = linear(candidate, y, u, seed)
    draw = rng.standard_normal
    params = [
        *(np.asarray(m) for m in (A, B, C)),
        SMALL * draw((nx, hidden)) / hidden,
        draw((hidden, nx)),
        draw((hidden, nu)),
        draw(hidden),
        np.zeros(nx),
        SMALL * draw((ny, hidden)) / hidden,
        draw((hidden, nx)),
        draw(hidden),
        np.zeros(ny),
    ]
    return params, x0


def train(candidate, data, params, x0, adam_epochs):
    """A model of the candidate's size, trained from `params` on."""
    y, u = data
    ny, nu = y[0].shape[1], u[0].shape[1]
    model = Model(candidate["states"], ny, nu, state_fcn=jax.jit(state), output_fcn=jax.jit(output))
    model.init(params=params, x0=x0)
    model.loss(rho_x0=1e-4, rho_th=candidate["rho"])
    model.optimization(
        adam_eta=1e-3, adam_epochs=adam_epochs, lbfgs_epochs=candidate["lbfgs_epochs"], iprint=-1
    )
    model.fit(list(y), list(u))
    return model


def free_run(model, y, u, start):
    """Simulation of a whole run from the state that its first `start` samples give."""
    x0 = model.learn_x0(u[:start], y[:start], rho_x0=1e-6, LBFGS_refinement=True, verbosity=False)
    return np.asarray(model.predict(x0, u)[0])


def error(model, runs):
    """Sum of squares of the free runs of (y, u) pairs after their first samples."""
    total = sum(float(np.sum((free_run(model, y, u, START) - y)[START:] ** 2)) for y, u in runs)
    return total if np.isfinite(total) else np.inf


def features(u, kind):
    """What enters the model: the input, and its square with sign where thrust is known to go so."""
    return np.concatenate([u, u * np.abs(u)], axis=1) if kind == "signed square" else u


def means(u, every):
    """The mean input of each `every` samples, which lead from one kept output to the next."""
    whole = np.pad(u, (0, -len(u) % every), mode="edge")
    return whole.reshape(-1, every).mean(axis=1)[:, None]


def choose(task, ys, inputs, seed):
    """The model kept, with what it was fed: (model, kind of input, its mean and spread).

    `ys` are scaled outputs, `inputs` plain ones.
    """
    tried = []
    for candidate in task["candidates"]:
        us = [features(u, candidate["input"]) for u in inputs]
        um, ug = np.concatenate(us).mean(0), np.concatenate(us).std(0)
        us = [(u - um) / ug for u in us]
        cuts = [int(len(y) * (1 - HELD_OUT)) for y in ys]
        runs = list(zip(ys, us, cuts, strict=True))
        first = [y[:c] for y, _, c in runs], [u[:c] for _, u, c in runs]
        held = [(y[c:], u[c:]) for y, u, c in runs]
        for start in range(task["starts"]):
            params, x0 = begin(candidate, *first, seed * task["starts"] + start)
            fitted = train(candidate, first, params, x0, candidate["adam_epochs"])
            tried.append((error(fitted, held), candidate, fitted, us, um, ug))
    _, candidate, model, us, um, ug = min(tried, key=lambda each: each[0])
    more = train(candidate, (ys, us), model.params, model.x0, 0)  # on with the held-out part
    runs = list(zip(ys, us, strict=True))
    kept = more if error(more, runs) < error(model, runs) else model
    return kept, candidate["input"], um, ug


def main(folder, seed):
    task, data = json.loads((folder / "task.json").read_text()), np.load(folder / "data.npz")
    every = task["every"]
    ys = [data[f"y{k}"][::every, None] for k in range(task["runs"])]
    inputs = [means(data[f"u{k}"], every) for k in range(task["runs"])]
    ym, yg = np.concatenate(ys).mean(0), np.concatenate(ys).std(0)
    begun = time.perf_counter()
    model, kind, um, ug = choose(task, [(y - ym) / yg for y in ys], inputs, seed)
    fit_s = time.perf_counter() - begun
    predicted = {}
    for name, window in task["tests"].items():
        u = (features(means(data[f"u_{name}"], every), kind) - um) / ug
        y = (data[f"y_{name}"][:window:every, None] - ym) / yg
        coarse = (free_run(model, y, u, len(y)) * yg + ym)[:, 0]
        fine = np.arange(len(data[f"u_{name}"]))
        predicted[name] = np.interp(fine, fine[::every], coarse)
    np.savez(folder / f"seed_{seed}.npz", **predicted)
    (folder / f"seed_{seed}.json").write_text(json.dumps({"fit_s": fit_s}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
