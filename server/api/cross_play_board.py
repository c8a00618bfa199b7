"""The board of cross-play: how each agent drives among CAVs of each other team's agent."""

from collections.abc import Sequence
from statistics import fmean

from mdrive_sumo.contract import SensingTrack
from server.api import submission_views
from server.api.problems import HiddenScenariosError
from server.api.schemas.parameters import ResponseModel
from server.api.submission_views import Caller
from server.enums import ChallengeTrack, JobState
from server.store import NotFound, Store, cross_play, phases
from server.store.cross_play import CrossPlayScore
from server.store.queries import LeaderboardEntry
from server.store.tables import JobRow


class CrossPlayCellOut(ResponseModel):
    """One CAV of an agent among CAVs of another: means over the episodes that count. DS and SR in percent."""

    others: str
    """Submission that drives the other CAVs."""
    ds: float | None
    """Null without an episode that counts: it has not been driven yet, or an agent of the others failed."""
    sr: float | None
    episodes: int
    failed: int
    """Episodes in which the agent under test failed; they count."""
    stopped_others: int
    """Episodes in which its messages made an agent of the others fail; they count, with DS x 0.6 and no success."""
    left_out: int
    """Episodes in which an agent of the others failed for another reason; they do not count."""
    is_own_team: bool
    """Agents of one team are no strangers and are not driven together."""


class CrossPlayAgentOut(ResponseModel):
    """An agent under test. DS and SR in percent."""

    team: str
    submission: str
    method: str
    track: ChallengeTrack
    sensing_track: SensingTrack
    alone_ds: float
    """Its DS on the leaderboard, where it drives all CAVs."""
    ds: float | None
    """Good with strangers: the mean over the agents that it was driven among, each with the same weight."""
    sr: float | None
    partners: int
    """Over how many of them."""
    failed: int
    stopped_others: int
    cells: list[CrossPlayCellOut]
    """In the order of the agents."""


class CrossPlayOut(ResponseModel):
    """The board of a phase: agents of the object track first, in each track the best with strangers."""

    phase: str
    scenarios: int
    """Scenarios of each pair."""
    jobs: int
    unfinished: int
    agents: list[CrossPlayAgentOut]


def read_cross_play(store: Store, caller: Caller | None, phase_id: str) -> CrossPlayOut:
    """Return the board of a phase: agents of the object track first, in each track the best with strangers.

    Raises NotFound for an unknown phase and one without this board, and HiddenScenariosError for a hidden one unless
    for admins: every cell is a figure that two agents can choose by driving (docs/api.md).
    """
    with store.read() as session:
        phase = phases.get(session, phase_id)
        if not phase.cross_play_scenarios:
            raise NotFound(f"phase {phase_id}: expected one with cross-play, found one without it")
        if not submission_views.may_see_scenarios(caller, phase):
            raise HiddenScenariosError
        agents = cross_play.list_agents(session, phase_id)
        jobs = cross_play.list_jobs(session, agents)
    rows = [_make_agent(entry, agents, jobs) for entry in agents]
    rows.sort(key=lambda row: (row.sensing_track != SensingTrack.OBJECT, row.ds is None, -(row.ds or 0.0)))
    order = {row.submission: place for place, row in enumerate(rows)}
    for row in rows:
        row.cells.sort(key=lambda cell: order[cell.others])
    undone = sum(job.state in (JobState.QUEUED, JobState.RUNNING) for job in jobs)
    return CrossPlayOut(
        phase=phase_id, scenarios=phase.cross_play_scenarios, jobs=len(jobs), unfinished=undone, agents=rows
    )


def _make_agent(
    entry: LeaderboardEntry, agents: Sequence[LeaderboardEntry], jobs: Sequence[JobRow]
) -> CrossPlayAgentOut:
    mine = [job for job in jobs if job.submission == entry.submission]
    cells = [_make_cell(entry, other, mine) for other in agents]
    driven = [cell for cell in cells if cell.ds is not None and cell.sr is not None]
    return CrossPlayAgentOut(
        team=entry.team,
        submission=entry.submission or "",
        method=entry.method,
        track=ChallengeTrack(entry.track),
        sensing_track=SensingTrack(entry.sensing_track or SensingTrack.OBJECT),
        alone_ds=entry.ds,
        ds=fmean(cell.ds or 0.0 for cell in driven) if driven else None,
        sr=fmean(cell.sr or 0.0 for cell in driven) if driven else None,
        partners=len(driven),
        failed=sum(cell.failed for cell in cells),
        stopped_others=sum(cell.stopped_others for cell in cells),
        cells=cells,
    )


def _make_cell(entry: LeaderboardEntry, other: LeaderboardEntry, jobs: Sequence[JobRow]) -> CrossPlayCellOut:
    """Return one cell over the episodes that say something about the agent under test."""
    scores = [job.result for job in jobs if job.others == other.submission and job.result is not None]
    results = [CrossPlayScore(**result) for result in scores]
    counted = [result for result in results if result.counts]
    return CrossPlayCellOut(
        others=other.submission or "",
        ds=fmean(result.ds for result in counted) if counted else None,
        sr=fmean(result.sr for result in counted) if counted else None,
        episodes=len(counted),
        failed=sum(bool(result.tested_failed) for result in counted),
        stopped_others=sum(result.by_messages for result in counted),
        left_out=len(results) - len(counted),
        is_own_team=entry.team == other.team,
    )
