"""Learned agents without a simulator: decisions at 5 Hz, plans, memory, blackout, instructions, creeping, the blend."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.learned_samples import make_briefing, make_observation
from testing.tiny_network import TinyNetwork, save_tiny_weights

from mdrive_sumo.agents.learned.creep_rule import CREEP, CreepRule
from mdrive_sumo.agents.learned.instructions import RouteInstructor
from mdrive_sumo.agents.learned.learned_agent import DecidedPlan
from mdrive_sumo.agents.learned.navigation import Navigation, RouteNavigator
from mdrive_sumo.agents.learned.system_spec import DECISION_TICKS, PLAN_INTERVAL_S, SYSTEMS
from mdrive_sumo.agents.learned.tcp import ControlFusion
from mdrive_sumo.agents.registry import LEARNED_AGENTS
from mdrive_sumo.contract import (
    STANDSTILL,
    Agent,
    Briefing,
    Observation,
    OwnState,
    Reply,
    TrafficLight,
    check_reply,
)
from mdrive_sumo.core.state import DT
from mdrive_sumo.sensing.sensor_kinds import derive_sensing_track
from mdrive_sumo.vehicle.control import CONTROLLERS

EAST = np.column_stack((np.arange(101.0), np.zeros(101)))
NORTH = np.column_stack((np.full(101, 30.0), np.arange(101.0)))


def make_agent(
    folder: Path, name: str, network: TinyNetwork | None = None, briefing: Briefing | None = None, **config: float
) -> Agent:
    path = save_tiny_weights(folder, SYSTEMS[name], network)
    agent = LEARNED_AGENTS[name]({"weights": str(path), **config})
    agent.start(briefing or make_briefing(EAST))
    return agent


def look(name: str, tick: int, own: OwnState | None = None, grey: int = 100) -> Observation:
    """Images and scans come at the system's rates."""
    seen = make_observation(SYSTEMS[name], tick, own, grey)
    if tick % DECISION_TICKS:
        seen = replace(seen, cameras={})
    return replace(seen, lidar={}) if tick % 2 else seen


def get_points(reply: Reply) -> np.ndarray:
    assert reply.plan is not None
    return reply.plan.points


@pytest.mark.parametrize("name", LEARNED_AGENTS)
def test_agents_are_single_and_of_the_sensor_track(tmp_path: Path, name: str) -> None:
    agent = make_agent(tmp_path, name)
    assert agent.label == "single" and derive_sensing_track([agent.sensors()]) == "sensor"
    first_line = (type(agent).__doc__ or "").splitlines()[0]
    assert first_line.startswith(f"Counterpart of {SYSTEMS[name].counterpart_of}, trained on mdrive-sumo data")


@pytest.mark.parametrize("name", LEARNED_AGENTS)
def test_replies_fulfil_the_contract_and_are_the_same_in_a_second_drive(tmp_path: Path, name: str) -> None:
    agent = make_agent(tmp_path, name, TinyNetwork(speed=6.0, ahead_per_grey=0.001, ahead_per_memory=0.1))
    states = [OwnState(0.1 * tick, 0.0, 0.0, 4.0 + 0.2 * tick, 0.0, 0.0, 0.0) for tick in range(12)]
    drives: list[list[str]] = []
    for _ in range(2):
        agent.start(make_briefing(EAST))
        replies = [agent.act(look(name, tick, own, grey=tick)) for tick, own in enumerate(states)]
        drives.append([repr(check_reply(reply, frozenset(CONTROLLERS))) for reply in replies])
    assert drives[0] == drives[1] and len(set(drives[0])) > 1


def test_plans_are_told_in_the_world_frame_and_follow_the_route(tmp_path: Path) -> None:
    agent = make_agent(tmp_path, "vad", briefing=make_briefing(NORTH, np.full(101, math.pi / 2)))
    reply = agent.act(look("vad", 0, OwnState(30.0, 10.0, math.pi / 2, 4.0, 0.0, 0.0, 0.0)))
    assert reply.plan is not None and (reply.plan.controller, reply.plan.interval_s) == ("b2d", PLAN_INTERVAL_S)
    assert reply.plan.points == pytest.approx(np.column_stack((np.full(6, 30.0), 10.0 + 2.0 * np.arange(1, 7))))


def test_decisions_are_made_every_fourth_tick_and_plans_move_on_in_between(tmp_path: Path) -> None:
    agent = make_agent(tmp_path, "uniad", TinyNetwork(speed=4.0, ahead_per_grey=0.01))
    greys = [100, 0, 0, 0, 200, 0]
    first = [float(get_points(agent.act(look("uniad", tick, grey=grey)))[0, 0]) for tick, grey in enumerate(greys)]
    shift, later = 0.01 * 102.5, 0.01 * 202.5  # six cameras: 100 to 105
    assert first[:4] == pytest.approx([2.0 + shift + 4.0 * DT * tick for tick in range(4)], rel=1e-5)
    assert first[4:] == pytest.approx([2.0 + later + 4.0 * DT * tick for tick in range(2)], rel=1e-5)


def test_a_missing_image_postpones_the_decision(tmp_path: Path) -> None:
    agent = make_agent(tmp_path, "lmdrive")
    blind = replace(look("lmdrive", 0), lidar={})
    assert agent.act(blind) == Reply(control=STANDSTILL)
    assert get_points(agent.act(look("lmdrive", 4)))[0].tolist() == [2.0, 0.0]
    assert get_points(agent.act(replace(look("lmdrive", 8), cameras={})))[0, 0] == pytest.approx(2.0 + 4 * 4.0 * DT)


@pytest.mark.parametrize("name", LEARNED_AGENTS)
def test_black_images_reach_the_network(tmp_path: Path, name: str) -> None:
    network = TinyNetwork(ahead_per_grey=0.01)
    seen = look(name, 0, OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    config = {"fusion": 0.0} if name == "tcp" else {}
    bright = get_points(make_agent(tmp_path, name, network, **config).act(seen))
    dark = get_points(make_agent(tmp_path, name, network, blackout=1.0, **config).act(seen))
    assert dark[:, 0] == pytest.approx(2.0 * np.arange(1, 7)) and (bright[:, 0] - dark[:, 0]).min() > 0.9


def test_memory_comes_from_the_last_decision_and_is_forgotten_at_the_start(tmp_path: Path) -> None:
    agent = make_agent(tmp_path, "vad", TinyNetwork(ahead_per_memory=0.5))
    for _ in range(2):
        agent.start(make_briefing(EAST))
        first = [float(get_points(agent.act(look("vad", tick)))[0, 0]) for tick in (0, 4, 8)]
        assert first == pytest.approx([2.0, 2.5, 3.0])


def test_a_decided_plan_goes_on_with_its_last_velocity() -> None:
    decided = DecidedPlan(0, np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 2.0))))
    assert decided.sample(0.0).tolist() == [[1.0, 0.0], [1.0, 2.0]]
    assert decided.sample(0.25) == pytest.approx(np.array(((1.0, 1.0), (1.0, 3.0))))
    assert decided.sample(5.0) == pytest.approx(np.array(((1.0, 20.0), (1.0, 22.0))))


def navigate(briefing: Briefing, x: float = 0.0) -> Navigation:
    return RouteNavigator(briefing).locate(OwnState(x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_instructions_change_with_the_situation_only_and_their_words_with_the_seed() -> None:
    follow = navigate(make_briefing(EAST))
    left = replace(follow, command=1)
    instructor = RouteInstructor(3)
    told = [instructor.instruct(place) for place in (follow, follow, left, left, follow)]
    assert told[0] == told[1] != told[2] == told[3]
    again = RouteInstructor(3)
    assert told == [again.instruct(place) for place in (follow, follow, left, left, follow)]
    assert len({RouteInstructor(seed).instruct(left) for seed in range(30)}) > 3


def drive_standing(agent: Agent, name: str, seconds: float) -> list[float]:
    """How far [m] the first point of the plan lies ahead, at every decision of a car that always stands."""
    ticks = range(0, round(seconds / DT), DECISION_TICKS)
    own = OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return [float(get_points(agent.act(look(name, tick, own)))[0, 0]) for tick in ticks]


def test_a_car_that_its_network_keeps_standing_creeps_for_a_second(tmp_path: Path) -> None:
    agent = make_agent(tmp_path, "vad", TinyNetwork(speed=0.05))
    ahead = drive_standing(agent, "vad", 14.0)
    creeps = np.flatnonzero(np.array(ahead) > 0.5)
    assert creeps.tolist() == [*range(30, 35), *range(65, 70)]
    assert ahead[30] == pytest.approx(CREEP.speed * PLAN_INTERVAL_S)


def test_without_the_rule_it_stands_and_a_network_that_wants_to_drive_is_left_alone(tmp_path: Path) -> None:
    standing = make_agent(tmp_path, "vad", TinyNetwork(speed=0.05), creep=0.0)
    assert max(drive_standing(standing, "vad", 14.0)) < 0.1
    driving = make_agent(tmp_path, "vad", TinyNetwork(speed=4.0))
    assert set(drive_standing(driving, "vad", 14.0)) == {2.0}


@pytest.mark.parametrize(("state", "light_m", "creeps"), [("r", 10.0, False), ("y", 10.0, False), ("g", 10.0, True),
                                                          ("r", 20.0, True), ("r", -1.0, True)])  # fmt: skip
def test_nothing_creeps_towards_a_closed_light(state: str, light_m: float, creeps: bool) -> None:
    briefing = replace(make_briefing(EAST), traffic_lights=(TrafficLight("light", 50.0 + light_m),))
    rule, place = CreepRule(briefing), replace(navigate(briefing), station_m=50.0)
    found = [
        rule.find_creep_plan(np.zeros((6, 2)), replace(look("vad", tick, OwnState(0, 0, 0, 0, 0, 0, 0)),
                                                       signals={"light": state}), place)
        for tick in range(0, 140, 4)
    ]  # fmt: skip
    assert any(plan is not None for plan in found) == creeps


def straight_points(speed: float) -> np.ndarray:
    return np.column_stack((speed * PLAN_INTERVAL_S * np.arange(1, 7), np.zeros(6)))


def test_the_plan_leads_on_straights_and_the_control_branch_in_turns() -> None:
    fusion, branch = ControlFusion(), np.array((0.5, 0.0, 0.2))
    first = fusion.blend(straight_points(4.0), branch, 5.0)  # too fast: the PID brakes
    assert (first.throttle, first.brake, first.steer) == pytest.approx((0.0, 0.7, 0.06))
    fusion = ControlFusion()
    turning = np.array((0.5, 0.0, 0.5))
    steers = [fusion.blend(straight_points(4.0), turning, 4.0).steer for _ in range(30)]
    assert steers[:11] == pytest.approx([0.15] * 11) and steers[11:] == pytest.approx([0.35] * 19)


def test_without_a_control_branch_the_plan_is_followed() -> None:
    fusion = ControlFusion()
    slow = fusion.blend(straight_points(4.0), None, 3.0)
    assert (slow.throttle, slow.brake, slow.steer) == (0.75, 0.0, 0.0)
    assert fusion.blend(straight_points(0.1), None, 3.0).brake == 1.0
    left = np.column_stack((straight_points(4.0)[:, 0], 1.0 + np.arange(6)))
    assert ControlFusion().blend(left, None, 4.0).steer > 0.1


def test_tcp_blends_both_branches_and_can_leave_the_blend_out(tmp_path: Path) -> None:
    seen = look("tcp", 0, OwnState(0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0))
    network = TinyNetwork(speed=4.0, control=(0.25, 0.0, 0.5))
    blended = make_agent(tmp_path, "tcp", network).act(seen).control
    assert blended is not None
    assert (blended.throttle, blended.steer) == pytest.approx((0.7 * 0.75 + 0.3 * 0.25, 0.15))
    plan = make_agent(tmp_path, "tcp", network, fusion=0.0).act(seen).plan
    assert plan is not None and plan.controller == "tracker"
