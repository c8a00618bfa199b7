"""The negotiation interface: own announcements, and the effect of others' announcements on the own plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from testing.planning import LENGTH, WIDTH, briefing, own, seen, straight, things

from mdrive_sumo.contract import Cause, Message, Observation, OwnState, Reason
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.negotiation import NegotiationInterface, NegotiationStep, RuleNegotiator
from mdrive_sumo.negotiation.peer_table import MEMORY_TICKS
from mdrive_sumo.planning.ego_planner import exclude_objects
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion, predict_yielding
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner, StopPoint
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose, decode, encode

CROSSING_X = 17.0


@dataclass
class Car:
    """One at the table; it does not move, but talks and plans as if it would."""

    name: str
    route: Float
    state: OwnState
    stops: bool = True
    passing: bool = False
    steps: list[NegotiationStep] = field(default_factory=list)

    def __post_init__(self) -> None:
        about = briefing(self.route, name=self.name)
        self.planner = SpaceTimePlanner(about, self.state.yaw, 8.0)
        self.interface = NegotiationInterface(about, RuleNegotiator(self.passing), self.stops)
        self.motions: list[PredictedMotion] = []
        self.names: frozenset[str] = frozenset()
        self.stop_points: list[StopPoint] = []

    def act(self, tick: int, heard: Sequence[Message]) -> list[Message]:
        now = seen(tick, self.state, things(), heard)
        self.planner.track_ego(tick, self.state)
        self.interface.receive(now)
        self.names, self.motions = self.interface.predict_announced_motions(now, self.planner)
        self.stop_points = self.interface.find_stop_points(now, self.planner)
        self.planner.update(tick, self.state.speed, self.motions, self.stop_points)
        step = self.interface.negotiate(now, self.planner, self.planner.get_planned_points(tick))
        self.steps.append(step)
        return [replace(message, sender=self.name, tick=tick) for message in step.messages]


def table(ticks: int, stops: bool = True, passing: bool | None = None) -> tuple[Car, Car]:
    """a comes from the west, 12 m before the crossing; b from the south, 15 m; a message takes a tick."""
    how = stops, not stops if passing is None else passing
    north = straight()[:, ::-1] + (CROSSING_X, -40.0)
    a = Car("a", straight(), own(CROSSING_X - 12.0, speed=6.0), *how)
    b = Car("b", north, own(CROSSING_X, -15.0, np.pi / 2, speed=6.0), *how)
    of_a: list[Message] = []
    of_b: list[Message] = []
    for tick in range(ticks):
        of_a, of_b = a.act(tick, of_b), b.act(tick, of_a)
    return a, b


def test_both_decide_that_the_nearest_goes_first() -> None:
    a, b = table(12)
    mine, theirs = a.steps[-1].decision, b.steps[-1].decision
    assert mine is not None
    assert theirs is not None
    assert (mine.priority_over, mine.yield_to) == ({"b"}, frozenset())
    assert (theirs.priority_over, theirs.yield_to) == (frozenset(), {"a"})
    assert theirs.intention == Intention.STOP


def test_an_agreed_stop_lies_before_the_crossing_until_it_is_free() -> None:
    a, b = table(12)
    assert a.stop_points == []
    (wait,) = b.stop_points
    assert b.planner.s < wait.s < 40.0 - WIDTH / 2
    decision = b.steps[-1].decision
    assert decision is not None
    assert wait.until_s == pytest.approx((decision.until_tick - 11) * DT)
    assert wait.until_s > 0
    assert (wait.reason.cause, wait.reason.others, wait.reason.seconds) == (Cause.AGREEMENT, ("a",), wait.until_s)


def test_without_stops_an_agreed_stop_gives_no_stop_point() -> None:
    _, b = table(12, stops=False, passing=False)
    decision = b.steps[-1].decision
    assert decision is not None
    assert decision.intention == Intention.STOP
    assert b.stop_points == []


def test_passing_behind_gives_no_stop_point() -> None:
    a, b = table(12, stops=False)
    assert a.stop_points == b.stop_points == []
    decision = b.steps[-1].decision
    assert decision is not None
    assert (decision.intention, decision.yield_to) == (Intention.SLOWER, {"a"})
    assert len(b.motions) == 1
    assert b.motions[0].length == LENGTH
    assert b.motions[0].reason == Reason(Cause.AGREEMENT, ("a",))
    assert a.motions[0].reason == Reason(Cause.ANNOUNCED, ("b",))


def test_a_yielding_car_is_avoided_for_two_seconds_only() -> None:
    a, b = table(12, stops=False)
    (minded,) = a.motions
    assert len(minded.poses) < len(TIMES) == len(b.motions[0].poses)
    assert minded.length < LENGTH
    assert minded.width < WIDTH
    assert a.planner.get_planned_points(11)[-1, 0] > 60.0  # goes on
    plans = a.planner.get_planned_points(11), b.planner.get_planned_points(11)
    at_crossing = [int(np.argmax(line > place)) for line, place in
                   ((plans[0][:, 0], CROSSING_X), (plans[1][:, 1], 0.0))]  # fmt: skip
    assert at_crossing[0] < at_crossing[1]


def test_announced_cars_are_excluded_from_the_objects() -> None:
    a, _ = table(6)
    assert a.names == {"b"}
    left = exclude_objects(things((1, 0, 0, 0), (2, 0, 0, 0), ids=("b", "t00000001")), a.names)
    assert left.ids == ("t00000001",)


def test_no_announcement_before_the_first_message_and_after_silence() -> None:
    a, _ = table(1)
    assert (a.names, a.motions) == (frozenset(), [])
    a, _ = table(6)
    for tick in range(6, 6 + MEMORY_TICKS + 6):
        a.act(tick, [])
    assert a.names == frozenset()
    assert a.steps[-1].decision is None or a.motions == []


def mcm(x: float, y: float, yaw: float, speed: float, tick: int = 0) -> Message:
    """Of car "b", which means to go straight on."""
    way = np.array((x, y)) + np.outer(speed * 0.2 * np.arange(1, 51), (math.cos(yaw), math.sin(yaw)))
    said = Mcm(ReferencePose(x, y, yaw, tick), speed, Intention.KEEP, Direction.FOLLOW, 0.2, way)
    return replace(encode(said), sender="b", tick=tick)


def minded(message: Message, tick: int = 0) -> list[PredictedMotion]:
    """What a car at (20, 0) that goes east at 6 m/s minds of it."""
    about = briefing()
    planner, interface = SpaceTimePlanner(about, 0.0, 8.0), NegotiationInterface(about, RuleNegotiator(), stops=True)
    planner.s = 20.0
    now = Observation(tick, own(20.0, speed=6.0), objects=things(), messages=(message,))
    planner.track_ego(tick, now.own)
    interface.receive(now)
    names, motions = interface.predict_announced_motions(now, planner)
    assert names == {"b"}
    return motions


def test_announcements_of_followers_are_ignored() -> None:
    assert minded(mcm(10.0, 0.0, 0.0, 8.0)) == []
    assert minded(mcm(14.0, -3.5, 0.3, 8.0)) == []
    assert len(minded(mcm(10.0, -20.0, np.pi / 2, 8.0))) == 1  # he crosses


def test_a_leader_may_brake_whatever_it_announced() -> None:
    (leader,) = minded(mcm(32.0, 0.0, 0.0, 6.0))
    assert leader.stands_at_end
    assert np.ptp(leader.poses[:, 0]) == pytest.approx(predict_yielding(6.0)[-1] - predict_yielding(6.0)[0], abs=0.05)
    (crossing,) = minded(mcm(40.0, -20.0, np.pi / 2, 6.0))
    assert not crossing.stands_at_end
    assert crossing.poses[:, 1] == pytest.approx(-20.0 + 6.0 * TIMES, abs=0.05)
    assert crossing.poses[:, 2] == pytest.approx(np.pi / 2, abs=1e-3)


def test_announced_motions_are_compensated_for_their_age() -> None:
    (crossing,) = minded(mcm(40.0, -20.0, np.pi / 2, 6.0), tick=10)
    assert crossing.poses[:, 1] == pytest.approx(-20.0 + 6.0 * (TIMES + 10 * DT), abs=0.05)


def test_the_announcement_is_the_own_plan() -> None:
    a, _ = table(1)
    said = decode(a.steps[0].messages[0])
    assert isinstance(said, Mcm)
    assert said.planned == pytest.approx(a.planner.get_planned_points(0), abs=0.011)
    assert (said.pose.x, said.speed) == (pytest.approx(5.0), pytest.approx(6.0))
    assert said.desired == pytest.approx(a.planner.predict_desired_points(6.0, 20), abs=0.011)
