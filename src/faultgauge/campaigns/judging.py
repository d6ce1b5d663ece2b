"""The model that judges a campaign: given, or made on healthy runs of its own."""

from collections.abc import Callable

from faultgauge.campaigns.design import healthy_seeds
from faultgauge.campaigns.runs import healthy_run
from faultgauge.campaigns.schema import MADE, TRUTH, Plan
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model, load_model
from faultgauge.plants.plant_file import parse_plant, presets
from faultgauge.plants.toml_file import parse_toml
from faultgauge.plants.toml_text import toml_text
from faultgauge.rehearsal.judging import check_calibrated

__all__ = ["made_model", "plant_of"]


def made_model(plan: Plan, progress: Callable[[str], None]) -> tuple[Model, list[str]]:
    """The calibrated model of the plan, and warnings. Raises `InputError` where there is none."""
    maker = plan.judge
    if maker.model not in MADE:
        given = load_model(plan.folder / maker.model)
        check_calibrated(given)
        return given, []
    progress("simulating healthy runs")
    seeds = healthy_seeds(plan, maker.fit + maker.calibrate)
    runs = [healthy_run(plan, seed, f"healthy {k}") for k, seed in enumerate(seeds)]
    plant = plant_of(plan)
    progress("fitting the model that judges")
    try:
        model, account = fit(plant, runs[: maker.fit], seed=plan.seed, progress=progress)
        found = calibrate(model, runs[maker.fit :], mtbfa=maker.mtbfa, progress=progress)
    except InputError as wrong:
        raise InputError(f"{plan.source}: [judge] cannot be made: {wrong}") from None
    return found.model, [*account.warnings, *found.warnings]


def plant_of(plan: Plan) -> GrayBoxPlant:
    """What is fitted; of the truth nothing is, and its constants are the scenario's."""
    name, true = plan.judge.plant, plan.scenario.plant
    plant = true
    if name is not None:
        path = plan.folder / name
        plant = load_plant(name if name in presets() and not path.is_file() else path)
    if plan.judge.model != TRUTH:
        return GrayBoxPlant.untrained(plant.spec)
    if plant.networks:
        raise InputError(
            f'{plan.source}: [judge] model = "truth" has no networks to learn '
            f'({", ".join(plant.networks)}); give model = "fitted".'
        )
    tables = parse_toml(plant.spec.text, plan.source)
    for name, table in tables.get("parameters", {}).items():
        value = float(true.parameters.get(name, plant.parameters[name]))
        table.pop("vary", None)
        table |= {"value": value, "fixed": True}
    return GrayBoxPlant.untrained(parse_plant(toml_text(tables), plan.source))
