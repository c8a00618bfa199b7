"""build_synthetic_arrays: a made-up data set with the keys and shapes of a real one, for smoke tests."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.navigation import take_limits
from mdrive_sumo.agents.learned.system_spec import (
    COMMANDS,
    INSTRUCTION_WORDS,
    LIDAR_CELLS,
    LIDAR_LAYERS,
    NAVIGATION_SIZE,
    PLAN_INTERVAL_S,
    PLAN_POINTS,
    ROUTE_POINTS,
    ROUTE_STEP_M,
    SystemSpec,
)
from mdrive_sumo.learning.sample_format import BOX_COLUMNS, LANE_POINTS, MAX_BOXES, MAX_LANES

Arrays = dict[str, npt.NDArray[np.generic]]
EPISODE_SAMPLES = 10
"""Consecutive samples of one car."""


def build_synthetic_arrays(spec: SystemSpec, samples: int, seed: int) -> Arrays:
    """Return arrays as `load_arrays` does: cars drive straight, their images are the brighter the faster they are."""
    random = np.random.default_rng(seed)
    speed = random.uniform(0.0, 12.0, samples).astype(np.float32)
    times = PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1, dtype=np.float32)
    plan = np.zeros((samples, PLAN_POINTS, 2), np.float32)
    plan[..., 0] = speed[:, None] * times
    rows = np.arange(samples)
    own = np.zeros((samples, 6), np.float32)
    own[:, 0], own[:, 3] = 2.0 * (rows % EPISODE_SAMPLES), speed
    arrays: Arrays = {
        "own": own,
        "expert_plan": plan,
        "expert_control": np.stack((speed / 20.0, 0.5 - speed / 24.0, 0.0 * speed), axis=-1),
        "perturbed": np.zeros(samples, np.uint8),
        "scenario": (rows // EPISODE_SAMPLES).astype(np.int32),
        "episode": (rows // EPISODE_SAMPLES).astype(np.int32),
        "previous": np.where(rows % EPISODE_SAMPLES < 2, -1, rows - 2).astype(np.int32),
    }
    return arrays | _build_inputs(spec, speed, random) | _build_scene(samples, times, random)


def _build_inputs(spec: SystemSpec, speed: npt.NDArray[np.float32], random: np.random.Generator) -> Arrays:
    samples = len(speed)
    arrays: Arrays = {}
    for image in spec.images:
        shape = samples, len(image.cameras), image.height, image.width, 3
        bright = 10.0 * speed[:, None, None, None, None]
        arrays[image.name] = (bright + random.integers(0, 120, shape, np.uint8)).astype(np.uint8)
    navigation = random.uniform(-1.0, 1.0, (samples, NAVIGATION_SIZE)).astype(np.float32)
    navigation[:, 0] = speed / 10.0
    navigation[:, 1 : 1 + len(COMMANDS)] = np.eye(len(COMMANDS), dtype=np.float32)[0]
    route = np.zeros((samples, ROUTE_POINTS, 4), np.float32)
    route[..., 0] = ROUTE_STEP_M * np.arange(ROUTE_POINTS)
    route[..., 2:] = 1.75, 8.33
    arrays |= {"navigation": navigation, "route": route, "limits": take_limits(route)}
    if spec.uses_lidar:
        arrays["lidar"] = random.integers(0, 9, (samples, LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS), np.uint8)
    if spec.uses_instruction:
        arrays["instruction"] = random.integers(0, 50, (samples, INSTRUCTION_WORDS))
    return arrays


def _build_scene(samples: int, times: npt.NDArray[np.float32], random: np.random.Generator) -> Arrays:
    """Return road users that drive straight, where they are, and lanes; all at random places."""
    boxes = np.full((samples, MAX_BOXES, len(BOX_COLUMNS)), np.nan, np.float32)
    futures = np.full((samples, MAX_BOXES, PLAN_POINTS, 3), np.nan, np.float32)
    there = random.integers(3, 8)
    boxes[:, :there, :2] = random.uniform(-20.0, 30.0, (samples, there, 2))
    boxes[:, :there, 2:] = 0.0, 4.5, 1.9, 5.0, 0.0, 1.0, 0.0
    futures[:, :there] = boxes[:, :there, None, :3]
    futures[:, :there, :, 0] += 5.0 * times
    occupied = random.random((samples, 1 + PLAN_POINTS, LIDAR_CELLS, LIDAR_CELLS)) < 0.02
    lanes = np.full((samples, MAX_LANES, LANE_POINTS, 2), np.nan, np.float32)
    lanes[:, :2] = np.stack((np.linspace(-10, 30, LANE_POINTS), np.zeros(LANE_POINTS)), axis=-1)
    lanes[:, 1, :, 1] = 3.5
    packed = np.packbits(occupied.reshape(samples, -1), axis=1)
    return {"boxes": boxes, "futures": futures, "occupancy": packed, "lane_graph": lanes}
