"""CAVs of a log: selection, and route, start state and goal of each."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, Route, build_lane_route, join_route_pieces
from mdrive_sumo.scenario.checks import compute_max_start_gap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from real2sim.fit.route_path import find_straight_continuation
from real2sim.match import LaneMatch
from real2sim.match.waypoint_matcher import RouteLeg, build_dense_route
from real2sim.recording import RecordedTrack

MIN_ROUTE_M = 20.0
"""[m] Least length of a route; that of a CAV that hardly moves in the log is extended along its lane."""
LANE_CHANGE_M = 20.0
"""[m] Length of a lane change of a route; it begins half of that before the lane marking is crossed."""
TAPER_M = 10.0
"""[m] Length over which the route returns to the centre line: half of a lane change (`cavs.LANE_CHANGE_M`)."""
MAX_ASIDE_M = 3.5
"""[m] Largest lateral offset; `checks.OFF_LANE_M` allows 4 m."""
BESIDE_LANE_M = 1.0
"""[m] A point this far before or behind a lane is beside another one."""


def choose_cavs(
    wanted: Sequence[str], tracks: Sequence[RecordedTrack], matches: Mapping[str, LaneMatch]
) -> tuple[str, ...]:
    """Return the track ids of the CAVs: those of the source that move on a usable route, else the vehicle that is
    present longest.

    `wanted` are the ids of the source's CAVs (`CleanedRecording.cavs`). Raises InputError if no vehicle is usable.
    """
    fit = {
        track.id: track for track in tracks if not track.parked and not explain_unusable(track, matches.get(track.id))
    }
    if told := tuple(name for name in wanted if name in fit):
        return told
    if not fit:
        raise InputError(
            f"expected a moving vehicle that is on a road from the first frame on to be the CAV,"
            f" found none of {len(tracks)} tracks"
        )
    driven_m = {id_: float(np.hypot(*np.diff(track.xy[track.valid], axis=0).T).sum()) for id_, track in fit.items()}
    return (max(fit, key=lambda id_: (int(fit[id_].valid.sum()), driven_m[id_], id_)),)


def explain_unused_cavs(
    wanted: Sequence[str], chosen: Sequence[str], tracks: Sequence[RecordedTrack], matches: Mapping[str, LaneMatch]
) -> dict[str, str]:
    """Return the CAVs of the source that are not CAVs of the scenario, with the reason."""
    track_by_id = {track.id: track for track in tracks}
    return {name: _explain_unused(track_by_id.get(name), matches.get(name)) for name in wanted if name not in chosen}


def _explain_unused(track: RecordedTrack | None, match: LaneMatch | None) -> str:
    if track is None:
        return "it is not in the cleaned log"
    return "it never moves" if track.parked else explain_unusable(track, match)


def explain_unusable(track: RecordedTrack, match: LaneMatch | None) -> str:
    """Return why a track cannot be a CAV; "" if it can."""
    if track.category.kind is not Kind.VEHICLE:
        return f"a {track.category.value} is not a vehicle"
    if not track.valid[0]:
        return (
            f"it appears only in frame {int(track.valid_frames[0])}, and a CAV is there from the first frame on"
            if len(track.valid_frames)
            else "it is never seen"
        )
    if match is None or match.is_off_road:
        return match.reason if match is not None else "it was not matched to lanes"
    if match.reason:
        return match.reason
    if not match.lanes[0]:
        return "it is on no lane in the first frame"
    if abs(float(match.offset[0])) > compute_max_start_gap(match.first_lane_width):
        return f"it starts {abs(float(match.offset[0])):.1f} m beside its lane"
    return ""


def build_ego(track: RecordedTrack, match: LaneMatch, roads: RoadMap, name: str, dt_s: float) -> tuple[Ego, str]:
    """Return the CAV and a remark about its route; raises InputError if the track cannot be a CAV."""
    if why := explain_unusable(track, match):
        raise InputError(f"CAV {track.id}: expected a vehicle with a way through the network, found: {why}")
    route, said = _build_route(match, roads)
    xy, yaw = route.xy, np.unwrap(route.yaw)
    start = Pose(x=_round_mm(track.x[0]), y=_round_mm(track.y[0]), yaw=round(float(track.yaw[0]), 4))
    points = tuple((_round_mm(x), _round_mm(y), round(float(a), 4)) for (x, y), a in zip(xy, yaw, strict=True))
    speed = float(np.clip(_estimate_start_speed(track, dt_s), 0.0, 60.0))
    return Ego(id=name, start=start, start_speed=round(speed, 2), lanes=route.lanes, route=points), said


def _round_mm(value: float) -> float:
    return round(float(value), 3)


def _estimate_start_speed(track: RecordedTrack, dt_s: float) -> float:
    """Return the speed [m/s] over the first frames, 0 below 0.1 m/s."""
    last = min(3, len(track.valid_frames) - 1)
    frames = track.valid_frames[[0, last]]
    if not last:
        return 0.0
    speed = float(np.hypot(*np.diff(track.xy[frames], axis=0)[0])) / (float(np.diff(frames)[0]) * dt_s)
    return speed if speed >= 0.1 else 0.0


def _build_route(match: LaneMatch, roads: RoadMap) -> tuple[Route, str]:
    """Return the route from the first to the last frame, at least `MIN_ROUTE_M` long, and a remark if it was
    extended."""
    on = [frame for frame, lane in enumerate(match.lanes) if lane in match.route]
    lanes = list(match.route[match.route.index(match.lanes[on[0]]) :])
    start, goal = float(match.s[on[0]]), float(match.s[on[-1]])
    lanes = lanes[: len(lanes) - lanes[::-1].index(match.lanes[on[-1]])]
    route = _build_dense_route(match, roads, lanes, start, goal)
    length = float(np.hypot(*np.diff(route.xy, axis=0).T).sum()) if route is not None else 0.0
    if route is not None and length >= MIN_ROUTE_M:
        return route, ""
    lanes, goal = _extend_lanes(roads, lanes, goal, MIN_ROUTE_M - length)
    route = _build_dense_route(match, roads, lanes, start, goal)
    if route is None:
        raise InputError(f"lane {lanes[-1]}: expected room for a route, found its end")
    return route, f"goes only {length:.1f} m in the log: its route is prolonged along its lane"


def _extend_lanes(roads: RoadMap, lanes: Sequence[str], goal: float, missing: float) -> tuple[list[str], float]:
    """Extend the lanes by `missing` [m], or to the end of the network; return them and the arc length [m] of the goal
    on the last one."""
    extended = list(lanes)
    for lane in ("", *find_straight_continuation(roads, lanes[-1], missing)):
        if lane:
            extended, goal = [*extended, lane], 0.0
        rest = roads.lanes[extended[-1]].centre.length - goal
        if missing <= rest:
            return extended, goal + missing
        goal, missing = goal + rest, missing - rest
    return extended, goal


def _build_dense_route(
    match: LaneMatch, roads: RoadMap, lanes: Sequence[str], start: float, goal: float
) -> Route | None:
    """Return the dense route with lane changes where the log has them; None if it has no length."""
    if len(lanes) == 1 and goal - start < 0.2:
        return None
    try:
        route = build_lane_route(roads, lanes, start, goal, _find_lane_change_positions(match, roads, lanes))
    except (InputError, ValueError):  # no room to change lanes there: as early as there is room
        route = build_dense_route(roads, (RouteLeg(tuple(lanes), start, goal),))
    return follow_log_aside(route, match, roads) if match.aside_frames else route


def _find_lane_change_positions(match: LaneMatch, roads: RoadMap, lanes: Sequence[str]) -> dict[int, float]:
    """Return the arc length [m] at which each lane change begins, by the index in `lanes` of the lane that is left."""
    places: dict[int, float] = {}
    for i, (here, there) in enumerate(pairwise(lanes)):
        on = [k for k, lane in enumerate(match.lanes) if lane == here]
        if there in (roads.lanes[here].left, roads.lanes[here].right) and on:
            places[i] = max(float(match.s[on[-1]]) - LANE_CHANGE_M / 2, 0.0)
    return places


def follow_log_aside(route: Route, match: LaneMatch, roads: RoadMap) -> Route:
    """Return the route with the log's own lateral offset in the stretch before or after a change between connectors.

    The driver was on the other connector there (`LaneMatch.aside_frames`), often around an obstacle on this one.
    """
    xy = route.xy.copy()
    lanes = dict.fromkeys(match.lanes[frame] for frame in match.aside_frames if match.lanes[frame])
    for lane in (roads.lanes[id_] for id_ in lanes):
        frames = [frame for frame in match.aside_frames if match.lanes[frame] == lane.id]
        stations, first = np.unique(match.s[frames], return_index=True)
        offsets = np.clip(match.offset[frames][first], -MAX_ASIDE_M, MAX_ASIDE_M)
        for i, (x, y) in enumerate(route.xy.tolist()):
            s, d = lane.centre.project(x, y)
            if abs(d) > BESIDE_LANE_M or np.hypot(*(np.array(lane.centre.at(s)) - (x, y))) > BESIDE_LANE_M:
                continue
            away = max(stations[0] - s, s - stations[-1], 0.0)
            share = np.clip(1 - away / TAPER_M, 0.0, 1.0)
            shift = float(np.interp(s, stations, offsets)) * share**2 * (3 - 2 * share)
            yaw = lane.centre.yaw_at(s)
            xy[i] += shift * np.array((-np.sin(yaw), np.cos(yaw)))
    return join_route_pieces(route.lanes, [(xy, route.yaw)])
