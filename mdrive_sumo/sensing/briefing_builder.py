"""Construction of the briefing of a CAV."""

import numpy as np
import shapely

from mdrive_sumo.contract import Briefing, StopSign, TrafficLight, VehicleFacts
from mdrive_sumo.contract.detector_profiles import IDEAL
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.sensing.route_room import compute_route_room


def build_briefing(
    ego: Ego,
    roads: RoadMap,
    vehicle: VehicleFacts,
    seed: int,
    time_limit_s: float,
    standard_detector: str = IDEAL,
) -> Briefing:
    """Return the briefing for the agent of one CAV."""
    route = Polyline(ego.xy)
    lanes = _find_assigned_lanes(ego, roads)
    return Briefing(
        ego_id=ego.id,
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
        route_room=compute_route_room(roads, ego.xy, ego.yaw),
        standard_detector=standard_detector,
    )


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
