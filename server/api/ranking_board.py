"""The ranking of a phase by item response: abilities of agents and difficulties of scenarios, fitted jointly."""

from collections import defaultdict

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.core.statistics import Label
from mdrive_sumo.scoring.item_response import LEAST_AGENTS, AgentScores, rank_agents
from server.api.problems import HiddenScenariosError
from server.api.schemas.parameters import ResponseModel
from server.enums import ChallengeTrack, JobKind
from server.store import phases, queries
from server.store.tables import JobOverviewRow, JobRow

MOST_AGENTS = 20
"""The best of the leaderboard, as on the board of cross-play: the intervals of 20 agents and 225 scenarios take some
seconds of processor time."""


class RankedSubmissionOut(ResponseModel):
    """A submission in the ranking. Abilities and DS in percent."""

    team: str
    submission: str
    method: str
    track: ChallengeTrack
    sensing_track: SensingTrack
    rank: int
    """1 + number of agents of its sensing track that are clearly abler."""
    rank_low: int | None
    """Ends of the 95 % interval of the rank; null, as those of the ability, for a phase of too few places."""
    rank_high: int | None
    ability: float
    """DS that is expected in a scenario of mean difficulty."""
    ability_low: float | None
    ability_high: float | None
    ds: float
    """Mean over the scenarios and seeds that all agents of this ranking have."""


class RankingOut(ResponseModel):
    """The ranking of a phase: agents of the object track first, in each track the ablest."""

    phase: str
    agents: list[RankedSubmissionOut]
    """Empty with fewer than three agents."""
    scenarios: int
    places: int
    """Networks of these scenarios, by which the intervals are drawn."""


def read_ranking(session: Session, phase_id: str) -> RankingOut:
    """Return the ranking of the best shown submission of each team. Raises NotFound for an unknown phase.

    Raises HiddenScenariosError for a hidden phase: abilities follow from the scores of single scenarios.
    """
    phase = phases.get(session, phase_id)
    if not phase.public:
        raise HiddenScenariosError
    entries = queries.find_leaderboard(session, phase_id, None)
    ranked = sorted((entry for entry in entries if entry.rank is not None), key=lambda entry: -entry.ds)[:MOST_AGENTS]
    scores = _read_scores(session, [entry.submission or "" for entry in ranked])
    entry_by_submission = {entry.submission: entry for entry in ranked if entry.submission in scores}
    if len(entry_by_submission) < LEAST_AGENTS:
        return RankingOut(phase=phase_id, agents=[], scenarios=0, places=0)
    tracks = {name: entry.sensing_track or SensingTrack.OBJECT for name, entry in entry_by_submission.items()}
    ranking = rank_agents(scores, {str(name): str(track) for name, track in tracks.items()})
    agents = [
        RankedSubmissionOut(
            team=entry_by_submission[one.agent].team,
            submission=one.agent,
            method=entry_by_submission[one.agent].method,
            track=ChallengeTrack(entry_by_submission[one.agent].track),
            sensing_track=SensingTrack(tracks[one.agent]),
            rank=one.rank or 0,
            rank_low=one.rank_low,
            rank_high=one.rank_high,
            ability=one.ability,
            ability_low=one.low,
            ability_high=one.high,
            ds=one.mean,
        )
        for one in ranking.agents
    ]
    agents.sort(key=lambda agent: (agent.sensing_track != SensingTrack.OBJECT, agent.rank, -agent.ability))
    return RankingOut(phase=phase_id, agents=agents, scenarios=len(ranking.difficulty), places=ranking.places)


def _read_scores(session: Session, submissions: list[str]) -> dict[str, AgentScores]:
    """Return DS by place, scenario and seed of each submission; without a known place the scenario is one."""
    data = JobOverviewRow.data
    wanted = (
        select(*(JobRow.submission, JobRow.scenario, JobRow.seed), data["ds"].as_float(), data["place"].as_string())
        .join(JobOverviewRow, JobOverviewRow.job == JobRow.id)
        .where(JobRow.kind == JobKind.SUBMISSION, JobRow.submission.in_(submissions))
    )
    found: dict[str, dict[Label, float]] = defaultdict(dict)
    for submission, scenario, seed, ds, place in session.execute(wanted):
        if ds is not None:
            found[submission][place or scenario, scenario, seed] = ds
    return {name: found[name] for name in submissions if name in found}
