"""Small V2XPnP logs for tests."""

from pathlib import Path
from typing import Any

import yaml

from testing.shared_material import SHARED_DATA

EXCERPT = SHARED_DATA / "v2xpnp_excerpt" / "2023-03-17-16-12-12_3_0"


POSE = [10.0, 20.0, 1.0, -4.0, 90.0, 2.0]


def thing(x: float = 0.0, y: float = 0.0, **more: Any) -> dict[str, Any]:
    return {
        "angle": [1.0, 30.0, 2.0],
        "attribute": "",
        "center": [0, 0, 0],
        "extent": [2.25, 0.95, 0.75],
        "location": [x, y, -2.0],
        "obj_type": "Car",
        **more,
    }


def frame(vehicles: dict[int, dict[str, Any]] | None = None, pose: list[float] = POSE, **more: Any) -> str:
    default = {7: thing(1.0, 2.0)}
    return yaml.dump(
        {
            "ego_speed": 0,
            "infra": False,
            "lidar_pose": list(pose),
            "true_ego_pose": list(pose),
            "vehicles": default if vehicles is None else vehicles,
            **more,
        }
    )


def log(folder: Path, agents: dict[str, list[str]]) -> Path:
    for agent, texts in agents.items():
        (folder / agent).mkdir(parents=True)
        for t, text in enumerate(texts):
            (folder / agent / f"{t:06d}.yaml").write_text(text)
    return folder


def cut(text: str) -> str:
    return text[: len(text) // 2]
