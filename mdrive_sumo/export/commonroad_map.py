"""CommonRoad: the lanelet network of a recording, with speed limits, stop signs and recorded traffic lights."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np
from commonroad.common.common_lanelet import LaneletType, LineMarking, StopLine
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightState,
)
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDZamunda

from mdrive_sumo.export.lane_bounds import compute_bounds, find_predecessors
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.export.signal_states import LaneSignal, list_lane_signals
from mdrive_sumo.roads import Lane, StopSignBox

STATE_BY_LETTER = {
    "r": TrafficLightState.RED,
    "u": TrafficLightState.RED_YELLOW,
    "y": TrafficLightState.YELLOW,
    "g": TrafficLightState.GREEN,
}
"""By SUMO's letter in lower case; any other letter is an inactive light."""


def build_lanelet_network(recording: ScoredRecording, numbers: Iterator[int]) -> tuple[LaneletNetwork, dict[str, int]]:
    """Return the network, and the number of each lane's lanelet by the lane's id; takes new ids from `numbers`."""
    roads = recording.roads
    number_by_lane = {lane.id: next(numbers) for lane in roads.driving}
    limits = {lane.speed_limit: next(numbers) for lane in roads.driving}
    stops = {sign.lane: (next(numbers), sign) for sign in roads.stop_signs or ()}
    lights = {next(numbers): signal for signal in list_lane_signals(recording.record, roads)}
    lights_by_lane: defaultdict[str, set[int]] = defaultdict(set)
    for number, signal in lights.items():
        lights_by_lane[signal.lane].add(number)
    entries = find_predecessors(roads)
    network = LaneletNetwork()
    for lane in roads.driving:
        lanelet = _build_lanelet(lane, entries[lane.id], number_by_lane)
        lanelet.traffic_signs = {limits[lane.speed_limit], *({stops[lane.id][0]} if lane.id in stops else ())}
        lanelet.traffic_lights = lights_by_lane[lane.id]
        if lane.id in stops:
            lanelet.stop_line = _build_stop_line(lane, *stops[lane.id])
        network.add_lanelet(lanelet)
    for sign in (*_build_limits(recording, limits, number_by_lane), *_build_stops(recording, stops, number_by_lane)):
        network.add_traffic_sign(sign, set())
    for number, signal in lights.items():
        network.add_traffic_light(_build_light(recording, number, signal), set())
    return network, number_by_lane


def _build_lanelet(lane: Lane, entries: tuple[str, ...], number_by_lane: Mapping[str, int]) -> Lanelet:
    left, right = compute_bounds(lane)
    return Lanelet(
        left_vertices=left,
        center_vertices=lane.centre.xy,
        right_vertices=right,
        lanelet_id=number_by_lane[lane.id],
        predecessor=[number_by_lane[other] for other in entries],
        successor=[number_by_lane[other] for other in lane.successors],
        adjacent_left=number_by_lane[lane.left] if lane.left else None,
        adjacent_left_same_direction=True if lane.left else None,
        adjacent_right=number_by_lane[lane.right] if lane.right else None,
        adjacent_right_same_direction=True if lane.right else None,
        lanelet_type={LaneletType.INTERSECTION if lane.junction else LaneletType.URBAN},
    )


def _build_limits(
    recording: ScoredRecording, limits: Mapping[float, int], lanelets: Mapping[str, int]
) -> Iterator[TrafficSign]:
    """Yield one sign per speed limit [m/s], at the first lane that has it."""
    for limit, number in limits.items():
        lane = next(lane for lane in recording.roads.driving if lane.speed_limit == limit)
        element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, [f"{limit:g}"])
        yield TrafficSign(number, [element], {lanelets[lane.id]}, lane.centre.xy[0])


def _build_stops(
    recording: ScoredRecording, stops: Mapping[str, tuple[int, StopSignBox]], lanelets: Mapping[str, int]
) -> Iterator[TrafficSign]:
    for number, sign in stops.values():
        position = np.array(recording.roads.lanes[sign.lane].centre.at(sign.line_pos_m))
        element = TrafficSignElement(TrafficSignIDZamunda.STOP, [])
        yield TrafficSign(number, [element], {lanelets[sign.lane]}, position)


def _build_stop_line(lane: Lane, number: int, sign: StopSignBox) -> StopLine:
    x, y = lane.centre.at(sign.line_pos_m)
    left, right = compute_bounds(lane)
    row = int(np.argmin(np.abs(lane.centre.s - sign.line_pos_m)))
    across = (left[row] - right[row]) / 2
    centre = np.array((x, y))
    return StopLine(centre + across, centre - across, LineMarking.SOLID, {number})


def _build_light(recording: ScoredRecording, number: int, signal: LaneSignal) -> TrafficLight:
    """Return a light whose cycle is what was recorded, once."""
    elements = [
        TrafficLightCycleElement(STATE_BY_LETTER.get(letter.lower(), TrafficLightState.INACTIVE), ticks)
        for letter, ticks in signal.phases
    ]
    position = recording.roads.lanes[signal.lane].centre.xy[-1]
    return TrafficLight(number, position, TrafficLightCycle(elements, time_offset=0, active=True))
