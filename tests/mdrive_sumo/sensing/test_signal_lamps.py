"""Brake lamps and indicators follow from the motion of vehicles."""

from collections.abc import Iterable

import numpy as np
import pytest

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.roads import Lane, RoadMap, find_network_folder, load_road_map
from mdrive_sumo.sensing.signal_lamps import SignalLamp, SignalLampObserver

Pose = tuple[float, float, float, float]
"""x, y [m], yaw [rad], speed [m/s]."""


def load(name: str = "freeway") -> RoadMap:
    return load_road_map(find_network_folder(name))


def observe(roads: RoadMap, poses: Iterable[Pose], kind: Kind = Kind.VEHICLE) -> list[int]:
    """The lamps of one vehicle in successive ticks."""
    observer = SignalLampObserver(roads)
    found: list[int] = []
    for tick, pose in enumerate(poses):
        columns = (np.array([value]) for value in (*pose, 4.6, 1.8))
        boxes = Objects(("a",), np.array([kind], dtype=np.uint8), *columns)
        found.append(observer.observe(tick, boxes).get("a", 0))
    return found


def find_long_lane(roads: RoadMap) -> Lane:
    lanes = [lane for lane in roads.driving if not lane.junction and lane.left]
    return max(lanes or roads.driving, key=lambda lane: lane.centre.length)


def drive(lane: Lane, speeds: Iterable[float], offsets: Float | None = None) -> list[Pose]:
    """Poses along a lane from its start, at offsets to the left of its centre [m]."""
    s, poses = 5.0, list[Pose]()
    for i, speed in enumerate(speeds):
        (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
        aside = 0.0 if offsets is None else float(offsets[i])
        poses.append((x - aside * np.sin(yaw), y + aside * np.cos(yaw), yaw, float(speed)))
        s += speed * DT
    return poses


@pytest.mark.parametrize(("deceleration", "lit"), [(0.5, False), (3.0, True)])
def test_brake_lamps_shine_from_the_deceleration_of_the_regulation_on(deceleration: float, lit: bool) -> None:
    roads = load()
    found = observe(roads, drive(find_long_lane(roads), 10.0 - deceleration * DT * np.arange(30)))
    assert bool(found[-1] & SignalLamp.BRAKE) is lit
    assert not found[0]


def test_who_stands_after_a_drive_brakes_and_who_never_drove_does_not() -> None:
    roads = load()
    lane = find_long_lane(roads)
    assert observe(roads, drive(lane, [1.0, 0.5, *[0.0] * 40]))[-1] & SignalLamp.BRAKE
    assert not any(observe(roads, drive(lane, [0.0] * 40)))
    assert not any(observe(roads, drive(lane, [1.0, 0.5, *[0.0] * 40]), Kind.PEDESTRIAN))


@pytest.mark.parametrize(("to", "lamp"), [(3.2, SignalLamp.LEFT), (-3.2, SignalLamp.RIGHT)])
def test_lane_changes_light_the_indicator_of_their_side_only(to: float, lamp: SignalLamp) -> None:
    roads = load()
    offsets = np.concatenate((np.zeros(10), np.linspace(0.0, to, 40), np.full(30, to)))
    found = observe(roads, drive(find_long_lane(roads), np.full(80, 12.0), offsets))
    assert lamp in {SignalLamp(lit) for lit in found[10:50]}
    assert {SignalLamp(lit) for lit in found} <= {SignalLamp(0), lamp}
    assert not found[9] and not found[-1]


def test_turns_light_the_indicator_before_and_in_the_junction() -> None:
    roads = load("town_crossing")
    for way in (lane for lane in roads.driving if lane.junction):
        turn = way.centre.yaw_at(way.centre.length) - way.centre.yaw_at(0.0)
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        if abs(turn) < 1.0 or way.centre.length < 8.0:
            continue
        stations = np.arange(0.0, way.centre.length, 0.25)
        lit = observe(roads, [(*way.centre.at(s), way.centre.yaw_at(s), 5.0) for s in stations])
        wanted = SignalLamp.LEFT if turn > 0 else SignalLamp.RIGHT
        assert SignalLamp(lit[len(lit) // 2]) == wanted


def test_a_gap_in_time_forgets_what_was_before() -> None:
    roads = load()
    observer = SignalLampObserver(roads)
    box = Objects(("a",), np.zeros(1, dtype=np.uint8), *(np.array([v]) for v in (0.0, 0.0, 0.0, 10.0, 4.6, 1.8)))
    slow = Objects(("a",), np.zeros(1, dtype=np.uint8), *(np.array([v]) for v in (0.0, 0.0, 0.0, 0.0, 4.6, 1.8)))
    assert not observer.observe(0, box)
    assert not observer.observe(500, slow)
