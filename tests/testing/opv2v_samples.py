"""Small logs in the layout of OPV2V for tests."""

from pathlib import Path
from typing import Any

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
