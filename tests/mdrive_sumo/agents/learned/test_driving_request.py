"""Requests: what a car cannot see, what matters on its way, and what a sender makes of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.agents.learned.driving_request import (
    REQUEST_CELLS,
    REQUEST_GRID,
    VISIBLE_SHARE,
    build_demand,
    encode_request,
    find_demand,
    find_hidden,
)
from mdrive_sumo.agents.learned.feature_inbox import FeatureInbox, ReceivedMap
from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CELLS
from mdrive_sumo.agents.learned.network_inputs import LIDAR_HEIGHT_M
from mdrive_sumo.agents.learned.point_grid import Cells, build_point_cells
from mdrive_sumo.contract import OwnState
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.perception.late_fusion import OPV2V_LIMITS
from mdrive_sumo.v2x.messages import Feature, ReferencePose, decode

ALL_SEEN: Bool = np.zeros((REQUEST_CELLS, REQUEST_CELLS), np.bool_)
STRAIGHT: Float = np.column_stack((np.arange(0.0, 21.0, 2.0), np.zeros(11)))


def scan_wall(height: float) -> Cells:
    """Points up to a height on a wall 10 m ahead, from 5 m left to 5 m right."""
    y, z = np.meshgrid(np.arange(-5.0, 5.01, 0.2), np.arange(0.1, height, 0.2))
    points = np.column_stack((np.full(y.size, 10.0), y.ravel(), z.ravel() - LIDAR_HEIGHT_M, np.ones(y.size)))
    return build_point_cells(points.astype(np.float32))


def find_cell(x: float, y: float) -> tuple[int, int]:
    return int((51.2 - x) / 6.4), int((51.2 - y) / 6.4)


def test_what_lies_behind_a_wall_is_hidden_and_a_kerb_hides_nothing() -> None:
    hidden = find_hidden(scan_wall(2.0))
    assert hidden[find_cell(40, 3)] and hidden[find_cell(40, -3)] and hidden[find_cell(22, 3)]
    assert not hidden[find_cell(3, 3)] and not hidden[find_cell(-40, 3)] and not hidden[find_cell(16, 40)]
    assert not find_hidden(scan_wall(0.6)).any() and not find_hidden(np.zeros(0, np.uint32)).any()


def test_demand_falls_with_the_distance_from_the_way_and_for_what_is_seen() -> None:
    nothing_seen = build_demand(STRAIGHT, ~ALL_SEEN)
    levels = [nothing_seen[find_cell(*place)] for place in ((10, 3), (10, -16), (-30, 3), (-48, 48))]
    assert levels == pytest.approx([1.0, 2 / 3, 1 / 3, 0.0])
    assert build_demand(STRAIGHT, ALL_SEEN) == pytest.approx(nothing_seen * VISIBLE_SHARE)


def receive(demand: Float, sender: ReferencePose, own: OwnState) -> list[ReceivedMap]:
    inbox = FeatureInbox(REQUEST_GRID, OPV2V_LIMITS)
    messages = [replace(message, sender="b") for message in encode_request(demand, sender)]
    assert inbox.receive(messages) == ()
    return inbox.collect(sender.tick, own)


def test_a_sender_finds_the_asked_places_in_its_own_map() -> None:
    """The asking car stands 20 m ahead and looks to the left: what lies 30 m ahead of it lies 30 m to the left."""
    demand = np.zeros((REQUEST_CELLS, REQUEST_CELLS))
    demand[find_cell(30, 1)] = 1.0  # 25.6 to 32 m ahead of it, 0 to 6.4 m left
    received = receive(demand, ReferencePose(20.0, 0.0, math.pi / 2, 4), OwnState(0.0, 0.0, 0.0, 0, 0, 0, 0))
    wanted = find_demand(received)
    x, y = (51.2 - (np.argwhere(wanted > 0) + 0.5) * 1.6).T
    assert set(wanted.ravel().tolist()) == {0.0, 1.0} and (wanted > 0).sum() == 16
    assert 20 - 6.4 < x.min() < x.max() < 20.0 and 25.6 < y.min() < y.max() < 32.0
    assert find_demand([]).shape == (FEATURE_CELLS, FEATURE_CELLS) and not find_demand([]).any()


@given(st.integers(0, 2**32 - 1), st.floats(-40, 40), st.floats(-math.pi, math.pi))
def test_a_request_is_one_small_message_and_its_demand_stays_within_bounds(seed: int, x: float, yaw: float) -> None:
    demand = np.random.default_rng(seed).integers(0, 4, (REQUEST_CELLS, REQUEST_CELLS)) / 3
    pose = ReferencePose(x, 0.0, yaw, 0)
    (message,) = encode_request(demand, pose)
    assert len(message.payload) < 200
    content = decode(message)
    assert isinstance(content, Feature) and content.grid == REQUEST_GRID
    wanted = find_demand(receive(demand, pose, OwnState(0.0, 0.0, 0.0, 0, 0, 0, 0)))
    assert wanted.min() >= 0.0 and wanted.max() <= 1.0
    levels = np.unique(demand)
    assert np.abs(wanted[..., None] - np.append(levels, 0.0)).min(axis=-1).max() < 1e-3


def test_a_car_that_needs_nothing_asks_nothing() -> None:
    assert encode_request(np.zeros((REQUEST_CELLS, REQUEST_CELLS)), ReferencePose(0.0, 0.0, 0.0, 0)) == ()
