"""The paper's rule planner behind cooperative detectors: CARLA BasicAgent's hazard rule (protocol 11.2)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.planning import briefing, own, seen, things

from mdrive_sumo.agents.perception_swap import AttFuseProfileAgent
from mdrive_sumo.contract import Objects, Observation, Reply, StopSign, TrafficLight
from mdrive_sumo.planning.hazard_rule import HAZARD_RULE, find_hazards
from mdrive_sumo.v2x.messages import CAM, CPM, Cpm, ReferencePose, encode

NOTHING = things()


@pytest.mark.parametrize(
    ("ahead", "aside", "speed", "found"),
    [
        (0.49, 0.0, 5.0, False),
        (0.51, 0.0, 5.0, True),
        (10.99, 0.0, 5.0, True),  # 6 m and a second's way
        (11.01, 0.0, 5.0, False),
        (8.0, 2.49, 5.0, True),
        (8.0, 2.51, 5.0, False),
        (8.0, -2.49, 5.0, True),
        (8.0, -2.51, 5.0, False),
        (-3.0, 0.0, 5.0, False),
        (6.29, 0.0, 0.31, True),  # slow, but not standing
        (3.99, 0.0, 0.29, True),
        (4.01, 0.0, 0.29, False),  # a standing car ignores objects 4 m away or more
        (4.01, 0.0, -0.29, False),
        (4.0, 0.0, 0.31, True),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 2.3])
def test_hazard_rule(ahead: float, aside: float, speed: float, found: bool, yaw: float) -> None:
    x = 5.0 + ahead * math.cos(yaw) - aside * math.sin(yaw)
    y = -3.0 + ahead * math.sin(yaw) + aside * math.cos(yaw)
    assert find_hazards(own(5.0, -3.0, yaw, speed), things((x, y, 0.0, 0.0))).tolist() == [found]


def test_one_of_several_objects_is_a_hazard() -> None:
    assert find_hazards(own(speed=5.0), things((50, 0, 0, 0), (8, 1, 0, 0))).tolist() == [False, True]
    assert not len(find_hazards(own(speed=5.0), NOTHING))


def started(*lights: TrafficLight) -> AttFuseProfileAgent:
    agent = AttFuseProfileAgent({})
    agent.start(replace(briefing(), traffic_lights=lights))
    return agent


def halts(reply: Reply) -> bool:
    """Whether the plan stands for its first second."""
    assert reply.plan is not None
    assert reply.plan.controller == "carla-pid-6"
    return bool(np.ptp(reply.plan.points[:5, 0]) < 0.01)


def asked(agent: AttFuseProfileAgent, tick: int, objects: Objects, speed: float = 5.0) -> bool:
    return halts(agent.act(seen(tick, own(speed=speed), objects)))


def test_a_hazard_is_held_for_three_ticks() -> None:
    agent, close = started(), things((9, 0, 0, 0))
    found = [asked(agent, tick, close if tick in (2, 10, 11) else NOTHING) for tick in range(20)]
    assert HAZARD_RULE.hold_ticks == 3
    assert [tick for tick, standing in enumerate(found) if standing] == [2, 3, 4, 10, 11, 12, 13]


def test_on_a_free_road_it_drives_21_kmh() -> None:
    reply = started().act(seen(0, own(), NOTHING))
    assert reply.plan is not None
    assert math.isclose(HAZARD_RULE.speed * 3.6, 21.6)
    assert reply.plan.points[:, 0] == pytest.approx(
        HAZARD_RULE.speed * HAZARD_RULE.interval_s * np.arange(1, 16), abs=0.05
    )


def test_received_objects_are_hazards() -> None:
    agent = started()
    told = encode(Cpm(ReferencePose(30.0, 10.0, 0.0, 0), 80.0, things((9, 0, 0, 0)), np.zeros(1, dtype=np.uint8)))
    now = Observation(1, own(speed=5.0), objects=NOTHING, messages=(replace(told, sender="b"),))
    assert not asked(started(), 1, NOTHING)
    assert halts(agent.act(now))


@pytest.mark.parametrize(("away", "counts"), [(69.0, True), (71.0, False)])
def test_distant_senders_are_ignored(away: float, counts: bool) -> None:
    told = encode(Cpm(ReferencePose(0.0, away, 0.0, 0), 80.0, things((9, 0, 0, 0)), np.zeros(1, dtype=np.uint8)))
    now = Observation(1, own(speed=5.0), objects=NOTHING, messages=(replace(told, sender="b"),))
    assert halts(started().act(now)) is counts


def test_red_lights_count_and_stop_signs_do_not() -> None:
    agent = started(TrafficLight("L", 12.0))
    red = replace(seen(0, own(speed=5.0), NOTHING), signals={"L": "r"})
    assert halts(agent.act(red))
    assert not halts(agent.act(replace(red, signals={"L": "g"})))
    assert not halts(started(TrafficLight("L", 40.0)).act(red))  # far ahead
    agent = AttFuseProfileAgent({})
    agent.start(replace(briefing(), stop_signs=(StopSign(10.0),)))
    assert not halts(agent.act(red))


def test_detections_are_sent() -> None:
    reply = started().act(seen(0, own(), things((9, 0, 0, 0))))
    assert [message.type for message in reply.messages] == [CAM, CPM]
