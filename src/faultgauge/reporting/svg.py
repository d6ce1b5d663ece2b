"""Drawings as SVG text that is small, the same for the same data, and safe to put on one page."""

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

from matplotlib.figure import Figure as Canvas

__all__ = ["Figure", "figure", "inline"]

SVG = "http://www.w3.org/2000/svg"
XLINK = "http://www.w3.org/1999/xlink"
FONTS = "system-ui, -apple-system, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif"
NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))

NUMBERS = re.compile(r"-?\d+\.\d+")
REFERENCE = re.compile(r"url\(#([^)]+)\)")
ILLEGAL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # not XML
TURNED_BY_NOTHING = re.compile(r"rotate\(-?0 [^)]*\)")

ET.register_namespace("", SVG)
ET.register_namespace("xlink", XLINK)


@dataclass(frozen=True)
class Figure:
    """A drawing ready for a report.

    Attributes:
        title: what is shown, a few words, plain text.
        caption: how to read it, plain text.
        svg: one `<svg>` element, complete in itself.
        canvas: the drawing itself, for who wants to go on with it.
    """

    title: str
    caption: str
    svg: str
    canvas: Canvas | None = field(default=None, repr=False, compare=False)


def figure(canvas: Canvas, title: str, caption: str) -> Figure:
    """Print a matplotlib drawing as a `Figure`; call it within `style.drawing()`."""
    stream = io.StringIO()
    canvas.savefig(stream, format="svg", metadata=NO_METADATA)
    root = ET.fromstring(ILLEGAL.sub("\ufffd", stream.getvalue()))
    for element in root.iter():
        _tidy(element)
    _keep_ids(root, {name: f"i{k}" for k, name in enumerate(_used(root))})
    for sheet in root.findall(f"{{{SVG}}}defs/{{{SVG}}}style/.."):
        root.remove(sheet)  # its rule would reach the whole page; the root carries it instead
    root.set("style", f"stroke-linejoin: round; stroke-linecap: butt; font-family: {FONTS}")
    return Figure(title, caption, _text(root), canvas)


def inline(drawing: Figure, prefix: str) -> str:
    """Return the SVG with ids that start with `prefix`, and the title for those who cannot see."""
    root = ET.fromstring(drawing.svg)
    _keep_ids(root, {name: prefix + name for name in _used(root)})
    del root.attrib["width"], root.attrib["height"]  # the page's width decides
    root.set("role", "img")
    root.set("aria-label", ILLEGAL.sub("\ufffd", drawing.title))
    return _text(root)


def _tidy(element: ET.Element) -> None:
    """Round to a hundredth of a point, far below a pixel, and drop what the root already says."""
    for key in ("d", "x", "y", "width", "height", "transform", "points"):
        if key in element.attrib:
            value = NUMBERS.sub(_rounded, element.attrib[key])
            element.set(key, " ".join(value.split()))
    if TURNED_BY_NOTHING.fullmatch(element.get("transform", "")):
        del element.attrib["transform"]
    if "style" in element.attrib:
        element.set("style", re.sub(r"font-family:[^;]*;? ?", "", element.attrib["style"]))
    if element.tag != f"{{{SVG}}}text":
        element.text = None
    element.tail = None


def _rounded(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def _used(root: ET.Element) -> list[str]:
    """The ids that something on the drawing points at, in the order in which it does."""
    names = dict[str, None]()
    for element in root.iter():
        for key, value in element.attrib.items():
            if key == f"{{{XLINK}}}href" and value.startswith("#"):
                names[value[1:]] = None
            names |= dict.fromkeys(REFERENCE.findall(value))
    return list(names)


def _keep_ids(root: ET.Element, names: Mapping[str, str]) -> None:
    """Give ids, and what points at them, their new `names`; drop those that nothing points at."""
    for element in root.iter():
        for key, value in list(element.attrib.items()):
            if key == "id" and value not in names:
                del element.attrib[key]
            elif key == "id":
                element.set(key, names[value])
            elif key == f"{{{XLINK}}}href" and value.startswith("#"):
                element.set(key, f"#{names[value[1:]]}")
            else:
                element.set(key, REFERENCE.sub(lambda at: f"url(#{names[at[1]]})", value))


def _text(root: ET.Element) -> str:
    return ET.tostring(root, encoding="unicode")
