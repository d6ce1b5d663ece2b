"""The chapter that has to convince a sceptic: what the model does on data it never saw."""

from collections.abc import Sequence

from faultgauge.identification.validation.evaluation import Prediction
from faultgauge.identification.validation.operating import Profile
from faultgauge.identification.validation.ranges import Range
from faultgauge.identification.validation.validate import (
    OutputValidation,
    Validation,
    errors_of,
    tested,
)
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.style import pretty_unit, quantity
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.validation_figures import (
    correlations,
    error_band,
    operating_points,
    ranges,
)

__all__ = ["noise_table", "validation_section", "verdicts"]

MOST_OUTPUTS = 4  # with figures: three each
LEVEL = 0.95  # of the band that is asked for
LITTLE, MUCH = 0.05, 0.5  # of the error's variance
FEW_INDEPENDENT = 40.0  # with fewer, even all inside would leave room for 91 %


def validation_section(
    plant: GrayBoxPlant, found: Validation, predictions: Sequence[Prediction]
) -> Section:
    """One sentence per test, the numbers behind them, and the figures."""
    figures: list[Figure] = []
    for output in [each for each in found.outputs if each.band is not None][:MOST_OUTPUTS]:
        figures += _figures(plant, output, predictions)
    covered = ranges(found.ranges)
    lines = tuple(line for output in found.outputs for line in verdicts(output))
    return Section(
        "Validation on unseen data",
        (
            "Tests on free runs over data that the model was not fitted to; e is measured minus "
            "free run.",
            *lines,
            *_outside(found.ranges),
        ),
        (_numbers(found.outputs), _range_table(found.ranges)),
        (*figures, *((covered,) if covered else ())),
    )


def noise_table(model: Model, found: Validation) -> tuple[Table, ...]:
    """The free run's error on unseen data beside the noise of each output's own samples."""
    rows = []
    for each in found.outputs:
        sd = model.record.noise.get(each.name, {}).get("sd")
        if sd is None or each.rmse is None or each.bias is None:
            continue
        left = max(each.rmse**2 - each.bias**2, 0.0) ** 0.5
        times = f"{left / sd:.3g}" if sd > 0 else ""
        rows.append((each.name, quantity(sd, each.unit), quantity(left, each.unit), times))
    said = (
        "Standard deviations. Near 1 the model is at the noise floor and no fit of these data can "
        "do better; above it, the rest is the model's error, or what disturbs the plant."
    )
    header = ("output", "noise", "error without its mean", "times the noise")
    return (Table(header, tuple(rows), said),) if rows else ()


def verdicts(output: OutputValidation) -> tuple[str, ...]:
    """One sentence per test of one output, each from its numbers."""
    name = output.name
    if output.diverges:
        return (f"{name}: the free run diverges, so nothing else was tested.",)
    if output.band is None or output.independent is None:
        return (f"{name}: {output.samples} samples are too few to test anything.",)
    sentences = [_size(output), _band(output), _whiteness(output), *_inputs(output)]
    worst = max(output.profiles, key=lambda each: each.explained - each.by_chance, default=None)
    if worst is not None:
        sentences.append(_place(worst, output))
    sentences.append(_seeds(output))
    return tuple(f"{name}: {sentence}" for sentence in sentences if sentence)


def _size(output: OutputValidation) -> str:
    assert output.bias is not None
    assert output.bias_95 is not None
    assert output.rmse is not None
    assert output.independent is not None
    share = (
        ""
        if output.nrmse is None
        else f" ({100 * output.nrmse:.2f} % of the output's spread in these data)"
    )
    lasting = abs(output.bias) > output.bias_95
    return (
        f"e is {quantity(output.rmse, output.unit)} RMS{share}; its {output.samples} samples are "
        f"worth {output.independent:.3g} independent ones, and its mean of "
        f"{quantity(output.bias, output.unit)} ± {quantity(output.bias_95, output.unit)} "
        + ("is a lasting offset." if lasting else "cannot be told from zero.")
    )


def _band(output: OutputValidation) -> str:
    band = output.band
    assert band is not None
    verdict = "the band keeps its promise" if band.holds else "the band promises too much"
    if band.holds and band.independent < FEW_INDEPENDENT:
        verdict = "too few independent samples to refute the band, or to confirm it"
    if band.low > (1.0 + band.level) / 2.0:
        verdict = "the band is wider than it need be"
    promise = f"{100 * band.level:.0f} % band"
    if band.level < LEVEL:
        promise += " (95 % would take 19 independent samples)"
    first, last = band.half_width[0], band.half_width[-1]
    growth = "" if len(band.half_width) == 1 else f" at first, ±{quantity(last, output.unit)} late"
    return (
        f"{promise} ±{quantity(first, output.unit)}{growth}; held against a band from "
        f"{band.held_against}, {100 * band.share_inside:.1f} % of the samples are inside (worst "
        f"part {100 * band.worst:.1f} %): {verdict}."
    )


def _whiteness(output: OutputValidation) -> str:
    test = output.residual
    if test is None:
        return ""
    share = f"{100 * test.share_outside:.0f} % of the lags are beyond the 95 % bound"
    if test.white:
        return f"e is white ({share}): nothing in it could be foreseen from its own past."
    return (
        f"e is not white ({share}, memory {output.time_s:.3g} s): coloured noise or missing "
        "dynamics; the tests against the inputs tell which."
    )


def _inputs(output: OutputValidation) -> list[str]:
    sentences = []
    for test in output.inputs:
        found = f"r = {test.peak:.3f} at {test.peak_lag_s:.3g} s, chance allows {test.limit:.3f}"
        if test.feedback:
            text = (
                f"input {test.name} follows e ({found}, and more at negative lags): the log was "
                "taken under feedback, which hides what the model may lack."
            )
        elif test.dependent:
            text = (
                f"e follows input {test.name} ({found}): dynamics from it are missing; at that lag "
                f"it makes up {_percent(test.peak**2)} of the variance of e."
            )
        else:
            text = (
                f"e does not follow input {test.name} ({found}): no missing dynamics found; an "
                f"effect below {_percent(min(test.limit**2, 1.0))} of the variance of e would go "
                "unseen."
            )
        sentences.append(text)
    return sentences


def _place(profile: Profile, output: OutputValidation) -> str:
    k = int(profile.rms.argmax())
    unit = profile.unit or "1"
    low, high = (quantity(float(ends[k]), unit) for ends in (profile.low, profile.high))
    where = low if low == high else f"{low} to {high}"
    text = (
        f"error is largest, {quantity(float(profile.rms[k]), output.unit)} RMS, where "
        f"{profile.name} is {where}; {_percent(profile.explained)} of its variance "
        f"goes with {profile.name}, chance allows {_percent(profile.by_chance)}"
    )
    if profile.by_chance > MUCH:
        return f"{text}: too few independent samples to tell."
    if profile.explained <= profile.by_chance:
        return f"{text}: no place stands out."
    size = "by little" if profile.explained < LITTLE else "by much"
    return f"{text}: the model is wrong in places, {size}."


def _seeds(output: OutputValidation) -> str:
    seeds = output.seeds
    if seeds is None:
        return "no other seed was tried; `fit --seeds 3` tells how much it matters."
    rmse = seeds.rmse[seeds.rmse == seeds.rmse]
    lost = len(seeds.rmse) - len(rmse)
    return (
        f"over {len(seeds.rmse)} seeds, each a whole fit, e is "
        f"{quantity(float(rmse.min()), output.unit)} to "
        f"{quantity(float(rmse.max()), output.unit)} RMS, and the free runs differ by "
        f"{quantity(seeds.spread, output.unit)} (standard deviation): "
        f"{_percent(seeds.explained)} of the mean square error is the luck of the seed"
        + (f"; {lost} diverge." if lost else ", the rest is common to all.")
    )


def _outside(found: Sequence[Range]) -> tuple[str, ...]:
    """The worst network argument, or the worst state or input where networks stay inside."""
    left = [each for each in found if each.share_outside]
    networks = [each for each in left if each.where not in ("state", "input")]
    if not left:
        return ("The unseen data stay inside the training range in every argument.",)
    worst = max(networks or left, key=lambda each: each.share_outside or 0.0)
    what = f"argument {worst.name} of {worst.where}" if networks else f"{worst.where} {worst.name}"
    far = "" if worst.beyond is None else f", by up to {100 * worst.beyond:.0f} % of its width"
    return (
        f"{100 * (worst.share_outside or 0.0):.1f} % of the unseen samples lie outside the "
        f"training range of {what}{far}: there the model extrapolates.",
    )


def _numbers(outputs: Sequence[OutputValidation]) -> Table:
    rows = []
    for each in outputs:
        band, test = each.band, each.residual
        unit = pretty_unit(each.unit) or "1"
        rows.append(
            (
                f"{each.name} [{unit}]",
                _number(each.rmse),
                _number(each.bias),
                "" if band is None else f"{band.half_width.max():.3g}",
                "" if band is None else f"{100 * band.share_inside:.1f} %",
                _number(each.time_s),
                _number(each.independent),
                "" if test is None else f"{100 * test.share_outside:.0f} %",
                *(
                    ("", "")
                    if not each.inputs
                    else (
                        f"{100 * max(i.share_outside for i in each.inputs):.0f} %",
                        f"{100 * max(i.share_outside_feedback for i in each.inputs):.0f} %",
                    )
                ),
            )
        )
    header = (
        "output",
        "RMS",
        "mean",
        "band ±",
        "inside",
        "memory [s]",
        "worth",
        "self",
        "input",
        "feedback",
    )
    caption = (
        "memory: integrated autocorrelation time; worth: that many independent samples; self, "
        "input, feedback: share of lags beyond the 95 % bound (5 % by chance)."
    )
    return Table(header, tuple(rows), caption)


def _range_table(found: Sequence[Range]) -> Table:
    def ends(pair: tuple[float, float] | None) -> str:
        return "" if pair is None else f"{pair[0]:.4g} to {pair[1]:.4g}"

    rows = tuple(
        (
            each.where,
            each.name,
            pretty_unit(each.unit),
            ends(each.training),
            ends(each.unseen),
            "" if each.share_outside is None else f"{100 * each.share_outside:.1f} %",
            "" if each.beyond is None else f"{100 * each.beyond:.1f} %",
        )
        for each in found
    )
    header = ("of", "argument", "unit", "training", "unseen", "outside", "furthest")
    caption = "furthest: how far beyond the training range, in widths of it."
    return Table(header, rows, caption)


def _figures(
    plant: GrayBoxPlant,
    output: OutputValidation,
    predictions: Sequence[Prediction],
) -> list[Figure]:
    j = plant.signals.output_names.index(output.name)
    parts = [predictions[k] for k in tested(predictions, j)]
    assert output.band is not None
    assert output.rmse is not None
    look = {"name": output.name, "unit": output.unit}
    times = [p.t[p.warmup :] - p.t[0] for p in parts]
    figures = [error_band(times, [errors_of(p, j) for p in parts], output.band, **look)]
    if output.residual is not None:
        figures.append(correlations(output.residual, output.inputs, name=output.name))
    if output.profiles:
        figures.append(operating_points(output.profiles, output.rmse, **look))
    return figures


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share < 0.1 else f"{100 * share:.0f} %"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
