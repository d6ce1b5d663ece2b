"""The table `[accommodation]` of a scenario file: from its keys to a policy."""

from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
import pydantic

from faultgauge.accommodation.estimator import ByPosterior, TotalDisturbance
from faultgauge.accommodation.feed_forward import Limits, outcome
from faultgauge.accommodation.policy import Accommodation, accommodation
from faultgauge.detection.posterior.uncalibrated import uncalibrated
from faultgauge.detection.watch import Watch
from faultgauge.errors import InputError
from faultgauge.observers.eso import design_eso
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.expression import unknown
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, load_model
from faultgauge.plants.signals import Fault
from faultgauge.plants.toml_file import Positive, SchemaTable, typed
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.simulation.scenario import Scenario, trained_plant

__all__ = ["policy_of"]

SLOWLY = 1e-3  # of the rate at which faults become known: that at which a compensation has to hold
DESIRED = ("estimate_and_friction", "adrc")

_Share = Annotated[float, pydantic.Field(gt=0, le=1, allow_inf_nan=False)]


class _Accommodation(SchemaTable):
    policy: Literal["none", "estimate", "estimate_and_friction", "adrc"]
    model: str | None = None
    desired: str | None = None
    fault: str | None = None
    bandwidth: Positive | None = None
    floor: _Share = 0.2
    authority: dict[str, Positive] = pydantic.Field(default_factory=dict)
    slew: dict[str, Positive] = pydantic.Field(default_factory=dict)


def policy_of(scenario: Scenario, points: OperatingPoints) -> Accommodation | None:
    """The policy that the scenario asks for (None: none), designed at `points`.

    Raises `InputError` that names the key of the first mistake.
    """
    if scenario.accommodation is None:
        return None
    where = f"{scenario.source}: [accommodation]"
    table = typed(_Accommodation, scenario.accommodation, where)
    return _Builder(table, scenario, points, where).policy()


class _Builder:
    def __init__(
        self, table: _Accommodation, scenario: Scenario, points: OperatingPoints, where: str
    ) -> None:
        self.table, self.scenario, self.points, self.where = table, scenario, points, where
        self.signals = scenario.plant.signals

    def fail(self, message: str) -> InputError:
        return InputError(f"{self.where} {message}.")

    def policy(self) -> Accommodation:
        self.check_loop()
        self.check_keys()
        table = self.table
        desired = None if table.desired is None else self.desired(table.desired)
        if table.policy == "adrc":
            assert desired is not None
            estimator, rate = self.total_disturbance(desired)
        else:
            estimator = ByPosterior(self.watch())
            rate = 1 / float(estimator.watch.modes.memory)
        model = estimator.plant
        return accommodation(
            table.policy,
            estimator,
            model if desired is None else desired,
            self.limits(),
            outcome(model, self.points, self.regulated(), SLOWLY * rate),
            table.floor,
        )

    def check_loop(self) -> None:
        for each in self.signals.inputs:
            if each.hold != "zero":
                raise self.fail(
                    f'needs inputs that are held, but the plant says hold = "{each.hold}" for '
                    f"{each.name!r}"
                )
            if each.delay:
                raise self.fail(
                    f"needs inputs that act at once, but the plant says delay = {each.delay:g} "
                    f"for {each.name!r}; remove one of them"
                )
        drops = [f.name for f in self.scenario.faults if f.effect == "dropout"]
        if self.scenario.flight and drops:
            raise self.fail(
                f"cannot be flown with the dropout {drops[0]!r}: in a flight the policy reads "
                "every sample; remove one of them"
            )

    def check_keys(self) -> None:
        """What a policy needs is there, and what it has no use for is not."""
        table, policy = self.table, self.table.policy
        if policy in DESIRED and table.desired is None:
            raise self.fail(
                f'policy = "{policy}" needs `desired`, the plant that the controller is '
                "to see (for a wheel: ideal_wheel)"
            )
        useless = {"desired": policy not in DESIRED}
        useless |= {"fault": policy != "adrc", "bandwidth": policy != "adrc"}
        for key, found in useless.items():
            if found and getattr(table, key) is not None:
                raise self.fail(f'policy = "{policy}" has no use for `{key}`; remove it')
        if policy == "adrc" and table.model is not None:
            raise self.fail('policy = "adrc" knows `desired` alone; remove `model`')

    def watch(self) -> Watch:
        """The watch of the calibrated model, over everything that the scenario measures."""
        model = self.model()
        self.check_alike("model", str(self.table.model), model.plant)
        columns = (*self.signals.input_names, *self.signals.output_names)
        try:
            return Watch(model, columns, self.scenario.step)
        except InputError as wrong:
            raise InputError(f"{self.where} model = {self.table.model!r}: {wrong}") from None

    def model(self) -> Model:
        name = self.table.model
        if name is None:
            raise self.fail(
                f'policy = "{self.table.policy}" needs `model`, whose posterior says what to act '
                "upon: a model file (.fgm) made by `faultgauge fit` and `faultgauge calibrate`"
            )
        path = self.scenario.folder / name
        if path.suffix != ".fgm":
            raise self.fail(
                f"model = {name!r} is no model file (.fgm), and a posterior needs one; make it by "
                "`faultgauge fit` and `faultgauge calibrate`"
            )
        model = load_model(path)
        if lacking := uncalibrated(model):
            raise self.fail(
                f"model = {name!r} is {lacking}, so it says nothing of faults; run "
                f"`faultgauge calibrate {path} LOG...` on healthy logs"
            )
        return model

    def desired(self, name: str) -> GrayBoxPlant:
        plant = trained_plant(name, f"{self.where} desired", self.scenario.folder)
        self.check_alike("desired", name, plant)
        return plant

    def check_alike(self, key: str, name: str, plant: GrayBoxPlant) -> None:
        """The plant named at `key` has the scenario's signals."""
        for kind in ("state_names", "input_names", "output_names"):
            own, other = getattr(self.signals, kind), getattr(plant.signals, kind)
            if own != other:
                raise InputError(
                    f"{self.where} {key} = {name!r}: has the {kind.removesuffix('_names')}s "
                    f"{', '.join(other)}, but the scenario's plant has {', '.join(own)}; they must "
                    "be the same, in the same order."
                )

    def total_disturbance(self, desired: GrayBoxPlant) -> tuple[TotalDisturbance, float]:
        """An ESO of the one fault that stands for all, and its bandwidth [rad/s]."""
        fault = self.fault(desired)
        model = with_faults(desired, (fault,))
        bandwidth = self.table.bandwidth or model.signals.observation.bandwidth
        if bandwidth is None:
            raise self.fail(
                "key 'bandwidth' is missing, and the plant has none in [observer]; add it (rad/s)"
            )
        step = self.scenario.step
        rate = fastest_rate(model, self.points.x, self.points.u)
        longest = RATE_STEP / rate if rate > 0 else step
        outputs = model.signals.observation.outputs or model.signals.output_names
        design = design_eso(
            model, fault.name, self.points, step, float(bandwidth), outputs, longest
        )
        return TotalDisturbance(design.observer), float(bandwidth)

    def fault(self, desired: GrayBoxPlant) -> Fault:
        known = {fault.name: fault for fault in desired.signals.faults}
        name = self.table.fault
        if name is None and len(known) == 1:
            return next(iter(known.values()))
        if name is None:
            raise self.fail(
                f"needs `fault`, the one of `desired` that stands for whatever differs: "
                f"{', '.join(known) or 'it declares none'}"
            )
        if name not in known:
            raise InputError(f"{self.where} fault: {unknown('fault', name, known)}.")
        return known[name]

    def limits(self) -> Limits:
        """By input; half of the way from the middle of its range to a limit, in a second."""
        for key in ("authority", "slew"):
            for name in getattr(self.table, key):
                if name not in self.signals.input_names:
                    problem = unknown("input", name, self.signals.input_names)
                    raise InputError(f"{self.where} {key}: {problem}.")
        authority, slew = [], []
        for each in self.signals.inputs:
            half = (each.max - each.min) / 4
            most = self.table.authority.get(each.name, half)
            if not np.isfinite(most):
                raise self.fail(
                    f"authority: input {each.name!r} has no limits of its own; say how much of it "
                    "a compensation may take"
                )
            authority.append(most)
            slew.append(self.table.slew.get(each.name, most))
        return Limits(jnp.array(authority), jnp.array(slew))

    def regulated(self) -> tuple[int, ...]:
        """The states that the loop controls: those behind outputs with feedback, or all that are
        measured."""
        gains = self.scenario.controller
        used = np.any((np.asarray(gains.kp) != 0) | (np.asarray(gains.ki) != 0), axis=0)
        every = [output.measures for output in self.signals.outputs]
        chosen = [m for m, u in zip(every, used, strict=True) if u and m] or [m for m in every if m]
        if not chosen:
            raise self.fail(
                "needs an output whose value is exactly a state: it tells what to keep where it is"
            )
        return tuple(self.signals.state_names.index(name) for name in dict.fromkeys(chosen))
