"""Cross-play: which pairs are driven, what an episode says of the CAV under test, and whose fault a failure is."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.metrics.endings import AGENT_FAILED_FACTOR
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, compute_mean
from server.phase_suites import PhaseSuites
from server.store import Store, cross_play, phases, standings, submissions
from server.store.cross_play import CrossPlayScore

LOG = logging.getLogger("mdrive.worker")
JUDGED_EPISODES = 3
"""Episodes of a job whose partner failed: the scored one, one without the messages, and one with them."""
REPEATS_FOLDER = "again"
"""Of the files of repeated episodes, so that those of the scored one are alone in theirs."""


def plan_pairs(store: Store, suites: PhaseSuites, unplanned: set[str]) -> None:
    """Add the jobs of new pairs in every phase with a board of cross-play. Raises StoreUnavailable.

    unplanned: the phases for which that failed before, since their suites or environments cannot be read; updated.
    """
    with store.read() as session:
        wanted = [phase.id for phase in phases.list_phases(session) if phase.cross_play_scenarios]
    for name in wanted:
        try:
            _plan_phase(store, name, suites)
        except InputError as error:
            if name not in unplanned:  # it is tried again with every heartbeat
                LOG.warning("phase %s: no jobs of cross-play are added: %s", name, error)
            unplanned.add(name)
        else:
            unplanned.discard(name)


def _plan_phase(store: Store, name: str, suites: PhaseSuites) -> None:
    with store.read() as session:
        is_due = _act_on_agents(session, name, suites, cross_play.list_missing)
    if is_due:
        with store.write() as session:
            count = _act_on_agents(session, name, suites, cross_play.plan)
        LOG.info("phase %s: %s jobs of cross-play added", name, count)


def _act_on_agents(session: Session, name: str, suites: PhaseSuites, act: Callable[..., object]) -> object:
    """Return what `act` returns for the agents of a phase that this worker can drive; None without two."""
    phase = phases.get(session, name)
    listed = [
        (entry, submissions.get(session, str(entry.submission))) for entry in cross_play.list_agents(session, name)
    ]
    ours = [(entry, row) for entry, row in listed if row.evaluator == suites.evaluator(phase, row.environment)]
    if len(ours) < 2:
        return None
    return act(session, phase, [entry for entry, _ in ours], standings.evaluator_digest(ours[0][1].evaluator))


def compute_score(result: ScenarioResult, *, by_messages: bool = False) -> CrossPlayScore:
    """Return the score of the CAV under test, and whose agents failed: each side by its own CAVs.

    by_messages: whether messages of the agent under test made one of the others fail. Then its score is that of a
    failure of its own, with the same factor, and no success: it must gain nothing by stopping its partners.
    """
    tested = [ego for ego in result.egos if not ego.is_other]
    failures = [ego for ego in result.egos if ego.outcome is End.AGENT_FAILED]
    factor = AGENT_FAILED_FACTOR if by_messages else 1.0
    return CrossPlayScore(
        ds=compute_mean(factor * ego.ds for ego in tested),
        sr=compute_mean(100.0 * (factor * ego.ds > SUCCESS_DS) for ego in tested),
        tested_failed=next((ego.reason for ego in failures if not ego.is_other), ""),
        others_failed=next((ego.reason for ego in failures if ego.is_other), ""),
        by_messages=by_messages,
    )


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
