"""Write the tables of measured numbers in README.md, docs/results.md and docs/results/speed.md.

    python -m tools.write_results RUN... --commit HASH [--bench FILE] [--dry-run]

RUN is a folder that `mdrive-sumo eval --suite mdrive@0 --agent NAME --seed N` wrote. All runs of an agent, one a seed,
replace its row in `docs/results/baselines.json` by their means, with the commit that they were driven at, which
`tools.sample_episodes` keeps a sample of; `--bench` copies the figures of `make bench` to
`docs/results/speed.json`. Without arguments the tables are written again from these two files, which a test compares
with the pages.
"""

import json
import operator
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agents.learned.fusion_spec import BOUNDS, FUSIONS
from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.registry import DETECTOR_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scoring import Means, Results, compute_bucket_means, compute_overall, load_results
from tools.seed_runs import check_seed_runs
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

ROOT = Path(__file__).parents[1]
BASELINES = Path("docs/results/baselines.json")
SPEED = Path("docs/results/speed.json")
README, RESULTS_PAGE, SPEED_PAGE = Path("README.md"), Path("docs/results.md"), Path("docs/results/speed.md")
COMPARISONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq}
BUCKETS = ("InterDrive", "Interaction", "V2XPnP")

DESCRIPTION_BY_AGENT: Mapping[str, str] = {
    "stationary": "stands still: the lower bound",
    "constant-speed": "blind, 8 m/s",
    "take-turns": "waits for the number in its id, then drives blindly: a fixed schedule, which agents should beat",
    "perception-swap:attfuse:profile": "hazard rule of CARLA's BasicAgent behind a surrogate detector",
    "perception-swap:disconet:profile": "the same, another detector",
    "perception-swap:fcooper:profile": "the same, another detector",
    "perception-swap:cobevt:profile": "the same, another detector",
    "perception-swap:none": "the same rule behind a trained detector of the own LiDAR's scans",
    "perception-swap:late": "the same, with the boxes that others find",
    "perception-swap:early": "the same, with the points of others: a bound, which no radio carries",
    "perception-swap:attfuse": "the same, with features of others, fused as AttFuse does",
    "perception-swap:disconet": "the same, fused as DiscoNet does",
    "perception-swap:fcooper": "the same, fused as F-Cooper does",
    "perception-swap:cobevt": "the same, fused as CoBEVT does",
    "codriving:alone": "`codriving` that neither sends nor reads messages",
    "codriving": "counterpart of CoDriving, trained on mdrive-sumo data: asks others for features of its way, 5 m/s",
    "codriving:fast": "the same without the cap of 5 m/s",
    "tcp": "counterpart of TCP, trained on mdrive-sumo data: sees through one front camera",
    "lmdrive": "counterpart of LMDrive, the same data: four cameras, LiDAR, instructions in English",
    "uniad": "counterpart of UniAD, the same data: six cameras",
    "vad": "counterpart of VAD, the same data: six cameras, lanes of its route",
    "idm": "alone, perfect detector: keeps its distance and yields",
    "single": "alone: plans in space and time around what it sees",
    "sharing": "the same planner, which also receives CAMs and CPMs",
    "colmdriver-rule": "the same planner, negotiates by rule: the nearest goes, the others stop",
    "sharing+negotiation": "both: shares perception and negotiates the order of passing",
    "omniscient": "privileged, every state and plan: the upper bound",
}
"""Rows of the tables, in this order."""
SWAPS = "perception-swap:*"
FAMILIES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    SWAPS: (
        "hazard rule of CARLA's BasicAgent behind seven trained detectors, from least to greatest",
        tuple(f"{SWAPS[:-1]}{name}" for name in (*BOUNDS, *FUSIONS)),
    ),
}
"""Rows that stand for several agents: what they do, and which they are."""
README_AGENTS = (
    "constant-speed", "take-turns", SWAPS, "codriving", *SYSTEMS, "idm", "single", "sharing", "sharing+negotiation",
    "omniscient",
)  # fmt: skip
ALL_SEEDS = [0, 1, 2]
"""Of the tables; a row of fewer says which."""

SCORES = ("ds", "sr", "efficient_sr", "time_ratio")
CONDITIONS: Mapping[str, str] = {
    "agent_clock": "ideal", "actors": "default", "friction": "dry", "ids": "random", "sensing": "realistic",
    "others": "", "attack": "none",
}  # fmt: skip
"""Conditions of every row besides the ideal channel, as the pages state them: rows under others cannot be compared."""


def build_rows(runs: Iterable[Results], commit: str) -> dict[str, Any]:
    """Return a row for every agent from its runs, one a seed. commit: at which they were driven. Raises InputError."""
    by_agent: dict[str, list[Results]] = {}
    for results in runs:
        by_agent.setdefault(results.run.agent, []).append(results)
    return {agent: build_row(found) | {"commit": commit} for agent, found in by_agent.items()}


def build_row(runs: Sequence[Results]) -> dict[str, Any]:
    """Return the scores of an agent by bucket and overall (mean of the buckets) over its seeds, and their provenance.

    runs: one a seed. Every scenario and seed has the same weight in its bucket. Raises InputError for runs that do not
    belong together.
    """
    _check_runs(runs)
    scenarios = [scenario for results in runs for scenario in results.scenarios]
    buckets = compute_bucket_means(scenarios)
    overall = compute_overall(scenarios)
    run = runs[0].run
    return {
        "scores": {name: _round_scores(buckets[name]) for name in BUCKETS}
        | {"overall": _round_scores(overall.bucket_mean)},
        "scenarios": len(runs[0].scenarios),
        "episodes": len(scenarios),
        "timed": overall.timed,
        "void": sum(results.void for results in runs),
        "seeds": sorted(results.run.seed for results in runs),
        "channel": run.comm.get("preset", "ideal"),
        "versions": run.versions,
    }


def _round_scores(means: Means) -> dict[str, float | None]:
    values = {name: getattr(means, name) for name in SCORES}
    return {name: None if value is None else round(value, 2) for name, value in values.items()}


def _check_runs(runs: Sequence[Results]) -> None:
    """Raise InputError unless the runs are of all buckets and differ in their seed alone."""
    first = runs[0]
    if missing := [bucket for bucket in BUCKETS if bucket not in first.buckets]:
        raise InputError(
            f"agent {first.run.agent}: expected a run of --suite mdrive@0, found none of bucket {missing[0]}"
        )
    for name, expected in (*CONDITIONS.items(), ("channel", "ideal")):
        found = first.run.comm.get("preset") if name == "channel" else getattr(first.run, name)
        if found != expected:
            raise InputError(f"agent {first.run.agent}: {name}: expected {expected or 'none'}, found {found}")
    check_seed_runs(runs)
    if first.run.agent_config not in _list_packaged_options(first.run.agent):
        raise InputError(
            f"agent {first.run.agent}: expected it as packaged, found a run with options; those that name the packaged"
            " weights, with or without the provider cpu, are allowed"
        )


def _list_packaged_options(agent: str) -> set[str]:
    """Return the hashes of options with which an agent drives as packaged."""
    if not AgentSpec(agent).is_learned:
        return {""}
    name = getattr(DETECTOR_AGENTS[agent], "weights", agent) if agent in DETECTOR_AGENTS else agent
    weights = {"weights": str(WEIGHTS_FOLDER / f"{name}.onnx")}
    options = {}, weights, {"provider": "cpu"}, weights | {"provider": "cpu"}
    return {AgentSpec(agent, one).config_hash() for one in options}


def format_baselines(rows: Mapping[str, Any], agents: Iterable[str]) -> str:
    """Return the Markdown table of the agents that have a row: DS / SR by bucket, and what they say of time.

    agents: or names in `FAMILIES`, whose row has the least and the greatest value of those members that have one.
    """
    header = ("Agent", "What it does", *BUCKETS, "Overall", "Efficient SR", "Time ratio")
    lines = _format_header(header)
    for agent in agents:
        description, members = FAMILIES.get(agent, (DESCRIPTION_BY_AGENT.get(agent, ""), (agent,)))
        found = [rows[member] for member in members if member in rows]
        if found:
            cells = [
                " / ".join(_format_range(found, bucket, score) for score in ("ds", "sr"))
                for bucket in (*BUCKETS, "overall")
            ]
            cells += [_format_range(found, "overall", name) for name in ("efficient_sr", "time_ratio")]
            lines.append(f"| `{agent}` | {description}{_describe_seeds(found)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _format_range(rows: Sequence[Mapping[str, Any]], bucket: str, name: str) -> str:
    """Return a score, of several rows the least and the greatest that are defined."""
    values = [value for row in rows if (value := row["scores"][bucket][name]) is not None]
    if not values:
        return "-"
    ends = dict.fromkeys(f"{end:.2f}" for end in (min(values), max(values)))
    return " to ".join(ends)


def _describe_seeds(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the seeds of rows if they are not all; "" otherwise."""
    seeds = sorted({*ALL_SEEDS}.intersection(*(row["seeds"] for row in rows)))
    return "" if seeds == ALL_SEEDS else f" (seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))} only)"


def format_times(rows: Mapping[str, Any], agents: Iterable[str]) -> str:
    """Return the Markdown table of efficient SR / time ratio by bucket, with the episodes that the ratio is over."""
    lines = _format_header(("Agent", *BUCKETS, "Overall", "Timed", "Seeds", "Commit"))
    for agent in (agent for agent in agents if agent in rows):
        row = rows[agent]
        cells = [
            " / ".join(_format_score(row["scores"][name], score) for score in ("efficient_sr", "time_ratio"))
            for name in (*BUCKETS, "overall")
        ]
        timed = f"{row['timed']} of {row['episodes']}" if row["timed"] is not None else "-"
        lines.append(
            f"| `{agent}` | {' | '.join(cells)} | {timed} | {', '.join(map(str, row['seeds']))} | {row['commit']} |"
        )
    return "\n".join(lines)


def _format_header(header: Sequence[str]) -> list[str]:
    return [f"| {' | '.join(header)} |", "|" + "---|" * len(header)]


def _format_score(scores: Mapping[str, float | None], name: str) -> str:
    value = scores[name]
    return "-" if value is None else f"{value:.2f}"


def format_speed(figures: Mapping[str, Any]) -> str:
    """Return the Markdown table of the figures of `make bench`: name -> value, unit, target such as "< 5".

    Figures without a target explain others where they are measured; the table leaves them out.
    """
    lines = ["| Figure | Measured | Target |", "|---|---|---|"]
    for name, figure in figures.items():
        if figure["target"] in {"", "-"}:
            continue
        missed = "" if is_target_met(figure["value"], figure["target"]) else ": missed"
        measured = f"{figure['value']:.3g} {figure['unit']}".strip()
        lines.append(f"| {name} | {measured} | {figure['target']}{missed} |")
    return "\n".join(lines)


def is_target_met(value: float, target: str) -> bool:
    """Whether a figure meets its target; one without a comparison has none to miss."""
    found = re.fullmatch(r"(<=|>=|<|>|=) ([\d.]+)", target)
    return found is None or COMPARISONS[found[1]](value, float(found[2]))


def replace_block(text: str, name: str, table: str) -> str:
    """Return the page with the lines between `<!-- NAME:begin ... -->` and `<!-- NAME:end -->` replaced.

    Raises ValueError for a page without them.
    """
    pattern = re.compile(rf"(<!-- {name}:begin[^>]*-->\n).*?(<!-- {name}:end -->)", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"expected a block {name!r}, found none")
    return pattern.sub(lambda found: f"{found[1]}{table}\n{found[2]}", text)


def render_pages(root: Path, rows: Mapping[str, Any], speed: Mapping[str, Any]) -> dict[Path, str]:
    """Return the text that each page with measured tables below `root` should have.

    rows, speed: contents of `BASELINES` and `SPEED`.
    """
    readme, results, speeds = ((root / page).read_text("utf-8") for page in (README, RESULTS_PAGE, SPEED_PAGE))
    results = replace_block(results, "baselines", format_baselines(rows, DESCRIPTION_BY_AGENT))
    results = replace_block(results, "times", format_times(rows, DESCRIPTION_BY_AGENT))
    return {
        README: replace_block(readme, "baselines", format_baselines(rows, README_AGENTS)),
        RESULTS_PAGE: results,
        SPEED_PAGE: replace_block(speeds, "speed", format_speed(speed)),
    }


def build_pages(runs: Sequence[Path], commit: str | None, bench: Path | None) -> dict[Path, str]:
    """Return the text of the JSON files with the figures of the runs and of `bench`, and of the pages made of them.

    commit: that the runs were driven at.

    Raises InputError.
    """
    stored: dict[str, Any] = json.loads((ROOT / BASELINES).read_text("utf-8"))
    stored |= build_rows([load_results(folder / "results.json") for folder in runs], commit or "")
    rows = {name: stored[name] for name in DESCRIPTION_BY_AGENT if name in stored}
    speed = json.loads((bench or ROOT / SPEED).read_text("utf-8"))
    measured = {BASELINES: rows} | ({SPEED: speed} if bench else {})
    figures = {path: json.dumps(value, indent=1) + "\n" for path, value in measured.items()}
    return figures | render_pages(ROOT, rows, speed)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("runs", nargs=-1, type=click.Path(path_type=Path, exists=True, file_okay=False), metavar="[RUN]...")
@click.option(
    "--bench", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="File that `make bench` wrote."
)
@click.option("--commit", metavar="HASH", help="Commit that the runs were driven at.")
@dry_run_option
def main(runs: Sequence[Path], commit: str | None, bench: Path | None, dry_run: bool) -> None:
    """Write the tables of README.md and the pages of results, with the rows of the RUN folders (`results.json`)."""
    if runs and not commit:
        raise InputError("--commit: expected the commit that the runs were driven at, found none")
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in build_pages(runs, commit, bench).items():
            path = Path(scratch, name)
            make_parents(path)
            write_text(path, text)
        replace_changed_files(Path(scratch), ROOT, dry_run=dry_run)


if __name__ == "__main__":
    main()
