"""The inputs of a learned system's network, built from an observation: training and driving use the same function."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.instructions import encode_instruction
from mdrive_sumo.agents.learned.navigation import Navigation, take_limits
from mdrive_sumo.agents.learned.plan_anchors import ANCHORS, SCORES
from mdrive_sumo.agents.learned.system_spec import (
    INSTRUCTION_WORDS,
    LIDAR_BEHIND_M,
    LIDAR_CELL_M,
    LIDAR_CELLS,
    LIDAR_LAYERS,
    LIMIT_ROWS,
    NAVIGATION_SIZE,
    PLAN_HEADS,
    PLAN_POINTS,
    ROUTE_POINTS,
    SystemSpec,
)
from mdrive_sumo.contract import Observation, PointCloud
from mdrive_sumo.core.geometry import Float, wrap_angle

Inputs = dict[str, npt.NDArray[Any]]
LIDAR_ID = "top"
"""Id of the LiDAR in `SystemSpec.build_sensors`."""


def build_inputs(
    spec: SystemSpec, seen: Observation, navigation: Navigation, instruction: str = "", *, has_limits: bool = False
) -> Inputs:
    """Return the inputs by name, without a batch dimension and without memory (`memory`, `motion`).

    has_limits: whether the network gets `limits`. seen: an observation with all images, and the scan if used
    (`has_sensor_data`). Shapes: `describe_inputs`.
    """
    assert seen.speedometer is not None, "the speedometer is declared"
    inputs: Inputs = {
        image.name: np.stack([seen.cameras[camera].pixels for camera in image.cameras]) for image in spec.images
    }
    inputs["navigation"] = navigation.build_vector(seen.speedometer)
    if has_limits:
        inputs["limits"] = take_limits(navigation.route)
    if spec.uses_route:
        inputs["route"] = navigation.route
    if spec.uses_lidar:
        inputs["lidar"] = build_lidar_histogram(seen.lidar[LIDAR_ID])
    if spec.uses_instruction:
        inputs["instruction"] = encode_instruction(instruction)
    return inputs


def has_sensor_data(spec: SystemSpec, seen: Observation) -> bool:
    """Return whether the observation has every image, and the scan, that the system needs for a decision."""
    has_images = all(camera in seen.cameras for image in spec.images for camera in image.cameras)
    return has_images and (not spec.uses_lidar or LIDAR_ID in seen.lidar)


def black_out_images(spec: SystemSpec, inputs: Inputs) -> Inputs:
    """Return the inputs with black images, for ablations."""
    return inputs | {image.name: np.zeros_like(inputs[image.name]) for image in spec.images}


def compute_motion(before: Float, pose: Float) -> npt.NDArray[np.float32]:
    """Return the input `motion` (3,) between two poses (3,): dx, dy [m] in the earlier ego frame, turn [rad]."""
    return np.array((*convert_to_frame(pose[:2], before), wrap_angle(float(pose[2] - before[2]))), dtype=np.float32)


def describe_inputs(
    spec: SystemSpec, memory_shape: tuple[int, ...] = (), *, has_limits: bool = False
) -> Mapping[str, tuple[tuple[int, ...], str]]:
    """Return shape without the batch dimension and dtype of every input by name, in the order of the network.

    has_limits: true for all that is trained now; older weights know 8 m/s only.
    """
    described: dict[str, tuple[tuple[int, ...], str]] = {
        image.name: ((len(image.cameras), image.height, image.width, 3), "uint8") for image in spec.images
    }
    described["navigation"] = ((NAVIGATION_SIZE,), "float32")
    if has_limits:
        described["limits"] = ((len(LIMIT_ROWS),), "float32")
    if spec.uses_route:
        described["route"] = ((ROUTE_POINTS, 4), "float32")
    if spec.uses_lidar:
        described["lidar"] = ((LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS), "uint8")
    if spec.uses_instruction:
        described["instruction"] = ((INSTRUCTION_WORDS,), "int64")
    if spec.uses_memory:
        described["memory"] = (memory_shape, "float32")
        described["motion"] = ((3,), "float32")
    return described


def describe_outputs(
    spec: SystemSpec, memory_shape: tuple[int, ...] = (), plan_head: str = PLAN_HEADS[0]
) -> Mapping[str, tuple[int, ...]]:
    """Return the shape without the batch dimension of every output by name; all are float32."""
    described: dict[str, tuple[int, ...]] = {"plan": (PLAN_POINTS, 2)}
    if plan_head == "anchors":
        described = {"anchor_scores": (ANCHORS, len(SCORES)), "anchor_offsets": (ANCHORS, PLAN_POINTS, 2)}
    if spec.answers_control:
        described["control"] = (3,)
    if spec.uses_memory:
        described["bev"] = memory_shape
    return described


LIDAR_HEIGHT_M = 2.5
"""Height of the LiDAR above the ground: the default pose of the sensor on a car (docs/range-sensors.md)."""
GROUND_M = 0.4
"""Points lower than that above the ground go to layer 0, higher ones to layer 1."""
MOST = 255
"""Points counted in a cell: the range of a byte."""


def build_lidar_histogram(cloud: PointCloud) -> npt.NDArray[np.uint8]:
    """Return the numbers of points (LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS) by cell, at most 255 each.

    Row 0 is ahead, column 0 is left; the car looks up and stands `LIDAR_BEHIND_M` above the lower edge. The sensor is
    level and lies above the box centre, `LIDAR_HEIGHT_M` above the ground.
    """
    points, side_m = cloud.points, LIDAR_CELLS * LIDAR_CELL_M
    row = np.floor((side_m - LIDAR_BEHIND_M - points[:, 0]) / LIDAR_CELL_M)
    column = np.floor((side_m / 2 - points[:, 1]) / LIDAR_CELL_M)
    inside = (row >= 0) & (row < LIDAR_CELLS) & (column >= 0) & (column < LIDAR_CELLS)
    layer = points[inside, 2] + LIDAR_HEIGHT_M >= GROUND_M
    cell = (layer * LIDAR_CELLS + row[inside].astype(np.int64)) * LIDAR_CELLS + column[inside].astype(np.int64)
    counts = np.bincount(cell, minlength=LIDAR_LAYERS * LIDAR_CELLS * LIDAR_CELLS)
    return np.minimum(counts, MOST).astype(np.uint8).reshape(LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS)
