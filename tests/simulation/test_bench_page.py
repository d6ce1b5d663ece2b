"""The commands on the page about the bench are commands, in both forms the same."""

import re
from pathlib import Path

from faultgauge.simulation.commands import Commands
from faultgauge.simulation.scenario import parse_scenario

PAGE = (Path(__file__).parents[2] / "docs" / "bench.md").read_text()
SCENARIO = """name = "s"
plant = "reaction_wheel"
seconds = 10
step = 1
[inputs.u]
source = "constant"
size = 0.1
"""


def test_both_lists_do_the_same():
    text, json = (
        re.search(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[1].splitlines()
        for language in ("text", "json")
    )
    assert len(text) == len(json) == 7
    first, second = (Commands(parse_scenario(SCENARIO)) for _ in range(2))
    for k, (line, same) in enumerate(zip(text, json, strict=True)):
        assert first.obey(line, float(k)) == second.obey(same, float(k))
        assert first.schedules == second.schedules
    assert first.schedules == {}
