"""The replays that a report leads to: where the page of a score lies, and the link from the report to it."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from mdrive_sumo.core.private_paths import hide_place
from mdrive_sumo.core.tables import Table
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.run_page.replay_files import VIEW_FOLDER, name_replay_file
from mdrive_sumo.runs.run_paths import recording_path
from mdrive_sumo.scoring import EpisodeKey, RunInfo, ScenarioResult

LINKED_NOTE = "Underlined scores lead to their replay, of several seeds the one with the lowest DS."
HOW_TO_WRITE = (
    "<code>mdrive-sumo view RUN</code> writes those of a run where something was lost, with <code>--replays all</code>"
    " the others as well; <code>mdrive-sumo report --replays</code> does so for all its runs."
)
UNNAMED_NOTE = (
    "it would name folders above those that the command names. Start it in a folder that holds both, with paths from"
    " there."
)


def list_replay_pages(agent: ComparedAgent) -> dict[str, Path]:
    """Return where the replay of an agent lies or would lie, for every scenario with a recording.

    Of several seeds it is the one with the lowest DS, the first of equal ones. Void episodes have no replay.
    """
    pages: dict[EpisodeKey, Path] = {}
    for run in agent.runs:
        for result in run.results.scenarios:
            if result.status == "ok" and (page := _find_page(Path(run.place), run.results.run, result)):
                pages[result.key] = page
    chosen: dict[str, ScenarioResult] = {}
    for result in agent.results.scenarios:
        if result.key in pages and (result.id not in chosen or result.ds < chosen[result.id].ds):
            chosen[result.id] = result
    return {name: pages[result.key] for name, result in chosen.items()}


def _find_page(folder: Path, info: RunInfo, result: ScenarioResult) -> Path | None:
    """Return the replay page of an episode; None without a recording, and for a name that leads out of the folder."""
    seed = result.seed if len(info.all_seeds) > 1 else None
    page = folder / VIEW_FOLDER / name_replay_file(info, result)
    is_inside = Path(result.id).name == result.id
    return page if is_inside and recording_path(folder, result.id, seed).is_file() else None


def find_replay_links(tables: Iterable[Table], folder: Path) -> dict[Path, str]:
    """Return the links to the replay pages that exist now, by page. folder: that of the report.

    A link is "" where it would name folders that the report does not name (docs/decisions/068). Pages that are links
    or lie behind one are left out: what a stranger's run points to is not part of it.
    """
    pages = {cell.replay for table in tables for row in table.rows for cell in row.cells if cell.replay is not None}
    return {page: _relate(page, folder) for page in pages if _is_page(page)}


def _is_page(page: Path) -> bool:
    return page.is_file() and page.resolve() == page.parents[1].resolve() / VIEW_FOLDER / page.name


def _relate(page: Path, folder: Path) -> str:
    relation = Path(os.path.relpath(page.resolve(), folder.resolve()))
    run_parts = tuple(part for part in relation.parts[:-2] if part != "..")
    named_parts = Path(hide_place(page.parents[1])).parts
    is_named = run_parts == named_parts[len(named_parts) - len(run_parts) :]
    return quote(relation.as_posix()) if is_named else ""


def describe_replays(table: Table, links: Mapping[Path, str]) -> Markup:
    """Return what a page says of the replays that the scores of a table lead to; "" without any recording."""
    pages = [cell.replay for row in table.rows for cell in row.cells if cell.replay is not None]
    if not pages:
        return Markup()
    linked = sum(bool(links.get(page)) for page in pages)
    unnamed = sum(links.get(page) == "" for page in pages)
    parts = [LINKED_NOTE if linked else "No score leads to a replay."]
    if unnamed:
        parts.append(f"{unnamed} replays have no link: {UNNAMED_NOTE}")
    if missing := len(pages) - linked - unnamed:
        parts.append(f"{missing} of {len(pages)} replays are not written: {HOW_TO_WRITE}")
    return Markup(" ".join(parts))
