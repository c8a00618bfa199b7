"""A moving vehicle of a log as a background vehicle: route, departure, schedule."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing, Schedule
from real2sim.clean.object_attributes import clamp_size
from real2sim.fit.route_path import RoutePath, build_route_path, compute_progress, find_straight_continuation
from real2sim.match import LaneMatch
from real2sim.percentile import compute_median
from real2sim.recording import RecordedTrack

SCHEDULE_S = 0.2
"""[s] Interval between two points of a schedule."""
ROUTE_AFTER_LOG_M = 300.0
"""[m] Length of the route after the end of the log: 20 s at 15 m/s."""
OFF_ROAD_M = 3.0
"""[m] A vehicle that drives further than this before its first lane or after its last was off the road there."""
BETWEEN_M = 10.0
"""[m] A vehicle that drives further than this between two of its lanes leaves the road: two car lengths. The largest
gap in the logs of docs/real2sim.md, a corner that is cut, is 3.6 m."""
EDGE_OF_MAP_M = 8.0
"""[m] A lane without predecessor or successor ends the map; within this distance of its end a vehicle leaves the
map."""
OVER_M = 1.0
"""[m] A front bumper this far beyond the last lane is off the map."""
INSERTION_MARGIN_M = 1.0
"""[m] Least distance from the end of an edge at which SUMO inserts a vehicle."""
LANE_CHANGE_MARGIN_M = 1.0
"""[m] A lane change is due at least this far before the end of its edge. Nearer than 0.5 m the simulation counts it to
the next edge (`sumo.scheduled_driving.EDGE_M`), and a vehicle whose lane ends there would wait for ever."""


@dataclass(frozen=True)
class RoutedTrack:
    """A track on its route."""

    track: RecordedTrack
    match: LaneMatch
    path: RoutePath
    """Includes the edge before a junction in which the track begins, and a straight continuation after its end."""
    progress: Float
    """(T,) distance of the box centre along the path [m]; NaN before the first and after the last frame."""
    length: float
    width: float
    """Median length and width [m] of its boxes."""

    @property
    def front_progress(self) -> Float:
        """(T,) distance of the front bumper along the path [m]."""
        return np.minimum(self.progress + self.length / 2, self.path.length - INSERTION_MARGIN_M / 10)

    @property
    def omitted_part(self) -> str:
        """Sentence about the frames of the track that are not driven; "" if there are none."""
        seen, kept = self.track.valid_frames, np.flatnonzero(np.isfinite(self.progress))
        late, early = kept[0] - seen[0], seen[-1] - kept[-1]
        comes = f"comes onto the map at frame {kept[0]}, {late} frames after it is first seen" if late else ""
        goes = f"leaves the map at frame {kept[-1]}, {early} frames before it is last seen" if early else ""
        return "; ".join(part for part in (comes, goes) if part)


def median_size(track: RecordedTrack) -> tuple[float, float]:
    """Return length and width [m] of a cleaned track, within the limits of a scenario."""
    size = compute_median(track.length[track.valid]), compute_median(track.width[track.valid])
    return clamp_size(*size, track.category.kind)


def route_track(track: RecordedTrack, match: LaneMatch, roads: RoadMap) -> RoutedTrack | str:
    """Return the track on its route, or the reason why it has no usable one."""
    if match.is_off_road:
        return match.reason
    if match.break_frames or match.reason:
        return match.reason or "no route connects all lanes that it drove on"
    on = np.array([frame for frame in track.valid_frames.tolist() if match.lanes[frame]], dtype=np.intp)
    if why := _explain_off_road(track, match, on, roads):
        return why
    lanes = (*_find_entry_lanes(roads, match.route[0]), *match.route)
    lanes = (*lanes, *find_straight_continuation(roads, lanes[-1], ROUTE_AFTER_LOG_M))
    path = build_route_path(roads, lanes)
    if not path.edges:
        return "no edge outside a junction on its route"
    length, width = median_size(track)
    progress = compute_progress(path, track, match)
    for off in _find_off_road_ends(track, on):
        progress[off] = np.nan
    front = progress + length / 2
    progress[(front < 0.0) | (front > path.length + OVER_M)] = np.nan
    if np.isfinite(progress).sum() < 2:
        return "it is on the roads of the map for one frame only"
    return RoutedTrack(track, match, path, progress, length, width)


def _find_off_road_ends(track: RecordedTrack, on: np.ndarray) -> list[slice]:
    """Return the frames before the first lane and after the last that are longer than `OFF_ROAD_M`."""
    ends = (slice(0, int(on[0])), slice(int(on[-1]) + 1, len(track.valid)))
    return [
        end
        for end, frame in zip(ends, (on[0], on[-1]), strict=True)
        if _compute_end_length(track, end, int(frame)) > OFF_ROAD_M
    ]


def _compute_end_length(track: RecordedTrack, end: slice, frame: int) -> float:
    """Return the distance [m] driven in the frames of one end, up to or from frame `at`."""
    rows = sorted({*(np.flatnonzero(track.valid[end]) + end.start).tolist(), frame})
    return float(np.hypot(*np.diff(track.xy[rows], axis=0).T).sum())


def _explain_off_road(track: RecordedTrack, match: LaneMatch, on: np.ndarray, roads: RoadMap) -> str:
    """Return why the track leaves the roads where they continue; "" where it only enters or leaves the map."""
    for end in _find_off_road_ends(track, on):
        first = end.start == 0
        frame = int(on[0] if first else on[-1])
        lane = roads.lanes[match.lanes[frame]]
        rest = float(match.s[frame]) if first else lane.centre.length - float(match.s[frame])
        onward = (
            any(lane.id in lane_after.successors for lane_after in roads.driving) if first else bool(lane.successors)
        )
        if onward or rest > EDGE_OF_MAP_M:
            away = _compute_end_length(track, end, frame)
            return f"drives {away:.1f} m off the road {'before its first' if first else 'after its last'} lane"
    for before, after in pairwise(on.tolist()):
        away = float(np.hypot(*np.diff(track.xy[before : after + 1], axis=0).T).sum()) if after > before + 1 else 0.0
        if away > BETWEEN_M:
            return f"drives {away:.1f} m off the road between two of its lanes"
    return ""


def _find_entry_lanes(roads: RoadMap, lane: str) -> tuple[str, ...]:
    """Return the lanes before one inside a junction, from an edge on: SUMO inserts vehicles on edges only."""
    lanes_before: list[str] = []
    while roads.lanes[(lanes_before or [lane])[0]].junction:
        first = (lanes_before or [lane])[0]
        before = [lane.id for lane in roads.driving if first in lane.successors and lane.id not in lanes_before]
        if not before:
            break
        lanes_before.insert(0, before[0])
    return tuple(lanes_before)


def build_background_vehicle(
    routed: RoutedTrack, name: str, driving: CarFollowing, dt_s: float, log: bool
) -> BackgroundVehicle:
    """Return the vehicle from its first frame on. The `progress` of its schedule begins above 0 if it begins in a
    junction."""
    frames = np.flatnonzero(np.isfinite(routed.progress))
    first, front = int(frames[0]), routed.front_progress
    edge = next(stage for stage in routed.path.edges_in_order if not stage.junction)
    depart = min(max(float(front[first]) - edge.begin, 0.0), max(edge.length - INSERTION_MARGIN_M, 0.0))
    start = edge.begin + depart
    return BackgroundVehicle(
        id=name,
        depart_s=round(first * dt_s, 3),
        edges=routed.path.edges,
        depart_lane=_find_depart_lane(routed),
        depart_pos_m=round(depart, 2),
        depart_speed=min(round(_compute_depart_speed(routed.progress[frames], dt_s), 2), 60.0),
        length=routed.length,
        width=routed.width,
        driving=driving,
        schedule=Schedule(
            progress=_sample_schedule(frames, front[frames] - start, dt_s),
            lanes=_find_lane_changes(routed, start),
            leaves=int(frames[-1]) < len(front) - 1,
        ),
        log=timed_poses(routed.track, dt_s) if log else (),
    )


def _find_depart_lane(routed: RoutedTrack) -> int:
    """Return the index of the departure lane: that of the first frame, else of the edge before the junction."""
    first = int(np.flatnonzero(np.isfinite(routed.progress))[0])
    edge = next(stage for stage in routed.path.edges_in_order if not stage.junction)
    on = [lane for lane in edge.lanes if lane.id == routed.match.lanes[first]]
    return (on or list(edge.lanes))[0].index


def _compute_depart_speed(progress: Float, dt_s: float) -> float:
    ahead = min(3, len(progress) - 1)
    return float(progress[ahead] - progress[0]) / (ahead * dt_s) if ahead else 0.0


def _sample_schedule(frames: np.ndarray, front: Float, dt_s: float) -> tuple[tuple[float, float], ...]:
    """Return at most one point per `SCHEDULE_S`, with the first and last frame."""
    every = max(round(SCHEDULE_S / dt_s), 1)
    kept = sorted({*range(0, len(frames), every), len(frames) - 1})
    if len(kept) < 2:
        return ((round(frames[0] * dt_s, 3), 0.0), (round((frames[0] + 1) * dt_s, 3), 0.0))
    rounded = np.maximum.accumulate(np.round(np.maximum(front[kept], 0.0), 2))
    return tuple((round(float(frames[k]) * dt_s, 3), float(s)) for k, s in zip(kept, rounded, strict=True))


def _find_lane_changes(routed: RoutedTrack, start: float) -> tuple[tuple[float, int], ...]:
    """Return where the front bumper is when the centre enters the next lane of its route [m], with the lane's index.

    A change that the route requires but no frame shows (a lane that ends) takes place at the last position on the lane
    before.
    """
    seen = _find_lane_extents(routed)
    changes: list[tuple[float, int]] = []
    index = _find_depart_lane(routed)
    for k, stage in enumerate(routed.path.edges_in_order):
        if stage.junction:
            continue
        for before, lane in pairwise([None, *stage.lanes]):
            if lane is not None and lane.index != index:
                change_at = (
                    seen.get((k, lane.id), (stage.begin, 0.0))[0]
                    if before is None
                    else _find_crossing(seen, k, before, lane)
                )
                change_at = max(min(change_at, stage.end - LANE_CHANGE_MARGIN_M), stage.begin)
                changes.append((round(max(change_at - start, 0.0), 2), lane.index))
                index = lane.index
    return tuple(sorted(changes, key=lambda change: change[0]))


def _find_crossing(seen: dict[tuple[int, str], tuple[float, float]], stage: int, before: Lane, lane: Lane) -> float:
    """Return the position along the path [m] of a change, from the first and last positions on the lanes."""
    if (stage, lane.id) in seen:
        return seen[stage, lane.id][0]
    return seen.get((stage, before.id), (0.0, 0.0))[1]


def _find_lane_extents(routed: RoutedTrack) -> dict[tuple[int, str], tuple[float, float]]:
    """Return the first and last position of the front bumper [m] by edge index and lane."""
    extents: dict[tuple[int, str], tuple[float, float]] = {}
    least, front = 0, routed.front_progress
    for frame in np.flatnonzero(np.isfinite(routed.progress)).tolist():
        lane = routed.match.lanes[frame]
        k = routed.path.find_edge_index(lane, least) if lane else None
        if k is not None:
            least, front_m = max(k, least), float(front[frame])
            extents[k, lane] = (extents.get((k, lane), (front_m, front_m))[0], front_m)
    return extents


def timed_poses(track: RecordedTrack, dt_s: float) -> tuple[tuple[float, float, float, float], ...]:
    """Return the timed poses of the log, rounded to ms, cm and 0.1 mrad."""
    frames: Sequence[int] = track.valid_frames.tolist()
    return tuple(
        (
            round(k * dt_s, 3),
            round(float(track.x[k]), 2),
            round(float(track.y[k]), 2),
            round(float(np.nan_to_num(track.yaw[k])), 4),
        )
        for k in frames
    )
