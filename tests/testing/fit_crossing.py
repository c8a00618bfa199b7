"""A drawn crossing and tracks on it, for the tests of fit and closeness."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import BackgroundMode
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.fit import FittedTraffic, fit_traffic
from real2sim.match import LaneMatch, match_track
from real2sim.network import build_network
from real2sim.recording import ObjectCategory, RecordedTrack
from testing.map_faults import lane, lanes_map

DT_S, FRAMES = 0.1, 101


def crossing(folder: Path) -> RoadMap:
    """Two lanes east along y = 0 and y = 3.5 from x = 0 to 430, crossed by one lane north at x = 215."""
    build_network(
        lanes_map(
            lane("w0", [(0, 0), (200, 0)], ("j0",)),
            lane("w1", [(0, 3.5), (200, 3.5)], ("j1",)),
            lane("j0", [(200, 0), (230, 0)], ("e0",), junction=True),
            lane("j1", [(200, 3.5), (230, 3.5)], ("e1",), junction=True),
            lane("e0", [(230, 0), (430, 0)]),
            lane("e1", [(230, 3.5), (430, 3.5)]),
            lane("s", [(215, -150), (215, -20)], ("jn",)),
            lane("jn", [(215, -20), (215, 20)], ("n",), junction=True),
            lane("n", [(215, 20), (215, 150)]),
        ),
        [],
        folder / "net",
        "crossing",
    )
    return load_road_map(folder / "net")


def seconds() -> Float:
    return np.arange(FRAMES, dtype=np.float64) * DT_S


def track(
    id_: str, x: object, y: object, category: ObjectCategory = ObjectCategory.CAR, parked: bool = False
) -> RecordedTrack:
    """A track through x, y (scalars or (T,), NaN where unseen), looking where it goes, east at rest."""
    full = np.ones(FRAMES)
    xs, ys = (np.asarray(value, dtype=np.float64) * full for value in (x, y))
    valid = np.isfinite(xs) & np.isfinite(ys)
    dx, dy = (np.gradient(np.where(valid, value, 0.0)) for value in (xs, ys))
    yaw = np.where(np.hypot(dx, dy) > 0.01, np.arctan2(dy, dx), 0.0)
    seen = np.where(valid, 1.0, np.nan)
    length, width = (0.6, 0.6) if category is ObjectCategory.PEDESTRIAN else (4.5, 1.8)
    return RecordedTrack(id_, category, valid, xs * seen, ys * seen, yaw * seen, length * seen, width * seen, parked)


def matches_of(tracks: Sequence[RecordedTrack], roads: RoadMap) -> Mapping[str, LaneMatch]:
    driving = [one for one in tracks if one.category not in (ObjectCategory.PEDESTRIAN, ObjectCategory.STATIC)]
    return {one.id: match_track(np.column_stack((one.x, one.y, one.yaw)), roads) for one in driving}


@dataclass(frozen=True)
class Made:
    fitted: FittedTraffic
    scenario: Scenario
    roads: RoadMap
    tracks: tuple[RecordedTrack, ...]


def made(
    roads: RoadMap,
    *tracks: RecordedTrack,
    mode: BackgroundMode = "reactive",
    cavs: Sequence[str] = ("cav",),
    cav_y: float = 0.0,
) -> Made:
    """Fitted tracks and their scenario; a CAV far ahead of all others is added."""
    all_tracks = (track("cav", 300.0 + 8.0 * seconds(), cav_y), *tracks)
    fitted = fit_traffic(all_tracks, matches_of(all_tracks, roads), roads, cavs, mode, DT_S)
    scenario = Scenario(
        id="crossing",
        bucket="Test",
        category="test",
        network="crossing",
        egos=fitted.egos,
        background=fitted.background,
        actors=fitted.actors,
    )
    return Made(fitted, scenario, roads, all_tracks)
