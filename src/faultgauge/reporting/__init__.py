"""Vector figures and the self-contained HTML report. Plain arrays in, text out.

Importing this package imports matplotlib and jinja2; commands do so only when they draw.
"""

from faultgauge.reporting.coverage import outside
from faultgauge.reporting.glance import Compared, ToldSpan, overview
from faultgauge.reporting.model_figures import bars, envelope, fit_history, learned_curve
from faultgauge.reporting.relations import relation
from faultgauge.reporting.report import Report, Section, Table, installed_versions, render, write
from faultgauge.reporting.style import axis_label, pretty_unit, quantity
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.thinning import thin
from faultgauge.reporting.time_figures import (
    Panel,
    curves,
    fault_estimate,
    free_run,
    panels,
    residual,
)

__all__ = [
    "Compared",
    "Figure",
    "Panel",
    "Report",
    "Section",
    "Table",
    "ToldSpan",
    "axis_label",
    "bars",
    "curves",
    "envelope",
    "fault_estimate",
    "fit_history",
    "free_run",
    "installed_versions",
    "learned_curve",
    "outside",
    "overview",
    "panels",
    "pretty_unit",
    "quantity",
    "relation",
    "render",
    "residual",
    "thin",
    "write",
]
