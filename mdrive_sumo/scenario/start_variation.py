"""Other starts of CAVs: position along the route and start speed, free of overlap, on the lane as written.

Two shifts add up: one of all CAVs together, as far as the scenario says (`CommonStartShift`), and one of each CAV. The
first changes from where a conflict is met, not which CAVs meet; the second which of them is there first.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Polyline, wrap_angle
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.checks import TOUCHING_M2
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import ReplayMotion
from mdrive_sumo.scenario.start_boxes import CAR, build_box, build_user_box, compute_first_pose, find_departure_pose


@dataclass(frozen=True, slots=True)
class StartBounds:
    """How far the start of a CAV may be from what is written. Assumptions."""

    shift_m: float = 3.0
    """Along the route: half a car's length, in which a queue keeps its order."""
    speed: float = 2.0
    """[m/s] of a CAV that is written to start at rest: it stops again within half a metre."""
    speed_share: float = 0.1
    """Share of the speed of a CAV that is written to start in motion."""
    line_gap_m: float = 1.0
    """A shifted front bumper stays this far before the end of its lane and before a stop line."""
    gap_m: float = 2.0
    """Free length kept before and behind a shifted CAV, as in a queue (SUMO's minimum gap is 2.5 m)."""
    route_left_m: float = 20.0
    """A shifted start leaves at least this much of the route."""


SHRINKS = (1.0, 0.5, 0.25, 0.0)
"""Shares of a drawn shift that are tried, in this order, until the start is free."""
LEAST_SHIFT_M = 0.05
"""A smaller shift is none: the route needs distinct points."""
FRONT_M = CAR.length / 2
"""[m] From the box centre to the front bumper."""


def vary_starts(
    scenario: Scenario, roads: RoadMap, seed: int, bounds: StartBounds, log_trim_s: float
) -> tuple[Ego, ...]:
    """Return the CAVs with other starts. `scenario`: with its actors and traffic already varied.

    A CAV that starts in motion is ahead by what it drives while the log is trimmed by `log_trim_s` [s]. A start that is
    not free is drawn nearer to the written one, which always fits.
    """
    others = list(_iterate_boxes(scenario, roads))
    egos = _shift_together(scenario, roads, seed, bounds, others)
    starts = {ego.id: build_user_box(ego) for ego in egos}
    varied: list[Ego] = []
    for ego in egos:
        drawn = draw_uniforms(seed, "variation", scenario.id, "cav", ego.id)
        shift_m = bounds.shift_m * (2.0 * drawn[0] - 1.0) + ego.start_speed * log_trim_s
        blockers = [*others, *(box for name, box in starts.items() if name != ego.id)]
        shifted = _find_free_start(ego, shift_m, roads, bounds, blockers)
        starts[ego.id] = build_user_box(shifted)
        varied.append(shifted.model_copy(update={"start_speed": _vary_speed(ego.start_speed, drawn[1], bounds)}))
    return tuple(varied)


def _shift_together(
    scenario: Scenario, roads: RoadMap, seed: int, bounds: StartBounds, others: Sequence[shapely.Polygon]
) -> tuple[Ego, ...]:
    """Return all CAVs shifted by one length: the largest tried share of the drawn one at which every start is free."""
    if scenario.start_shift is None:
        return scenario.egos
    low, high = -scenario.start_shift.back_m, scenario.start_shift.ahead_m
    drawn_m = low + (high - low) * draw_uniforms(seed, "variation", scenario.id, "starts")[0]
    ranges = [find_shift_range(ego, roads, bounds) for ego in scenario.egos]
    for share in SHRINKS:
        shift_m = min(max([share * drawn_m, *(least for least, _ in ranges)]), *(most for _, most in ranges))
        shifted = tuple(shift_start(ego, shift_m, roads) for ego in scenario.egos)
        if shifted == scenario.egos or not _is_any_in_the_way(scenario.egos, shifted, others, bounds):
            return shifted
    return scenario.egos


def _is_any_in_the_way(
    egos: Sequence[Ego], shifted: Sequence[Ego], others: Sequence[shapely.Polygon], bounds: StartBounds
) -> bool:
    """Return whether a start is not free, or something is on the way between the written start and that one."""
    boxes = [build_user_box(ego) for ego in shifted]
    return any(
        _is_blocked(new.start, [*others, *boxes[:i], *boxes[i + 1 :]], bounds)
        or any(shapely.intersects(_build_sweep(ego, new), box) for box in others)
        for i, (ego, new) in enumerate(zip(egos, shifted, strict=True))
    )


def _build_sweep(ego: Ego, shifted: Ego) -> shapely.Polygon:
    """Return what a CAV covers between the written start and the shifted one."""
    there, here = Polyline(ego.xy), Polyline(shifted.xy)
    longer, gap_m = (
        (here, here.length - there.length) if here.length > there.length else (there, there.length - here.length)
    )
    stations = np.linspace(0.0, gap_m, max(math.ceil(gap_m), 1) + 1).tolist()
    return shapely.LineString([longer.at(s) for s in stations]).buffer(CAR.width / 2)


def _vary_speed(speed: float, uniform: float, bounds: StartBounds) -> float:
    if speed == 0.0:
        return round(bounds.speed * uniform, 3)
    return round(min(speed * (1.0 + bounds.speed_share * (2.0 * uniform - 1.0)), 60.0), 3)


def _find_free_start(
    ego: Ego, shift_m: float, roads: RoadMap, bounds: StartBounds, blockers: Sequence[shapely.Polygon]
) -> Ego:
    """Return the CAV at the largest tried share of the shift at which no blocker is nearer than it was, or `gap_m`."""
    low, high = find_shift_range(ego, roads, bounds)
    for share in SHRINKS:
        shifted = shift_start(ego, min(max(share * shift_m, low), high), roads)
        if shifted is ego or not _is_blocked(shifted.start, blockers, bounds):
            return shifted
    return ego


def _is_blocked(start: Pose, blockers: Sequence[shapely.Polygon], bounds: StartBounds) -> bool:
    room = build_box(start, CAR.length + 2.0 * bounds.gap_m, CAR.width)
    return any(float(shapely.intersection(room, box).area) > TOUCHING_M2 for box in blockers)


def find_shift_range(ego: Ego, roads: RoadMap, bounds: StartBounds) -> tuple[float, float]:
    """Return the least and greatest shift [m]: on the lane of the start, before its stop lines, with a route left."""
    lane = roads.lanes[ego.lanes[0]]
    start_m = lane.centre.project(ego.start.x, ego.start.y)[0]
    lines = [sign.line_pos_m for sign in roads.stop_signs or () if sign.lane == lane.id]
    ends = [line for line in (*lines, lane.centre.length) if line >= start_m + FRONT_M]
    ahead = min([lane.centre.length - start_m, *(end - bounds.line_gap_m - start_m - FRONT_M for end in ends)])
    route_left = float(Polyline(ego.xy).length) - bounds.route_left_m
    return min(-(start_m - FRONT_M), 0.0), max(min(ahead, route_left), 0.0)


def shift_start(ego: Ego, shift_m: float, roads: RoadMap) -> Ego:
    """Return the CAV that starts `shift_m` [m] further along its route, with the same lateral position.

    The route begins at the new start: it loses its first points, or begins further back on the lane of the start.
    """
    if abs(shift_m) < LEAST_SHIFT_M:
        return ego
    route = _cut_route(ego, shift_m) if shift_m > 0 else _extend_route(ego, -shift_m, roads.lanes[ego.lanes[0]])
    route = tuple((round(x, 3), round(y, 3), round(yaw, 4)) for x, y, yaw in route)
    return ego.model_copy(update={"route": route, "start": _move_pose(ego.start, ego.route[0], route[0])})


def _move_pose(pose: Pose, base: tuple[float, float, float], target: tuple[float, float, float]) -> Pose:
    """Return a pose relative to `target` as it is relative to `base`."""
    turn = target[2] - base[2]
    dx, dy = pose.x - base[0], pose.y - base[1]
    x = target[0] + portable.cos(turn) * dx - portable.sin(turn) * dy
    y = target[1] + portable.sin(turn) * dx + portable.cos(turn) * dy
    return Pose(x=round(x, 3), y=round(y, 3), yaw=round(pose.yaw + wrap_angle(turn), 4))


def _cut_route(ego: Ego, shift_m: float) -> list[tuple[float, float, float]]:
    """Return the route from `shift_m` [m] on. Its first hop is 0.4 to 1.4 m long."""
    line = Polyline(ego.xy)
    before = int(np.searchsorted(line.s, shift_m, side="right")) - 1
    kept = [point for point, s in zip(ego.route, line.s.tolist(), strict=True) if s >= shift_m + 0.4]
    return [(*line.at(shift_m), ego.route[before][2]), *kept]


def _extend_route(ego: Ego, back_m: float, lane: Lane) -> list[tuple[float, float, float]]:
    """Return the route begun `back_m` [m] before its first point, at that point's offset from the lane's centre."""
    x, y, _ = ego.route[0]
    begin_m, offset = lane.centre.project(x, y)
    hops = math.ceil(back_m)
    added: list[tuple[float, float, float]] = []
    for s in np.linspace(begin_m - back_m, begin_m, hops, endpoint=False).tolist():
        (cx, cy), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
        added.append((cx - portable.sin(yaw) * offset, cy + portable.cos(yaw) * offset, yaw))
    return [*added, *ego.route]


def _iterate_boxes(scenario: Scenario, roads: RoadMap) -> Iterator[shapely.Polygon]:
    """Yield the boxes of scripted actors and background vehicles that are there in frame 0."""
    for actor in scenario.actors:
        if not (isinstance(actor.motion, ReplayMotion) and actor.motion.poses[0][0] > 0.0 and actor.trigger is None):
            yield build_box(compute_first_pose(actor, roads), actor.length, actor.width)
    for vehicle in scenario.background.vehicles:
        pose = find_departure_pose(vehicle, roads) if vehicle.depart_s == 0.0 else None
        if pose is not None:
            yield build_box(pose, vehicle.length, vehicle.width)
