"""`fit`: a model from healthy logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

from faultgauge.detection.answer.alarmed import refuse_alarms
from faultgauge.detection.words import number
from faultgauge.identification import fit as identification
from faultgauge.identification.fit import FitReport
from faultgauge.identification.unseen import Unseen, on_unseen
from faultgauge.identification.validation.evaluation import evaluate
from faultgauge.plants.model import Model
from faultgauge.plants.signals import spoken
from faultgauge.telemetry import check_same_units
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import plant as as_plant
from faultgauge.verbs.reading import Runs, runs_for_plant
from faultgauge.verbs.result import Columns, Result

__all__ = ["Fit", "fit"]


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result):
    """What a fit found.

    **Fields**

    - `model`: the fitted model; with several seeds, that of the first.
    - `parameters`: every fitted value by name.
    - `unseen`: its free runs over held-out data, None where that is too short; found when asked.
    - `account`: how it came about; `fits` are (model, account) of every seed.
    - `warnings`: about the logs and the fit.
    """

    fits: list[tuple[Model, FitReport]]
    runs: Runs
    held: Runs
    warnings: Sequence[str]

    @property
    def model(self) -> Model:
        """The fitted model; with several seeds, that of the first."""
        return self.fits[0][0]

    @property
    def account(self) -> FitReport:
        """How the fit came about."""
        return self.fits[0][1]

    @property
    def parameters(self) -> dict[str, float]:
        """Every parameter's value, by name."""
        return {name: float(value) for name, value in self.model.plant.parameters.items()}

    @cached_property
    def unseen(self) -> Unseen | None:
        """Free runs over held-out data; None where those are too short."""
        return on_unseen(self.model, self.account, self.runs, self.held, self.fits[1:])

    @property
    def lines(self) -> list[str]:
        return [*self._values(), *self._errors()]

    def as_dict(self) -> dict[str, Any]:
        record, information = self.model.record, self.account.information
        return {
            "parameters": self.parameters,
            "metrics": record.metrics.as_dict(),
            "derivatives": record.derivatives,
            "noise": record.noise,
            "envelope": {name: list(ends) for name, ends in record.envelope.items()},
            "choices": record.choices.as_dict(),
            "refinement": record.metrics.refinement,
            "equation_error": information.to_dict() if information else None,
            "members": len(self.model.members),
            "warnings": self.account.warnings,
            "validation": self.unseen.validation.to_dict() if self.unseen else None,
        }

    def columns(self) -> Columns:
        """A row per parameter: value, standard error where it is known, unit."""
        shown = self.model.plant.spec.parameters
        return {
            "parameter": [each.name for each in shown],
            "value": [self.parameters[each.name] for each in shown],
            "standard_error": [self._error(each) for each in shown],
            "unit": [each.unit for each in shown],
            "fitted": [not each.fixed for each in shown],
        }

    def page(self) -> Any:
        from faultgauge.reporting.chapters import fit_report

        return fit_report(self.model, self.account, self.unseen, given=bool(self.held))

    def figures(self) -> Any:
        """Free runs over held-out data, or over all where too little was held out."""
        from faultgauge.reporting.chapters import evaluation_section

        model = self.model
        between = model.record.between
        found = self.unseen or evaluate(model.plant, self.runs, model.max_step, between=between)
        return evaluation_section(model, found[0], found[1]).figures

    def _error(self, parameter: Any) -> float | None:
        """The standard error; none of what varies, of which the runs tell their own values: the
        common one leans on the prior."""
        account = self.account
        known = account.refinement.information if account.refinement else account.information
        errors = {each.name: each.standard_error for each in known.constants} if known else {}
        return None if parameter.fixed or parameter.vary else errors.get(parameter.name)

    def _shift(self, parameter: Any) -> str | None:
        """What noise or the model's errors do to it, where that is worth a word."""
        refinement = self.account.refinement
        known = refinement.information if refinement else self.account.information
        return {c.name: c.shift for c in known.constants}.get(parameter.name) if known else None

    def _values(self) -> list[str]:
        """A line for every fitted parameter: value, standard error where it is known, unit."""
        refinement, lines = self.account.refinement, []
        for p in self.model.plant.spec.parameters:
            if not p.fixed:
                error, unit = self._error(p), spoken(p.unit)
                width = "" if error is None else f" +- {number(error, 2)}"
                line = f"{p.name} = {self.parameters[p.name]:.6g}{width} {unit}".rstrip()
                shift = self._shift(p)
                lines.append(line if shift is None else f"{line} ({shift})")
                own = refinement.per_run.get(p.name, {}) if refinement else {}
                for run, each in own.items():
                    said = f"  run {run}: {each:.6g} {unit}".rstrip()
                    limit = "min" if each < p.min else "max" if each > p.max else ""
                    if limit:
                        end = f"{limit} = {getattr(p, limit):g}"
                        said += (
                            f" (outside of the file's {end}, which limits the common value only)"
                        )
                    lines.append(said)
        return lines

    def _errors(self) -> list[str]:
        """The free run's error on held-out data, of the model and over the seeds."""
        errors = [each.record.metrics.free_run_error for each, _ in self.fits]
        refined = self.account.refinement
        refitted = refined is not None and refined.refitted
        before = ", before the model was fitted to them, too" if refitted else ""
        lines = [
            f"on held-out data the free run is off by {self.account.free_run(errors[0])}{before}"
        ]
        if len(errors) > 1:
            lines.append(
                f"over {len(errors)} seeds: {100 * min(errors):.2f} % to {100 * max(errors):.2f} %"
            )
        return lines


@reads
def fit(
    plant: Any,
    sources: Any,
    *,
    validate: Any = None,
    refine: bool | None = None,
    robust: bool = False,
    ensemble: bool = False,
    restarts: int = 10,
    seed: int = 0,
    seeds: int = 1,
    despite_alarms: bool = False,
    replaces: Path | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Fit:
    """Learn a plant's unknowns from healthy logs.

    **Arguments**

    - `plant`: a plant, a plant file, a preset, the text of a plant file, or a dict (`plant`).
    - `sources`: the healthy logs: paths, data frames, dicts of arrays, runs, or a list of them
      (`read`, which also says what `time`, `time_format`, `map`, `where` and `resample` mean);
      the model remembers the first three for logs to come.
    - `validate`: logs to stop and select on, never to fit; else a part of the logs is held out.
    - `refine`: go on to the simulation error; by default where a state is hidden, a parameter
      varies or a sensor is slower than the rows, and with `robust` or `ensemble`.
    - `robust`: bound what an outlier can do. `ensemble`: keep the next best models, too.
    - `restarts`: how many starts; `seed` of the starts; `seeds`: fit with so many, from `seed` on.
    - `despite_alarms`: fit logs that stand under alarm, too, by a column `status` of theirs or by
      the calibrated model in the file `replaces`, whose place the new one takes.
    - `progress`: is told what is being done.

    Returns a `Fit`: its `.model` is for `calibrate`. Raises `InputError` for logs that cannot be
    read, do not tell the unknowns, or stand under alarm.
    """
    untrained = as_plant(plant)
    how = How(**reading)
    runs = runs_for_plant(untrained.spec, sources, how, fitting=True)
    held = Runs([], [], how)
    if validate is not None:
        held = runs_for_plant(untrained.spec, validate, how)
    both, how = [*runs, *held], runs.how
    check_same_units(both, how.maps)
    if not despite_alarms:
        read = [*runs.sources, *held.sources]
        refuse_alarms(both, read, how.time, how.maps, how.where, replaces, how.time_format)
    asked = {"refine": refine, "robust": robust, "ensemble": ensemble, "restarts": restarts}
    fits = [
        identification.fit(untrained, runs, held, seed=seed + k, progress=progress, **asked)
        for k in range(seeds)
    ]
    fits = [(model.with_reading(how.said), account) for model, account in fits]
    return Fit(fits, runs, held, fits[0][1].warnings)
