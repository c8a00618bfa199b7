"""Records of one CAV, for golden tests of metrics. A CAV drives 0.5 m per tick unless stated otherwise."""

from collections.abc import Sequence

from mdrive_sumo.core.state import End
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scoring.metrics import EgoRecord, ScoredEpisode, build_ego_records
from testing.score_golden import NO_HITS, Hits, Row, episode, scenario, street

Events = list[tuple[str, int]]


def record(
    rows: Sequence[Row], end: End = End.AGENT_FAILED, hits: Hits = NO_HITS, on: RoadMap | None = None
) -> EgoRecord:
    """Return the record of the only CAV of a 100 m scenario; its agent fails at the end unless stated otherwise."""
    about = scenario()
    return build_ego_records(ScoredEpisode(episode(about, {"0": rows}, {"0": end}, hits), about, on or street()))[0]


def events(found: EgoRecord) -> Events:
    """Return kind and tick of the infractions, without the marks of failed agents and deviations."""
    return [(i.kind, i.tick) for i in found.infractions if i.kind not in ("agent-failed", "route-deviation")]


def move_aside(rows: Sequence[Row], begin: float, end: float, y: float) -> list[Row]:
    """Return the drive with the lateral position y where begin <= x < end."""
    return [(x, y if begin <= x < end else at, yaw, speed) for x, at, yaw, speed in rows]
