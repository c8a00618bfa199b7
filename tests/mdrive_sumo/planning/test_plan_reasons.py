"""What limits a plan is what the planner says: each limit by its cause, the first one of several."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from testing.planning import FACTS, briefing, moving, own, seen, standing, straight, things

from mdrive_sumo.contract import REASON, Cause, Objects, Reason, StopSign, TrafficLight
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.ego_planner import EgoPlanner
from mdrive_sumo.planning.motion_conflicts import MotionConflicts
from mdrive_sumo.planning.motion_prediction import PredictedMotion
from mdrive_sumo.planning.parameters import MARGINS
from mdrive_sumo.planning.reference_path import build_path
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopPoint

SIGN, FAR = Reason(Cause.STOP_SIGN, distance_m=15.0), Reason(Cause.LIGHT, ("L",))


def reason_of(motions: Sequence[PredictedMotion] = (), stops: Sequence[StopPoint] = (), speed: float = 8.0) -> Reason:
    planner = SpaceTimePlanner(briefing(), 0.0, 8.0)
    planner.track_ego(0, own(speed=speed))
    planner.update(0, speed, motions, stops)
    return planner.reason


def test_the_first_limit_that_a_free_drive_meets_is_the_reason() -> None:
    assert reason_of().cause is Cause.FREE
    assert reason_of(stops=[StopPoint(60.0, FAR), StopPoint(20.0, SIGN)]) == SIGN
    assert reason_of([standing(30.0, 0.0)], [StopPoint(60.0, FAR)]).others == ("standing",)
    assert reason_of([standing(60.0, 0.0)], [StopPoint(20.0, SIGN)]) == SIGN
    assert reason_of([standing(30.0, 9.0)]).cause is Cause.FREE  # beside the road


def test_a_limit_beyond_the_next_seconds_is_no_reason_yet() -> None:
    assert reason_of(stops=[StopPoint(75.0, FAR)]).cause is Cause.FREE


def test_a_reason_without_a_place_gets_that_of_the_meeting() -> None:
    reason = reason_of([moving(30.0, -20.0, math.pi / 2, 5.0)])
    assert (reason.cause, reason.others) == (Cause.AVOID, ("moving",))
    assert reason.seconds == pytest.approx(3.5, abs=1.0)
    assert reason.distance_m == pytest.approx(28.0, abs=5.0)


def test_a_car_without_a_way_says_so() -> None:
    reason = reason_of([standing(6.0, 0.0)], speed=8.0)
    assert (reason.cause, reason.others) == (Cause.NO_WAY, ("standing",))


def test_a_motion_is_found_among_all() -> None:
    path = build_path(straight(), FACTS.rear_to_centre)
    motions = [moving(80.0, 30.0, 0.0, 1.0), standing(30.0, 0.0), standing(30.0, 30.0)]
    cells = np.arange(40) * 8
    met = MotionConflicts(path, FACTS, motions).find_first_met(cells, MARGINS.contact)
    assert met is not None and met[1] is motions[1]
    assert cells[met[0]] / 4 == pytest.approx(30.0 - 4.5, abs=2.1)
    assert MotionConflicts(path, FACTS, motions[::2]).find_first_met(cells, MARGINS.contact) is None
    assert MotionConflicts(path, FACTS, []).find_first_met(cells, MARGINS.contact) is None


SIGNS = {"stop_signs": (StopSign(25.0),)}
LIGHTS = {"traffic_lights": (TrafficLight("L", 25.0),)}
WALKER = replace(things((25.0, -4.0, math.pi / 2, 1.5), ids=("w",), kind=Kind.PEDESTRIAN))


@pytest.mark.parametrize(
    ("objects", "parts", "cause", "others"),
    [
        (things(), {}, Cause.FREE, ()),
        (things(), SIGNS, Cause.STOP_SIGN, ()),
        (things(), LIGHTS, Cause.LIGHT, ("L",)),
        (things((18.0, 0.0, 0.0, 3.0), ids=("a",)), {}, Cause.FOLLOW, ("a",)),
        (things((18.0, 0.0, 0.0, 0.0), ids=("a",)), {}, Cause.BLOCKED, ("a",)),
        (things((26.0, -16.0, math.pi / 2, 8.0), ids=("a",)), {}, Cause.YIELD, ("a",)),
        (WALKER, {}, Cause.YIELD, ("w",)),
        (things((26.0, 40.0, -math.pi / 2, 1.0), ids=("a",)), {}, Cause.FREE, ()),  # far from the crossing, slow
    ],
)
def test_what_a_car_meets_on_its_way(
    objects: Objects, parts: dict[str, object], cause: Cause, others: tuple[str, ...]
) -> None:
    about = replace(briefing(), **parts)
    car = EgoPlanner(about, own(speed=8.0), 8.0)
    now = replace(seen(0, own(speed=8.0), objects), signals={"L": "r"})
    assert car.track_ego(now)
    (note,) = car.update_plan(now, objects)
    reason = Reason.from_note(note)
    assert note.kind == REASON and reason is not None
    assert (reason.cause, reason.others) == (cause, others)
    if cause is Cause.YIELD:
        assert reason.seconds is not None and 0.0 <= reason.seconds < 4.0
        assert reason.position == pytest.approx((objects.x[0], objects.y[0]), abs=0.1)


def bend(radius_m: float) -> list[tuple[float, float]]:
    turn = np.linspace(0.0, math.pi / 2, 12)
    arc = [(20 + radius_m * math.sin(a), radius_m * (1 - math.cos(a))) for a in turn]
    return [(float(x), 0.0) for x in range(20)] + arc + [(20 + radius_m, radius_m + y) for y in range(1, 40)]


def test_the_route_is_a_reason_too() -> None:
    planner = SpaceTimePlanner(briefing(np.array(bend(7.0))), 0.0, 8.0)
    planner.update(0, 8.0, [])
    assert planner.reason.cause is Cause.BEND
    assert planner.reason.speed == pytest.approx(math.sqrt(3.0 * 7.0), abs=0.6)
    slow = SpaceTimePlanner(briefing(limit=5.0), 0.0, 8.0)
    slow.update(0, 5.0, [])
    assert (slow.reason.cause, slow.reason.speed) == (Cause.SPEED_LIMIT, 5.0)
