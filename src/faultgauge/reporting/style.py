"""One look for every figure: readable in grey, safe for colour-blind readers, same bytes each time.

Curves differ in lightness and in dashes, never in hue alone.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from faultgauge.detection.words import number
from faultgauge.plants.signals import spoken

__all__ = [
    "BINS",
    "SERIES",
    "axis_label",
    "drawing",
    "legend",
    "panels",
    "plain_powers",
    "pretty_unit",
    "quantity",
    "short",
    "time_axis",
    "upright_label",
]

# inches in the drawing; the report scales it to the page: its letters are as large as the text
# on a wide one, and can be read on one of 600 pixels
WIDTH = 7.4
BINS = 600  # points per curve: about one per pixel of that width

INK = "#1f2933"
GREY = "#7b8794"
MEASURED = "#a3adb8"
PREDICTED = "#0b4f8a"
BAND = "#bcd3ea"
LIMIT = "#a61b1b"
EVENT = "#fcecca"
ALARM = "#e3e6ea"
BLANK = "#eceff2"
STRANGE = "#b84a00"
LONGEST_NAME = 44  # letters; beyond it is cut
LEGEND_LETTERS = 88  # beside each other

# Neighbours differ in lightness by more than a fifth of the scale, and no two share their dashes.
SERIES: tuple[dict[str, Any], ...] = (
    {"color": "#0b4f8a", "linestyle": "-", "linewidth": 1.6},
    {"color": "#e58a00", "linestyle": (0, (6, 2)), "linewidth": 1.6},
    {"color": "#111111", "linestyle": (0, (1, 1.5)), "linewidth": 1.8},
    {"color": "#5fb3d9", "linestyle": (0, (8, 2, 1.5, 2)), "linewidth": 1.6},
    {"color": "#7a1f6b", "linestyle": (0, (3, 1.5)), "linewidth": 1.4},
    {"color": "#e0a3c8", "linestyle": (0, (12, 3)), "linewidth": 1.6},
    {"color": "#205c3b", "linestyle": (0, (5, 1.5, 1, 1.5, 1, 1.5)), "linewidth": 1.4},
    {"color": "#b9b13a", "linestyle": (0, (2, 3)), "linewidth": 1.8},
)
TRUTH: dict[str, Any] = {"color": "#111111", "linestyle": (0, (5, 2.5)), "linewidth": 1.3}

_RC: Any = {
    "svg.fonttype": "none",  # text stays text: small, searchable, drawn in the reader's own font
    "svg.hashsalt": "faultgauge",
    "text.parse_math": False,  # a "$" in a name is a "$"
    "path.simplify": False,  # curves arrive thinned; a lone sample must stay a dot
    "font.family": "DejaVu Sans",  # ships with matplotlib and is wide: other fonts fit its boxes
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.0,
    "axes.formatter.limits": (-4, 6),
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 2.2,
    "legend.columnspacing": 1.3,
}


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in this package's style, whatever the machine's matplotlibrc says."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        # The reader's browser draws the text, so the font measured with may lack a letter.
        warnings.filterwarnings("ignore", message="Glyph", category=UserWarning)
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        yield


def panels(
    heights: tuple[float, ...], columns: int = 1, *, share_time: bool = False
) -> tuple[Canvas, list[Axes]]:
    """Make a drawing of `len(heights)` rows of panels, heights in inches.

    Args:
        heights: height of each row, inches.
        columns: panels per row.
        share_time: the rows have one time axis, labelled at the bottom only.
    """
    canvas = Canvas(figsize=(WIDTH, sum(heights)), layout="constrained")
    grid = canvas.subplots(
        len(heights), columns, sharex=share_time, squeeze=False, height_ratios=heights
    )
    return canvas, list(grid.flat)


def pretty_unit(unit: str) -> str:
    """Return a unit label as it is read, "N*m/s**2" as "N·m/s²"."""
    raised = re.sub(
        r"(?:\*\*|\^)(-?\d+)(?![.\d])",
        lambda power: power[1].translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")),
        unit.strip(),
    ).replace("**", "^")  # a power that is no whole number
    return raised.replace("*", "·")


def short(name: str) -> str:
    """Return a name that fits beside a figure; the end of a longer one becomes "…"."""
    return name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"


def axis_label(name: str, unit: str) -> str:
    """Return "name (unit)", or the name alone where no unit was declared."""
    return f"{short(name)} ({short(pretty_unit(unit))})" if unit.strip() else short(name)


def upright_label(name: str, unit: str, width: int = 24) -> str:
    """Return `axis_label` in lines of at most `width` letters, for beside a vertical axis; broken
    between words, those of a name_of_several too."""
    words = re.split(r"(?<=[ _])", axis_label(name, unit))
    lines = [""]
    for part in (word[k : k + width] for word in words for k in range(0, len(word), width)):
        if len(lines[-1]) + len(part.rstrip()) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.rstrip() for line in lines if line)


def quantity(value: float, unit: str, figures: int = 3) -> str:
    """Return a value to so many figures with its unit, which no line break parts from it."""
    return f"{number(value, figures)}\u00a0{pretty_unit(spoken(unit))}".rstrip()


def time_axis(t: Float[np.ndarray, "samples"]) -> tuple[float, str]:
    """Return the seconds per drawn time unit, and that unit: s, h or d by the length of `t`."""
    length = float(np.ptp(t)) if t.size else 0.0
    if length < 3 * 3600.0:
        return 1.0, "s"
    return (3600.0, "h") if length < 5 * 86400.0 else (86400.0, "d")


def legend(axes: Axes) -> None:
    """Put the legend above the panel, at the right: the left corner is the axis multiplier's."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        widest = max(len(label) for label in labels) + 7  # 7: the sample and the space around it
        columns = max(1, min(len(labels), LEGEND_LETTERS // widest))
        axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns)


def plain_powers(axis: Axis) -> None:
    """Write plain numbers at a logarithmic axis: 1, 2 and 5 where it spans little, else 1."""
    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
