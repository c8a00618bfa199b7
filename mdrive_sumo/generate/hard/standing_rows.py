"""Rows of standing vehicles beside a stream, which hide it from those who cross it just before their front."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.hard.sites.junction_conflicts import JunctionConflict, refuse_place
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_box
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_route_line, compute_pose
from mdrive_sumo.worlds.placement.occupancy import overlaps_building

STEP_M = 0.1
"""[m] Between the places that are tried for the front of a row, ..."""
BEFORE_M, BEYOND_M = 15.0, 8.0
"""[m] ... which lie so far before and beyond the place where the ways meet: some cross the lane beside it later."""
MOST_ASIDE_M = 0.5
"""[m] By which a vehicle in a bend stands aside at most: an articulated bus in a bend of 80 m needs that."""
MOST_BEND_RAD = 0.06
"""A row ends where the street turns by more along a vehicle: a bus that passes with 0.3 m to spare would touch it."""
RIM_M = 1.0
"""[m] From the beginning of the lanes to the last vehicle of a row."""


def build_row(
    roads: RoadMap,
    conflict: JunctionConflict,
    flank_m: float,
    side_m: float,
    row: tuple[Sequence[str], float],
    closed: BaseGeometry,
) -> tuple[Actor, ...]:
    """Return vehicles that stand beside the other way of a conflict, up to the own way.

    flank_m: from the middle of the other way to their flanks, to its left; negative: to its right. side_m: from the
    first one to the middle of the own way. row: models from the first one on, and the gap [m] between two.
    closed: where none of them stands [m].

    Raises ProposalRejected without room.
    """
    models, gap_m = row
    path = shapely.LineString(build_route_line(roads, conflict.own.lanes).xy)
    shapely.prepare(closed)
    front_m = _find_front(roads, conflict, flank_m, side_m, (models[0], closed))
    lanes, made = conflict.other.lanes, list[Actor]()
    for model in models:
        length = BODY_SIZES[model][0]
        pose, box = place_beside(roads, lanes, front_m - length / 2, (flank_m, flank_m), model)
        while closed.intersects(box) and front_m - length > RIM_M:
            front_m -= STEP_M
            pose, box = place_beside(roads, lanes, front_m - length / 2, (flank_m, flank_m), model)
        if front_m - length < RIM_M or _bends(roads, lanes, (front_m - length, front_m)):
            break
        if shapely.distance(box, path) < side_m - STEP_M or overlaps_building(box, roads):
            break
        made.append(build_parked_vehicle(f"standing{len(made)}", model, pose))
        front_m -= length + gap_m
    return tuple(made)


def _bends(roads: RoadMap, lanes: Lanes, stations_m: tuple[float, float]) -> bool:
    """Return whether lanes bend between two stations [m]."""
    begin, end = map(build_route_line(roads, lanes).curve.yaw_at, stations_m)
    return abs(wrap_angle(end - begin)) > MOST_BEND_RAD


def place_beside(
    roads: RoadMap, lanes: Lanes, middle_m: float, flank: tuple[float, float], model: str
) -> tuple[Pose, shapely.Polygon]:
    """Return pose and box of a vehicle beside lanes, by the station [m] of its middle.

    flank: its lateral place [m], to the left of the lanes, and a number with the sign of the direction in which the
    vehicle stands from there. In a bend it stands so far aside that its corners are not beyond that flank.
    """
    length, width = BODY_SIZES[model]
    flank_m, away = flank[0], math.copysign(1.0, flank[1])
    first = build_box(compute_pose(roads, lanes, middle_m, flank_m + away * width / 2), length, width)
    curve = build_route_line(roads, lanes).curve
    over_m = away * flank_m - min(away * curve.project(x, y)[1] for x, y in first.exterior.coords[:4])
    aside_m = min(max(over_m, 0.0), MOST_ASIDE_M)
    pose = compute_pose(roads, lanes, middle_m, flank_m + away * (width / 2 + aside_m))
    return pose, build_box(pose, length, width)


def _find_front(
    roads: RoadMap, conflict: JunctionConflict, flank_m: float, side_m: float, first: tuple[str, BaseGeometry]
) -> float:
    """Return the greatest station [m] of a front from which a vehicle is `side_m` away from the own way behind it.

    first: its model, and where it does not stand [m].
    """
    model, closed = first
    path = shapely.LineString(build_route_line(roads, conflict.own.lanes).xy)
    fronts = np.arange(conflict.other_m + BEYOND_M, conflict.other_m - BEFORE_M, -STEP_M)
    half_m = BODY_SIZES[model][0] / 2
    boxes = [
        place_beside(roads, conflict.other.lanes, front - half_m, (flank_m, flank_m), model)[1]
        for front in fronts.tolist()
    ]
    away = np.asarray(shapely.distance(boxes, path))
    is_free = (away >= side_m) & np.maximum.accumulate(away < side_m) & ~np.asarray(shapely.intersects(closed, boxes))
    if not is_free.any():
        raise refuse_place(roads, f"room for a {model} {side_m:g} m beside a way")
    return float(fronts[np.argmax(is_free)])
