"""What stands beside the edges of a draft: houses, hedges, walls, trees; never on a road or in a sight triangle."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.worlds.places.alignment import buffer_line, cut_line, find_point, shift_line
from mdrive_sumo.worlds.places.draft_edge import DraftEdge
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.sight_triangles import EYE_M, compute_leg
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_spine import Spine

URBAN_LIMIT_KMH = 70.0
"""[km/h] Largest limit of the guideline for urban roads, whose sight triangles `compute_leg` knows."""
RURAL_SIGHT_M = 200.0
"""[m] Length of a sight triangle at 80 km/h and more (RAL 2012, section 6.6.3: 200 m at 100 km/h; chosen for all)."""
SIGHT_MARGIN_M = 2.0
"""[m] Beside the lines of sight to the axis: half of a lane, since vehicles do not drive on the axis."""
LEAST_HOUSE_M = 5.0
"""[m] A house that would have a shorter front is not built; chosen."""
NEXT_TRY_M = 4.0
"""[m] How much further along a row the next house is tried where one does not fit; chosen."""
LEAST_AREA_M2 = 0.05
"""[m2] Overlaps that are smaller come from rounded coordinates."""
CLEARANCE_M = 0.3
"""[m] Between things at the roadside, so that outlines do not touch; chosen."""
VERGE_M = (1.5, 3.0)
"""[m] Range between the edge of a road in the country and a hedge (RAL 2012: 1.50 m of verge)."""
HEDGE_M = 1.5
"""[m] Width of a hedge in the country; chosen."""
HEDGED_M = (40.0, 130.0)
"""[m] Range of the length of a hedge along a road; chosen."""


@dataclass(eq=False)
class Roadside:
    """The free land beside the roads of a draft, and what stands on it already."""

    draft: NetworkDraft
    clear: list[BaseGeometry] = field(default_factory=list[BaseGeometry])
    """Areas where nothing may stand: sight triangles, driveways."""

    def __post_init__(self) -> None:
        self.road = shapely.union_all([*_list_surfaces(self.draft), *_list_junctions(self.draft)])
        shapely.prepare(self.road)
        self._built: list[shapely.Polygon] = []

    def is_free(self, outline: shapely.Polygon, clearance_m: float) -> bool:
        """Return whether an outline keeps its distance [m] from roads and touches nothing that stands there."""
        return (
            self.road.distance(outline) >= clearance_m
            and not any(area.intersects(outline) for area in self.clear)
            and all(other.distance(outline) > CLEARANCE_M for other in self._built)
        )

    def add(self, kind: str, outline: Float, clearance_m: float = CLEARANCE_M) -> bool:
        """Add a house or obstacle if it is free; return whether it is."""
        return self._add_free(kind, [outline], clearance_m) == 1

    def _add_free(self, kind: str, outlines: Sequence[Float], clearance_m: float) -> int:
        """Add those outlines that are free, whether or not they touch each other; return their number."""
        polygons = [shapely.Polygon(np.round(outline, 1)) for outline in outlines]
        are_free = [
            polygon.is_valid and polygon.area > LEAST_AREA_M2 and self.is_free(polygon, clearance_m)
            for polygon in polygons
        ]
        for outline, polygon, is_free in zip(outlines, polygons, are_free, strict=True):
            if is_free:
                self._built.append(polygon)
                if kind == "house":
                    self.draft.buildings.append(outline)
                else:
                    self.draft.obstacles.append((kind, outline))
        return sum(are_free)

    def add_house_row(self, kerb: Polyline, rows: HouseRows, rng: random.Random) -> None:
        """Add a row of houses to the right of a kerb, the outer edge of a road in driving direction."""
        station = rng.uniform(0.0, rows.gap_m[1])
        while station < kerb.length - LEAST_HOUSE_M:
            length = min(rng.uniform(*rows.size_m), kerb.length - station)
            depth, setback = rng.uniform(*rows.depth_m), rng.uniform(*rows.setback_m)
            outline = build_block(kerb, station, length, setback, depth)
            if rng.random() >= rows.share or self.add("house", outline, rows.setback_m[0] * 0.8):
                station += length + rng.uniform(*rows.gap_m)
            else:
                station += NEXT_TRY_M

    def add_strip(self, kind: str, line: Polyline, right_m: float, width_m: float, piece_m: float = 12.0) -> None:
        """Add a hedge, wall or fence to the right of a line, in pieces; those that are not free are left out."""
        count = max(round(line.length / piece_m), 1)
        pieces = [cut_line(line, k * line.length / count, (k + 1) * line.length / count) for k in range(count)]
        self._add_free(kind, [buffer_line(piece, -right_m, right_m + width_m) for piece in pieces], CLEARANCE_M)

    def add_hedges(self, kerb: Polyline, rng: random.Random) -> None:
        """Add hedges with gaps to the right of the edge of a road in the country."""
        station, verge = rng.uniform(0.0, 20.0), rng.uniform(*VERGE_M)
        while station < kerb.length - 10.0:
            end = min(station + rng.uniform(*HEDGED_M), kerb.length)
            if rng.random() < 0.8:
                self.add_strip("hedge", cut_line(kerb, station, end), verge, HEDGE_M)
            station = end + rng.uniform(8.0, 40.0)


def build_block(line: Polyline, station: float, length: float, right_m: float, depth: float) -> Float:
    """Return a rectangle (4, 2) [m] to the right of a line, its nearest side along the chord of that part."""
    a, b = np.array(line.at(station)), np.array(line.at(station + length))
    ahead = (b - a) / max(portable.hypot(float(b[0] - a[0]), float(b[1] - a[1])), 1e-6)
    right = np.array((ahead[1], -ahead[0]))
    bulge = max(float(portable.dot(np.array(line.at(station + length * k / 4)) - a, right)) for k in range(5))
    near, far = right * (right_m + bulge), right * (right_m + bulge + depth)
    return np.array((a + near, a + length * ahead + near, a + length * ahead + far, a + far))


def build_box(line: Polyline, station: float, left_m: float, length: float, width: float) -> Float:
    """Return a rectangle (4, 2) [m] around a point beside a line, along it."""
    x, y = find_point(line, station, left_m)
    ahead = np.array(find_point(line, station + 1.0, left_m)) - np.array((x, y))
    ahead /= portable.hypot(float(ahead[0]), float(ahead[1]))
    left = np.array((-ahead[1], ahead[0]))
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return np.array([(x, y) + a * length / 2 * ahead + b * width / 2 * left for a, b in corners])


def find_kerb(edge: DraftEdge) -> Polyline:
    """Return the outer edge of an edge: that beside its pavement, parking or rightmost lane."""
    return shift_line(edge.line, -edge.width_m)


def list_sight_triangles(spine: Spine, limit_kmh: float) -> Iterator[BaseGeometry]:
    """Return the sight triangles of the side streets that give way: at those with signals, drivers need not see.

    A driver whose eyes are `EYE_M` before the edge of the main road sees along it as far as the guideline asks.
    """
    plan = spine.plan
    leg_m = compute_leg(limit_kmh / 3.6) if limit_kmh <= URBAN_LIMIT_KMH else RURAL_SIGHT_M
    half = max(sum(lane.width_m for lane in edge.lanes if lane.use != "walk") for edge in spine.list_main_edges())
    for joint in (joint for joint in plan.joints if joint.type != "traffic_light"):
        ways = [
            cut_line(plan.axis, max(joint.station - leg_m, 0.0), joint.station),
            cut_line(plan.axis, joint.station, min(joint.station + leg_m, plan.axis.length)),
        ]
        for arm in joint.arms:
            inward = spine.arms[arm.id][0]
            eye = find_point(inward.line, inward.line.length - half - EYE_M, -arm.half.lane_m / 2)
            for way in ways:
                yield shapely.make_valid(shapely.Polygon([eye, *way.xy.tolist()])).buffer(SIGHT_MARGIN_M)


def _list_surfaces(draft: NetworkDraft) -> Iterator[BaseGeometry]:
    for edge in draft.edges:
        yield shapely.make_valid(shapely.Polygon(buffer_line(edge.line, 0.0, edge.width_m)))


def _list_junctions(draft: NetworkDraft) -> Iterator[BaseGeometry]:
    """Return the area of each node: the hull of its edges up to where its corners begin."""
    radius = {node.id: node.radius if node.type else 0.0 for node in draft.nodes}
    edges: dict[str, list[tuple[DraftEdge, bool]]] = {node.id: [] for node in draft.nodes}
    for edge in draft.edges:
        edges[edge.begin].append((edge, True))
        edges[edge.end].append((edge, False))
    for node, ends in edges.items():
        reach = max((edge.width_m for edge, _ in ends), default=0.0) + radius[node] + 1.0
        points = [
            find_point(edge.line, station if begins else edge.line.length - station, -right)
            for edge, begins in ends
            for station in (0.0, min(reach, edge.line.length) if radius[node] else 0.0)
            for right in (0.0, edge.width_m)
        ]
        yield shapely.MultiPoint(points).convex_hull
