"""Construction of the briefing of a CAV, with the free road width to either side of its route."""

from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.contract import Briefing, StopSign, TrafficLight, VehicleFacts
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED, V2xRate
from mdrive_sumo.contract.detector_profiles import IDEAL
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.sensing.route_junctions import find_junctions


def build_briefing(
    ego: Ego,
    roads: RoadMap,
    vehicle: VehicleFacts,
    seed: int,
    time_limit_s: float,
    standard_detector: str = IDEAL,
    *,
    pseudonym: str = "",
    desired_speed: float | None = PROTOCOL_SPEED,
    v2x_rate: V2xRate = "fixed",
) -> Briefing:
    """Return the briefing for the agent of one CAV, by default under its id; its free width is measured when read."""
    route = Polyline(ego.xy)
    lanes = _find_assigned_lanes(ego, roads)
    briefing = Briefing(
        ego_id=pseudonym or ego.id,
        seed=seed,
        tick_s=DT,
        time_limit_s=time_limit_s,
        vehicle=vehicle,
        route_xy=ego.xy,
        route_yaw=ego.yaw,
        route_s=route.s,
        route_lane_width=np.array([lane.width for lane in lanes]),
        route_speed_limit=np.array([lane.speed_limit for lane in lanes]),
        stop_signs=tuple(StopSign(s) for s in _find_stop_signs(ego, roads, route)),
        traffic_lights=tuple(_find_traffic_lights(ego, roads, route)),
        junctions=tuple(find_junctions(ego.lanes, roads, route)),
        standard_detector=standard_detector,
        desired_speed=desired_speed,
        v2x_rate=v2x_rate,
    )
    briefing.defer(partial(_measure_room, roads, ego))
    return briefing


def _measure_room(roads: RoadMap, ego: Ego) -> Float:
    """Return the free width, also while an agent runs. Raises WorldError: a failure here is none of the agent's."""
    try:
        return compute_route_room(roads, ego.xy, ego.yaw)
    except Exception as error:
        raise WorldError(f"free width of a route: {type(error).__name__}: {error}") from error


def _find_assigned_lanes(ego: Ego, roads: RoadMap) -> list[Lane]:
    """Return the lane of the route that is nearest to each route point; other lanes may cross there."""
    lanes = [roads.lanes[name] for name in ego.lanes]
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in lanes], dtype=object)
    gaps = np.asarray(shapely.distance(np.array(shapely.points(ego.xy), dtype=object)[:, None], lines))
    return [lanes[i] for i in gaps.argmin(axis=1)]


def _find_stop_signs(ego: Ego, roads: RoadMap, route: Polyline) -> list[float]:
    signs = [sign for sign in roads.stop_signs or () if sign.lane in ego.lanes]
    return sorted(route.project(*roads.lanes[sign.lane].centre.at(sign.line_pos_m))[0] for sign in signs)


def _find_traffic_lights(ego: Ego, roads: RoadMap, route: Polyline) -> list[TrafficLight]:
    lights: list[TrafficLight] = []
    for here, there in zip(ego.lanes, ego.lanes[1:], strict=False):
        lane = roads.lanes[here]
        if there in lane.lights:
            s, d = route.project(*lane.centre.at(lane.centre.length))
            if abs(d) < lane.width:  # else the stop line lies before the start of the route
                lights.append(TrafficLight(lane.lights[there], s))
    return lights


MAX_ROOM_M = 10.0
"""Maximum reported width."""
SEAM_M = 0.1
"""Strips of neighbouring lanes may leave a gap of that width between each other, which is no edge of the road."""


class _Surface(NamedTuple):
    """Drivable surface in pieces, with a search tree."""

    pieces: npt.NDArray[np.object_]
    tree: shapely.STRtree


def compute_route_room(roads: RoadMap, xy: Float, yaw: Float) -> Float:
    """Return the free width (N, 2) [m] left and right of route points xy (N, 2) [m] with lane direction yaw (N,).

    Measured across the lane, up to the edge of all lanes and junctions together, oncoming lanes included; at most
    `MAX_ROOM_M`.
    """
    return _compute_room(roads, xy.tobytes(), yaw.tobytes()).copy()  # an agent may write into its briefing


@lru_cache(maxsize=64)  # 6 to 60 ms a route, which is often driven again: by other agents, with other seeds
def _compute_room(roads: RoadMap, xy_bytes: bytes, yaw_bytes: bytes) -> Float:
    xy, yaw = np.frombuffer(xy_bytes).reshape(-1, 2), np.frombuffer(yaw_bytes)
    surface = _build_surface(roads)
    near = np.unique(surface.tree.query(shapely.LineString(xy), predicate="dwithin", distance=MAX_ROOM_M))
    area = shapely.buffer(shapely.union_all(surface.pieces[near]), -SEAM_M)
    shapely.prepare(area)
    cos, sin = portable.cos_sin(yaw)
    left = np.column_stack((-sin, cos)) * MAX_ROOM_M
    return np.column_stack([_measure_reach(area, xy, side) for side in (left, -left)])


def _measure_reach(area: shapely.Geometry, xy: Float, across: Float) -> Float:
    """Return the distance (N,) [m] from each point in that direction to the first exit from the area."""
    rays = shapely.linestrings(np.stack((xy, xy + across), axis=1))
    gone = np.asarray(shapely.distance(shapely.points(xy), shapely.difference(rays, area)))
    return np.where(np.isnan(gone), MAX_ROOM_M, gone)


@lru_cache(maxsize=64)  # as many networks as stay loaded
def _build_surface(roads: RoadMap) -> _Surface:
    """Return lanes widened by `SEAM_M` on either side, and junctions without pedestrian areas."""
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in roads.driving], dtype=object)
    lanes = shapely.buffer(lines, roads.lane_width / 2 + SEAM_M)
    pedestrian_areas = shapely.STRtree([shapely.make_valid(shapely.Polygon(outline)) for outline in roads.pavements])
    junctions = [
        _subtract_pedestrian_areas(shapely.buffer(shapely.Polygon(outline), SEAM_M), pedestrian_areas)
        for outline in roads.junctions
    ]
    pieces = np.array([*lanes, *junctions], dtype=object)
    return _Surface(pieces, shapely.STRtree(pieces))


def _subtract_pedestrian_areas(junction: shapely.Geometry, pedestrian_areas: shapely.STRtree) -> shapely.Geometry:
    overlapping = pedestrian_areas.geometries[pedestrian_areas.query(junction, predicate="intersects")]
    return shapely.difference(junction, shapely.union_all(overlapping)) if len(overlapping) else junction
