"""Calibrated models without a fit: any plant file, its networks drawn, with a usual noise."""

from collections import OrderedDict

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from calibrations import for_bank
from faultgauge.detection.bank.bank import WINDOWS
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.uncertain_constants import constants_of, drifting_of
from faultgauge.plants.disturbed import answering_outputs, dynamic_states, following_inputs
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.plants.record import FitRecord
from faultgauge.simulation.free_run import simulate

STEP = 0.1


def drawn(plant, seed):
    """`plant` with small random weights in place of untrained networks."""
    rng = np.random.default_rng(seed)

    def weights(leaf):
        return jnp.asarray(leaf + 0.3 * rng.standard_normal(leaf.shape))

    names = ("weights_out", "weights_in", "bias", "bias_out")
    networks = {
        name: eqx.tree_at(
            lambda n: [getattr(n, each) for each in names],
            network,
            [weights(getattr(network, each)) for each in names],
        )
        for name, network in plant.networks.items()
    }
    return eqx.tree_at(lambda p: p.networks, plant, networks)


def calibrated(source, seed=0, step=STEP, late=False):
    """A model of the plant file, text or preset `source`, as `calibrate` would leave it; with
    `late` its first input and its sensors have lags, that input is bent, its last dynamic state
    sticks and errs more in the middle of its range, its first two faults are told alike, and
    healthy logs mimic its first one for a while. An explanation may fit somewhat worse than the
    right one."""
    text = source if "\n" in source else read_plant_text(source)
    plant = drawn(GrayBoxPlant.untrained(parse_plant(text)), seed)
    signals, rng = plant.signals, np.random.default_rng(seed)
    x = np.stack([draws(rng, s.min, s.max, s.initial) for s in signals.states], 1)
    u = np.stack([draws(rng, i.min, i.max, 0.0) for i in signals.inputs], 1)
    measured = {each.measures for each in signals.outputs}
    record = {
        "max_step": step / 2,
        "sample_time": step,
        "envelope_points": np.concatenate([x, u], 1).tolist(),
        "columns": {
            "states": [[s.name if s.name in measured else "", 0] for s in signals.states],
            "outputs": list(signals.output_names),
        },
        "data": {"fit": [], "validate": []},
        "derivatives": {},
        "envelope": {},
        "metrics": {"validation_free_run_nrmse": None},
    }
    model = Model(plant, FitRecord.model_validate(record))
    ways = len(dynamic_states(plant)), len(following_inputs(plant))
    known = len(constants_of(model).names)
    spread = 0.01 * np.abs([float(plant.values()[n]) for n in constants_of(model).names])
    noise = Noise(
        np.full(len(signals.outputs), 0.01), np.full(len(signals.states), 1e-3),
        np.full(len(drifting_of(model)), 1e-3), np.full(ways[0], 1e-3), np.full(ways[0], 5.0),
        np.full(ways[1], 1e-2), np.full(ways[1], 1.0), spread + 1e-6, np.zeros(known),
        np.zeros(known),
    )  # fmt: skip
    # more error where the last input is large
    places = np.arange(len(signals.inputs) + len(signals.states))
    last = places == len(signals.inputs) - 1
    edge = np.where(last, np.quantile(u[:, -1], 0.75), -np.inf)
    noise = noise._replace(doubt=3.0 * last, above=edge, below=np.full(len(last), np.inf))
    first = np.arange(len(signals.inputs)) == 0
    slow = np.isin(np.arange(len(signals.outputs)), answering_outputs(plant))
    if late:
        noise = noise._replace(lean=-1.0 * first, leaning=2.0 * step * first, bend=0.05 * first)
        noise = noise._replace(trail=np.where(slow, 0.0, 3.0 * step))
        stuck = np.isin(np.arange(len(signals.states)), dynamic_states(plant)[-1:])
        noise = noise._replace(grip=0.05 * stuck, gripping=3.0 * step * stuck, slip=0.1 * stuck)
        noise = noise._replace(travel=0.1 * step * stuck, jitter=0.1 * step * slow)
        there = np.append(np.zeros(len(signals.inputs), bool), stuck)
        low, high = np.quantile(x[:, np.flatnonzero(stuck)[0]], [0.25, 0.75])
        noise = noise._replace(
            doubt=np.where(there, 2.0, noise.doubt),
            above=np.where(there, low, noise.above),
            below=np.where(there, high, noise.below),
        )
    size = dict.fromkeys(signals.fault_names, 1.0)
    two = signals.fault_names[:2]
    alike = [(*two, -2.0)] if late and len(two) == 2 else []
    mimicked = {two[0]: [0.02, 0.02, 0.01, 0.0, 0.0]} if late and two else {}
    limits = [2.0] * len(WINDOWS)
    return for_bank(model, noise, size=size, alike=alike, mimicked=mimicked, nis=limits)


def draws(rng, low, high, middle):
    low, high = (b if np.isfinite(b) else middle + w for b, w in ((low, -1.0), (high, 1.0)))
    return rng.uniform(low, high, 60)


def log_of(model, count, seed=0, fault=0, size=0.3, missing=0.0):
    """Samples by name: the plant under steps of its inputs, the `fault` from the middle on, a share
    `missing` of the outputs not sampled, and a gap."""
    plant, rng = model.plant, np.random.default_rng(seed)
    signals, step = plant.signals, model.record.sample_time
    points = np.asarray(model.record.envelope_points)
    states = len(signals.states)
    u = np.repeat(points[rng.integers(0, len(points), count // 20 + 1), states:], 20, 0)[:count]
    f = np.zeros((count, len(signals.faults)))
    if signals.faults:
        f[count // 2 :, fault] = size
    dt = np.full(count, step)
    start = jnp.asarray(np.median(points[:, :states], axis=0))
    y = np.asarray(simulate(plant, start, jnp.asarray(u), jnp.asarray(dt), jnp.asarray(f), 4).y)
    y = y + 0.01 * rng.standard_normal(y.shape)
    y = np.where(rng.random(y.shape) < missing, np.nan, y)
    t = step * np.arange(count) + 20 * step * (np.arange(count) > 0.8 * count)
    columns = [("t", t), *zip(signals.input_names, u.T, strict=True)]
    columns += zip(signals.output_names, y.T, strict=True)
    read = ("t", *signals.input_names, *(signals.observation.outputs or signals.output_names))
    return OrderedDict((name, values) for name, values in columns if name in read)


def walked(step, samples):
    """What Python says of the samples, by name."""

    @jax.jit
    def walk(state, given):
        return jax.lax.scan(step.step, state, given)[1]

    given = OrderedDict((k, jnp.asarray(v)) for k, v in samples.items())
    return {k: np.asarray(v) for k, v in walk(step.state, given).items()}
