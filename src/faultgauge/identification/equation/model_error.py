"""How far the constants of an equation error are off where the plant is not its model.

Groups of equations share no unknowns, so each is looked at in the form that it was fitted in. With
simulated instruments the slopes are those at the instruments, which know no noise: G in the place
of J. Only filtered equations let columns come late: instruments make up for that, and the weak form
reads other noise at every shift.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.identification.constants import LateColumn
from faultgauge.identification.equation.fit import GroupReport, Material
from faultgauge.identification.equation.groups import Group, equation_errors, target_scales
from faultgauge.identification.equation.simulated_instruments import Freed
from faultgauge.identification.equation.weak_form import WeakErrors, weak_samples, weak_states
from faultgauge.identification.model_error import (
    MOST_ALONG,
    BandScatter,
    InOrder,
    agreed,
    band_scatter,
    delays,
)
from faultgauge.identification.optimise.means import means_of, points_of
from faultgauge.identification.samples import Channels, Samples
from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.programs import program

__all__ = ["off_by_model", "residuals_at"]

SHIFTED = 4  # samples to either side, or half a kernel if that is more: closer ones share noise


def off_by_model(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    how: Channels,
    reports: Sequence[GroupReport],
    given: Material,
    free: Bool[np.ndarray, "unknowns"],
) -> tuple[BandScatter, tuple[LateColumn, ...]]:
    """(how far the parameters are off, columns that come late), of those that are `free`.

    Networks make up for what a file lacks, so nothing is looked for beside these; nor at the file's
    own values, which this error has not found, nor beside instruments from the log.
    """
    nothing = agreed(len(unknowns.parameters))
    found_here = [e for e in reports if not (e.stated or e.group.networks)]
    if unknowns.networks:
        return nothing, ()
    alone = [e for e in found_here if e.form == "weak" or isinstance(e.freed, Freed)]
    bands = [band_scatter(_alone(plant, unknowns, how, e, given, free)) for e in alone]
    late: tuple[LateColumn, ...] = ()
    plain = [each for each in found_here if each.form == "filtered" and not each.freed]
    if plain:
        columns = _columns(plant, how)
        parts = _along(plant, unknowns, list(columns.values()), plain, given, free)
        found, own = delays(parts), band_scatter(parts)
        bands.append(own._replace(off=np.hypot(own.off, found.moved)))
        inputs = plant.signals.input_names
        late = tuple(
            LateColumn(
                name,
                abs(float(found.seconds[k])),
                float(found.errors[k]),
                name in inputs,
                abs(float(found.seconds[k])) / parts[0].step,
            )
            for k, name in enumerate(columns)
            # a plant follows an input later where its column comes too early
            if found.sure[k] and (found.seconds[k] < 0) == (name in inputs)
        )
    return BandScatter(*np.sum([nothing, *bands], axis=0)), late


def _along(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    columns: Sequence[dict[str, list[int]]],
    reports: Sequence[GroupReport],
    given: Material,
    free: Bool[np.ndarray, "unknowns"],
) -> list[InOrder]:
    """What every stretch says, in the order of the log."""
    share = MOST_ALONG // len(given.stretches)
    stretches = [s.samples.take(np.arange(min(len(s.t), share))) for s in given.stretches]
    shift = max(SHIFTED, given.stretches[0].reach)
    stretches = [samples for samples in stretches if len(samples.x) > 2 * shift]
    theta = jnp.asarray(unknowns.vector(plant))
    scales = [jnp.asarray(target_scales(each.group, given.training)) for each in reports]

    def errors(moved: Sequence[Samples]) -> tuple[np.ndarray, np.ndarray]:
        samples = jax.tree.map(jnp.asarray, _joined(moved))
        found = [
            residuals_at(theta, samples, plant, unknowns, each.group, equation_errors, scale)
            for each, scale in zip(reports, scales, strict=True)
        ]
        r, J = (np.concatenate(each, axis=1) for each in zip(*found, strict=True))
        return r, J

    r, J = errors(stretches)
    slopes = [
        errors([_shifted(s, where, shift) for s in stretches])[0]
        - errors([_shifted(s, where, -shift) for s in stretches])[0]
        for where in columns
    ]
    step = given.stretches[0].step
    C = np.stack(slopes, axis=-1) / (2 * shift * step)
    ends, inner = np.cumsum([len(s.x) for s in stretches])[:-1], slice(shift, -shift)
    parts = zip(*(np.split(each, ends) for each in (r, J * free, C)), strict=True)
    return [InOrder(r[inner], J[inner], C[inner], step) for r, J, C in parts]


def _alone(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    how: Channels,
    report: GroupReport,
    given: Material,
    free: Bool[np.ndarray, "unknowns"],
) -> list[InOrder]:
    """The same of a group with simulated instruments, or in the weak form, at samples a quarter of
    a kernel apart, as that takes them."""
    stretches, group = given.stretches, report.group
    share, freed = MOST_ALONG // len(stretches), report.freed
    apart = 1 if freed else max(stretches[0].reach // 2, 1)
    at = [np.arange(0, min(len(s.t), share), apart) for s in stretches]
    starts = np.cumsum([0, *(len(s.t) for s in stretches)])
    places = np.concatenate([start + each for start, each in zip(starts, at, strict=False)])
    theta = jnp.asarray(unknowns.vector(plant))

    def told(points: Any, errors: Callable[..., Array]) -> tuple[Array, Array]:
        scales = jnp.asarray(target_scales(group, points))
        points = jax.tree.map(jnp.asarray, points)
        return residuals_at(theta, points, plant, unknowns, group, errors, scales)

    if isinstance(freed, Freed):
        samples, exogenous = (each.take(places) for each in freed.along)
        r, J = told(samples, equation_errors)[0], told(exogenous, equation_errors)[1]
    else:
        samples = [s.samples.take(each) for s, each in zip(stretches, at, strict=True)]
        states = weak_states(plant.spec, how, group)
        points = weak_samples(plant.signals, stretches, places, _joined(samples))
        r, J = told(points.of_group(group, states), WeakErrors(states))
    ends = np.cumsum([len(each) for each in at])[:-1]
    parts = zip(np.split(np.asarray(r), ends), np.split(np.asarray(J * free), ends), strict=True)
    return [InOrder(r, J, J[..., :0], apart * stretches[0].step) for r, J in parts]


def _joined(parts: Sequence[Samples]) -> Samples:
    return Samples(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _columns(plant: GrayBoxPlant, how: Channels) -> dict[str, dict[str, list[int]]]:
    """Where in `Samples` each column of the log stands."""
    found: dict[str, dict[str, list[int]]] = {}
    for k, (column, _) in enumerate(how.sources):
        for field in ("x", "dx"):
            found.setdefault(column, {}).setdefault(field, []).append(k)
    for k, name in enumerate(plant.signals.output_names):
        if name in how.outputs:
            found.setdefault(name, {}).setdefault("y", []).append(k)
    return found | {name: {"u": [k]} for k, name in enumerate(plant.signals.input_names)}


def _shifted(samples: Samples, where: dict[str, list[int]], shift: int) -> Samples:
    """`samples` in which one column is read so many samples later."""
    fields = samples._asdict()
    for name, columns in where.items():
        fields[name] = fields[name].copy()
        fields[name][:, columns] = np.roll(fields[name][:, columns], -shift, axis=0)
    return Samples(**fields)


@program
def residuals_at(
    theta: Float[Array, "unknowns"],
    samples: Any,
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    group: Group,
    errors: Callable[[GrayBoxPlant, Group, Any], Array],
    scales: Float[Array, "equations"],
) -> tuple[Float[Array, "samples equations"], Float[Array, "samples equations unknowns"]]:
    """(`errors` of the group at every sample, each over its scale; their Jacobian), 0 where either
    is not finite: LAPACK may not end on what is infinite."""

    def error(theta: Array, sample: Any) -> tuple[Array, Array]:
        r = errors(unknowns.assemble(plant, theta), group, sample) / scales
        return r, r

    J, r = jax.vmap(jax.jacrev(error, has_aux=True), (None, 0))(theta, points_of(samples))
    J, r = (means_of(samples, each.T).T for each in (J, r))
    tells = jnp.isfinite(r) & jnp.all(jnp.isfinite(J), axis=-1)
    return jnp.where(tells, r, 0.0), jnp.where(tells[..., None], J, 0.0)
