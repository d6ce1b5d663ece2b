"""What a fleet is worth to its next unit, and what one bad log does to a fleet.

    python benchmarks/fleet.py [--seeds N] [--units N]

Wheels h' = gain u - drag h - coulomb tanh(h / 0.05) - hump h exp(-2 h^2) - windage h|h|, whose
constants all differ by 10 %. Hump (like Stribeck's) and windage are a network to the fit, shared by
all wheels, which it therefore cannot follow in full. They sweep through +- 1.2 N*m*s in 400 s, with
a voltage on top that is drawn anew every 20 s. Noise on h is 2e-3 N*m*s, 0.2 % of its spread; 1 Hz.

1. A fleet of 30 wheels with an hour of log each; the next wheel is fitted from 10 minutes and from
   2 hours, with the fleet and alone. Error: free run against the wheel over an hour that no fit has
   seen, as a share of its spread; without noise.
2. Five wheels with 20 minutes each; then the same, the third with twice its Coulomb friction
   throughout. How far the fleet's means move, in their standard errors. The fit knows the form of
   hump and windage, so that all five constants have values.

Medians [smallest, largest] over seeds 0..N-1.
"""

import argparse
import math
import tempfile
from pathlib import Path

from faultgauge.settings import set_for_commands

set_for_commands()

import numpy as np  # noqa: E402
from jaxtyping import Float  # noqa: E402

from faultgauge.fleet.fit import fit_fleet  # noqa: E402
from faultgauge.identification.validation.evaluation import predict  # noqa: E402
from faultgauge.plants.model import Model, load_model  # noqa: E402
from faultgauge.telemetry import Run  # noqa: E402
from faultgauge.verbs.fit import fit  # noqa: E402

PLANT = """
name = "wheel of a fleet"
[states.h]
unit = "N*m*s"
derivative = "gain*u - drag*h - coulomb*tanh(h/0.05) - S(h)"
[inputs.u]
unit = "V"
hold = "zero"
[outputs.hm]
unit = "N*m*s"
value = "h"
[parameters]
gain = { value = 0.005, unit = "N*m/V", min = 0 }
drag = { value = 3e-4, unit = "1/s", min = 0 }
coulomb = { value = 2e-3, unit = "N*m", min = 0 }
[networks.S]
hidden = 6
odd = true
"""
PHYSICS = """
name = "wheel whose physics is known"
[states.h]
unit = "N*m*s"
derivative = '''
gain*u - drag*h - coulomb*tanh(h/0.05) - hump*h*exp(-2*h*h) - windage*h*abs(h)
'''
[inputs.u]
unit = "V"
hold = "zero"
[outputs.hm]
unit = "N*m*s"
value = "h"
[parameters]
gain = { value = 0.005, min = 0 }
drag = { value = 3e-4, min = 0 }
coulomb = { value = 2e-3, min = 0 }
hump = { value = 1e-3, min = 0 }
windage = { value = 1e-3, min = 0 }
"""
CENTER = np.array([0.0055, 4e-4, 2e-3, 2e-3, 4e-4])  # gain, drag, coulomb, hump, windage
SPREAD, NOISE, SUBSTEPS, HOLD = 0.1, 2e-3, 10, 20
HOUR, LONG, SHORT, FIVE = 3600, 7200, 600, 1200  # s


def constants(seed: int, wheel: int) -> Float[np.ndarray, "5"]:
    random = np.random.default_rng([seed, wheel])
    return CENTER * np.exp(SPREAD * random.standard_normal(5))


def simulated(
    seed: int, wheel: int, seconds: int, log: int, friction: float = 1.0
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(u, h without noise) of the `log`-th log of a wheel; h starts at 0."""
    gain, drag, coulomb, hump, windage = map(float, constants(seed, wheel))
    random = np.random.default_rng([seed, wheel, log])
    u = np.repeat(random.uniform(-2, 2, -(-seconds // HOLD)), HOLD)[:seconds]
    sweep = 1.2 * np.sin(2 * np.pi * (np.arange(seconds) / 400 + random.uniform()))

    def rate(h: float, command: float) -> float:
        shared = hump * h * math.exp(-2 * h * h) + windage * h * abs(h)
        return gain * command - drag * h - friction * coulomb * math.tanh(h / 0.05) - shared

    h, state, step = np.zeros(seconds), 0.0, 1.0 / SUBSTEPS
    for k in range(seconds):
        h[k] = state
        command = u[k] = float(np.clip(u[k] + 20 * (sweep[k] - state), -5, 5))
        for _ in range(SUBSTEPS):
            a = rate(state, command)
            b = rate(state + step / 2 * a, command)
            c = rate(state + step / 2 * b, command)
            d = rate(state + step * c, command)
            state += step / 6 * (a + 2 * b + 2 * c + d)
    return u, h


def write(path: Path, seed: int, wheel: int, seconds: int, log: int, friction: float = 1.0) -> None:
    u, h = simulated(seed, wheel, seconds, log, friction)
    noise = NOISE * np.random.default_rng([seed, wheel, log, 1]).standard_normal(seconds)
    path.parent.mkdir(exist_ok=True)
    rows = zip(range(seconds), u, h + noise, strict=True)
    path.write_text("t,u,hm\n" + "".join(f"{t},{v:.8g},{y:.8g}\n" for t, v, y in rows))


def error(model: Model, seed: int, wheel: int) -> float:
    """Of the free run over a log that is not for fitting, a share of its spread."""
    u, h = simulated(seed, wheel, HOUR, 9)
    run = Run("test", "test", np.arange(HOUR, dtype=float), {"u": u, "hm": h})
    (found,) = predict(model.plant, [run], model.max_step)
    return float(np.sqrt(np.mean((found.predicted[:, 0] - h) ** 2)) / np.std(h))


def next_unit(seed: int, units: int) -> dict[str, float]:
    """Errors of a wheel that the fleet of `units` does not have."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for k in range(units):
            write(root / "fleet" / f"wheel{k:02d}.csv", seed, k, HOUR, 0)
        fit_fleet(PLANT, [root / "fleet"], root / "out", seed=seed)
        found = {}
        for name, seconds in (("10 min", SHORT), ("2 h", LONG)):
            path = root / name / "next.csv"
            write(path, seed, units, seconds, 1)
            fit_fleet(PLANT, [path.parent], root / f"{name} out", prior=root / "out", seed=seed)
            model = load_model(root / f"{name} out" / "units" / "next.fgm")
            found[f"{name}, with the fleet"] = error(model, seed, units)
            alone = fit(PLANT, path, seed=seed).model
            found[f"{name}, alone"] = error(alone, seed, units)
        return found


def moved(seed: int) -> dict[str, float]:
    """How far one contaminated log of five moves every mean, in standard errors."""
    laws = []
    for friction in (1.0, 2.0):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            for k in range(5):
                path = root / "fleet" / f"wheel{k}.csv"
                write(path, seed, k, FIVE, 2, friction if k == 2 else 1.0)
            laws.append(fit_fleet(PHYSICS, [root / "fleet"], root / "out", seed=seed).laws)
    clean, dirty = laws
    return {
        name: abs(law.off(dirty[name].center)) * law.spread / law.error
        for name, law in clean.items()
    }


def told(values: list[float]) -> str:
    return f"{np.median(values):.3g} [{min(values):.3g}, {max(values):.3g}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--units", type=int, default=30)
    arguments = parser.parse_args()
    rows: dict[str, list[float]] = {}
    for seed in range(arguments.seeds):
        found = next_unit(seed, arguments.units)
        mine = found["10 min, with the fleet"]
        found["10 min / 2 h, both with the fleet"] = mine / found["2 h, with the fleet"]
        found["10 min with the fleet / 2 h alone"] = mine / found["2 h, alone"]
        found |= {f"one bad log of five moves {n} by": by for n, by in moved(seed).items()}
        for name, value in found.items():
            rows.setdefault(name, []).append(value)
        print(f"seed {seed}: " + ", ".join(f"{n} {v:.3g}" for n, v in found.items()), flush=True)
    for name, values in rows.items():
        print(f"{name:<40} {told(values)}")


if __name__ == "__main__":
    main()
