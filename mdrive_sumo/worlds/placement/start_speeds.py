"""Speeds of CAVs at the start: those of the protocol start at rest or slowly, those at the speed of the road drive."""

import math
import random
from collections.abc import Sequence

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.start_boxes import build_user_box

MOVING_SHARE, START_MPS = 0.35, (2.0, 8.0)
"""Share of CAVs that start with a speed [m/s], as those of logs do, if nothing is near ahead."""
CLEAR_AHEAD_M, CLEAR_WIDTH_M = 24.0, 5.0
"""[m] Length and width of what must be free ahead of a CAV that starts with a speed."""
STRAIGHT_RAD = 0.25
"""[rad] Its route turns by no more than that there."""
ROLLING_SHARE, LIMIT_SHARES = 0.75, (0.4, 0.95)
"""Share of the scenarios at road speed whose CAVs drive at the start, and bounds of the share of their speed limits at
which they do; chosen."""
BRAKING, LATERAL = 3.0, 2.0
"""[m/s2] A CAV that starts at road speed can stop with the first before what stands ahead and before its junction, and
take its bends with the second: comfortable driving, as of planners that have no time to lose."""
STOP_GAP_M, OWN_WIDTH_M = 8.0, 3.0
"""[m] From its centre to what it stops before: half a car and 5 m. Width of the strip that it needs: a lane."""
BEND_M = 4
"""[m] Over which the curvature of a route is measured: a car's length."""


def draw_start_speeds(egos: Sequence[Ego], others: Sequence[shapely.Polygon], rng: random.Random) -> tuple[Ego, ...]:
    """Return the CAVs, some with a speed at the start: those with a free and nearly straight stretch ahead.

    others: boxes of all other road users.
    """
    boxes = [build_user_box(ego) for ego in egos]
    found: list[Ego] = []
    for k, ego in enumerate(egos):
        is_moving, speed = rng.random() < MOVING_SHARE, round(rng.uniform(*START_MPS), 2)
        if is_moving and _is_clear_ahead(ego, [*boxes[:k], *boxes[k + 1 :], *others]):
            ego = ego.model_copy(update={"start_speed": speed})
        found.append(ego)
    return tuple(found)


def _is_clear_ahead(ego: Ego, others: Sequence[shapely.Polygon]) -> bool:
    ahead = min(int(CLEAR_AHEAD_M), len(ego.route) - 1)
    turned = max(abs(wrap_angle(yaw - ego.start.yaw)) for yaw in ego.yaw[: ahead + 1].tolist())
    strip = shapely.LineString(ego.xy[: ahead + 1]).buffer(CLEAR_WIDTH_M / 2, cap_style="flat")
    return turned < STRAIGHT_RAD and not np.any(shapely.intersects(strip, list(others)))


def draw_road_speeds(
    roads: RoadMap, egos: Sequence[Ego], others: Sequence[shapely.Polygon], rng: random.Random
) -> tuple[Ego, ...]:
    """Return the CAVs with speeds of one share of their speed limits, less where they could not stop in time.

    others: boxes of all other road users, taken to stand. All CAVs have the same share, so those that would meet when
    they start at rest still meet.
    """
    share = rng.uniform(*LIMIT_SHARES) if rng.random() < ROLLING_SHARE else 0.0
    speeds = [min(share * roads.lanes[ego.lanes[0]].speed_limit, _find_safe_speed(roads, ego, others)) for ego in egos]
    for _ in egos[1:]:  # a CAV that is slower slows those behind it, and these those behind them
        speeds = [min(speed, _find_following_speed(k, egos, speeds)) for k, speed in enumerate(speeds)]
    return tuple(
        ego.model_copy(update={"start_speed": round(speed, 2)}) for ego, speed in zip(egos, speeds, strict=True)
    )


def _find_safe_speed(roads: RoadMap, ego: Ego, others: Sequence[shapely.Polygon]) -> float:
    """Return the greatest speed [m/s] from which a CAV can take its bends, and stop before its junction and others."""
    stations = np.arange(len(ego.route) - BEND_M)
    turned = np.abs([wrap_angle(angle) for angle in (ego.yaw[BEND_M:] - ego.yaw[:-BEND_M]).tolist()])
    bends = LATERAL / np.maximum(turned / BEND_M, 1e-6) + 2 * BRAKING * stations
    stops = [_measure_way(ego, box) for box in others]
    stops.append(_measure_way_to_junction(roads, ego))
    return min(math.sqrt(float(bends.min(initial=np.inf))), *(_find_stopping_speed(way_m) for way_m in stops))


def _find_stopping_speed(way_m: float, ahead_mps: float = 0.0) -> float:
    """Return the speed [m/s] from which a CAV does not run into what is so far ahead and brakes as it does."""
    return math.sqrt(ahead_mps * ahead_mps + 2 * BRAKING * max(way_m - STOP_GAP_M, 0.0))


def _find_following_speed(k: int, egos: Sequence[Ego], speeds: Sequence[float]) -> float:
    """Return the greatest speed [m/s] of one CAV behind the others ahead in its lane."""
    ego = egos[k]
    found = math.inf
    for other, speed in zip(egos, speeds, strict=True):
        way_m = _measure_way(ego, build_user_box(other)) if other is not ego else math.inf
        if way_m < math.inf:
            along = max(speed * portable.cos(other.start.yaw - ego.start.yaw), 0.0)
            found = min(found, _find_stopping_speed(way_m, along))
    return found


def _measure_way(ego: Ego, box: shapely.Polygon) -> float:
    """Return the distance [m] along a CAV's route to a box in its way; infinite for one that is not."""
    route = shapely.LineString(ego.xy)
    met = box.intersection(route.buffer(OWN_WIDTH_M / 2, cap_style="flat"))
    if met.is_empty:
        return math.inf
    return min(float(route.project(shapely.Point(corner))) for corner in shapely.get_coordinates(met).tolist())


def _measure_way_to_junction(roads: RoadMap, ego: Ego) -> float:
    """Return the distance [m] to the first junction at which a CAV may have to wait; infinite on motorways."""
    way_m = -roads.lanes[ego.lanes[0]].centre.project(ego.start.x, ego.start.y)[0]
    for name in ego.lanes:
        lane = roads.lanes[name]
        if lane.junction:
            return max(way_m, 0.0) if _is_crossed(roads, name) else math.inf
        way_m += lane.centre.length
    return math.inf


def _is_crossed(roads: RoadMap, name: str) -> bool:
    """Return whether a junction has lanes from edges of different directions: not a piece of one carriageway."""
    junction = name.rsplit("_", 2)[0]
    inside = {lane.id for lane in roads.driving if lane.junction and lane.id.rsplit("_", 2)[0] == junction}
    return len({lane.edge for lane in roads.driving if not lane.junction and inside.intersection(lane.successors)}) > 2
