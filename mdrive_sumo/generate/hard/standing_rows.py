"""Rows of standing vehicles beside a stream, which hide it from those who cross it just before their front."""

from collections.abc import Sequence

import numpy as np
import shapely

from mdrive_sumo.generate.hard.sites.junction_conflicts import JunctionConflict, refuse_place
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_box
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import build_route_line, compute_pose
from mdrive_sumo.worlds.placement.occupancy import overlaps_building

STEP_M = 0.1
"""[m] Between the places that are tried for the front of a row, ..."""
BEFORE_M, BEYOND_M = 15.0, 8.0
"""[m] ... which lie so far before and beyond the place where the ways meet: some cross the lane beside it later."""
RIM_M = 1.0
"""[m] From the beginning of the lanes to the last vehicle of a row."""


def build_row(
    roads: RoadMap, conflict: JunctionConflict, flank_m: float, side_m: float, row: tuple[Sequence[str], float]
) -> tuple[Actor, ...]:
    """Return vehicles that stand beside the other way of a conflict, up to the own way.

    flank_m: from the middle of the other way to their flanks, to its left; negative: to its right. side_m: from the
    first one to the middle of the own way. row: models from the first one on, and the gap [m] between two.

    Raises ProposalRejected without room.
    """
    models, gap_m = row
    path = shapely.LineString(build_route_line(roads, conflict.own.lanes).xy)
    front_m = _find_front(roads, conflict, flank_m, side_m, models[0])
    made: list[Actor] = []
    for model in models:
        length, width = BODY_SIZES[model]
        if front_m - length < RIM_M:
            break
        pose = compute_pose(roads, conflict.other.lanes, front_m - length / 2, _move_aside(flank_m, width))
        box = build_box(pose, length, width)
        if shapely.distance(box, path) < side_m - STEP_M or overlaps_building(box, roads):
            break
        made.append(build_parked_vehicle(f"standing{len(made)}", model, pose))
        front_m -= length + gap_m
    return tuple(made)


def _move_aside(flank_m: float, width: float) -> float:
    """Return the lateral place [m] of the middle of a vehicle by that of its flank."""
    return flank_m + width / 2 if flank_m > 0.0 else flank_m - width / 2


def _find_front(roads: RoadMap, conflict: JunctionConflict, flank_m: float, side_m: float, model: str) -> float:
    """Return the greatest station [m] of a front from which a vehicle is `side_m` away from the own way behind it."""
    length, width = BODY_SIZES[model]
    path = shapely.LineString(build_route_line(roads, conflict.own.lanes).xy)
    fronts = np.arange(conflict.other_m + BEYOND_M, conflict.other_m - BEFORE_M, -STEP_M)
    poses = [
        compute_pose(roads, conflict.other.lanes, front - length / 2, _move_aside(flank_m, width)) for front in fronts
    ]
    away = np.array([shapely.distance(build_box(pose, length, width), path) for pose in poses])
    is_free = (away >= side_m) & np.maximum.accumulate(away < side_m)
    if not is_free.any():
        raise refuse_place(roads, f"room for a {model} {side_m:g} m beside a way")
    return float(fronts[np.argmax(is_free)])
