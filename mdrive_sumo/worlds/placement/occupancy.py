"""Boxes of what is on the road at the start, and whether a place is free of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import shapely

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_user_box

FAR_M = 100.0
"""[m] Longer gaps along a lane count as this."""

BESIDE_ROUTE_M = 1.45
"""[m] Least distance of a parked vehicle from the centre line of any CAV's route."""
CLEAR_START_M = 6.0
"""[m] Added to the length of a CAV at its start: nothing is placed there."""


def build_box_behind(lane: Lane, front_m: float, size: tuple[float, float]) -> shapely.Polygon:
    """Return the box of a vehicle of that length and width whose front bumper is at a station [m] of a lane."""
    middle = front_m - size[0] / 2
    (x, y), yaw = lane.centre.at(middle), lane.centre.yaw_at(middle)
    return shapely.Polygon(box_corners(x, y, yaw, *size))


def locate_departure(vehicle: BackgroundVehicle, roads: RoadMap) -> shapely.Polygon:
    """Return the box of a vehicle where it departs."""
    lane = roads.lanes[f"{vehicle.edges[0]}_{vehicle.depart_lane}"]
    return build_box_behind(lane, vehicle.depart_pos_m, (vehicle.length, vehicle.width))


def build_start_area(egos: Sequence[Ego], radius_m: float) -> shapely.Polygon | shapely.MultiPolygon:
    """Return the area within a distance [m] of the starts of CAVs."""
    return shapely.MultiPoint([(ego.start.x, ego.start.y) for ego in egos]).buffer(radius_m)


def select_lanes_near(lanes: Iterable[Lane], egos: Sequence[Ego], radius_m: float) -> list[Lane]:
    """Return the lanes that come within a distance [m] of the start of a CAV."""
    area = build_start_area(egos, radius_m)
    return [lane for lane in lanes if area.intersects(shapely.LineString(lane.centre.xy))]


def overlaps_building(box: shapely.Polygon, roads: RoadMap) -> bool:
    """Return whether a box stands in a building."""
    return bool(_build_tree(roads).query(box, predicate="intersects").size)


@lru_cache(maxsize=32)
def _build_tree(roads: RoadMap) -> shapely.STRtree:
    return shapely.STRtree(roads.building_shapes)


@dataclass(slots=True)
class Occupancy:
    """Boxes that are taken at the start."""

    boxes: list[shapely.Polygon]

    def is_free(self, box: shapely.Polygon, gap_m: float) -> bool:
        """Return whether a box keeps a distance [m] from all others."""
        return all(box.distance(other) >= gap_m for other in self.boxes)

    def find_gaps(self, lane: Lane, front_m: float, length_m: float) -> tuple[float, float]:
        """Return the free length [m] ahead of and behind a vehicle on a lane, at most `FAR_M`."""
        ahead, behind = FAR_M, FAR_M
        strip = shapely.LineString(lane.centre.xy).buffer(lane.width / 2 - 0.2, cap_style="flat")
        middle = front_m - length_m / 2
        for box in self.boxes:
            if box.intersects(strip):
                stations = [lane.centre.project(x, y)[0] for x, y in box.exterior.coords[:4]]
                if sum(stations) / 4 > middle + 0.01:
                    ahead = min(ahead, min(stations) - front_m)
                elif sum(stations) / 4 < middle - 0.01:
                    behind = min(behind, front_m - length_m - max(stations))
        return ahead, behind


def build_occupancy(users: Iterable[Ego | Actor], vehicles: Sequence[BackgroundVehicle], roads: RoadMap) -> Occupancy:
    """Return the boxes of CAVs, scripted actors and the background vehicles that are there at the start."""
    boxes = [build_user_box(user) for user in users]
    return Occupancy(boxes + [locate_departure(vehicle, roads) for vehicle in vehicles if vehicle.depart_s == 0.0])


def select_free_actors(roads: RoadMap, egos: Sequence[Ego], actors: Sequence[Actor]) -> tuple[Actor, ...]:
    """Return the actors, in order, that overlap no building, CAV or earlier actor; parked ones also leave the CAVs'
    routes free."""
    routes = shapely.MultiLineString([ego.xy for ego in egos])
    taken = [build_user_box(ego, CLEAR_START_M) for ego in egos]
    chosen: list[Actor] = []
    for actor in actors:
        box = build_user_box(actor)
        is_parked = actor.id.startswith(("parked", "screen"))
        if any(box.intersects(other) for other in (*roads.building_shapes, *taken)):
            continue
        if is_parked and box.distance(routes) < BESIDE_ROUTE_M:
            continue
        taken.append(box)
        chosen.append(actor)
    return tuple(chosen)
