"""Accommodation alone, as `faultgauge reproduce` measures it, over seeds: results and report.

python benchmarks/accommodation.py [SEEDS] [DIR]
"""

import sys
from pathlib import Path
from typing import Any

from faultgauge.reporting.report import Report, write
from faultgauge_studies.paper.accommodating import measured
from faultgauge_studies.paper.bench import set_up
from faultgauge_studies.paper.reproduce import as_json, over_seeds


def one_seed(seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    bench = set_up(seed)
    figures: dict[str, Any] = {}
    traces: dict[str, Any] = {}
    for more, curves in measured.measured(bench):
        for key, value in more.items():
            figures.setdefault(key, {}).update(value)
        traces |= curves
    return figures, traces


if __name__ == "__main__":
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for seed in range(seeds):
        found.append(one_seed(seed))
        results = {"quick": False, **over_seeds([figures for figures, _ in found])}
        (folder / "accommodation.json").write_text(as_json(results))
        sections = measured.sections(results, found[0][1])
        summary = (f"{len(found)} seeds; curves of seed 0.",)
        write(Report("Accommodation", summary, sections), folder / "accommodation.html")
        print(f"seeds done: {len(found)} of {seeds}", file=sys.stderr)
