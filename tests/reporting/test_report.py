"""The report: nothing fetched, nothing run, nothing half-written."""

import functools
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.reporting.report import Report, Section, Table, installed_versions, render, write
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import fault_estimate, residual

EVIL = "<script>alert('x')</script> & \"co\""
VOID = {"meta", "link", "img", "br", "hr", "input", "base", "source", "embed"}


class Page(HTMLParser):
    """What a browser would see: tags, attributes, text; checks that tags are nested."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.seen: list[tuple[str, str]] = []  # text that is not folded, with the tag it stands in
        self.figures_open = 0
        self.loose_tables = 0  # outside a box that scrolls
        self.boxes: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {key: value or "" for key, value in attrs}))
        self.figures_open += tag == "figure" and "details" not in self.open
        self.loose_tables += tag == "table" and self.boxes[-1:] != ["wide"]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "div":
            self.boxes.append(dict(attrs).get("class") or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {key: value or "" for key, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "div":
            self.boxes.pop()

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        folded = "details" in self.open and "summary" not in self.open
        if data.strip() and not folded:
            self.seen.append((self.open[-1] if self.open else "", data.strip()))

    def ids(self) -> list[str]:
        return [attributes["id"] for _, attributes in self.tags if "id" in attributes]

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


def estimate(name: str = "friction") -> Figure:
    t = np.linspace(0.0, 10.0, 101)
    return fault_estimate(
        t, t, t - 1, t + 1, limit=3.0, name=name, unit="N*m", events=[(3.0, 9.0)], not_judged=t < 1
    )


def page_of(*sections: Section, answer: tuple[str, ...] = ("Well.",)) -> Page:
    return Page(render(Report("x", answer, sections, None, {})))


@functools.cache
def sample(text: str = "plain") -> Report:
    t = np.linspace(0.0, 10.0, 101)
    other = residual(t, np.sin(t), limit=0.5, name=text, unit="N*m", reference=text)
    table = Table(("fault", text), (("friction", "0.1 N·m"), (text, "0.2 N·m")), text)
    return Report(
        title=text,
        summary_sentences=(f"Friction is higher by 0.1 N·m in {text}.", text),
        sections=(
            Section(text, (text,), (table,), (estimate(text), other)),
            Section("Again", figures=(estimate(text),)),
        ),
        key_numbers=table,
        versions={"faultgauge": "1.2.3", text: text},
    )


def test_nothing_is_fetched_and_nothing_runs():
    text = render(sample())
    page = Page(text)
    assert not {"script", "link", "img", "image", "iframe", "object", "base"} & {
        tag for tag, _ in page.tags
    }
    for _, attributes in page.tags:
        assert not any(key.startswith("on") or key in ("src", "srcset") for key in attributes)
        for key in ("href", "xlink:href"):
            assert attributes.get(key, "#").startswith("#")
    namespaces = [
        f'"{uri}"' for uri in ("http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink")
    ]
    for namespace in namespaces:
        text = text.replace(namespace, "")
    assert "http:" not in text
    assert "https:" not in text
    assert "@import" not in text
    assert text.count("url(") == text.count("url(#")


def test_the_browser_is_told_to_fetch_nothing():
    policies = [meta for meta in Page(render(sample())).all("meta") if "http-equiv" in meta]
    assert policies[0]["http-equiv"] == "Content-Security-Policy"
    assert policies[0]["content"].startswith("default-src 'none';")


def test_page_is_well_formed():
    text = render(sample())
    page = Page(text)
    assert page.open == []
    assert text.startswith("<!doctype html>")
    assert page.all("html") == [{"lang": "en"}]
    assert {"charset": "utf-8"} in page.all("meta")


def test_user_text_is_shown_and_never_run():
    text = render(sample(EVIL))
    page = Page(text)
    assert page.all("script") == []
    assert "<script" not in text
    # title, heading, two sentences, contents, section, paragraph, two tables of three, footer
    assert "".join(page.text).count(EVIL) >= 14
    assert all(EVIL in svg["aria-label"] for svg in page.all("svg"))


def test_ids_are_unique_and_every_reference_has_its_target():
    text = render(sample())
    page = Page(text)
    assert len(page.ids()) == len(set(page.ids()))
    wanted = {
        attributes[key][1:]
        for _, attributes in page.tags
        for key in ("href", "xlink:href")
        if key in attributes
    }
    wanted |= {rest.split(")")[0] for rest in text.split("url(#")[1:]}
    wanted |= {
        attributes["aria-labelledby"]
        for _, attributes in page.tags
        if "aria-labelledby" in attributes
    }
    assert wanted <= set(page.ids())
    assert {"figure1-", "figure2-", "figure3-"} <= {name[:8] for name in wanted}


def test_every_drawing_has_a_text_for_those_who_cannot_see_it():
    drawings = Page(render(sample())).all("svg")
    assert len(drawings) == 3
    for drawing in drawings:
        assert drawing["role"] == "img"
        assert drawing["aria-label"]
        assert "viewbox" in drawing  # html.parser writes names small
        assert "width" not in drawing


def test_the_answer_comes_first():
    text = render(sample())
    places = [
        text.index(part) for part in ("Friction is higher", "<table", "<nav", "<svg", "<footer")
    ]
    assert places == sorted(places)


def test_numbers_stand_at_the_right():
    table = Table(
        ("name", "size", "note"),
        (("1", "+0.1 ± 0.02 N·m", "mean"), ("2", "–", "5 runs"), ("3", "−3e-4", "none")),
    )
    text = render(Report("x", ("y.",), (), table, {}))
    assert text.count('class="number"') == 1 + 3  # the heading and three cells of one column
    assert '<td class="number">–</td>' in text
    assert text.count("<td>mean</td>") == 1
    seldom = Table(("name", "size"), (("1", ""), ("2", ""), ("3", "+0.1 m (+0.0 to +0.2)")))
    assert 'class="number"' not in render(Report("x", ("y.",), (), seldom, {}))
    most = Table(("name", "settling"), (("1", "0.1 s"), ("2", "never"), ("3", "0.2 s")))
    assert '<td class="number">never</td>' in render(Report("x", ("y.",), (), most, {}))


def test_a_percentage_has_a_space_that_does_not_break():
    said = render(Report("x", ("2.02% in all, 3 %, and 2.02%.",), (), None, {}))
    assert "2.02\u00a0% in all, 3\u00a0%, and 2.02\u00a0%." in said


def test_eight_figures_lie_open_and_the_others_are_folded_in_their_order():
    five = (estimate(),) * 5
    page = page_of(
        Section("One", figures=five),
        Section("Two", figures=five, folded=True),
        Section("Three", figures=five),
    )
    assert page.figures_open == 8
    assert len(page.all("figure")) == 15
    numbers = [int(text[7:].split(".")[0]) for text in page.text if text.startswith("Figure ")]
    assert numbers == list(range(1, 16))
    assert ("summary", "Figures 14 to 15") in page.seen


def test_a_folded_chapter_shows_its_heading_alone():
    table = Table(("name", "size"), (("cell", "1"),), "caption")
    page = page_of(Section("Heading", ("a paragraph",), (table,), (estimate(),), folded=True))
    shown = [text for _, text in page.seen]
    assert "Heading" in shown
    assert not {"a paragraph", "cell", "caption"} & set(shown)
    assert page.figures_open == 0
    assert page.all("section") == [{"aria-labelledby": "section1"}]
    assert "section1" in page.ids()


def test_of_many_sentences_five_lie_open():
    nine = tuple(f"Sentence {k}." for k in range(9))
    for page, where in (
        (page_of(answer=nine), ["p"] + 4 * ["li"]),
        (page_of(Section("x", nine)), 5 * ["li"]),
    ):
        shown = [(tag, text) for tag, text in page.seen if text.startswith("Sentence")]
        assert shown == list(zip(where, nine, strict=False))
        assert ("summary", "4 more") in page.seen
        assert [text for text in page.text if text.startswith("Sentence")] == list(nine)
    assert [tag for tag, _ in page_of(Section("x", nine[:2])).seen][-2:] == ["p", "p"]


def test_what_stands_between_backticks_is_code_and_still_only_text():
    table = Table(("`head`", "b"), (("`cell`", "`<i>`"),), "`caption`")
    section = Section("`title`", ("Run `faultgauge fit`.", "a `b` c `d`."), (table,))
    page = page_of(section, answer=("See `<script>`.", "`more`"))
    assert "`" not in "".join(page.text)
    codes = [text for tag, text in page.seen if tag == "code"]
    assert codes == [
        *("<script>", "more", "title", "faultgauge fit", "b", "d"),
        *("caption", "head", "cell", "<i>"),
    ]
    assert not page.all("script")
    assert not page.all("i")


def test_contents_are_folded():
    page = page_of(*(Section(f"Chapter {k}") for k in range(20)))
    assert page.open == []
    assert [text for tag, text in page.seen if tag == "summary"] == ["Contents"]
    assert not [text for tag, text in page.seen if tag == "a"]


def test_nothing_is_cut_off_on_a_narrow_page():
    """Tables and drawings scroll in boxes of their own, and a drawing needs no more than a window
    of 600 pixels has between its margins of 24."""
    text = render(sample())
    page = Page(text)
    assert page.loose_tables == 0
    assert len(page.all("table")) == 2
    assert ".wide { overflow-x: auto;" in text
    assert "figure > div { overflow-x: auto; }" in text
    # but for names of rows that are short (a long one has the class `name`)
    (kept,) = re.findall(r".*nowrap.*", text)
    assert kept == 'th[scope="row"]:not(.name) { white-space: nowrap; }'
    (least,) = re.findall(r"svg {[^}]*min-width: (\d+)px", text)
    assert int(least) <= 600 - 2 * 24


def test_same_report_same_page():
    assert render(sample()) == render(sample.__wrapped__())  # drawn anew


def test_footer_names_the_versions():
    text = render(sample())
    assert "faultgauge 1.2.3" in text[text.index("<footer") :]
    assert installed_versions()["numpy"] == np.__version__


def test_write_puts_the_page_there(tmp_path: Path):
    target = tmp_path / "report.html"
    write(sample(), target)
    assert target.read_text(encoding="utf-8") == render(sample())
    assert os.listdir(tmp_path) == ["report.html"]


def test_write_takes_names_that_are_not_text(tmp_path: Path):
    write(Report("log \udcff", ("y.",), (), None, {}), tmp_path / "report.html")
    assert b"log ?" in (tmp_path / "report.html").read_bytes()


@pytest.mark.parametrize("step", ["replace", "fsync"])
@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (OSError(28, "No space left on device"), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_a_write_that_fails_leaves_the_old_file_whole(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    step: str,
    failure: BaseException,
    raised: type[BaseException],
):
    target = tmp_path / "report.html"
    target.write_text("the old report")

    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(raised):
        write(sample(), target)
    assert target.read_text() == "the old report"
    assert os.listdir(tmp_path) == ["report.html"]


def no_folder(folder: Path) -> Path:
    return folder / "missing" / "report.html"


def a_file_as_folder(folder: Path) -> Path:
    (folder / "file").write_text("")
    return folder / "file" / "report.html"


def a_folder_as_file(folder: Path) -> Path:
    return folder


@pytest.mark.parametrize("place", [no_folder, a_file_as_folder, a_folder_as_file])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, place):
    target = place(tmp_path)
    with pytest.raises(InputError) as caught:
        write(sample(), target)
    message = str(caught.value)
    assert str(target) in message
    assert message.endswith("that you may write to.")
    assert "\n" not in message
    assert not list(tmp_path.parent.glob(".*.draft"))
