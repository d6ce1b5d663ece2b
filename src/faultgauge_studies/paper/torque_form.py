"""Eq (11) as it is written, closed on the torque output: where it is stable, and what it leaves."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.observers.observer import observe
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge_studies.paper.output_eso import design_output_eso, time_constant

__all__ = ["torque_form"]

# An integrator whose torque output has the sign c: +1 as eq (16), -1 as eq (18) writes it.
PLANT = """
name = "integrator"
states.h.derivative = "u"
inputs.u.unit = "N*m"
outputs.T.value = "{c}*d(h)"
faults.friction = {{ enters = "state", target = "h" }}
"""
BETA_2 = 0.04  # 1/s^2: omega_o = 0.2
BETA_1 = np.round(np.arange(0.0, 3.01, 0.05), 2)
DT, SAMPLES = 0.05, 400
SIZE = 0.1  # N*m
CURVES = (0.4, 1.6)  # beta_1 of the curves over time


def torque_form() -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Growth rate of the fault's error over beta_1 for both signs, simulated and in closed form.

    Where e = -(f - f_true)/(1 - beta_1) has no solution (c = -1, beta_1 = 1) it is NaN.
    """
    map_: dict[str, Any] = {"beta_1": BETA_1}
    figures: dict[str, Any] = {"beta_2": BETA_2, "momentum_error_left": {}}
    curves: dict[str, Any] = {"t": DT * np.arange(1, SAMPLES + 1)}
    for c, name in ((1.0, "plus"), (-1.0, "minus")):
        plant = GrayBoxPlant.untrained(parse_plant(PLANT.format(c=c), "integrator"))
        solvable = np.abs(1 + c * BETA_1) > 1e-9
        closed = np.full(len(BETA_1), np.nan)
        closed[solvable] = [-1 / time_constant(b, BETA_2, c) for b in BETA_1[solvable]]
        map_[f"closed_form_{name}"] = closed
        map_[f"simulated_{name}"] = np.array(
            [
                _rate(_trace(plant, b, c)[0]) if ok and k % 6 == 2 else np.nan
                for k, (b, ok) in enumerate(zip(BETA_1, solvable, strict=True))
            ]
        )
        for beta_1 in CURVES:
            f, x = _trace(plant, beta_1, c)
            curves[f"f_{name}_{beta_1:g}"] = f
            if c > 0:
                # momentum starts wrong by 1 N*m*s, and nothing corrects it
                left = float(x[-1] - SIZE * DT * SAMPLES)
                figures["momentum_error_left"][f"{beta_1:g}"] = left
    tested = np.isfinite(map_["simulated_plus"])
    figures["largest_rate_mismatch"] = float(
        np.abs(map_["simulated_plus"] - map_["closed_form_plus"])[tested].max()
    )
    return {"torque_form": figures}, {"torque_map": map_, "torque_curves": curves}


def _trace(
    plant: GrayBoxPlant, beta_1: float, c: float
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(fhat, hhat) under a constant fault; hhat starts 1 N*m*s off the truth of 0."""
    observer = design_output_eso(plant, "friction", "T", float(beta_1), BETA_2, 1)
    found = observe(
        observer,
        jnp.ones(1),
        jnp.zeros((SAMPLES, 1)),
        jnp.full((SAMPLES, 1), c * SIZE),
        jnp.full(SAMPLES, DT),
    )
    return np.asarray(found.f), np.asarray(found.x[:, 0])


def _rate(f: Float[np.ndarray, "samples"]) -> float:
    """Exponential rate [1/s] of the error of f, from its first 2 s."""
    error = np.abs(f - SIZE)
    last = round(2.0 / DT)
    return float(np.log(error[last] / error[0]) / (DT * last))
