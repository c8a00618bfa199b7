"""Vehicles that stop, pull out of parked rows, cyclists, and people for whom SUMO's traffic yields."""

from collections.abc import Iterator

import numpy as np
import pytest
from testing.sumo_crossing import compiled, scenario

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Actors, Frame, Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing, ParkedStart, VehicleStop
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, GapTrigger, PathMotion, TimeTrigger
from mdrive_sumo.sumo import SumoWorld

LANE_Y = -4.8
"""Centre [m] of the right one of the two lanes eastbound; the left one is at -1.6."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("street"), "priority")


def car(name: str, pos_m: float, speed: float = 0.0, **fields: object) -> BackgroundVehicle:
    """A car on the right lane eastbound; its front is at x = pos_m - 150."""
    return BackgroundVehicle.model_validate(
        {
            "id": name,
            "depart_s": 0.0,
            "edges": ("a", "b"),
            "depart_pos_m": pos_m,
            "depart_speed": speed,
            "driving": CarFollowing(sigma=0.0),
            "keeps_lane": True,
            **fields,
        }
    )


def drive(some: Scenario, roads: RoadMap, seconds: float) -> Iterator[Actors]:
    """All road users tick by tick."""
    scripted = ScriptedActors(some, roads)
    with SumoWorld(some, roads, {}, 0) as world:
        around = world.start({}, scripted.present)
        for tick in range(round(seconds * 20)):
            frame = Frame(tick, {}, around.actors.merge(scripted.present), {})
            yield frame.actors
            around = world.advance({}, scripted.advance(frame, ()), ())


def of(actors: Actors, name: str) -> tuple[float, float, float, float]:
    i = actors.ids.index(name)
    return float(actors.x[i]), float(actors.y[i]), float(actors.yaw[i]), float(actors.speed[i])


def touching(actors: Actors) -> bool:
    boxes = boxes_corners(actors.x, actors.y, actors.yaw, actors.length, actors.width)
    hits = boxes_overlap(boxes[:, None], boxes[None])
    return bool((hits & ~np.eye(len(boxes), dtype=np.bool_)).any())


def test_a_bus_stops_where_it_shall_for_as_long_as_it_shall_and_drives_on(roads: RoadMap) -> None:
    stop = VehicleStop(edge="a", lane=0, pos_m=80.0, duration_s=4.0)
    rows = np.array([of(one, "bus") for one in drive(scenario(car("bus", 40.0, 8.0, stops=[stop])), roads, 20.0)])
    standing = rows[rows[:, 3] < 0.05]
    assert len(standing) == pytest.approx(80, abs=4)
    assert standing[:, 0] + 2.5 == pytest.approx(80.0 - 150.0, abs=1.5)
    assert rows[-1, 3] > 5.0


def test_a_parked_vehicle_is_beside_its_lane_lets_others_pass_and_moves_over_when_there_is_a_gap(
    roads: RoadMap,
) -> None:
    parked = ParkedStart(offset_m=-2.8, leaves_s=2.0)
    some = scenario(car("parked", 60.0, parked=parked, length=4.6), car("passing", 30.0, 8.0))
    frames = list(drive(some, roads, 14.0))
    rows = np.array([of(one, "parked") for one in frames])
    assert not any(map(touching, frames))
    waits = rows[:40]
    assert waits[:, 0] == pytest.approx(60.0 - 2.3 - 150.0, abs=0.01)
    assert waits[:, 1] == pytest.approx(LANE_Y - 2.8, abs=0.01)
    assert (waits[:, 3] == 0.0).all()
    assert of(frames[60], "passing")[0] > rows[60, 0] + 5.0  # it has been passed
    assert np.abs(np.diff(rows[:, :2], axis=0)).max() < 0.9  # at 16 m/s a tick is 0.8 m: no leap
    assert rows[-1, 1] == pytest.approx(LANE_Y, abs=0.05)
    assert rows[-1, 3] > 5.0


def test_a_cyclist_rides_at_the_kerb_side_and_is_one(roads: RoadMap) -> None:
    rider = car("rider", 40.0, 4.0, kind="cyclist", length=1.8, width=0.6, driving=CarFollowing(max_speed=5.0))
    frames = list(drive(scenario(rider), roads, 6.0))
    assert {int(kind) for one in frames for kind in one.kind} == {int(Kind.CYCLIST)}
    rows = np.array([of(one, "rider") for one in frames])
    assert rows[:, 1] == pytest.approx(LANE_Y - 0.55, abs=0.02)
    assert rows[:, 3].max() < 5.6


def test_a_vehicle_drives_on_its_own_line_in_the_lane(roads: RoadMap) -> None:
    rows = np.array([of(one, "car") for one in drive(scenario(car("car", 40.0, 8.0, lane_offset_m=0.3)), roads, 3.0)])
    assert rows[:, 1] == pytest.approx(LANE_Y + 0.3, abs=0.01)
    assert rows[:, 2] == pytest.approx(0.0, abs=0.01)


def test_a_vehicle_that_keeps_its_lane_waits_behind_one_that_stops(roads: RoadMap) -> None:
    stop = VehicleStop(edge="a", lane=0, pos_m=80.0, duration_s=60.0)
    some = scenario(car("van", 80.0, stops=[stop]), car("behind", 40.0, 8.0))
    rows = np.array([of(one, "behind") for one in drive(some, roads, 15.0)])
    assert rows[:, 1] == pytest.approx(LANE_Y, abs=0.05)
    assert rows[-1, 3] < 0.1


def test_traffic_yields_to_someone_who_crosses_on_the_lanes_ahead_of_them_as_well(roads: RoadMap) -> None:
    """The car is too far away to hinder the walker at first, and at the far lane when the walker is."""
    x = -50.0
    walker = Actor(
        id="walker",
        kind="pedestrian",
        length=0.5,
        width=0.5,
        start=Pose(x=x, y=-7.5, yaw=np.pi / 2),
        motion=PathMotion(points=((x, -7.5), (x, 0.8), (x + 30.0, 0.8)), speed=1.2),
        trigger=GapTrigger(after_s=0.5),
    )
    some = scenario(car("car", 20.0, 12.0, depart_lane=1), actors=(walker,))
    frames = list(drive(some, roads, 16.0))
    assert not any(map(touching, frames))
    crossed_tick = next(k for k, one in enumerate(frames) if of(one, "walker")[1] > 0.5)
    assert crossed_tick < 9 * 20
    assert of(frames[crossed_tick - 1], "car")[0] < x  # it has waited
    assert of(frames[-1], "car")[0] > x + 10.0  # and driven on
    as_others_do = some.model_copy(update={"actors": (walker.model_copy(update={"trigger": TimeTrigger(at_s=0.5)}),)})
    assert any(map(touching, drive(as_others_do, roads, 16.0)))  # who does not claim the way is run over
