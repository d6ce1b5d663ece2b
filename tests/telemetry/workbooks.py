"""Workbooks as Excel keeps them, by hand: a zip of a few XML files."""

import zipfile
from datetime import datetime
from pathlib import Path
from xml.sax.saxutils import escape

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OF = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
SHEET_TYPE = "application/vnd.openxmlformats-officedocument.spreadsheetml"
DAY = 86_400.0  # s
STYLES = (
    f'<styleSheet xmlns="{MAIN}"><fonts count="1"><font/></fonts><fills count="1"><fill/></fills>'
    '<borders count="1"><border/></borders><cellStyleXfs count="1"><xf/></cellStyleXfs>'
    '<cellXfs count="2"><xf numFmtId="0"/><xf numFmtId="22" applyNumberFormat="1"/></cellXfs>'
    "</styleSheet>"
)


def write_workbook(path: Path, sheets: dict[str, list[list]], merged: str = "") -> Path:
    """A workbook of `sheets`, rows of cells: numbers, text, dates, None; `merged` cells of the
    first, as "B1:C1 A1:A2"."""
    names = list(sheets)
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{PACKAGE}/content-types">'
        '<Default Extension="xml" ContentType="application/xml"/><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Override '
        f'PartName="/xl/workbook.xml" ContentType="{SHEET_TYPE}.sheet.main+xml"/></Types>',
        "_rels/.rels": _relations({"r1": (f"{OF}/officeDocument", "xl/workbook.xml")}),
        "xl/workbook.xml": f'<workbook xmlns="{MAIN}" xmlns:r="{OF}"><sheets>'
        + "".join(
            f'<sheet name="{escape(name)}" sheetId="{k}" r:id="r{k}"/>'
            for k, name in enumerate(names, 1)
        )
        + "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": _relations(
            {f"r{k}": (f"{OF}/worksheet", f"worksheets/s{k}.xml") for k in range(1, len(names) + 1)}
            | {"r0": (f"{OF}/styles", "styles.xml")}
        ),
        "xl/styles.xml": STYLES,
    }
    for k, rows in enumerate(sheets.values(), 1):
        ranges = merged.split() if k == 1 else []
        cells = "".join(f"<row r='{n}'>{_row(n, row)}</row>" for n, row in enumerate(rows, 1))
        more = "".join(f'<mergeCell ref="{each}"/>' for each in ranges)
        more = f"<mergeCells>{more}</mergeCells>" if ranges else ""
        parts[f"xl/worksheets/s{k}.xml"] = (
            f'<worksheet xmlns="{MAIN}"><sheetData>{cells}</sheetData>{more}</worksheet>'
        )
    with zipfile.ZipFile(path, "w") as file:
        for name, text in parts.items():
            file.writestr(name, f'<?xml version="1.0" encoding="UTF-8"?>{text}')
    return path


def _relations(targets: dict[str, tuple[str, str]]) -> str:
    found = "".join(
        f'<Relationship Id="{name}" Type="{kind}" Target="{target}"/>'
        for name, (kind, target) in targets.items()
    )
    return f'<Relationships xmlns="{PACKAGE}/relationships">{found}</Relationships>'


def _row(number: int, row: list) -> str:
    found = ""
    for k, cell in enumerate(row):
        at = f"{chr(ord('A') + k)}{number}"
        match cell:
            case None:
                continue
            case str():
                found += f'<c r="{at}" t="inlineStr"><is><t>{escape(cell)}</t></is></c>'
            case datetime():
                days = (cell - datetime(1899, 12, 30)).total_seconds() / DAY
                found += f'<c r="{at}" s="1"><v>{days!r}</v></c>'
            case _:
                found += f'<c r="{at}"><v>{cell!r}</v></c>'
    return found
