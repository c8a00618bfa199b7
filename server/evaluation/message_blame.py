"""Whose messages made a partner's agent fail in cross-play: what is found by driving the episode again."""

from dataclasses import replace
from pathlib import Path

from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError
from mdrive_sumo.scoring import ScenarioResult

JUDGED_EPISODES = 3
"""Episodes of a job whose partner failed: the scored one, one without the messages, and one with them."""
REPEATS_FOLDER = "again"
"""Of the files of repeated episodes, so that those of the scored one are alone in theirs."""


def have_others_failed(result: ScenarioResult) -> bool:
    """Return whether an agent failed that drove CAVs which are not under test."""
    return any(ego.is_other and ego.outcome is End.AGENT_FAILED for ego in result.egos)


def is_failure_by_messages(job: EpisodeJob, result: ScenarioResult, folder: Path) -> bool:
    """Return whether an agent of the others failed because of messages of the agent under test.

    It did if no such agent fails in the same episode without these messages, and one fails again in the same episode
    with them. So no team is blamed for an agent that fails in any company, or by chance. folder: for files of the
    repeated episodes. Raises what `run_job` raises for failures on our side.
    """
    if not have_others_failed(result) or not result.exchanged:
        return False
    tested = [ego.id for ego in result.egos if not ego.is_other]
    comm = replace(job.options.comm, mute=(*job.options.comm.mute, *(f"{ego}/*" for ego in tested)))
    again = replace(job, recording=None, logs=make_folder(folder / REPEATS_FOLDER))
    try:
        without = run_job(replace(again, options=replace(job.options, comm=comm)))
        return not have_others_failed(without) and have_others_failed(run_job(again))
    except RejectedError:  # what it asks for depends on the repeat: it cannot be told whose fault the first was
        return False
