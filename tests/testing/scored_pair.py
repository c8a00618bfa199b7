"""A scored episode of two CAVs and the facts of its run, for tests of scores and results files."""

from mdrive_sumo.core.state import End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scoring import (
    RunInfo,
)
from testing.score_golden import arriving, ego, episode, hit, scenario, straight, street

SIGN = StopSignBox(id="stop", lane="east", line_pos_m=100.0, length_m=6.0)
ROADS = street(signs=[SIGN])
PAIR = scenario(ego("0"), ego("1", y=3.2))


def pair_episode() -> EpisodeRecord:
    """Ego 0 hits a car and runs over the sign: IP 0.48. Ego 1, one lane to the left, fails at x = 20."""
    drives = {"0": arriving(), "1": straight(41, y=3.2)}
    ends = {"0": End.ARRIVED, "1": End.AGENT_FAILED}
    return episode(PAIR, drives, ends, {20: [hit("0", "npc")]})


RUN = RunInfo(
    agent="idm",
    labels=("single",),
    suite="s",
    suite_checksum="sha256:0",
    seed=1,
    score_mode="mdrive",
    versions={"mdrive-sumo": "0.1.0"},
)
