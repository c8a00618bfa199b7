"""Check the compiled network of a place: sentences about what is wrong."""

import shapely

from mdrive_sumo.roads import Lane, RoadMap

LEAST_LANE_M = 4.0
"""[m] Shorter lanes outside junctions are too short for a car to stand on."""


def check_place(roads: RoadMap) -> list[str]:
    """Return a sentence for each fault of the network of a place; none for a sound one."""
    return [*_check_lanes(roads), *_check_buildings(roads)]


def _check_lanes(roads: RoadMap) -> list[str]:
    streets = [lane for lane in roads.driving if not lane.junction]
    short = [lane.id for lane in streets if lane.centre.length < LEAST_LANE_M]
    return [f"lane {lane}: shorter than {LEAST_LANE_M:g} m" for lane in short]


def _check_buildings(roads: RoadMap) -> list[str]:
    surface = shapely.union_all([_build_strip(lane) for lane in roads.driving])
    walks = shapely.union_all([shapely.Polygon(outline).buffer(0) for outline in roads.pavements])
    faults: list[str] = []
    for building, shape in zip(roads.buildings, roads.building_shapes, strict=True):
        for what, area in (("lane", surface), ("pavement", walks)):
            if shape.intersection(area).area > 0.01:
                faults.append(f"building {building.id}: stands on a {what}")
    return faults


def _build_strip(lane: Lane) -> shapely.Geometry:
    return shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat")
