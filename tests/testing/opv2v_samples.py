"""Small logs in the layouts of OPV2V and V2V4Real for tests."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

CAVS = ("641", "650")
"""Folders of agents; OPV2V names them by CARLA's ids, which their vehicles have in the lists of the others."""
Y = {"641": 1.75, "650": 1.75, "700": -1.75, "-1": 6.0}
"""[m] to the right, as in CARLA: the CAVs drive along x on the right, 700 comes towards them."""


def locate(id_: str, frame: int) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [degrees] in CARLA's frame, 8 m/s."""
    start = {"641": 10.0, "650": 30.0, "700": 90.0, "-1": 50.0}[id_]
    speed = {"700": -0.8, "-1": 0.0}.get(id_, 0.8)
    return start + speed * frame, Y[id_], 180.0 if id_ == "700" else 0.0


def format_frame(frame: int, agent: str = "641") -> str:
    """Format a file: no types, attributes or kind of the agent; fields of the simulation besides."""
    x, y, yaw = locate(agent, frame)
    pose = [x, y, 1.9, 0.0, yaw, 0.0]
    content: dict[str, Any] = {
        "camera0": {"cords": pose, "intrinsic": [[1.0, 0.0], [0.0, 1.0]]},
        "ego_speed": 28.8,
        "lidar_pose": pose,
        "plan_trajectory": [[x + 1, y, 28.8]],
        "predicted_ego_pos": pose,
        "true_ego_pos": pose,
        "vehicles": {
            int(id_): {
                "angle": [0.0, locate(id_, frame)[2], 0.0],
                "center": [0.0, 0.0, 0.7],
                "extent": [2.4, 1.0, 0.75],
                "location": [*locate(id_, frame)[:2], 0.03],
                "speed": 28.8,
            }
            for id_ in ("641", "650", "700")
            if id_ != agent
        },
    }
    return yaml.dump(content).replace("0.03", "3e-02")  # as numpy's floats come out: text by YAML's rules


def write_log(folder: Path, frames: int = 31, agents: tuple[str, ...] = (*CAVS, "-1"), first: int = 68) -> Path:
    """Write a scenario whose frames are numbered in steps of 2."""
    for agent in agents:
        (folder / agent).mkdir(parents=True)
        for frame in range(frames):
            (folder / agent / f"{first + 2 * frame:06d}.yaml").write_text(format_frame(frame, agent))
    (folder / "data_protocol.yaml").write_text("world: {}\n")
    return folder


REAL_IDS = {"0": {"641": (7, -1), "650": (2, 3), "700": (3, 4)}, "1": {"641": (1, 5), "650": (9, -1), "700": (5, 4)}}
"""V2V4Real: id of an object for an agent, and its common id or -1. Agent 0 is car 641, agent 1 car 650."""


def find_real_pose(agent: str, frame: int) -> np.ndarray:
    """Return the transform from the LiDAR of a car to the world: y to the left, turned against the car, tilted."""
    x, y, yaw = locate({"0": "641", "1": "650"}[agent], frame)
    turn, tilt = math.radians(-yaw + (90.0 if agent == "0" else -30.0)), math.radians(2.0)
    about_z = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    about_y = np.array([[math.cos(tilt), 0, math.sin(tilt)], [0, 1, 0], [-math.sin(tilt), 0, math.cos(tilt)]])
    pose = np.eye(4)
    pose[:3, :3] = about_z @ about_y
    pose[:3, 3] = x, -y, 1.9
    return pose


def format_real_frame(frame: int, agent: str = "0", module: str = "numpy.core") -> str:
    """Format a file of V2V4Real: NumPy's arrays as PyYAML dumps them, boxes in the frame of the agent's LiDAR."""
    pose = find_real_pose(agent, frame)
    vehicles = {}
    for car, (id_, common) in REAL_IDS[agent].items():
        if car == {"0": "641", "1": "650"}[agent]:
            continue
        x, y, yaw = locate(car, frame)
        location = np.linalg.inv(pose) @ [x, -y, 0.8, 1.0]
        ahead, left, up = pose[:3, :3].T @ [math.cos(math.radians(-yaw)), math.sin(math.radians(-yaw)), 0.0]
        vehicles[id_] = {
            "angle": [0.0, math.degrees(math.atan2(left, ahead)), math.degrees(math.asin(up))],
            "ass_id": common if frame else -1,
            "center": [0.0, 0.0, 0.0],
            "extent": [2.4, 1.0, 0.75],
            "location": location[:3].tolist(),
            "obj_type": "Truck" if car == "700" else "Car",
        }
    gps = list(np.array([34.0, -118.0, 80.0, 0.0, 0.0, 0.0]))
    content = {"ego_speed": 0, "gps": gps, "lidar_pose": pose, "true_ego_pos": pose, "vehicles": vehicles}
    return yaml.dump(content).replace("numpy._core", module)


def write_real_log(folder: Path, frames: int = 5, module: str = "numpy.core") -> Path:
    """Write a scenario of V2V4Real, whose frames are numbered one by one from 0."""
    for agent in REAL_IDS:
        (folder / agent).mkdir(parents=True)
        for frame in range(frames):
            (folder / agent / f"{frame:06d}.yaml").write_text(format_real_frame(frame, agent, module))
    return folder
