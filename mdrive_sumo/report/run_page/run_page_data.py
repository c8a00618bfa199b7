"""The content of a run page: a row per scenario, the worst first, with a cell per seed and what each CAV lost."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

from markupsafe import Markup

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.private_paths import hide_paths_in_text
from mdrive_sumo.report.agent_failures import list_agent_failures, read_tail
from mdrive_sumo.report.reasons import NotedReason, list_reasons
from mdrive_sumo.report.run_page.losses import CavLosses, explain_losses
from mdrive_sumo.report.run_page.provenance import Fact, list_provenance
from mdrive_sumo.report.run_page.replay_files import name_replay_file
from mdrive_sumo.report.run_page.scenario_sketch import draw_scenario_sketch
from mdrive_sumo.report.run_report import REPORT_FILE
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.runs.run_paths import find_agent_log
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scoring import EpisodeKey, ScenarioResult
from mdrive_sumo.scoring.score_mode import compute_mean

SUCCESS_SR = 100.0
FILES = (RESULTS_FILE, REPORT_FILE, JOURNAL_FILE)
"""Files of a run that its page links."""
STEPS = 10
"""Colours of driving scores below success: one for each 10."""
Replays: TypeAlias = Mapping[EpisodeKey, Sequence[NotedReason]]
"""The episodes that have a replay page in the folder of a run's page, with the reasons that their agents noted."""


@dataclass(frozen=True, slots=True)
class AgentLog:
    """The log of a failed agent."""

    path: str
    href: str
    """Link from the page; "" if the page is somewhere else than its run."""
    tail: tuple[str, ...]
    """The last lines of the log: the end of the traceback."""


@dataclass(frozen=True, slots=True)
class EpisodeCell:
    """One episode: a cell of the matrix."""

    seed: int
    ds: float
    outcome: str
    """One of success, failed and void."""
    reason: str
    """Why the episode is void; "" if it is not."""
    replay: str
    """Link to its replay; "" if there is none."""
    cavs: tuple[CavLosses, ...]
    """The CAVs that lost something."""
    kinds: tuple[str, ...]
    """Kinds of all infractions."""
    logs: Mapping[str, AgentLog]
    """The logs of agents that failed, by CAV."""

    @property
    def has_failed_agent(self) -> bool:
        """Whether the agent of a CAV failed."""
        return any(cav.has_failed_agent for cav in self.cavs)

    @property
    def colour_step(self) -> int:
        """The colour of the cell, 0 (worst) to `STEPS` (success)."""
        return STEPS if self.outcome == "success" else min(int(self.ds / (100 / STEPS)), STEPS - 1)


@dataclass(frozen=True, slots=True)
class ScenarioRow:
    """One scenario with its episodes: a row of the matrix."""

    id: str
    bucket: str
    category: str
    description: str
    ds: float
    """Mean over the seeds; a void episode counts 0."""
    cells: tuple[EpisodeCell, ...]
    """One cell for each seed, in the order of the run's seeds."""
    sketch: Markup
    """Roads and routes as a small SVG image."""


@dataclass(frozen=True, slots=True)
class RunPageData:
    """The content of a run page."""

    stored: StoredRun
    rows: tuple[ScenarioRow, ...]
    """One row for each scenario, the worst first."""
    provenance: tuple[Fact, ...]
    failed_episodes: int
    failed_cavs: int
    have_all_left: bool
    """Whether the failures are those of people, who have left."""
    has_recordings: bool
    files: tuple[str, ...]
    """Links to the files of the run; none if the page is somewhere else than its run."""

    @property
    def seeds(self) -> tuple[int, ...]:
        """The columns of the matrix."""
        return self.stored.results.run.all_seeds

    @property
    def cells(self) -> tuple[EpisodeCell, ...]:
        """All episodes, the worst scenario's first."""
        return tuple(cell for row in self.rows for cell in row.cells)

    def list_kinds(self) -> list[str]:
        """Return the kinds of all infractions, sorted."""
        return sorted({kind for cell in self.cells for kind in cell.kinds})


def read_replays(stored: StoredRun, results: Iterable[ScenarioResult]) -> Replays:
    """Return the reasons noted in these episodes. Raises InputError for a recording that cannot be read."""
    return {result.key: list_reasons(load_recording(stored.run, result)) for result in results}


def build_run_page_data(stored: StoredRun, replays: Replays, page: Path) -> RunPageData:
    """Return the content of the page of a run. page: the place of the page itself."""
    by_id: dict[str, list[ScenarioResult]] = {}
    for result in stored.results.scenarios:
        by_id.setdefault(result.id, []).append(result)
    rows = [_build_row(stored, found, replays, page) for found in by_id.values()]
    failures = list_agent_failures(stored.results)
    return RunPageData(
        stored,
        tuple(sorted(rows, key=lambda row: (row.ds, row.id))),
        list_provenance(stored.results, stored.run.fingerprint),
        len({failure.result.key for failure in failures}),
        len(failures),
        all(failure.has_left for failure in failures),
        stored.run.config.record,
        tuple(filter(None, (_link(stored.run.folder, stored.run.folder / name, page) for name in FILES))),
    )


def _build_row(stored: StoredRun, results: Sequence[ScenarioResult], replays: Replays, page: Path) -> ScenarioRow:
    first = results[0]
    scenario = next(scenario for scenario in stored.run.scenarios if scenario.id == first.id)
    lengths = {ego.id: Polyline(ego.xy).length for ego in scenario.egos}
    by_seed = {stored.run.find_key(result)[1]: result for result in results}
    cells = (
        _build_cell(stored, by_seed[seed], lengths, replays, page)
        for seed in stored.run.config.seeds
        if seed in by_seed  # of a run that is going on some are missing
    )
    ds = compute_mean(result.ds for result in results)
    roads = load_road_map(find_network_folder(scenario.network, stored.run.suite.find_folder(scenario.id)))
    sketch = draw_scenario_sketch(scenario, roads)
    return ScenarioRow(first.id, first.bucket, first.category, scenario.description, ds, tuple(cells), sketch)


def _build_cell(
    stored: StoredRun,
    result: ScenarioResult,
    route_lengths: Mapping[str, float],
    replays: Replays,
    page: Path,
) -> EpisodeCell:
    cavs = explain_losses(result, route_lengths, replays.get(result.key, ()))
    kinds = {event.kind for ego in result.egos for event in ego.infractions}
    logs = {cav.ego: _find_log(stored, result, cav.ego, page) for cav in cavs if cav.has_failed_agent}
    return EpisodeCell(
        result.seed,
        result.ds,
        "void" if result.status == "void" else "success" if result.sr == SUCCESS_SR else "failed",
        " ".join(result.reason.split()),
        quote(name_replay_file(stored.run.info, result)) if result.key in replays else "",
        cavs,
        tuple(sorted(kinds)),
        {ego: log for ego, log in logs.items() if log is not None},
    )


def _find_log(stored: StoredRun, result: ScenarioResult, ego: str, page: Path) -> AgentLog | None:
    run = stored.run
    log = find_agent_log(run.folder, result.id, ego, result.seed if run.config.has_many_seeds else None)
    if log is None:
        return None
    name = log.relative_to(run.folder).as_posix()
    return AgentLog(name, _link(run.folder, log, page), tuple(map(hide_paths_in_text, read_tail(log))))


def _link(run_folder: Path, file: Path, page: Path) -> str:
    """Return the link from a page to a file of its run; "" if the page is somewhere else, or if there is no file."""
    if not page.resolve().is_relative_to(run_folder.resolve()) or not file.is_file():
        return ""
    return quote(Path(os.path.relpath(file.resolve(), page.resolve().parent)).as_posix())
