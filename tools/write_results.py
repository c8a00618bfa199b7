"""Write the tables of measured numbers in README.md and docs/results.md.

    python -m tools.write_results RUN... [--bench FILE]

RUN is a folder that `mdrive-sumo eval --suite mdrive --agent NAME` wrote. Its scores replace the row of that agent in
`docs/results/baselines.json`; `--bench` copies the figures of `make bench` to `docs/results/speed.json`. Without
arguments the tables are written again from these two files, which a test compares with the pages.
"""

import argparse
import json
import operator
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.scoring import Results, load_results

ROOT = Path(__file__).parents[1]
BASELINES = Path("docs/results/baselines.json")
SPEED = Path("docs/results/speed.json")
README, RESULTS_PAGE = Path("README.md"), Path("docs/results.md")
COMPARISONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
BUCKETS = ("InterDrive", "Interaction", "V2XPnP")

DESCRIPTION_BY_AGENT: Mapping[str, str] = {
    "stationary": "stands still: the lower bound",
    "constant-speed": "blind, 8 m/s",
    "perception-swap:attfuse": "hazard rule of CARLA's BasicAgent behind a surrogate detector",
    "perception-swap:disconet": "the same, another detector",
    "perception-swap:fcooper": "the same, another detector",
    "perception-swap:cobevt": "the same, another detector",
    "idm": "alone, perfect detector: keeps its distance and yields",
    "single": "alone: plans in space and time around what it sees",
    "sharing": "the same planner, which also receives CAMs and CPMs",
    "colmdriver-rule": "the same planner, negotiates by rule: the nearest goes, the others stop",
    "sharing+negotiation": "both: shares perception and negotiates the order of passing",
    "omniscient": "privileged, every state and plan: the upper bound",
}
"""Rows of the tables, in this order."""
README_AGENTS = ("constant-speed", "idm", "single", "sharing", "sharing+negotiation", "omniscient")


def build_row(results: Results) -> dict[str, Any]:
    """Return DS and SR [%] of a run by bucket and overall (mean of the buckets), and its provenance."""
    means = {bucket: results.buckets[bucket] for bucket in BUCKETS} | {"overall": results.overall.bucket_mean}
    run = results.run
    return {
        "scores": {name: {"ds": round(mean.ds, 2), "sr": round(mean.sr, 2)} for name, mean in means.items()},
        "scenarios": len(results.scenarios),
        "void": results.void,
        "seed": run.seed,
        "channel": run.comm.get("preset", "ideal"),
        "versions": run.versions,
    }


def format_baselines(rows: Mapping[str, Any], agents: Iterable[str]) -> str:
    """Return the Markdown table of the agents that have a row."""
    lines = [f"| Agent | What it does | {' | '.join(BUCKETS)} | Overall |", "|---|---|" + "---|" * (len(BUCKETS) + 1)]
    for agent in agents:
        if agent in rows:
            scores = rows[agent]["scores"]
            cells = [f"{scores[name]['ds']:.2f} / {scores[name]['sr']:.2f}" for name in (*BUCKETS, "overall")]
            lines.append(f"| `{agent}` | {DESCRIPTION_BY_AGENT[agent]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def format_speed(figures: Mapping[str, Any]) -> str:
    """Return the Markdown table of the figures of `make bench`: name -> value, unit, target such as "< 5"."""
    lines = ["| Figure | Measured | Target |", "|---|---|---|"]
    for name, figure in figures.items():
        missed = "" if is_target_met(figure["value"], figure["target"]) else ": missed"
        lines.append(f"| {name} | {figure['value']:.3g} {figure['unit']} | {figure['target']}{missed} |")
    return "\n".join(lines)


def is_target_met(value: float, target: str) -> bool:
    """Whether a figure meets its target; one without a comparison has none to miss."""
    found = re.fullmatch(r"(<=|>=|<|>) ([\d.]+)", target)
    return found is None or COMPARISONS[found[1]](value, float(found[2]))


def replace_block(text: str, name: str, table: str) -> str:
    """Return the page with the lines between `<!-- NAME:begin ... -->` and `<!-- NAME:end -->` replaced.

    Raises ValueError for a page without them.
    """
    pattern = re.compile(rf"(<!-- {name}:begin[^>]*-->\n).*?(<!-- {name}:end -->)", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"expected a block {name!r}, found none")
    return pattern.sub(lambda found: f"{found[1]}{table}\n{found[2]}", text)


def render_pages(root: Path) -> dict[Path, str]:
    """Return the text that each page with measured tables should have, from the JSON files below `root`."""
    rows = json.loads((root / BASELINES).read_text("utf-8"))
    speed = json.loads((root / SPEED).read_text("utf-8"))
    readme, results = ((root / page).read_text("utf-8") for page in (README, RESULTS_PAGE))
    results = replace_block(results, "baselines", format_baselines(rows, DESCRIPTION_BY_AGENT))
    return {
        README: replace_block(readme, "baselines", format_baselines(rows, README_AGENTS)),
        RESULTS_PAGE: replace_block(results, "speed", format_speed(speed)),
    }


def main() -> None:
    """Update the JSON files from the given runs, then write the pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN", help="run folder with results.json")
    parser.add_argument("--bench", type=Path, metavar="FILE", help="bench.json of `make bench`")
    options = parser.parse_args()
    rows = json.loads((ROOT / BASELINES).read_text("utf-8")) if (ROOT / BASELINES).is_file() else {}
    for folder in options.runs:
        results = load_results(folder / "results.json")
        rows[results.run.agent] = build_row(results)
    ordered = {name: rows[name] for name in DESCRIPTION_BY_AGENT if name in rows}
    (ROOT / BASELINES).write_text(json.dumps(ordered, indent=1) + "\n")
    if options.bench:
        (ROOT / SPEED).write_text(json.dumps(json.loads(options.bench.read_text("utf-8")), indent=1) + "\n")
    for page, text in render_pages(ROOT).items():
        (ROOT / page).write_text(text, "utf-8")


if __name__ == "__main__":
    main()
