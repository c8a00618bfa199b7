"""What each built-in agent notes as the reason of its driving, observation by observation."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from testing.planning import briefing, own, seen, straight, things

from mdrive_sumo.agents.learned.learned_agent import DecidedPlan, find_reason
from mdrive_sumo.agents.omniscient import OmniscientAgent
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import Agent, Cause, Objects, Privileged, Reason, Reply, StopSign, TrafficLight
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind

PROFILE = "perception-swap:cobevt:profile"
SEEN, TRACKED = "t0000002a", "k0"
"""Names of the only road user: of the sensor's track, and of the tracker of the agents that have one."""
AHEAD = things((18.0, 0.0, 0.0, 0.0), ids=(SEEN,))
MOVING = things((18.0, 0.0, 0.0, 3.0), ids=(SEEN,))
CROSSING = things((15.0, -9.0, math.pi / 2, 7.0), ids=(SEEN,))
NOTHING = things()


def read_reasons(reply: Reply) -> list[Reason]:
    return [reason for note in reply.notes if (reason := Reason.from_note(note)) is not None]


def start(name: str, route: Float | None = None, **parts: Any) -> Agent:
    agent = AGENTS[name]({})
    agent.start(replace(briefing(route), **parts))
    return agent


def find_first(name: str, objects: Objects, parts: dict[str, Any], speed: float = 8.0) -> Reason:
    (reason,) = read_reasons(start(name, **parts).act(replace(seen(0, own(speed=speed), objects), signals={"L": "r"})))
    return reason


@pytest.mark.parametrize(
    ("name", "objects", "parts", "cause", "others"),
    [
        ("stationary", NOTHING, {}, Cause.STATIONARY, ()),
        ("constant-speed", AHEAD, {}, Cause.FREE, ()),
        ("constant-speed", NOTHING, {"route_speed_limit": np.full(101, 5.0), "desired_speed": None}, Cause.FREE, ()),
        ("idm", NOTHING, {}, Cause.FREE, ()),
        ("idm", AHEAD, {}, Cause.BLOCKED, (SEEN,)),
        ("idm", MOVING, {}, Cause.FOLLOW, (SEEN,)),
        ("idm", CROSSING, {}, Cause.YIELD, (SEEN,)),
        ("idm", NOTHING, {"traffic_lights": (TrafficLight("L", 11.0),)}, Cause.LIGHT, ("L",)),
        ("idm", NOTHING, {"stop_signs": (StopSign(10.0),)}, Cause.STOP_SIGN, ()),
        ("single", AHEAD, {}, Cause.BLOCKED, (TRACKED,)),
        ("sharing", AHEAD, {}, Cause.BLOCKED, (TRACKED,)),
        ("sharing+negotiation", AHEAD, {}, Cause.BLOCKED, (TRACKED,)),
        ("colmdriver-rule", AHEAD, {}, Cause.BLOCKED, (TRACKED,)),
        (PROFILE, NOTHING, {}, Cause.FREE, ()),
        (PROFILE, things((9.0, 0.0, 0.0, 0.0), ids=(SEEN,)), {}, Cause.HAZARD, (SEEN,)),
        (PROFILE, NOTHING, {"traffic_lights": (TrafficLight("L", 12.0),)}, Cause.LIGHT, ("L",)),
    ],
)  # fmt: skip
def test_an_agent_says_what_limits_it(
    name: str, objects: Objects, parts: dict[str, Any], cause: Cause, others: tuple[str, ...]
) -> None:
    reason = find_first(name, objects, parts)
    assert (reason.cause, reason.others) == (cause, others)
    if others and cause is not Cause.LIGHT:
        assert reason.position == pytest.approx((objects.x[0], objects.y[0]), abs=0.1)


def test_a_reason_is_noted_when_it_changes_and_not_again() -> None:
    agent = start("idm")
    told = [
        (tick, read_reasons(agent.act(seen(tick, own(speed=8.0), AHEAD if tick >= 8 else NOTHING))))
        for tick in range(20)
    ]
    assert [(tick, [reason.cause for reason in reasons]) for tick, reasons in told if reasons] == [
        (0, [Cause.FREE]), (8, [Cause.BLOCKED]),
    ]  # fmt: skip


def test_take_turns_says_when_its_turn_begins() -> None:
    agent = start("take-turns", ego_id="2")
    (reason,) = read_reasons(agent.act(seen(0, own(), NOTHING)))
    assert (reason.cause, reason.seconds) == (Cause.TURN, pytest.approx(2 * 0.115 * 60.0, abs=0.1))
    (begun,) = read_reasons(agent.act(seen(400, own(), NOTHING)))
    assert begun.cause is Cause.FREE


@pytest.mark.parametrize(
    ("x", "creeps", "cause"),
    [
        ((0.0, 4.0, 8.0, 12.0), False, Cause.NETWORK_DRIVES), ((0.0, 3.8, 7.4, 11.0), False, Cause.NETWORK_DRIVES),
        ((0.0, 3.0, 5.0, 6.0), False, Cause.NETWORK_BRAKES), ((0.0, 0.2, 0.3, 0.3), False, Cause.NETWORK_STANDS),
        ((0.0, 0.7, 1.5, 2.2), True, Cause.CREEP),
    ],
)  # fmt: skip
def test_a_network_can_only_say_what_it_plans(x: tuple[float, ...], creeps: bool, cause: Cause) -> None:
    points = np.column_stack((x, np.zeros(len(x))))
    assert find_reason(DecidedPlan(0, points, None, creeps), own(speed=8.0)).cause is cause


def know(objects: Objects, *others: tuple[float, float, float, float]) -> Privileged:
    """The own CAV on the straight route; objects; other CAVs at x, y, yaw, with a speed, whose way north crosses it."""
    states = (own(speed=8.0), *(own(*other) for other in others))
    north = straight()[:, ::-1] + (25.0, -40.0)
    count = len(others)
    room = np.full((101, 2), 1.75)
    ids = ("me", *(f"cav{i}" for i in range(count)))
    return Privileged(
        ids, states, (straight(), *[north] * count), (None,) * (count + 1), objects, (room,) * (count + 1)
    )


@pytest.mark.parametrize(
    ("privileged", "parts", "cause", "others"),
    [
        (know(NOTHING), {}, Cause.FREE, ()),
        (know(replace(AHEAD, y=AHEAD.y + 4.0)), {}, Cause.FREE, ()),  # beside the road
        (know(things((30.0, 0.0, 0.0, 0.5), ids=("a",))), {}, Cause.AVOID, ("a",)),
        (know(NOTHING, (25.0, -21.0, math.pi / 2, 7.0)), {}, Cause.AVOID, ("cav0",)),
        (know(things((25.0, -5.0, math.pi / 2, 0.0), ids=("w",), kind=Kind.PEDESTRIAN)), {}, Cause.PEDESTRIAN, ("w",)),
        (know(NOTHING), {"stop_signs": (StopSign(20.0),)}, Cause.STOP_SIGN, ()),
    ],
)
def test_omniscient_names_what_a_free_drive_would_meet(
    privileged: Privileged, parts: dict[str, Any], cause: Cause, others: tuple[str, ...]
) -> None:
    agent = OmniscientAgent({"speed": 8.0})
    agent.start(replace(briefing(), **parts))
    reasons = [
        reason
        for tick in range(14)
        for reason in read_reasons(agent.act(replace(seen(tick, own(speed=8.0), NOTHING), privileged=privileged)))
    ]
    assert (reasons[-1].cause, reasons[-1].others) == (cause, others)
