"""Plan anchors: a vocabulary near every trajectory that a car can drive, and what scores of it decide."""

import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.learned_samples import make_briefing, make_observation
from testing.onnx_writer import Array, Node, write_model

from mdrive_sumo.agents.learned.model_weights import load_network
from mdrive_sumo.agents.learned.network_inputs import describe_inputs, describe_outputs
from mdrive_sumo.agents.learned.plan_anchors import ANCHORS, SCORES, build_anchors, decode_plans
from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS, SYSTEMS
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.agents.registry import LEARNED_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_manifest import write_manifest

VOCABULARY_DIGEST = "b6fc4cb6821a398e"
"""Of the anchors that weights are trained with; another vocabulary makes them useless."""
UNIAD = SYSTEMS["uniad"]
EAST = np.column_stack((np.arange(101.0), np.zeros(101)))
TIMES_S = PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1)


def test_the_vocabulary_is_the_same_everywhere() -> None:
    anchors = build_anchors()
    assert anchors.digest == VOCABULARY_DIGEST and anchors.points.shape == (ANCHORS, PLAN_POINTS, 2)
    assert not anchors.points[0].any()  # standing
    assert len({each.tobytes() for each in anchors.points}) == ANCHORS
    assert 99.0 < anchors.points[:, -1, 0].max() < 101.0  # 120 km/h


@given(st.floats(0, 33), st.floats(-6, 2.5), st.floats(-0.1, 0.1))
def test_an_anchor_lies_near_whatever_a_car_can_drive(speed: float, acceleration: float, curvature: float) -> None:
    """Mean distance within a metre for the first 10 m of way, and a twentieth more for every metre beyond."""
    steps = np.arange(0.025, 3.0, 0.05)
    speeds = np.clip(speed + acceleration * steps, 0.0, 33.0)
    curvature = math.copysign(min(abs(curvature), 4.0 / max(speeds.max(), 1.0) ** 2), curvature)
    yaw = np.cumsum(speeds) * 0.05 * curvature
    way = np.cumsum(0.05 * speeds[:, None] * np.column_stack((np.cos(yaw), np.sin(yaw))), axis=0)[9::10]
    gap = np.hypot(*np.moveaxis(build_anchors().points - way, -1, 0)).mean(axis=-1).min()
    assert gap <= 1.0 + 0.05 * max(np.hypot(*way[-1]) - 10.0, 0.0)


def score(**by_row: float) -> np.ndarray:
    """Scores in which all anchors are equally bad but some."""
    scores = np.full((ANCHORS, len(SCORES)), -20.0, np.float32)
    for row, value in by_row.items():
        scores[int(row[1:])] = value
    return scores


def test_the_best_anchor_and_its_offset_decide() -> None:
    offsets = np.zeros((ANCHORS, PLAN_POINTS, 2), np.float32)
    offsets[7] = (0.5, -0.25)
    plan = decode_plans(score(_7=-1.0, _9=-4.0), offsets)
    assert np.allclose(plan, build_anchors().points[7] + (0.5, -0.25))


def test_plans_of_one_kind_are_averaged_and_others_are_not() -> None:
    points = build_anchors().points
    offsets = np.zeros((ANCHORS, PLAN_POINTS, 2), np.float32)
    far = int(np.argmax(points[:, -1, 0]))
    offsets[8] = points[7] + (0.0, 0.8) - points[8]
    scores = score(_7=0.0, _8=0.0)
    scores[far] = -0.01  # nearly as good, and another decision
    assert np.allclose(decode_plans(scores, offsets), points[7] + (0.0, 0.4), atol=1e-6)
    both = decode_plans(np.stack((scores, score(_9=0.0))), np.stack((offsets, offsets)))  # a batch
    assert np.allclose(both[0], points[7] + (0.0, 0.4), atol=1e-6) and np.allclose(both[1], points[9])


def save_anchor_weights(folder: Path, **manifest: Any) -> Path:
    """Weights of `uniad` that drive straight on, at the allowed speed on the mean of 3 s."""
    points, memory = build_anchors().points, (1,)
    speeds = np.where(np.abs(points[:, -1, 1]) < 0.01, points[:, -1, 0] / TIMES_S[-1], 1e3)
    constants = {
        "speeds": speeds[None].astype(np.float32),
        "here": np.repeat(np.float32([[1.0], [0.0], [0.0]]), ANCHORS, axis=1),
        "shape": np.array((1, ANCHORS, 1), np.int64),
        "columns": np.float32([[[-1.0, 0.0, 0.0, 0.0, 0.0]]]),
        "none": np.zeros((1, ANCHORS, PLAN_POINTS, 2), np.float32),
    }
    nodes = [
        Node("MatMul", ("limits", "here"), "limit"),
        Node("Sub", ("speeds", "limit"), "gap"),
        Node("Mul", ("gap", "gap"), "cost"),
        Node("Reshape", ("cost", "shape"), "column"),
        Node("Mul", ("column", "columns"), "anchor_scores"),
        Node("Identity", ("none",), "anchor_offsets"),
        Node("Identity", ("memory",), "bev"),
    ]
    described = describe_inputs(UNIAD, memory, has_limits=True)
    inputs = [Array(name, (1, *shape), kind) for name, (shape, kind) in described.items()]
    outputs = [Array(name, (1, *shape)) for name, shape in describe_outputs(UNIAD, memory, "anchors").items()]
    path, content = folder / "uniad.onnx", write_model(nodes, constants, inputs, outputs)
    path.write_bytes(content)
    facts = {"plan_head": "anchors", "anchors": build_anchors().digest, "has_limits": True} | manifest
    checksum = hashlib.sha256(content).hexdigest()
    written = WeightsManifest(
        system="uniad", sha256=checksum, bytes=len(content), parameters=0, memory_shape=memory, **facts
    )
    write_manifest(written, path.with_suffix(".json"))
    return path


@pytest.mark.parametrize(("desired", "speed"), [(8.0, 8.0), (None, 13.9)])
def test_a_car_follows_the_anchor_that_its_network_likes_best(
    tmp_path: Path, desired: float | None, speed: float
) -> None:
    agent = LEARNED_AGENTS["uniad"]({"weights": str(save_anchor_weights(tmp_path))})
    agent.start(make_briefing(EAST, desired_speed=desired))
    plan = agent.act(make_observation(UNIAD)).plan
    assert plan is not None
    assert abs(plan.points[-1, 0] - 3.0 * speed) < 4.0  # the nearest one that is straight
    assert np.abs(plan.points[:, 1]).max() < 0.1


@pytest.mark.parametrize(
    ("manifest", "message"),
    [
        ({"anchors": "0123"}, f"expected scores of the plan anchors {VOCABULARY_DIGEST}, found those of '0123'; train"),
        ({"plan_head": "waypoints"}, r"output 'anchor_offsets': expected none of the system uniad, found float32 \[1"),
        ({"has_limits": False}, r"input 'limits': expected none of the system uniad, found float32 \[1, 3\]; export"),
    ],
)
def test_weights_that_are_not_what_their_manifest_says_are_refused(
    tmp_path: Path, manifest: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load_network(UNIAD, save_anchor_weights(tmp_path, **manifest))
