"""Where the numbers of a report come from: agents, settings, seeds, code, versions and checksums of the runs."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.checksum import SHORT_CHECKSUM
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.private_paths import hide_place
from mdrive_sumo.core.tables import Table, make_row, make_text_columns
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent, describe_code
from mdrive_sumo.report.comparison_report.drive_conditions import SEEDS, find_differing_conditions
from mdrive_sumo.report.comparison_report.report_runs import ReportRun
from mdrive_sumo.report.result_tables import describe_missing_reference
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.scoring import EpisodeKey

PROVENANCE_NOTE = (
    "One line for each run. Checksum: of the results file (SHA-256, its beginning); code: of the library that drove."
)
_COLUMNS = {
    "agent": "Agent",
    "labels": "labels",
    "seeds": "seeds",
    "settings": "settings",
    "track": "track",
    "agent_code": "agent code",
    "code": "code",
    "versions": "versions",
    "checksum": "checksum",
    "place": "run",
}


def build_provenance_table(agents: Sequence[ComparedAgent], name: str = "provenance") -> Table:
    """Return a line for every run."""
    rows = [make_row(_describe_run(agent, run)) for agent in agents for run in agent.runs]
    return Table(name, "Provenance", make_text_columns(_COLUMNS), tuple(rows), PROVENANCE_NOTE)


def _describe_run(agent: ComparedAgent, run: ReportRun) -> tuple[str, ...]:
    info = run.results.run
    comm = info.comm.get("preset", "-") if info.comm.get("on", True) else "off"
    settings = {"channel": comm, "clock": info.agent_clock, **info.shown_conditions}
    return (
        agent.name,
        ", ".join(info.labels) or "-",
        ", ".join(map(str, info.all_seeds)),
        ", ".join(f"{name} {value}" for name, value in settings.items() if value),
        info.sensing_track or "-",
        str(run.settings.get("agent code") or "-").removeprefix("sha256:")[:SHORT_CHECKSUM],
        describe_code(run) or "-",
        ", ".join(f"{name} {version}" for name, version in sorted(info.versions.items())),
        compute_results_checksum(run) or "-",
        hide_place(Path(run.place)),
    )


def compute_results_checksum(run: ReportRun) -> str:
    """Return the beginning of the SHA-256 of a run's results file; "" if there is no file."""
    path = Path(run.place)
    path = path / RESULTS_FILE if path.is_dir() else path
    return hashlib.sha256(read_bytes(path)).hexdigest()[:SHORT_CHECKSUM] if path.is_file() else ""


def list_facts(agents: Sequence[ComparedAgent]) -> dict[str, str]:
    """Return what all runs have in common, by name."""
    results = agents[0].results
    run = results.run
    buckets = ", ".join(f"{name} {bucket.scenarios}" for name, bucket in results.buckets.items())
    return {
        "suite": f"{run.suite_label}, checksum {run.suite_checksum.removeprefix('sha256:')[:SHORT_CHECKSUM]}",
        "scenarios": f"{len({scenario.id for scenario in results.scenarios})} ({buckets})",
        "score mode": run.score_mode,
        "runs": str(sum(len(agent.runs) for agent in agents)),
    }


def list_warnings(agents: Sequence[ComparedAgent]) -> tuple[str, ...]:
    """Return a sentence about everything that limits the comparison of the agents."""
    runs = [run for agent in agents for run in agent.runs]
    codes = sorted({code for run in runs if (code := describe_code(run))})
    warnings = [
        _describe_differing_conditions(agents),
        f"The runs were driven with different code of the library: {', '.join(codes)}." if len(codes) > 1 else "",
    ]
    if any(agent.results.planned is not None for agent in agents):
        count = len({scenario.id for agent in agents for scenario in agent.results.scenarios})
        warnings.insert(0, f"Runs are partial: all numbers are over the {count} scenarios that every run has finished.")
    for agent in agents:
        void = _shorten([scenario.key for scenario in agent.results.scenarios if scenario.status == "void"])
        warnings.append(f"{agent.name}: void episodes count as 0 in means: {void}." if void else "")
        failed = sum(ego.outcome == "agent-failed" for scenario in agent.results.scenarios for ego in scenario.egos)
        warnings.append(f"{agent.name}: the agent failed in {failed} drives." if failed else "")
        if any(scenario.status == "ok" and scenario.efficient_sr is None for scenario in agent.results.scenarios):
            warnings.append(f"{agent.name}: reference times: {describe_missing_reference(agent.results)}.")
    return tuple(warning for warning in warnings if warning)


def _describe_differing_conditions(agents: Sequence[ComparedAgent]) -> str:
    """Return a sentence on the conditions in which the agents differ; "" if they differ in none."""
    names = find_differing_conditions([agent.conditions for agent in agents])
    if not names:
        return ""
    parts = [f"{name}: {_list_values(agents, name)}." for name in names]
    paired = ["Differences are paired by the seeds that both have."] if SEEDS in names else []
    return " ".join(
        (
            "The agents were driven under different conditions, so that places are given only among agents with the"
            " same ones.",
            *parts,
            *paired,
        )
    )


def _list_values(agents: Sequence[ComparedAgent], name: str) -> str:
    """Return "realistic for idm, single; perfect for sharing"."""
    agents_by_value: dict[str, dict[str, None]] = {}
    for agent in agents:
        if name in agent.conditions.values:
            agents_by_value.setdefault(agent.conditions.values[name], {})[agent.results.run.agent] = None
    return "; ".join(f"{value} for {', '.join(names)}" for value, names in agents_by_value.items())


def _shorten(keys: Sequence[EpisodeKey], limit: int = 5) -> str:
    names = [f"{name} (seed {seed})" for name, seed in keys[:limit]]
    return ", ".join(names) + (f" and {len(keys) - limit} more" if len(keys) > limit else "")
