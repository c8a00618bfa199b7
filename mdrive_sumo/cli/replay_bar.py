"""Write replay pages with a bar on a terminal, for `view` and `report`."""

import sys
from collections.abc import Iterable
from pathlib import Path

import click

from mdrive_sumo.report.run_page.replay_files import VIEW_FOLDER, ReplaySelection, select_replays, write_replays
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scoring import ScenarioResult


def write_run_replays(stored: StoredRun, selection: ReplaySelection) -> list[ScenarioResult]:
    """Write the replays of a run into its folder of pages; return their episodes. Raises InputError."""
    chosen = select_replays(stored.run, stored.results.scenarios, selection)
    follow_pages(write_replays(stored.run.folder / VIEW_FOLDER, stored.run, chosen), len(chosen))
    return chosen


def follow_pages(written: Iterable[Path], count: int) -> None:
    """Write pages, with a bar on a terminal. written: writes a page for each path that it yields."""
    with click.progressbar(written, count, "replays", file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
        for _ in bar:
            pass
