"""Routes in steps: "west_in_2 -45 > west_in_1 -40 > south_out_1 20".

The first step is the start and the last one the goal: lane and arc length of the box centre [m]. A step between them is
a lane on the way; its number, if it has one, is the arc length at which the lane change into it begins. Numbers below
zero count from the lane's end. A point "12.5,-40.2" in place of a lane stands for the place on the road that is nearest
to it. What lies between two steps is found by routing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.roads import RoadMap, Route, build_lane_route, find_lane_path
from mdrive_sumo.worlds.authoring.point_matching import Spot, match_points

Point = tuple[float, float]
"""x, y [m] in the frame of the network."""
RouteSteps = str | Sequence[str | Point]
"""A route as a text of steps with ">" between them, or as a sequence of steps and points."""


@dataclass(frozen=True, slots=True)
class RouteStep:
    """A lane on a route, and an arc length [m] on it (below zero: from its end) or None."""

    lane: str
    s: float | None


def parse_steps(steps: RouteSteps) -> tuple[RouteStep | Point, ...]:
    """Return lanes and points of a route. Raises InputError, also if start or goal lack their arc length."""
    parts = steps.split(">") if isinstance(steps, str) else steps
    if not isinstance(cast(object, parts), list | tuple):
        raise InputError(f"route: expected a text or a list of steps, found {steps!r:.80}")
    parsed = [_parse_text(part) if isinstance(part, str) else _parse_point(part) for part in parts]
    if len(parsed) < 2:
        raise InputError(f"route: expected a start and a goal with '>' between them, found {steps!r:.80}")
    for step in (parsed[0], parsed[-1]):
        if isinstance(step, RouteStep) and step.s is None:
            raise InputError(f"route: expected an arc length for start and goal, found {step.lane!r} without")
    return tuple(parsed)


def _parse_text(part: str) -> RouteStep | Point:
    if "," in part:
        return _parse_point(tuple(part.split(",")))
    words = part.split()
    try:
        lane, *number = words
        s = float(number[0]) if number else None
    except ValueError:
        s, lane = math.nan, ""
    if not lane or len(words) > 2 or not math.isfinite(s or 0.0):
        raise InputError(f"route: expected steps 'lane [arc length]' or 'x,y', found {part.strip()!r:.60}")
    return RouteStep(lane, s)


def _parse_point(part: object) -> Point:
    try:
        x, y = (float(number) for number in cast("Sequence[str | float]", part))
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"route: expected a point (x, y) in metres, found {part!r:.60}")
    return x, y


def build_route(roads: RoadMap, steps: RouteSteps) -> Route:
    """Build the dense route through steps. Raises InputError for a lane that does not exist, and if there is no way."""
    parsed = parse_steps(steps)
    _check_steps(roads, [step for step in parsed if isinstance(step, RouteStep)])
    way = _match_steps(roads, parsed)
    lanes, changes = _join_lanes(roads, way)
    start_s, goal_s = (_find_station(roads, step) for step in (way[0], way[-1]))
    if len(lanes) == 1 and goal_s <= start_s:
        raise InputError(
            f"route: expected the goal ahead of the start, found {goal_s:.1f} m behind {start_s:.1f} m of {lanes[0]}"
        )
    return build_lane_route(roads, lanes, start_s, goal_s, changes)


def check_lane(roads: RoadMap, lane: str) -> None:
    """Raise InputError for a lane that the network does not have, or has for others than cars."""
    if lane not in roads.lanes:
        roadways = (name for name, known in roads.lanes.items() if not known.junction)
        raise InputError(f"expected a car lane of network {roads.name}, found {lane!r}{suggest_name(lane, roadways)}")


def _check_steps(roads: RoadMap, steps: Sequence[RouteStep]) -> None:
    for step in steps:
        check_lane(roads, step.lane)
        length = roads.lanes[step.lane].centre.length
        if step.s is not None and not -length <= step.s <= length:
            raise InputError(
                f"route: expected an arc length from -{length:.1f} to {length:.1f} m on lane {step.lane},"
                f" found {step.s:g}"
            )


def _match_steps(roads: RoadMap, parsed: Sequence[RouteStep | Point]) -> list[RouteStep]:
    """Return the steps with a lane for every point; between start and goal it only leads the way."""
    lanes = [step for step in parsed if isinstance(step, RouteStep)]
    if len(lanes) == len(parsed):
        return lanes
    spots = match_points(
        roads, [Spot(step.lane, _find_station(roads, step)) if isinstance(step, RouteStep) else step for step in parsed]
    )
    ends = (0, len(parsed) - 1)
    return [
        step if isinstance(step, RouteStep) else RouteStep(spot.lane, spot.s if i in ends else None)
        for i, (step, spot) in enumerate(zip(parsed, spots, strict=True))
    ]


def _join_lanes(roads: RoadMap, way: Sequence[RouteStep]) -> tuple[list[str], dict[int, float]]:
    """Return the lanes of the route, and by index of a lane the arc length [m] at which a lane change begins."""
    lanes = [way[0].lane]
    changes: dict[int, float] = {}
    for step in way[1:]:
        here = roads.lanes[lanes[-1]]
        if step.lane in (here.left, here.right):
            if step.s is not None and step is not way[-1]:
                changes[len(lanes) - 1] = _find_station(roads, RouteStep(here.id, step.s))
            lanes.append(step.lane)
        elif step.lane != here.id:
            lanes.extend(find_lane_path(roads, here.id, step.lane)[1:])
    return lanes, changes


def _find_station(roads: RoadMap, step: RouteStep) -> float:
    s = step.s or 0.0
    return s + roads.lanes[step.lane].centre.length if s < 0 else s
