"""What is said to users keeps to the words of docs/words.md."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import faultgauge

ROOT = Path(faultgauge.__file__).parent
# other words for what was named, judged, undeclared, told, or there before the log
SYNONYMS = re.compile(
    r"\b(detected|flagged|isolated|diagnos\w+|anomal\w+|spotted|ruled out|excluded|unidentified"
    r"|unknown fault|not declared|unexplained|raised at|predates?|older than the log)\b",
    re.IGNORECASE,
)


def said(path: Path) -> Iterator[str]:
    """Text between quotes that is no docstring."""
    tree = ast.parse(path.read_text())
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def test_ten_words_are_used_for_what_was_found():
    page = Path(__file__).parents[1] / "docs" / "words.md"
    table = page.read_text().partition("| word |")[2].partition("\n\n")[0]
    assert len(re.findall(r"^\| (?!-)", table, re.MULTILINE)) == 10


@pytest.mark.parametrize(
    "folder", ["cli", "verbs", "detection", "reporting", "foresight", "rehearsal"]
)
def test_no_other_words_are_used(folder):
    found = [
        (path.name, text)
        for path in sorted((ROOT / folder).rglob("*.py"))
        for text in said(path)
        if SYNONYMS.search(text)
    ]
    assert found == []
