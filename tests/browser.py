"""Pages as Chromium lays them out: measured, and photographed."""

import json
import re
import shutil
import subprocess
from html import escape, unescape
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from matplotlib.image import imread, imsave

WIDTHS, HEIGHT = (1100, 600), 800  # pixels: a laptop's window and half of one
TALL = 6000  # pixels: a picture that can be looked at, and less than Chromium draws at once
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
MEASURE = """
<script>
const open = e => e.checkVisibility();
const name = e => e.textContent.trim().slice(0, 60);
function measured(frame) {
  const page = frame.contentDocument, view = frame.contentWindow;
  const answer = page.querySelector('.answer').getBoundingClientRect();
  const shown = [...page.querySelectorAll('svg')].filter(open).length;
  for (const each of page.querySelectorAll('details')) each.open = true;
  const wide = [...page.querySelectorAll('.wide, figure > div')]
    .filter(e => e.scrollWidth > e.clientWidth + 1).map(name);
  const overlaps = [], beyond = [];
  let smallest = Infinity;
  for (const svg of page.querySelectorAll('svg')) {
    const box = svg.getBoundingClientRect(), scale = box.width / svg.viewBox.baseVal.width;
    const texts = [...svg.querySelectorAll('text')].filter(e => name(e));
    const boxes = texts.map(e => e.getBoundingClientRect());
    texts.forEach((e, i) => {
      const one = boxes[i];
      smallest = Math.min(smallest, scale * parseFloat(view.getComputedStyle(e).fontSize));
      if (one.left < box.left - 1 || one.right > box.right + 1) beyond.push(name(e));
      for (let j = 0; j < i; j++) {
        const other = boxes[j];
        const across = Math.min(one.right, other.right) - Math.max(one.left, other.left);
        const down = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
        // a box is higher than its letters
        const slack = 0.25 * Math.min(one.height, other.height);
        if (across > 1 && down > slack) overlaps.push(name(e) + ' / ' + name(texts[j]));
      }
    });
  }
  return {width: view.innerWidth, needs: page.documentElement.scrollWidth, shown: shown,
          answer: answer.bottom, wide: wide, overlaps: overlaps, beyond: beyond,
          smallest: smallest === Infinity ? null : smallest,
          text: page.body.innerText};
}
window.onload = () => {
  const found = [...document.querySelectorAll('iframe')].map(measured);
  const result = document.createElement('pre');
  result.textContent = JSON.stringify(found);
  document.body.replaceChildren(result);
};
</script>
"""


class Layout(NamedTuple):
    """A page in a window `width` wide: how wide it `needs` to be, figures `shown` before anything
    is unfolded, and where its `answer` ends; of all that can be unfolded what is wider than its
    place (`wide`), text in figures that `overlaps` other or lies `beyond` its figure, the size of
    the `smallest` there, all in pixels, and what the page says."""

    width: float
    needs: float
    shown: int
    answer: float
    wide: list[str]
    overlaps: list[str]
    beyond: list[str]
    smallest: float | None
    text: str


def layouts(pages: list[str], folder: Path) -> list[list[Layout]]:
    """Every page's layouts, one for each of `WIDTHS`; a skip where there is no Chromium."""
    frames = "".join(
        f'<iframe srcdoc="{escape(page)}" style="width:{width}px;height:{HEIGHT}px;border:0">'
        "</iframe>"
        for page in pages
        for width in WIDTHS
    )
    harness = folder / "pages.html"
    harness.write_text(f"<!doctype html><meta charset=utf-8>{MEASURE}<body>{frames}</body>")
    done = _chromium(folder, "--dump-dom", harness.as_uri())
    found = re.search(r"<pre>(.*?)</pre>", done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    each = [Layout(**layout) for layout in json.loads(unescape(found[1]))]
    assert len(each) == len(WIDTHS) * len(pages)
    return [each[k : k + len(WIDTHS)] for k in range(0, len(each), len(WIDTHS))]


def picture(page: str, width: int, folder: Path, above: int = 0) -> np.ndarray:
    """(height, width, colour) of a page, all unfolded, in a window `width` wide, from `above`
    pixels below its beginning on: as much as Chromium draws at once."""
    harness, found = folder / "picture.html", folder / "picture.png"
    unfolded = re.sub(r"<details(?! open)", "<details open", page)
    harness.write_text(f"{unfolded}<style>body {{ margin-top: -{above}px }}</style>")
    size = f"--window-size={width},{TALL}"
    done = _chromium(folder, "--hide-scrollbars", size, f"--screenshot={found}", harness.as_uri())
    assert found.exists(), done.stderr[-2000:]
    return imread(found)[:, :, :3]


def save_pictures(pages: dict[str, str], target: Path, folder: Path) -> None:
    """Of every page by its name a picture in `target` for each of `WIDTHS`, or several that go
    below each other."""
    target.mkdir(parents=True, exist_ok=True)
    for name, page in pages.items():
        for width in WIDTHS:
            for part in count():
                shot = picture(page, width, folder, part * TALL)
                ink = np.flatnonzero((shot < 1).any(axis=(1, 2)))
                if len(ink):
                    file = f"{name.replace(' ', '_')}_{width}_{part + 1}.png"
                    imsave(target / file, shot[: ink[-1] + 20])
                if not len(ink) or ink[-1] < TALL - HEIGHT:
                    break


def _chromium(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no Chromium here: pages are measured where `chromium` is on the PATH")
    return subprocess.run(
        [program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
         f"--user-data-dir={folder / 'profile'}", *arguments],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def check(layout: Layout) -> None:
    """Nothing is clipped or covered, the answer is on the first screen, and figures can be read."""
    assert layout.needs <= layout.width
    assert layout.answer <= HEIGHT
    assert layout.wide == []
    assert layout.beyond == []
    assert layout.overlaps == []
    assert layout.shown <= 8
    # 8 pixels: what browsers and printers hold for the smallest that is read without effort
    assert layout.smallest is None or layout.smallest >= 8.0
    assert "`" not in layout.text
