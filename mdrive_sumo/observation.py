"""What a CAV is told: the briefing before the first tick, then observations. Only what was declared is computed."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import shapely

from mdrive_sumo.contract import (
    Briefing,
    Objects,
    Observation,
    OwnState,
    Plan,
    Privileged,
    SensorSpec,
    StopSign,
    TrafficLight,
    VehicleFacts,
)
from mdrive_sumo.errors import InputError
from mdrive_sumo.geometry import Int, Polyline
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.spec import Ego
from mdrive_sumo.state import DT, EgoState, Frame, Kind

SENSORS = ("objects", "privileged")
"""The kinds of sensor that exist."""


def briefing(ego: Ego, roads: RoadMap, vehicle: VehicleFacts, seed: int, time_limit_s: float) -> Briefing:
    """All that the agent of one CAV is told before the first tick."""
    route = Polyline(ego.xy)
    lanes = _assigned_lanes(ego, roads)
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
        stop_signs=tuple(StopSign(s) for s in _sign_stations(ego, roads, route)),
        traffic_lights=tuple(_lights(ego, roads, route)),
    )


def _assigned_lanes(ego: Ego, roads: RoadMap) -> list[Lane]:
    """The lane of the route that is nearest to each route point; others may cross there."""
    lanes = [roads.lanes[name] for name in ego.lanes]
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in lanes], dtype=object)
    gaps = np.asarray(shapely.distance(np.array(shapely.points(ego.xy), dtype=object)[:, None], lines))
    return [lanes[i] for i in gaps.argmin(axis=1)]


def _sign_stations(ego: Ego, roads: RoadMap, route: Polyline) -> list[float]:
    signs = [sign for sign in roads.stop_signs or () if sign.lane in ego.lanes]
    return sorted(route.project(*roads.lanes[sign.lane].centre.at(sign.line_pos_m))[0] for sign in signs)


def _lights(ego: Ego, roads: RoadMap, route: Polyline) -> list[TrafficLight]:
    found: list[TrafficLight] = []
    for here, there in zip(ego.lanes, ego.lanes[1:], strict=False):
        lane = roads.lanes[here]
        if there in lane.lights:
            s, d = route.project(*lane.centre.at(lane.centre.length))
            if abs(d) < lane.width:  # else the stop line lies before the start of the route
                found.append(TrafficLight(lane.lights[there], s))
    return found


class Senses:
    """The declared sensors of every CAV of an episode, applied to one frame after the other."""

    def __init__(
        self,
        sensors: Mapping[str, tuple[SensorSpec, ...]],
        briefings: Mapping[str, Briefing],
    ) -> None:
        """Raises InputError for a sensor that does not exist."""
        for specs in sensors.values():
            for spec in specs:
                if spec.kind not in SENSORS:
                    raise InputError(
                        f"sensor {spec.kind!r}: expected one of {', '.join(SENSORS)}, found none of that kind"
                    )
        self._sensors, self._briefings = sensors, briefings

    def observe(self, frame: Frame, plans: Mapping[str, Plan], living: tuple[str, ...]) -> dict[str, Observation]:
        """What the living CAVs see of the frame; `plans` are the CAVs' latest, for whoever is privileged.

        A CAV that ended in this frame is seen once more: it leaves the world with the coming tick.
        """
        boxes = self._boxes(frame) if any(self._sensors[ego] for ego in living) else _NOTHING
        return {ego: self._observation(ego, frame, boxes, plans) for ego in living}

    def _boxes(self, frame: Frame) -> Objects:
        """Every road user of the frame, CAVs first."""
        actors, egos = frame.actors, tuple(frame.egos.values())
        sizes = [(self._briefings[ego].vehicle.length, self._briefings[ego].vehicle.width) for ego in frame.egos]
        table = np.array([(e.x, e.y, e.yaw, e.speed, *size) for e, size in zip(egos, sizes, strict=True)])
        return Objects(
            ids=(*frame.egos, *actors.ids),
            kind=np.concatenate((np.full(len(egos), Kind.VEHICLE, dtype=np.uint8), actors.kind)),
            x=np.concatenate((table[:, 0], actors.x)),
            y=np.concatenate((table[:, 1], actors.y)),
            yaw=np.concatenate((table[:, 2], actors.yaw)),
            speed=np.concatenate((table[:, 3], actors.speed)),
            length=np.concatenate((table[:, 4], actors.length)),
            width=np.concatenate((table[:, 5], actors.width)),
        )

    def _observation(self, ego: str, frame: Frame, boxes: Objects, plans: Mapping[str, Plan]) -> Observation:
        objects = privileged = None
        for spec in self._sensors[ego]:
            if spec.kind == "objects":
                objects = _within(boxes, list(frame.egos).index(ego), spec.range_m)
            else:
                privileged = self._privileged(frame, boxes, plans)
        lights = self._briefings[ego].traffic_lights
        signals = {light.id: _letter(frame.signals, light.id) for light in lights}
        return Observation(frame.tick, own_state(frame.egos[ego]), objects, MappingProxyType(signals), (), privileged)

    def _privileged(self, frame: Frame, boxes: Objects, plans: Mapping[str, Plan]) -> Privileged:
        ids = tuple(sorted(frame.egos))
        return Privileged(
            ego_ids=ids,
            states=tuple(own_state(frame.egos[ego]) for ego in ids),
            routes=tuple(self._briefings[ego].route_xy for ego in ids),
            plans=tuple(plans.get(ego) for ego in ids),
            objects=_picked(boxes, np.arange(len(frame.egos), len(boxes.ids))),
        )


def own_state(ego: EgoState) -> OwnState:
    """The ego's own instruments."""
    return OwnState(ego.x, ego.y, ego.yaw, ego.speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)


def _letter(signals: Mapping[str, str], light: str) -> str:
    name, _, index = light.rpartition(":")
    return signals[name][int(index)]


def _within(boxes: Objects, me: int, range_m: float) -> Objects:
    """Boxes whose centre is in range, nearest first, oneself left out."""
    distance = np.hypot(boxes.x - boxes.x[me], boxes.y - boxes.y[me])
    distance[me] = np.inf
    order = np.argsort(distance, kind="stable")
    return _picked(boxes, order[: int((distance <= range_m).sum())])


def _picked(boxes: Objects, rows: Int) -> Objects:
    return Objects(
        ids=tuple(boxes.ids[i] for i in rows),
        kind=boxes.kind[rows],
        x=boxes.x[rows],
        y=boxes.y[rows],
        yaw=boxes.yaw[rows],
        speed=boxes.speed[rows],
        length=boxes.length[rows],
        width=boxes.width[rows],
    )


_EMPTY = np.zeros(0)
_NOTHING = Objects((), np.zeros(0, dtype=np.uint8), _EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY)
