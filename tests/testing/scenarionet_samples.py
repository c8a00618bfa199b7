"""Small ScenarioNet descriptions for tests."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from real2sim.readers.scenarionet import read_scenarionet
from real2sim.recording import Recording

FRAMES = 5


Description = dict[str, Any]


# --- small descriptions ---
def state(x: float = 0.0, length: float = 4.5, frames: int = FRAMES) -> dict[str, Any]:
    steps = np.arange(frames, dtype=np.float64)
    return {
        "position": np.column_stack((x + steps, np.zeros(frames), np.zeros(frames))),
        "heading": np.zeros(frames),
        "velocity": np.tile((10.0, 0.0), (frames, 1)),
        "valid": np.ones(frames),
        "length": np.full((frames, 1), length),
        "width": np.full(frames, 2.0),
    }


def describe_track(type_: str, finer: str = "", **changes: Any) -> dict[str, Any]:
    return {"type": type_, "state": state() | changes, "metadata": {"type": finer}}


def straight(y: float = 0.0, start: float = 0.0, end: float = 40.0, **more: Any) -> dict[str, Any]:
    xy = np.array([(x, y, 0.0) for x in np.linspace(start, end, 5)])
    return {"type": "LANE_SURFACE_STREET", "polyline": xy, **more}


def description(dataset: str = "waymo", **changes: Any) -> Description:
    return {
        "id": "s1",
        "length": FRAMES,
        "metadata": {"dataset": dataset, "sdc_id": "1", "ts": np.arange(FRAMES) * 0.1},
        "tracks": {"1": describe_track("VEHICLE")},
        "map_features": {"7": straight()},
        "dynamic_map_states": {},
    } | changes


def read(folder: Path, what: Any, protocol: int | None = None) -> Recording:
    path = folder / "scenario.pkl"
    path.write_bytes(pickle.dumps(what, protocol))
    return read_scenarionet(path)
