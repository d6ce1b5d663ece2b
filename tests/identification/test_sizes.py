"""The number of hidden units where a plant file leaves it open."""

import numpy as np
import pytest

from faultgauge.identification.fit import fit
from faultgauge.identification.sizes import smallest_sufficient, with_hidden
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.model import load_model, save_model
from faultgauge.telemetry import Run

OPEN = """
name = "open"
inputs.u = {}
outputs.y = { value = "x" }
networks.NN = {}
networks.fixed = { hidden = 3 }
[states]
x = { derivative = "NN(x, u) + k*fixed(u)" }
[parameters]
k = { value = 2 }
"""


@pytest.fixture
def plant(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(OPEN)
    return load_plant(path)


@pytest.mark.parametrize(
    ("errors", "chosen"),
    [
        ({2: 1.0, 5: 0.99}, 2),  # 1 % less is not worth three units more
        ({2: 1.0, 5: 0.5, 10: 0.49}, 5),
        ({2: 1.0, 5: 0.5, 10: 0.1, 20: 0.05}, 20),
        ({2: np.inf, 5: 0.5, 10: np.inf}, 5),
    ],
)
def test_units_grow_until_they_no_longer_pay(plant, errors, chosen):
    def fit_(sized):
        size = len(sized.networks["NN"].bias)
        return errors[size], size

    assert smallest_sufficient(plant, fit_) == chosen


def test_nothing_open_is_fitted_once(plant):
    settled, calls = with_hidden(plant, {"NN": 4}), []
    smallest_sufficient(settled, lambda sized: (calls.append(sized), (1.0, sized))[1])
    assert calls == [settled]


def test_only_open_sizes_change(plant):
    sized = with_hidden(plant, {"NN": 4})
    assert len(sized.networks["NN"].bias) == 4
    assert len(sized.networks["fixed"].bias) == 3
    assert float(sized.parameters["k"]) == 2.0


def test_a_plant_that_two_units_describe_gets_two_and_the_file_says_so(tmp_path):
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(600)
    u = np.repeat(rng.uniform(-1, 1, 60), 10)
    x = np.zeros(600)
    for k in range(599):  # exact under a held input: x' = u - x
        x[k + 1] = u[k] + (x[k] - u[k]) * np.exp(-0.1)
    path = tmp_path / "plant.toml"
    path.write_text(
        OPEN.replace(" + k*fixed(u)", "").replace("networks.fixed = { hidden = 3 }", "")
    )
    log = Run("log", "log", t, {"u": u, "y": x})
    model, _ = fit(load_plant(path), [log], restarts=3)
    save_model(model, tmp_path / "model.fgm")
    again = load_model(tmp_path / "model.fgm")
    size = again.record["choices"]["hidden"]["NN"]
    assert size == len(again.plant.networks["NN"].bias)
    assert size in (2, 5)  # a line needs no more; noise-free, five may still halve a tiny error
