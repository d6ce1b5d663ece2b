"""The README's snippets and the notebook run, and the generated pages are up to date."""

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
README = FENCE.findall((ROOT / "README.md").read_text())
PAGE = FENCE.findall((ROOT / "docs" / "python.md").read_text())
NOTEBOOK = ROOT / "examples" / "leaking_tank" / "leaking_tank.ipynb"
NEXT = "-- next"
ONCE = (
    "from faultgauge.cli.app import run",
    "from once import looked_once",
    "once = looked_once(by_plant=True)",
    "once.__enter__()",
)
TOLD = """import json
events = [(each.fault, each.size, each.onset) for each in answer.events]
print(json.dumps({"shown": [type(each).__name__ for each in shown], "events": events}))
"""


def run(command: list[str], folder: Path, env: dict[str, str]) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout


@dataclass(frozen=True)
class Printed:
    """By the snippets of the README, by those of the Python page and by the notebook."""

    folder: Path
    readme: str
    page: str
    notebook: str


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """All run in one process, so that what several of them compile is compiled once, and noise,
    2 mm in all logs of one tank, is looked for once. Commands are called as the script calls
    them."""
    folder = tmp_path_factory.mktemp("docs")
    code, typed = [f"import sys\nsys.path.append({str(ROOT / 'tests')!r})", *ONCE], 0
    for language, text in README:
        if language == "python":
            code.append(text)
        elif language == "bash":
            for line in text.splitlines():
                program, *words = shlex.split(line)
                assert program == "faultgauge"
                code.append(f"assert run({words!r}) == 0")
                typed += 1
    assert typed == 6
    shown = [text for language, text in PAGE if language == "python"]
    assert len(shown) > 4
    code += [f"print({NEXT!r})", *shown, f"print({NEXT!r})", *cells(), TOLD]
    # of so much that is compiled next to nothing runs for long
    said = run([sys.executable, "-c", "\n".join(code)], folder, dict(os.environ))
    return Printed(folder, *said.split(f"{NEXT}\n"))


def cells():
    """The code of the notebook, in its folder, every figure in `shown`, as a notebook shows it."""
    yield f"import os\nos.chdir({str(NOTEBOOK.parent)!r})\nshown = []"
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            *before, last = "".join(cell["source"]).splitlines()
            yield from before
            yield last if "=" in last else f"shown.append({last})"


def test_every_snippet_of_the_readme_runs_and_says_what_the_readme_says(printed):
    assert (printed.folder / "estimates.csv").exists()
    answers = [text.strip() for language, text in README if language == "text"]
    assert answers
    for answer in answers:
        # The digits of an estimate may move with the numerical libraries: the first three hold.
        fault, size, *_ = answer.split()
        line = rf"{fault} (\S+) m/s \(\S+ to \S+\) since (\S+) s\b.* \(p > 0.999, run"
        found = re.search(line, printed.readme)
        assert found is not None, printed.readme
        assert float(found[1]) == pytest.approx(float(size), rel=5e-3)
        assert abs(float(found[2]) - 4001) <= 2  # s: a sample, between two of which it begins


def test_the_snippets_of_the_python_page_run_one_after_another(printed):
    assert re.search(r"leak -0\.00\d+ .*m/s", printed.page), printed.page
    assert "has no column 'u'" in printed.page
    assert (printed.folder / "report.html").exists()


def test_the_notebook_goes_from_a_frame_to_an_answer_and_three_plots(printed):
    _, *code = cells()
    assert sum(map(bool, code)) == 10
    *_, line = printed.notebook.splitlines()
    told = json.loads(line)
    assert told["shown"] == ["Figure"] * 3
    ((fault, size, onset),) = told["events"]
    assert fault == "leak"
    assert size == pytest.approx(-0.001, rel=0.05)  # of 2 mm of noise over 1600 s: 1 %
    assert abs(onset - 2400) < 30  # s: by then it has taken 30 mm, fifteen times the noise
    assert "leak -0.001" in printed.notebook


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
