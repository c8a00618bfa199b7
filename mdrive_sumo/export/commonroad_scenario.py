"""CommonRoad: recordings as scenarios (XML 2020a) through commonroad-io.

Source: Althoff, Koschi and Manzinger, CommonRoad, IV 2017, and its documentation of the XML format. A state is the box
centre; metres, radians, one step per tick.
"""

import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from commonroad.common.common_lanelet import LaneletType, LineMarking, StopLine
from commonroad.common.common_scenario import Location, ScenarioID
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.util import FileFormat, Interval
from commonroad.geometry.obstacle_shapes.rect_obstacle_shape import RectObstacleShape
from commonroad.geometry.occupancy.circle_occupancy import CircleOccupancy
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightState,
)
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDZamunda
from commonroad.scenario.trajectory import Trajectory

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.export.lane_assignment import compute_bounds, find_predecessors
from mdrive_sumo.export.scored_recording import ScoredRecording, list_presences
from mdrive_sumo.export.signal_states import LaneSignal, list_lane_signals
from mdrive_sumo.roads import Lane, StopSignBox
from mdrive_sumo.scoring.criteria import GOAL_RADIUS_M, compute_time_limit_ticks

COUNTRY = "ZAM"
"""CommonRoad's code for places that do not exist."""
TYPE_BY_CATEGORY = {
    "car": ObstacleType.CAR,
    "van": ObstacleType.CAR,
    "truck": ObstacleType.TRUCK,
    "bus": ObstacleType.BUS,
    "motorcycle": ObstacleType.MOTORCYCLE,
    "bicycle": ObstacleType.BICYCLE,
    "pedestrian": ObstacleType.PEDESTRIAN,
    "static": ObstacleType.UNKNOWN,
}
DECIMALS = 4
"""Of metres and radians: recordings have 1 mm and 0.1 mrad."""
STATE_BY_LETTER = {
    "r": TrafficLightState.RED,
    "u": TrafficLightState.RED_YELLOW,
    "y": TrafficLightState.YELLOW,
    "g": TrafficLightState.GREEN,
}
"""By SUMO's letter in lower case; any other letter is an inactive light."""


@dataclass(frozen=True, slots=True)
class ObstacleEntry:
    """One presence of a road user as an obstacle; CommonRoad's ids are numbers."""

    number: int
    column: int
    presence: range


def write_commonroad(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write SCENARIO.xml per recording, and SCENARIO.ids.json with what its numbers stand for."""
    for configuration, recording in enumerate(recordings, start=1):
        name = recording.name
        scenario, problems, ids = build_scenario(recording, configuration)
        writer = CommonRoadFileWriter(
            scenario,
            PlanningProblemSet(problems),
            author="mdrive-sumo",
            affiliation="",
            source=f"mdrive-sumo, episode {recording.record.digest}",
            tags=set(),
            location=Location(),
            decimal_precision=DECIMALS,
            file_format=FileFormat.XML,
        )
        writer.write_to_file(str(folder / f"{name}.xml"), OverwriteExistingFile.ALWAYS)
        write_text(folder / f"{name}.ids.json", json.dumps(ids, indent=1) + "\n")


def build_scenario(
    recording: ScoredRecording, configuration: int
) -> tuple[Scenario, list[PlanningProblem], Mapping[str, Mapping[str, str]]]:
    """Return the scenario, the task of each CAV, and what their numbers, as text, stand for.

    configuration: distinguishes scenarios on the same map.
    """
    numbers = count(1)
    network, lanelet_by_lane = build_lanelet_network(recording, numbers)
    words = re.findall(r"[A-Za-z0-9]+", recording.roads.name)
    place = "".join(word.capitalize() for word in words) or "Map"
    scenario = Scenario(DT, ScenarioID(False, COUNTRY, place, 1, configuration, "T", 1))
    scenario.add_objects(network)
    entries = list(_list_entries(recording, numbers))
    for entry in entries:
        scenario.add_objects(_build_obstacle(recording, entry))
    problems = [_build_problem(recording, next(numbers), column) for column in range(recording.record.egos)]
    pairs = zip(problems, recording.record.ego_ids, strict=True)
    ids = {
        "lanelets": {str(number): lane for lane, number in lanelet_by_lane.items()},
        "obstacles": {str(entry.number): recording.record.ids[entry.column] for entry in entries},
        "planning_problems": {str(problem.planning_problem_id): ego for problem, ego in pairs},
    }
    return scenario, problems, ids


def _build_problem(recording: ScoredRecording, number: int, column: int) -> PlanningProblem:
    """Return the task of a CAV: from its start to the end of its route within its time limit."""
    ego = recording.scenario.egos[column]
    initial = _build_initial_state(recording, 0, column)
    goal: Any = CustomState(
        time_step=Interval(1, compute_time_limit_ticks(recording.scenario)[ego.id]),
        position=CircleOccupancy(GOAL_RADIUS_M, shapely.Point(ego.xy[-1])),
    )
    return PlanningProblem(number, initial, GoalRegion([goal]))


def _list_entries(recording: ScoredRecording, numbers: Iterator[int]) -> Iterator[ObstacleEntry]:
    for column in range(len(recording.record.ids)):
        for presence in list_presences(recording.record.valid[:, column]):
            yield ObstacleEntry(next(numbers), column, presence)


def _build_obstacle(recording: ScoredRecording, entry: ObstacleEntry) -> StaticObstacle | DynamicObstacle:
    record, column = recording.record, entry.column
    shape = RectObstacleShape(length=float(record.length[column]), width=float(record.width[column]))
    type_ = TYPE_BY_CATEGORY[recording.categories[column]]
    first, *later = entry.presence
    initial = _build_initial_state(recording, first, column)
    still = np.ptp(record.quanta[entry.presence, column], axis=0).max() == 0
    if record.kind[column] == Kind.STATIC and still and len(entry.presence) == record.ticks:
        return StaticObstacle(entry.number, type_, shape, initial)
    # A trajectory has at least one state: a presence of one tick repeats it, which no reader can tell from a stand.
    states: list[Any] = [CustomState(**_describe_state(recording, tick, column)) for tick in later]
    prediction = TrajectoryPrediction(Trajectory(later[0], states), shape) if states else None
    return DynamicObstacle(entry.number, type_, shape, initial, prediction)


def _build_initial_state(recording: ScoredRecording, tick: int, column: int) -> InitialState:
    """Return a state with the entries that the format demands and a recording does not have as 0."""
    state = _describe_state(recording, tick, column)
    return InitialState(**state, acceleration=0.0, yaw_rate=0.0, slip_angle=0.0)


def _describe_state(recording: ScoredRecording, tick: int, column: int) -> dict[str, Any]:
    record = recording.record
    return {
        "time_step": tick,
        "position": np.array((record.x[tick, column], record.y[tick, column])),
        "orientation": float(record.yaw[tick, column]),
        "velocity": float(record.speed[tick, column]),
    }


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
