"""Compiled functions of the negotiation against their Python text, on random inputs."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import REFUSALS, compare_twins

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.announcement import Announcement
from mdrive_sumo.negotiation.conflict_graph import CONFLICT, MAX_STEP_M
from mdrive_sumo.negotiation.intention import POINTS
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.rule_negotiator import LEADER
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose

SEEDS = st.integers(0, 2**32 - 1)


def random_points(rng: np.random.Generator, most: int = 25) -> Float:
    """Points of a trajectory; in some the car stands for a while, or turns."""
    steps = rng.choice((0.0, 0.2, rng.uniform(0.0, 3.0)), int(rng.integers(0, most)))
    yaw = np.cumsum(rng.choice((0.0, rng.uniform(-0.3, 0.3)), len(steps)))
    return np.cumsum(np.column_stack((steps * np.cos(yaw), steps * np.sin(yaw))), axis=0) + rng.uniform(-9.0, 9.0, 2)


@given(seed=SEEDS)
def test_lines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.concatenate((rng.uniform(-9.0, 9.0, (1, 2)), random_points(rng)))
    line = compare_twins("negotiation_intention_measure_line", points)
    some = np.concatenate((line.s, rng.uniform(-2.0, 40.0, 6), (float("nan"), float("inf"))))
    compare_twins("negotiation_intention_sample_line", line, rng.permutation(some)[: int(rng.integers(0, 12))])
    compare_twins("negotiation_intention_classify_direction", points)
    compare_twins("negotiation_intention_classify_direction", random_points(rng, 130))


@given(seed=SEEDS)
def test_announcements(seed: int) -> None:
    rng = np.random.default_rng(seed)
    name, here = "negotiation_announcement_{}".format, (float(rng.uniform(-9.0, 9.0)), 0.5)
    interval_s, age_s = float(rng.choice((0.1, 0.2, 0.5))), float(rng.choice((0.0, 0.05, 0.4, 1.0, 30.0)))
    planned, desired = (compare_twins(name("measure_trajectory"), here, random_points(rng), interval_s) for _ in "pd")
    pose = ReferencePose(*here, float(rng.uniform(-3.0, 3.0)), 7)
    mcm = Mcm(pose, float(rng.choice((0.0, 6.0))), Intention.KEEP, Direction.LEFT, interval_s, np.zeros((0, 2)))
    compare_twins(name("predict_member"), "a", Announcement(mcm, planned, desired), age_s)
    poses = compare_twins(name("predict_poses"), planned, age_s, pose.yaw)
    compare_twins(name("predict_braking"), poses, mcm.speed)


@given(seed=SEEDS)
def test_leaders(seed: int) -> None:
    rng, members = np.random.default_rng(seed), list[NegotiationMember]()
    for i in range(int(rng.integers(0, 6))):
        x, y, yaw = (
            float(rng.uniform(-20.0, 20.0)),
            float(rng.choice((0.0, 1.0, 9.0))),
            float(rng.choice((0.0, 0.4, 3.0))),
        )
        ahead = np.cumsum(rng.choice((0.0, 1.0, 7.0), int(rng.integers(0, 20))))
        desired = np.column_stack((x + ahead, np.full(len(ahead), y)))
        members.append(NegotiationMember(f"{i}", x, y, yaw, 5.0, Intention.KEEP, Direction.FOLLOW, 0.2, desired))
    compare_twins("negotiation_rule_negotiator_list_leader_pairs", members, LEADER, MAX_STEP_M)
    if members and len(members[0].desired):
        members[0] = replace(members[0], x=float("nan"))
        assert compare_twins("negotiation_rule_negotiator_list_leader_pairs", members, LEADER, MAX_STEP_M) == REFUSALS


@given(seed=SEEDS)
def test_pairs_of_trajectories(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1.0, 1.0, (int(rng.integers(0, 6)), POINTS, 2)) * rng.choice((0.0, 1.0, 9.0))
    points = np.cumsum(steps, axis=1) + rng.uniform(-9.0, 9.0, (len(steps), 1, 2))
    if len(points) > 1 and rng.random() < 0.3:
        points[1] = points[0]
    arguments = CONFLICT.min_distance_m, MAX_STEP_M, CONFLICT.free_distance_m
    compare_twins("negotiation_conflict_graph_compare_trajectories", points, *arguments)
