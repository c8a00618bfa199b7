"""Buildings of an OpenStreetMap extract: outlines that block sight and stop cars."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from real2sim.readers.osm_file import OsmFile

OPEN_BUILDINGS = frozenset({"no", "roof", "carport", "canopy", "bridge", "construction", "proposed"})
"""Values of the tag `building` for what has no walls beside a road."""
ON_ROAD_M2 = 0.5
"""[m2] A building that covers more of a lane stands above it, as an arch or a bridge does."""
LEAST_AREA_M2 = 4.0
"""[m2] Smaller ones are kiosks of telephones and the like: chosen."""
SIMPLIFY_M = 0.1
"""[m] Accuracy of outlines: that of surveying them on aerial pictures is worse."""
MAX_BUILDINGS = 20_000
"""A square kilometre of a town has about 2 000."""


class FoundBuildings(NamedTuple):
    """Buildings that are kept, and how many are not, by reason."""

    kept: tuple[Building, ...]
    lost: dict[str, int]


def find_buildings(osm: OsmFile, roads: RoadMap) -> FoundBuildings:
    """Return the buildings of an extract near its roads, in the frame of the network."""
    lanes = shapely.STRtree([shapely.LineString(lane.centre.xy).buffer(lane.width / 2) for lane in roads.driving])
    kept: list[Building] = []
    lost = dict.fromkeys(("above a lane", "without walls or tiny", "broken or cut off"), 0)
    for name, tags, outline in _list_outlines(osm):
        polygon = _repair(outline)
        if polygon is None:
            lost["broken or cut off"] += 1
        elif tags.get("building") in OPEN_BUILDINGS or "building:min_level" in tags or polygon.area < LEAST_AREA_M2:
            lost["without walls or tiny"] += 1
        elif _covers_lane(polygon, lanes):
            lost["above a lane"] += 1
        elif len(kept) < MAX_BUILDINGS:
            corners = shapely.get_coordinates(polygon.exterior)[:-1].round(2)
            kept.append(Building(id=name, polygon=tuple((x, y) for x, y in corners.tolist())))
    return FoundBuildings(tuple(kept), {reason: count for reason, count in lost.items() if count})


def _list_outlines(osm: OsmFile) -> Iterator[tuple[str, dict[str, str], Float]]:
    """Yield id, tags and outline (N, 2) [m] of buildings: closed ways, and outer ways of multipolygons."""
    for way in osm.ways.values():
        if "building" in way.tags and way.nodes[0] == way.nodes[-1]:
            yield f"w{way.id}", dict(way.tags), osm.build_line(way)
    for relation in osm.list_relations("multipolygon"):
        if "building" not in relation.tags:
            continue
        for way in osm.list_ways(relation, "outer", ""):
            if "building" not in way.tags:
                yield f"r{relation.id}_{way.id}", dict(relation.tags), osm.build_line(way)


def _repair(outline: Float) -> shapely.Polygon | None:
    """Return a simple polygon without holes; None if the outline is none."""
    if len(outline) < 4 or np.hypot(*(outline[0] - outline[-1])) > SIMPLIFY_M:
        return None
    shape = shapely.make_valid(shapely.Polygon(outline)).simplify(SIMPLIFY_M)
    parts = [part for part in getattr(shape, "geoms", (shape,)) if isinstance(part, shapely.Polygon)]
    return max(parts, key=lambda part: part.area) if parts and not shape.is_empty else None


def _covers_lane(polygon: shapely.Polygon, lanes: shapely.STRtree) -> bool:
    near = lanes.geometries[lanes.query(polygon, predicate="intersects")]
    return bool(shapely.area(shapely.intersection(near, polygon)).sum() > ON_ROAD_M2) if len(near) else False
