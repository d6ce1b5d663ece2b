"""The table `[accommodation]` of a scenario file: from its keys to a policy."""

from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
import pydantic
from jaxtyping import Float

from faultgauge.accommodation.alarm import Alarm
from faultgauge.accommodation.estimator import Estimator, JointFaults, SingleFault
from faultgauge.accommodation.feed_forward import Limits, outcome
from faultgauge.accommodation.policy import Accommodation, accommodation
from faultgauge.errors import InputError
from faultgauge.observers.eso import design_eso
from faultgauge.observers.joint import design_joint
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.expression import unknown
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Fault
from faultgauge.plants.toml_file import Positive, Table, typed
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.simulation.scenario import Scenario, trained_plant

__all__ = ["policy_of"]

SLOWLY = 1e-3  # of the bandwidth: the rate at which a compensation has to hold

_Share = Annotated[float, pydantic.Field(gt=0, le=1, allow_inf_nan=False)]


class _Accommodation(Table):
    policy: Literal["none", "estimate", "estimate_and_friction", "adrc"]
    model: str | None = None
    desired: str | None = None
    bandwidth: Positive | None = None
    persistence: Positive | None = None
    settling: Positive | None = None
    floor: _Share = 0.2
    alarms: Annotated[dict[str, Positive], pydantic.Field(min_length=1)]
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
        model, desired = self.plants()
        model = with_faults(model, self.hypotheses(model))
        bandwidth = self.bandwidth(model)
        alarms = [self.table.alarms[fault.name] for fault in model.signals.faults]
        alarm = Alarm(
            limits=jnp.array(alarms),
            persistence=self.table.persistence or 1.0 / bandwidth,
            settling=self.table.settling or 1.0 / bandwidth,
        )
        return accommodation(
            self.table.policy,
            self.estimator(model, bandwidth),
            alarm,
            desired,
            self.limits(),
            outcome(model, self.points, self.regulated(), SLOWLY * bandwidth),
            self.table.floor,
        )

    def check_loop(self) -> None:
        for each in self.signals.inputs:
            if each.hold != "zero":
                raise self.fail(
                    f'needs inputs that are held, but the plant says hold = "{each.hold}" for '
                    f"{each.name!r}"
                )
        drops = [f.name for f in self.scenario.faults if f.effect == "dropout"]
        if self.scenario.flight and drops:
            raise self.fail(
                f"cannot be flown with the dropout {drops[0]!r}: in a flight the policy reads "
                "every sample; remove one of them"
            )

    def plants(self) -> tuple[GrayBoxPlant, GrayBoxPlant]:
        """(what the estimator believes in, what the controller is to see)."""
        table = self.table
        if table.policy in ("estimate_and_friction", "adrc"):
            if table.desired is None:
                raise self.fail(
                    f'policy = "{table.policy}" needs `desired`, the plant that the controller is '
                    "to see (for a wheel: ideal_wheel)"
                )
        elif table.desired is not None:
            raise self.fail(f'policy = "{table.policy}" has no use for `desired`; remove it')
        if table.policy == "adrc" and table.model is not None:
            raise self.fail('policy = "adrc" knows `desired` alone; remove `model`')
        model = self.read("model", table.model)
        desired = self.read("desired", table.desired)
        return (desired, desired) if table.policy == "adrc" else (model, desired)

    def read(self, key: str, name: str | None) -> GrayBoxPlant:
        """The plant named at `key`, the scenario's own if none is, with the same signals."""
        if name is None:
            return self.scenario.plant
        where = f"{self.where} {key}"
        plant = trained_plant(name, where, self.scenario.folder)
        for kind in ("state_names", "input_names", "output_names"):
            own, other = getattr(self.signals, kind), getattr(plant.signals, kind)
            if own != other:
                raise InputError(
                    f"{where} = {name!r}: has the {kind.removesuffix('_names')}s "
                    f"{', '.join(other)}, but the scenario's plant has {', '.join(own)}; they must "
                    "be the same, in the same order."
                )
        return plant

    def hypotheses(self, model: GrayBoxPlant) -> tuple[Fault, ...]:
        known = {fault.name: fault for fault in model.signals.faults}
        for name in self.table.alarms:
            if name not in known:
                raise InputError(f"{self.where} alarms: {unknown('fault', name, known)}.")
        return tuple(fault for name, fault in known.items() if name in self.table.alarms)

    def bandwidth(self, model: GrayBoxPlant) -> float:
        found = self.table.bandwidth or model.signals.observation.bandwidth
        if found is None:
            raise self.fail(
                "key 'bandwidth' is missing, and the plant has none in [observer]; add it (rad/s)"
            )
        return float(found)

    def estimator(self, model: GrayBoxPlant, bandwidth: float) -> Estimator:
        """An ESO for one additive fault, the joint observer for several or one that multiplies."""
        step, faults = self.scenario.step, model.signals.faults
        rate = fastest_rate(model, self.points.x, self.points.u)
        longest = RATE_STEP / rate if rate > 0 else step
        chosen = model.signals.observation.outputs or model.signals.output_names
        if len(faults) == 1 and faults[0].enters in ("state", "input", "output"):
            design = design_eso(
                model, faults[0].name, self.points, step, bandwidth, chosen, longest
            )
            return SingleFault(design.observer)
        sigma = np.where([n in chosen for n in self.signals.output_names], self.sigma(), np.inf)
        return JointFaults(design_joint(model, self.points, step, bandwidth, sigma, longest))

    def sigma(self) -> Float[np.ndarray, "outputs"]:
        sigma = self.scenario.sigma
        for name, size in zip(self.signals.output_names, sigma, strict=True):
            if size == 0:
                raise InputError(
                    f"{self.scenario.source}: [noise] {name}: several faults are weighed against "
                    "each other by the noise of the outputs; give it more than 0."
                )
        return sigma

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
