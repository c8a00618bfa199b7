"""A recorded crossing for tests of the viewer: four arms, CAVs, traffic around and around, every kind of event."""

import math
from functools import cache
from pathlib import Path

import numpy as np

from mdrive_sumo.contract import Control, Plan
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.state import Actors, Contact, EgoState, End, FailureReason, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame
from mdrive_sumo.report.replay_marks import ReplayMark
from mdrive_sumo.roads import Lane, RoadMap, StopSignBox
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose

ARM_M, CORE_M, WIDTH_M = 260.0, 12.0, 3.5


def heading(arm: int) -> tuple[Float, Float]:
    """Driving direction of an arm of the crossing, and its right-hand normal."""
    yaw = arm * math.pi / 2
    return np.array((math.cos(yaw), math.sin(yaw))), np.array((math.sin(yaw), -math.cos(yaw)))


def straight(arm: int, lane: int, begin: float, end: float) -> Float:
    ahead, right = heading(arm)
    side = right * WIDTH_M * (1.5 - lane)
    return np.array([ahead * begin + side, ahead * end + side])


def crossing_lane(name: str, xy: Float, index: int = 0, lights: dict[str, str] | None = None) -> Lane:
    left, right = ("x", "") if index == 0 else ("", "x")
    junction = name.startswith(":")
    return Lane(
        id=name, edge=name, index=index, width=WIDTH_M, speed_limit=13.9, centre=Polyline(xy),
        junction=junction, successors=(), left="" if junction else left, right="" if junction else right,
        lights=lights or {},
    )  # fmt: skip


def crossing() -> RoadMap:
    """Four arms with two lanes each way, made by hand."""
    lanes: list[Lane] = [crossing_lane("far", np.array([(5000.0, 0.0), (5100.0, 0.0)]))]
    for arm in range(4):
        for lane in (0, 1):
            lights = {"next": f"c:{arm}", "turn": f"c:{arm + 4}"} if lane else {"next": f"c:{arm}"}
            lanes.append(crossing_lane(f"in{arm}_{lane}", straight(arm, lane, -ARM_M, -CORE_M), lane, lights))
            lanes.append(crossing_lane(f":x{arm}_{lane}", straight(arm, lane, -CORE_M, CORE_M)))
            lanes.append(crossing_lane(f"out{arm}_{lane}", straight(arm, lane, CORE_M, ARM_M), lane))
    side = 2 * WIDTH_M
    outline = [(side, CORE_M), (-side, CORE_M), (-CORE_M, side), (-CORE_M, -side)]
    outline += [(-side, -CORE_M), (side, -CORE_M), (CORE_M, -side), (CORE_M, side)]
    pavement = np.array([(-ARM_M, 8.0), (-CORE_M, 8.0), (-CORE_M, 11.0), (-ARM_M, 11.0)])
    zebra = np.array([(14.0, -8.0), (14.0, 8.0)])
    return RoadMap(
        name="crossing", folder=Path(), lanes={lane.id: lane for lane in lanes}, junctions=(np.array(outline),),
        pavements=(pavement,),
        crossings=((zebra, 4.0),),
        buildings=(Building(id="b", polygon=((20, 20), (40, 20), (40, 40), (20, 40))),),
        stop_signs=(StopSignBox(id="s", lane="in3_0", line_pos_m=247.0, length_m=3.0),), checksum="",
    )  # fmt: skip


def scenario(egos: int) -> Scenario:
    def ego(i: int) -> Ego:
        line = Polyline(straight(i % 4, i // 4 % 2, -100.0, 80.0)).resample(1.0)
        route = tuple((float(x), float(y), i % 4 * math.pi / 2) for x, y in line.xy)
        start = Pose(x=route[0][0], y=route[0][1], yaw=route[0][2])
        return Ego(id=f"cav_{i}", start=start, lanes=("in",), route=route)

    return Scenario(
        id="crossing-4", bucket="InterDrive", category="crossing", network="crossing",
        egos=tuple(ego(i) for i in range(egos)),
    )  # fmt: skip


def ego_state(i: int, tick: int) -> EgoState:
    along = 0.3 * tick + 2.0 * math.sin(tick / 40 + i)
    ahead, _ = heading(i % 4)
    x, y = straight(i % 4, i // 4 % 2, -100.0, 0.0)[0] + ahead * along
    return EgoState(float(x), float(y), i % 4 * math.pi / 2, 6.0 + math.cos(tick / 40 + i), 0.0, 0.0, 0.0)


@cache
def long_line(arm: int, lane: int) -> Polyline:
    return Polyline(straight(arm, lane, -250.0, 250.0))


def traffic(count: int, tick: int, prefix: str) -> Actors:
    """Cars around and around, then a few pedestrians, cyclists and obstacles."""
    kind = np.array([(0, 0, 0, 0, 0, 0, 0, 2, 1, 3)[i % 10] for i in range(count)], dtype=np.uint8)
    along = np.array([(i * 37 + tick * (0.0, 0.4, 0.5)[i % 3]) % 500 for i in range(count)])
    lines = [long_line(i % 4, i // 4 % 2) for i in range(count)]
    x, y = np.array([line.at(float(s)) for line, s in zip(lines, along, strict=True)]).reshape(-1, 2).T
    yaw = np.array([i % 4 * math.pi / 2 for i in range(count)])
    length = np.array([(4.6, 0.6, 1.8, 2.4)[k] for k in kind])
    width = np.array([(1.9, 0.6, 0.7, 1.2)[k] for k in kind])
    ids = tuple(f"{prefix}{i:03d}" for i in range(count))
    return Actors(ids, kind, x, y, yaw, np.full(count, 8.0), length, width)


def record(ticks: int = 40, egos: int = 2, actors: int = 3, prefix: str = "car_", text: str = "") -> EpisodeRecord:
    sizes = {f"cav_{i}": (4.7, 1.9) for i in range(egos)}
    recorder = Recorder("crossing-4", {"agent": "idm", "seed": 7, "note": text}, sizes)
    for tick in range(ticks):
        living = {f"cav_{i}": ego_state(i, tick) for i in range(egos) if i != 1 or tick < 0.7 * ticks}
        touch = (Contact("cav_0", "cav_1", Kind.VEHICLE),) if 0.5 * ticks <= tick < 0.5 * ticks + 8 else ()
        signals = {"c": "GrGrrryy" if tick // 20 % 2 else "rGrGrrrr"}
        frame = quantize_frame(Frame(tick, living, traffic(actors, tick, prefix), signals, touch))
        plans = {ego: Plan(plan_ahead(state), 0.5) for ego, state in living.items()}
        pedal = math.sin(tick / 30)
        control = Control(max(pedal, 0.0), max(-pedal, 0.0), 0.4 * math.sin(tick / 25))
        recorder.add(frame, dict.fromkeys(living, control), plans, {})
    failed = Ending("cav_1", int(0.7 * ticks), End.AGENT_FAILED, FailureReason.CRASHED, text, int(0.7 * ticks))
    return recorder.finish([Ending("cav_0", ticks - 1, End.ARRIVED), failed])


def plan_ahead(state: EgoState) -> Float:
    steps = np.arange(3.0, 27.0, 3.0)
    return np.stack((state.x + steps * math.cos(state.yaw), state.y + steps * math.sin(state.yaw)), axis=-1)


def some_marks(ticks: int, text: str = "hit cav_1 at 6.3 m/s") -> list[ReplayMark]:
    middle, late = ticks // 2, int(0.7 * ticks)
    return [
        ReplayMark(middle, "cav_0", "collision-vehicle", text, 1.5, -3.5),
        ReplayMark(late, "cav_1", "agent-failed", "crashed", 1.7, 5.0),
        ReplayMark(ticks // 4, "cav_1", "stop-sign", "stop-sign, x 0.80", 1.7, -30.0),
        ReplayMark(ticks - 1, "cav_0", "arrived", "arrived", 80.0, -1.7),
    ]
