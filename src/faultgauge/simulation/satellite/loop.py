"""The closed attitude loop: one pure step; a run is a scan, many runs are a batch.

    I d(omega)/dt = -omega x (I omega + A h) - A T + T_ext,    d(h)/dt = F(h, u) + faults

A holds the wheels' axes; T is each wheel's torque output, which the body feels with the opposite
sign: d(h)/dt, unless a fault enters that output, as eq (18) of the paper has it.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from faultgauge.plants.plant import Plant, Stuck, respond
from faultgauge.programs import program
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.satellite import rotations
from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.determination import AttitudeEstimate, AttitudeFilter
from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors

__all__ = ["NOISES", "Now", "Satellite", "SatelliteState", "Telemetry", "fly", "start", "step"]

NOISES = 10  # standard normal numbers per step: gyro 3, its bias 3, earth 2, sun 2


class Satellite(eqx.Module):
    """Everything that does not change during a run. SI units, angles in rad.

    `wheel` is any plant with one state (momentum), one input (torque command) and the outputs
    torque and momentum, in this order; `axes` holds the wheels' directions, one column each.
    `disturbance` acts on the body: constant, and amplitude at the orbital rate. With `stacked` each
    wheel has numbers of its own: the leaves of `wheel` have the wheels first. A `policy` turns the
    torque wanted on the body [N*m] into the wheels' commands, in place of `allocation`; it reads
    the wheels' outputs, the momentum with noise of standard deviation `tachometer` [N*m*s].
    """

    wheel: Plant
    axes: Float[Array, "3 wheels"]
    allocation: Float[Array, "wheels 3"]  # the pseudo-inverse of `axes`
    inertia: Float[Array, "3"]
    disturbance: Float[Array, "2 3"]
    orbit: Orbit
    gyro: Gyro
    earth: EarthSensor
    sun: SunSensors
    filter: AttitudeFilter
    controller: AttitudeController
    dt: float  # control period
    substeps: int = eqx.field(static=True)  # RK4 steps in it
    policy: Policy | None = None
    tachometer: float = 0.0
    stacked: bool = eqx.field(static=True, default=False)


class SatelliteState(NamedTuple):
    """What is carried from step to step (a checkpoint)."""

    step: Int[Array, ""]
    q: Float[Array, "4"]
    omega: Float[Array, "3"]
    h: Float[Array, "wheels"]
    angle: Float[Array, "3"]  # integrated rate, as the gyro's wheel has it
    counted: Float[Array, "3"]
    bias: Float[Array, "3"]
    estimate: AttitudeEstimate
    policy: Any = ()  # (last command, state) where there is one


class Now(NamedTuple):
    """What happens during one step: noise, and each wheel's faults per integration step.

    `noise` has a number per wheel more where a policy reads the tachometers.
    """

    noise: Float[Array, "noises"]
    f: Float[Array, "substeps wheels faults"]
    stuck: Stuck


class Telemetry(NamedTuple):
    """One sample at the controller's rate: what is known on board, and the truth."""

    t: Float[Array, ""]
    u: Float[Array, "wheels"]  # torque command inside the wheel's limits
    torque: Float[Array, "wheels"]  # T and h as the wheels telemeter them, without noise
    momentum: Float[Array, "wheels"]
    rate: Float[Array, "wheels"]  # d(h)/dt, true
    attitude: Float[Array, "3"]  # true roll, pitch, yaw against the orbit frame, rad
    estimated: Float[Array, "3"]
    sunlit: Array
    read: Any = ()  # the wheels' outputs as a policy read them
    info: Any = ()  # what it tells


def start(
    satellite: Satellite,
    angles: Float[Array, "3"],
    h: Float[Array, "wheels"],
    error: Float[Array, "3"],
) -> SatelliteState:
    """At rest against the orbit frame, turned by `angles` (roll, pitch, yaw), wheel momenta `h`;
    attitude is first known to within `error` [rad]."""
    orbit = satellite.orbit
    turn = rotations.from_angles(*angles)
    q = rotations.product(orbit.frame(jnp.zeros(())), turn)
    omega = rotations.into_frame(turn, orbit.frame_rate)
    variance = jnp.concatenate([jnp.maximum(error**2, 1e-6), jnp.full(3, 1e-10)])
    estimate = AttitudeEstimate(
        rotations.product(q, rotations.from_vector(error)),
        jnp.zeros(3),
        jnp.diag(variance),
        omega,
    )
    zero, policy = jnp.zeros(3), ()
    if satellite.policy is not None:
        policy = (jnp.zeros_like(h), satellite.policy.init(h, jnp.zeros_like(h)))
    bias = jnp.array(satellite.gyro.bias)
    return SatelliteState(jnp.asarray(0), q, omega, h, zero, zero, bias, estimate, policy)


def step(satellite: Satellite, state: SatelliteState, now: Now) -> tuple[SatelliteState, Telemetry]:
    """One control period: sense, estimate, command, and let the physics run under it."""
    orbit = satellite.orbit
    t = state.step * satellite.dt
    state = _determine(satellite, state, t, now.noise)
    wanted = satellite.controller.torque(
        state.estimate, orbit.frame(t), orbit.frame_rate, satellite.axes @ state.h
    )
    first = jax.tree.map(lambda a: a[0], now.stuck)
    u, policy, read, info = _command(satellite, state, wanted, now, first)
    dh, y = _wheels(satellite, state.h, u, now.f[0], first)
    relative = rotations.conjugate(orbit.frame(t))
    telemetry = Telemetry(
        t=t,
        u=u,
        torque=y[:, 0],
        momentum=y[:, 1],
        rate=dh,
        attitude=rotations.to_angles(rotations.product(relative, state.q)),
        estimated=rotations.to_angles(rotations.product(relative, state.estimate.q)),
        sunlit=orbit.sunlit(t),
        read=read,
        info=info,
    )
    return _advance(satellite, state._replace(policy=policy), t, u, now), telemetry


def _command(
    satellite: Satellite, state: SatelliteState, wanted: Array, now: Now, stuck: Stuck
) -> tuple[Array, Any, Any, Any]:
    """(commands inside the wheels' limits; the policy's next state, what it read, its info)."""
    limit = satellite.wheel.signals.inputs[0]
    if satellite.policy is None:
        return jnp.clip(-satellite.allocation @ wanted, limit.min, limit.max), (), (), ()
    last, inner = state.policy
    y = _wheels(satellite, state.h, last, now.f[0], stuck)[1]
    y = y.at[:, 1].add(satellite.tachometer * now.noise[NOISES:])
    inner, u, info = satellite.policy.step(inner, wanted, y, jnp.asarray(satellite.dt))
    u = jnp.clip(u, limit.min, limit.max)
    return u, (u, inner), y, info


def _determine(
    satellite: Satellite, state: SatelliteState, t: Array, noise: Array
) -> SatelliteState:
    """Read the sensors and bring the attitude estimate to this sample."""
    orbit, gyro, dt = satellite.orbit, satellite.gyro, satellite.dt
    root = jnp.sqrt(dt)
    angle = state.angle + state.bias * dt + gyro.arw * root * noise[0:3]
    counted = gyro.counts(angle)
    estimate = satellite.filter.propagate(state.estimate, counted - state.counted, dt)
    # at the very start no period has passed: nothing was counted and nothing turned
    first = state.step == 0
    estimate = jax.tree.map(lambda old, new: jnp.where(first, old, new), state.estimate, estimate)
    nadir, sun = -orbit.position(t), orbit.sun
    earth_seen = satellite.earth.measure(rotations.into_frame(state.q, nadir), noise[6:8])
    sun_seen = satellite.sun.measure(
        rotations.into_frame(state.q, sun), orbit.sunlit(t), noise[8:10]
    )
    estimate = satellite.filter.correct(estimate, earth_seen, nadir, satellite.earth.sigma)
    estimate = satellite.filter.correct(estimate, sun_seen, sun, satellite.sun.sigma)
    return state._replace(
        angle=angle,
        counted=counted,
        bias=state.bias + gyro.rrw * root * noise[3:6],
        estimate=estimate,
    )


def _wheels(
    satellite: Satellite, h: Array, u: Array, f: Array, stuck: Stuck
) -> tuple[Array, Array]:
    """(d(h)/dt, outputs) of every wheel. At a limit of its state a wheel takes up no more."""
    limits = satellite.wheel.signals.states[0]

    def one(wheel: Plant, h: Array, u: Array, f: Array, stuck: Stuck) -> tuple[Array, Array]:
        dx, y = respond(wheel, h[None], u[None], f, stuck)
        if limits.min == -jnp.inf and limits.max == jnp.inf:
            return dx[0], y
        full = ((h >= limits.max) & (dx[0] > 0)) | ((h <= limits.min) & (dx[0] < 0))
        held = stuck._replace(dx=jnp.where(full, 0.0, stuck.dx))
        dx, y = respond(wheel, h[None], u[None], f, held)
        return dx[0], y

    each = eqx.if_array(0) if satellite.stacked else None
    return eqx.filter_vmap(one, in_axes=(each, 0, 0, 0, 0))(satellite.wheel, h, u, f, stuck)


class _Motion(NamedTuple):
    q: Array
    omega: Array
    h: Array
    angle: Array


def _advance(
    satellite: Satellite, state: SatelliteState, t: Array, u: Array, now: Now
) -> SatelliteState:
    """RK4 over one control period; faults are held over each integration step."""
    step = satellite.dt / satellite.substeps

    def add(a: _Motion, b: _Motion, factor: float) -> _Motion:
        return jax.tree.map(lambda p, r: p + factor * r, a, b)

    def integrate(carried: tuple[Array, _Motion], held: tuple[Array, Stuck]) -> tuple:
        t, x = carried
        f, stuck = held
        k1 = _rates(satellite, t, x, u, f, stuck)
        k2 = _rates(satellite, t + step / 2, add(x, k1, step / 2), u, f, stuck)
        k3 = _rates(satellite, t + step / 2, add(x, k2, step / 2), u, f, stuck)
        k4 = _rates(satellite, t + step, add(x, k3, step), u, f, stuck)
        slope = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
        x = add(x, slope, step)
        return (t + step, x._replace(q=rotations.normalised(x.q))), None

    x = _Motion(state.q, state.omega, state.h, state.angle)
    (_, x), _ = jax.lax.scan(integrate, (t, x), (now.f, now.stuck))
    return state._replace(step=state.step + 1, q=x.q, omega=x.omega, h=x.h, angle=x.angle)


def _rates(satellite: Satellite, t: Array, x: _Motion, u: Array, f: Array, stuck: Stuck) -> _Motion:
    dh, y = _wheels(satellite, x.h, u, f, stuck)
    inertia, axes = satellite.inertia, satellite.axes
    constant, orbital = satellite.disturbance
    outside = constant + orbital * jnp.sin(satellite.orbit.rate * t)
    total = inertia * x.omega + axes @ x.h
    omega = (outside - axes @ y[:, 0] - jnp.cross(x.omega, total)) / inertia
    spin = jnp.concatenate([jnp.zeros(1), x.omega])
    return _Motion(rotations.product(x.q, spin) / 2, omega, dh, x.omega)


@program
def fly(
    satellite: Satellite, begin: SatelliteState, during: Now
) -> tuple[SatelliteState, Telemetry]:
    """A run: (state after it, telemetry of every step). `during` has the steps first."""
    return jax.lax.scan(lambda state, now: step(satellite, state, now), begin, during)
