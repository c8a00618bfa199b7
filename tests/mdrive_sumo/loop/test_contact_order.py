"""The order of motion and contact in one tick (docs/decisions/022): the poses that the world gets and the frame has."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from testing.worlds import Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.core.geometry import box_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors, EgoState, Kind, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver

PARKED_X = 40.0
RESOLUTION_M = 0.001


@dataclass
class RecordingWorld:
    """A world with one parked car; it keeps the CAV poses and struck ids of every call, by tick of the new frame."""

    egos_by_tick: list[Mapping[str, EgoState]] = field(default_factory=list[Mapping[str, EgoState]])
    struck_by_tick: list[set[str]] = field(default_factory=list[set[str]])

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self.egos_by_tick.append(dict(egos))
        self.struck_by_tick.append(set(struck))
        one = np.ones(1)
        kind = np.full(1, Kind.VEHICLE, dtype=np.uint8)
        parked = Actors(("parked",), kind, PARKED_X * one, 0 * one, 0 * one, 0 * one, 5.0 * one, 1.8 * one)
        return WorldState(parked, {})


def drive_into_the_parked_car(pass_through: bool = False) -> tuple[EpisodeRecord, RecordingWorld, int]:
    """Return the record, the world and the first tick whose frame has a contact."""
    world = RecordingWorld()
    config = EpisodeConfig(
        straight_scenario(straight_ego("0", length=60)), straight_road(), seed=0, pass_through=pass_through
    )
    record = run_episode(config, world, {"0": LocalDriver(Says(lambda seen: pedals(throttle=1.0)))})
    return record, world, record.contacts[0][0]


def overlaps_parked_car(x: float, y: float, yaw: float) -> bool:
    own = box_corners(x, y, yaw, VEHICLE.length, VEHICLE.width)
    return bool(boxes_overlap(own, box_corners(PARKED_X, 0.0, 0.0, 5.0, 1.8)))


@pytest.mark.slow
def test_without_contact_the_world_and_the_frame_have_the_same_pose() -> None:
    record, world, first = drive_into_the_parked_car()
    assert first > 10
    for tick in range(first):
        assert record.x[tick, 0] == pytest.approx(world.egos_by_tick[tick]["0"].x, abs=5.1e-4)


@pytest.mark.slow
def test_in_the_tick_of_a_contact_the_world_gets_the_proposed_pose_and_the_frame_shows_the_resolved_one() -> None:
    record, world, first = drive_into_the_parked_car()
    proposed = world.egos_by_tick[first]["0"]
    assert overlaps_parked_car(proposed.x, proposed.y, proposed.yaw)
    assert not overlaps_parked_car(record.x[first, 0] - RESOLUTION_M, record.y[first, 0], record.yaw[first, 0])
    correction = proposed.x - record.x[first, 0]
    assert 0.001 < correction <= record.speed[first - 1, 0] * DT + 0.5 * 10.0 * DT**2
    assert record.speed[first, 0] < proposed.speed - 1.0


@pytest.mark.slow
def test_the_next_proposal_starts_from_the_resolved_pose() -> None:
    record, world, first = drive_into_the_parked_car()
    following = world.egos_by_tick[first + 1]["0"]
    assert abs(following.x - record.x[first, 0]) < 0.02  # at rest against the parked car, full throttle for 50 ms


@pytest.mark.slow
def test_a_struck_actor_is_reported_to_the_world_one_tick_after_the_frame_with_the_contact() -> None:
    _, world, first = drive_into_the_parked_car()
    assert not any(world.struck_by_tick[: first + 1])
    assert world.struck_by_tick[first + 1] == {"parked"}


def test_with_pass_through_the_frame_shows_the_proposed_pose_and_the_contact() -> None:
    record, world, first = drive_into_the_parked_car(pass_through=True)
    assert record.x[first, 0] == pytest.approx(world.egos_by_tick[first]["0"].x, abs=5.1e-4)
    assert overlaps_parked_car(record.x[first, 0], record.y[first, 0], record.yaw[first, 0])
    assert world.struck_by_tick[first + 1] == {"parked"}
