"""The README's snippets run, and the generated pages are up to date."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
README = FENCE.findall((ROOT / "README.md").read_text())
PAGE = FENCE.findall((ROOT / "docs" / "python.md").read_text())


def run(command: list[str], folder: Path, env: dict[str, str]) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def printed(tmp_path_factory, long_jobs):
    """What the README's snippets print and then those of the Python page, in one process, so that
    what several of them compile is compiled once. Commands are called as the script calls them."""
    folder = tmp_path_factory.mktemp("docs")
    made = [text for language, text in README if language == "python"]
    code, typed = ["from faultgauge.cli.app import run"], 0
    for language, text in README:
        if language == "python":
            code.append(text)
        elif language == "bash":
            for line in text.splitlines():
                program, *words = shlex.split(line)
                assert program == "faultgauge"
                code.append(f"assert run({words!r}) == 0")
                typed += 1
    assert (len(made), typed) == (2, 6)
    code.append("print('-- the Python page')")
    shown = [text for language, text in PAGE if language == "python"]
    assert len(shown) > 4
    said = run([sys.executable, "-c", "\n".join([*code, *shown])], folder, long_jobs)
    return folder, *said.split("-- the Python page\n")


def test_every_snippet_of_the_readme_runs_and_says_what_the_readme_says(printed):
    folder, said, _ = printed
    assert (folder / "estimates.csv").exists()
    answers = [text.strip() for language, text in README if language == "text"]
    assert answers
    for answer in answers:
        # The digits of an estimate may move with the numerical libraries: the first three hold.
        fault, size, *_ = answer.split()
        line = rf"{fault} (\S+) m/s \(\S+ to \S+\) since (\S+) s .* \(p > 0.999, run"
        found = re.search(line, said)
        assert found is not None, said
        assert float(found[1]) == pytest.approx(float(size), rel=5e-3)
        assert abs(float(found[2]) - 4001) <= 2  # s: a sample, between two of which it begins


def test_the_snippets_of_the_python_page_run_one_after_another(printed):
    folder, _, said = printed
    assert re.search(r"leak -0\.00\d+ .*m/s", said), said
    assert "has no column 'u'" in said
    assert (folder / "report.html").exists()


def test_the_set_up_commands_are_targets_of_the_makefile():
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = {
        line.split()[1]
        for language, text in README
        if language == "sh"
        for line in text.strip().splitlines()
    }
    assert named == {"demo", "test"}
    assert named <= targets


def test_links_of_the_pages_lead_somewhere():
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_command_page_is_what_the_commands_say(long_jobs):
    run([sys.executable, "docs/generate_cli.py", "--check"], ROOT, long_jobs)
