"""How a station moves that has warned of its emergency braking, and what `sharing` makes of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.planning import briefing, own, seen, straight, things

from mdrive_sumo.agents.sharing import SharingAgent
from mdrive_sumo.contract import Cause, Reason, Reply
from mdrive_sumo.planning.motion_prediction import TIMES
from mdrive_sumo.planning.warned_motion import predict_braking_station
from mdrive_sumo.v2x.messages import Denm, EventCause, ReferencePose, Termination, encode


def warning(x: float, speed: float, yaw: float = 0.0, tick: int = 0) -> Denm:
    pose = ReferencePose(x, 0.0, yaw, tick)
    return Denm(pose, 0, EventCause.DANGEROUS_SITUATION, 1, x, 0.0, tick, 1.0, speed, 4.5, 1.8)


def test_a_station_that_brakes_in_an_emergency_stops_straight_ahead_and_stays() -> None:
    motion = predict_braking_station("cav_1", warning(10.0, 6.0, math.pi / 2), 0)
    way = motion.poses[:, 1]
    early = TIMES <= 1.0
    assert way[early] == pytest.approx(6.0 * TIMES[early] - 3.0 * TIMES[early] ** 2)
    assert way[~early] == pytest.approx(np.full((~early).sum(), 3.0))  # 6 m/s at 6 m/s2
    assert motion.poses[:, 0] == pytest.approx(np.full(len(TIMES), 10.0))
    assert motion.stands_at_end and motion.reason == Reason(Cause.ANNOUNCED, ("cav_1",))
    later = predict_braking_station("cav_1", warning(10.0, 6.0), 10).poses[0, 0]  # half a second ago
    assert later == pytest.approx(10.0 + 6.0 * (0.5 + TIMES[0]) - 3.0 * (0.5 + TIMES[0]) ** 2)


def follow(denms: list[Denm], tick: int = 4) -> float:
    """Return how far [m] a car at 8 m/s plans to get in 3 s, 14 m behind a station that drives at 8 m/s."""
    agent = SharingAgent({"detector": "ideal"})
    agent.start(replace(briefing(straight(200.0)), v2x_rate="etsi"))
    told = [replace(encode(denm), sender="cav_1", tick=denm.pose.tick) for denm in denms]
    reply = Reply()
    for now in range(tick + 1):
        place = own(0.4 * now, 0.0, 0.0, 8.0)
        ahead = things((14.0 + 0.4 * now, 0.0, 0.0, 8.0))
        reply = agent.act(seen(now, place, ahead, [one for one in told if one.tick + 1 == now]))
    assert reply.plan is not None
    return float(reply.plan.points[14, 0])


def test_a_follower_plans_to_stop_behind_a_station_that_warns() -> None:
    braking = warning(15.2, 8.0, tick=3)
    free, warned = follow([]), follow([braking])
    assert warned < 15.2 + 8.0**2 / 12.0 - 4.5 < free  # it stops behind where the station will stand
    cancelled = replace(braking, termination=Termination.CANCELLATION)
    assert follow([cancelled]) == pytest.approx(free, abs=0.5)
