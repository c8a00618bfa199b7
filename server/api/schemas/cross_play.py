"""Response bodies of the board of cross-play."""

from mdrive_sumo.contract import SensingTrack
from server.api.schemas.parameters import ResponseModel
from server.enums import ChallengeTrack


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
