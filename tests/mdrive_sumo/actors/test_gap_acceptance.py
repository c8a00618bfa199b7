"""People who cross a road: which traffic they wait for, and that they set off in the first gap."""

import numpy as np
import pytest
from testing.actors_world import actor

from mdrive_sumo.actors.gap_acceptance import is_gap
from mdrive_sumo.core.state import Actors, EgoState, Frame, Kind
from mdrive_sumo.scenario.scripted_actor import Actor, GapTrigger

NORTH = np.pi / 2
Mover = tuple[float, float, float, float]


def crosser(**parts: object) -> Actor:
    """Someone who crosses along the y axis from y = -4 to y = 4."""
    return actor("walker", "pedestrian", points=[(0.0, -4.0), (0.0, 4.0), (30.0, 4.0)], speed=1.4, **parts)


def frame(*movers: Mover, kind: Kind = Kind.VEHICLE, cav: Mover | None = None) -> Frame:
    """Movers with x, y, yaw, speed, and a CAV."""
    x, y, yaw, speed = np.array(movers, dtype=np.float64).reshape(-1, 4).T
    full = np.ones(len(movers))
    ids = tuple(str(k) for k in range(len(movers)))
    others = Actors(ids, np.full(len(movers), kind, dtype=np.uint8), x, y, yaw, speed, 4.6 * full, 1.8 * full)
    return Frame(0, {"0": EgoState(*cav)} if cav else {}, others, {})


@pytest.mark.parametrize(
    ("mover", "free"),
    [
        ((-30.0, 1.0, 0.0, 10.0), False),  # 30 m and 10 m/s: it needs 10 + 17 + 5 m
        ((-45.0, 1.0, 0.0, 10.0), True),
        ((-16.0, 1.0, 0.0, 3.0), True),
        ((-9.0, 1.0, 0.0, 3.0), False),
        ((-9.0, 1.0, 0.0, 0.0), True),  # it stands
        ((20.0, 1.0, 0.0, 10.0), True),  # it has passed
        ((4.0, 1.0, 0.0, 5.0), True),
        ((30.0, 1.0, np.pi, 10.0), False),  # from the other side
        ((-9.0, -9.0, NORTH, 4.0), False),  # it may turn onto the way
        ((-30.0, 12.0, NORTH, 14.0), True),  # it drives past
    ],
    ids=str,
)
def test_people_wait_for_what_could_not_stop_comfortably(mover: Mover, free: bool) -> None:
    assert is_gap(crosser(), frame(mover)) is free
    assert is_gap(crosser(), frame(cav=mover)) is free
    assert is_gap(crosser(), frame(mover, kind=Kind.CYCLIST)) is free


def test_nobody_waits_for_people_nor_on_an_empty_road() -> None:
    assert is_gap(crosser(), frame((-9.0, 1.0, 0.0, 3.0), kind=Kind.PEDESTRIAN))
    assert is_gap(crosser(), frame())


def test_the_trigger_wants_a_path() -> None:
    with pytest.raises(ValueError, match="actor walker: expected a path for the trigger gap, found replay"):
        actor("walker", "pedestrian", poses=[(0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)], trigger=GapTrigger())
