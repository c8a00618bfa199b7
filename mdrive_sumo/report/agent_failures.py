"""Failures of agents in a run, with the end of the first one's log: what to mend before any score counts."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.input_files import open_regular
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.loop.agent_driver import shorten
from mdrive_sumo.runs.run_paths import LOGS_FOLDER, find_agent_log
from mdrive_sumo.scoring import EgoResult, Results, ScenarioResult

TAIL_LINES = 8
"""Lines of a log that are shown: the innermost calls of a traceback and its error."""
TAIL_BYTES = 8192
"""Bytes from the end of a log that are read: room for `TAIL_LINES` long lines."""
MAX_LOG_BYTES = 2**40
"""Only the end is read, so any size will do."""


@dataclass(frozen=True, slots=True)
class CavFailure:
    """The failure of one CAV's agent."""

    result: ScenarioResult
    ego: EgoResult

    @property
    def has_left(self) -> bool:
        """Whether it was a person, who has left."""
        return self.ego.reason.startswith(f"{FailureReason.LEFT}: ")


def list_agent_failures(results: Results) -> tuple[CavFailure, ...]:
    """Return the CAVs whose agent failed, in the order of the results."""
    return tuple(
        CavFailure(result, ego)
        for result in results.scenarios
        for ego in result.egos
        if ego.outcome is End.AGENT_FAILED
    )


def format_agent_failures(results: Results, run_folder: Path) -> str:
    """Return how many agents failed, the first failure and the end of its log; "" if none failed."""
    failures = list_agent_failures(results)
    if not failures:
        return ""
    episodes = len({(failure.result.id, failure.result.seed) for failure in failures})
    who = "A PERSON LEFT" if all(failure.has_left for failure in failures) else "THE AGENT FAILED"
    heading = f"{who} in {episodes} of {len(results.scenarios)} episodes ({len(failures)} CAVs)"
    is_seeded = len(results.run.all_seeds) > 1
    return "\n".join((heading, *_format_failure(failures[0], run_folder, is_seeded=is_seeded)))


def format_first_failure(result: ScenarioResult, run_folder: Path, *, is_seeded: bool) -> str:
    """Return the failure at which a run stopped and the end of its log. is_seeded: whether it has several seeds."""
    first = CavFailure(result, next(ego for ego in result.egos if ego.outcome is End.AGENT_FAILED))
    return "\n".join(("THE AGENT FAILED", *_format_failure(first, run_folder, is_seeded=is_seeded)))


def _format_failure(failure: CavFailure, run_folder: Path, *, is_seeded: bool) -> Iterator[str]:
    seed = failure.result.seed if is_seeded else None
    place = f"{failure.result.id}{f', seed {seed}' if is_seeded else ''}, CAV {failure.ego.id}"
    yield f"  first: {place}: {shorten(failure.ego.reason)}"
    log = find_agent_log(run_folder, failure.result.id, failure.ego.id, seed)
    if log is None:
        return
    yield from (f"    {line}" for line in read_tail(log))
    yield f"  whole log: {log}; all logs: {run_folder / LOGS_FOLDER}"


def read_tail(log: Path) -> list[str]:
    """Return the last `TAIL_LINES` lines of a log as printable text; none if it cannot be read."""
    try:
        with open_regular(log, MAX_LOG_BYTES) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES))
            text = file.read(TAIL_BYTES).decode("utf-8", "replace")
    except OSError:
        return []
    lines = [line for line in text.splitlines() if line.strip(" ^~")]
    return [f"{line[: len(line) - len(line.lstrip())]}{shorten(line)}" for line in lines[-TAIL_LINES:]]
