"""What the verbs for fleets give: a row per unit, and what is to be said of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.fleet.folder import unit_of
from faultgauge.fleet.typical import laws_of
from faultgauge.identification.population import own_parameters
from faultgauge.plants.model import Model
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry.writing import write_table
from faultgauge.verbs.result import Columns, Result

__all__ = ["TABLE", "FleetFit", "FleetResult", "UnitFit", "failures"]

TABLE = "units.csv"
UNLIKE = 0.5  # probability of being unlike the other units, from which on it is said
SHOWN = 5  # units that a sentence names


def failures(failed: dict[str, str]) -> list[str]:
    """The units that `failed`, as warnings."""
    return [f"unit {name}: {why.rstrip('.')}" for name, why in failed.items()]


class FleetResult(Result):
    """What became of a fleet: `units` by name, `failed` with the reason, and how many were done
    `before` and are not done again; all of it stands in `folder`."""

    folder: Path
    units: dict[str, Any]
    failed: dict[str, str]
    before: int

    @property
    def title(self) -> str:
        return "Fleet"

    def written(self) -> Any:
        """The same, its table written into its folder."""
        write_table(self.columns(), self.folder / TABLE)
        return self

    @property
    def counts(self) -> str:
        """ "30 units, 2 of which were done before; 1 failed" """
        before = f", {self.before} of which were done before" if self.before else ""
        failed = f"; {len(self.failed)} failed" if self.failed else ""
        return f"{len(self.units)} units{before}{failed}"

    def page(self) -> Any:
        from faultgauge.reporting.report import Report, Section, Table

        columns = self.columns()
        cells = zip(*columns.values(), strict=True)
        rows = tuple(tuple(_cell(each) for each in row) for row in cells)
        table = Table(tuple(columns), rows)
        said = (*self.lines, *(f"Warning: {each}." for each in self.warnings))
        return Report(self.title, said, (Section("Units", (), (table,), tuple(self.figures())),))

    def figures(self) -> Any:
        return []


@dataclass(frozen=True)
class UnitFit:
    """Of one unit: how much log, the free run's error on what was held out, [value, standard error
    or None] of its constants, whether these lean on the fleet, and the warnings of its fit."""

    samples: int
    seconds: float
    error: float
    constants: dict[str, tuple[float, float | None]]
    prior: bool
    warnings: list[str]

    @staticmethod
    def of(model: Model) -> "UnitFit":
        told = unit_of(model)
        return UnitFit(
            told.samples,
            told.seconds,
            model.record.metrics.free_run_error,
            {name: (each[0], each[1]) for name, each in told.constants.items()},
            told.prior,
            told.warnings,
        )


@dataclass(frozen=True, eq=False, repr=False)
class FleetFit(FleetResult):
    """What `fit_fleet` found.

    **Fields**

    - `units`: a `UnitFit` each, by name; `failed`: why a unit has none.
    - `typical`: the model of the typical unit; None where units share nothing.
    - `laws`: center and spread of every constant over the fleet, by name.
    - `folder`: where `fleet.fgm`, `units/NAME.fgm` and `units.csv` are.
    """

    spec: PlantSpec
    folder: Path
    typical: Model | None
    units: dict[str, UnitFit]
    failed: dict[str, str]
    before: int
    warnings: Sequence[str]

    @property
    def title(self) -> str:
        return f"Fleet: {self.spec.name}"

    @property
    def laws(self) -> dict[str, Any]:
        return {} if self.typical is None else laws_of(self.typical)

    @property
    def unlike(self) -> dict[str, float]:
        """Probabilities of the units that are unlike the others rather than like them."""
        fleet = None if self.typical is None else self.typical.record.fleet
        return {name: p for name, p in fleet.unlike.items() if p >= UNLIKE} if fleet else {}

    @property
    def lines(self) -> list[str]:
        found = [f"{self.counts}; median error of the free runs {100 * self._median_error():.2f} %"]
        units = {p.name: p.unit for p in self.spec.parameters}
        for name, law in self.laws.items():
            if law.log:
                spread, error = f"{100 * law.spread:.1f} %", f"{100 * law.error:.1f} %"
            else:
                spread, error = f"{law.spread:.3g}", f"{law.error:.2g}"
            found.append(
                f"{name} = {law.center:.6g} {units[name]}".rstrip()
                + f", +- {spread} from unit to unit, mean known to {error}"
            )
        if self.typical is not None and not self.laws:
            found.append("too few units for their spread: four with a healthy log each tell it")
        for name, p in self.unlike.items():
            found.append(f"{name} is unlike the other units (p {p:.2g}){self._where(name)}")
        return found

    def _median_error(self) -> float:
        return float(np.median([each.error for each in self.units.values()]))

    def _where(self, unit: str) -> str:
        """In which constants a unit is off, the farthest first."""
        if unit not in self.units:
            return ""
        off = {
            n: self.laws[n].off(v)
            for n, (v, _) in self.units[unit].constants.items()
            if n in self.laws
        }
        far = sorted((n for n in off if abs(off[n]) > 3), key=lambda n: -abs(off[n]))
        return ": " + ", ".join(f"{n} {off[n]:+.1f} spreads" for n in far) if far else ""

    def as_dict(self) -> dict[str, Any]:
        return {
            "fleet": {name: law.to_dict() for name, law in self.laws.items()},
            "unlike": self.unlike,
            "units": {name: vars(each) for name, each in self.units.items()},
            "failed": self.failed,
            "done_before": self.before,
        }

    def columns(self) -> Columns:
        """A row per unit: its log, its error, and every constant with its standard error and how
        many spreads it is off the fleet's center; why it failed."""
        names = [p.name for p in own_parameters(self.spec.parameters)]
        laws, rows = self.laws, list[dict[str, Any]]()
        for unit, each in self.units.items():
            row: dict[str, Any] = {
                "unit": unit, "samples": each.samples, "seconds": each.seconds,
                "free_run_error": each.error,
            }  # fmt: skip
            for name in names:
                value, error = each.constants.get(name, (None, None))
                row |= {name: value, f"{name}_error": error}
                known = name in laws and value is not None
                row[f"{name}_off"] = laws[name].off(value) if known and value else None
            rows.append(row | {"leans_on_fleet": int(each.prior), "failed": None})
        rows += [{"unit": unit, "failed": why} for unit, why in self.failed.items()]
        keys = ["unit", "samples", "seconds", "free_run_error"]
        keys += [key for n in names for key in (n, f"{n}_error", f"{n}_off")]
        keys += ["leans_on_fleet", "failed"]
        return {key: [row.get(key) for row in rows] for key in keys}

    def figures(self) -> Any:
        """Every constant's range over the units, as a share of the fleet's center."""
        from faultgauge.reporting.model_figures import bars

        ranges = []
        for name, law in self.laws.items():
            shares = [
                u.constants[name][0] / law.center
                for u in self.units.values()
                if name in u.constants
            ]
            ranges.append([float(np.median(shares)), min(shares), max(shares)])
        if not ranges:
            return []
        return [
            bars(
                list(self.laws), np.array(ranges),
                title="Constants of the units", name="Of the fleet's center", unit="1",
            )
        ]  # fmt: skip


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)
