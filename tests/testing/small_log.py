"""A small V2XPnP log for tests of conversion: 4 s on a straight road, two CAVs, a station, one of everything."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.v2xpnp import write_v2xpnp
from real2sim.writers.v2xpnp_map import write_vector_map

FRAMES, DT_S = 41, 0.1
TIME = np.arange(FRAMES) * DT_S
STATION = (60.0, 12.0)


def road(y: float = 0.0, length: float = 200.0) -> HdMap:
    """Two lanes eastwards, side by side, at y and y + 3.5."""
    x = np.linspace(0.0, length, 41)
    lanes = {
        f"1_{k}": MapLane(f"1_{k}", LaneKind.DRIVING, np.column_stack((x, np.full(41, y + 3.5 * k)))) for k in range(2)
    }
    lanes["1_0"] = replace(lanes["1_0"], left_neighbour="1_1")
    lanes["1_1"] = replace(lanes["1_1"], right_neighbour="1_0")
    return HdMap(lanes=lanes)


def track(
    id_: str,
    x: float,
    y: float,
    speed: float,
    category: ObjectCategory = ObjectCategory.CAR,
    size: tuple[float, float] = (4.5, 1.8),
) -> RecordedTrack:
    full = np.ones(FRAMES)
    return RecordedTrack(
        id_,
        category,
        np.ones(FRAMES, dtype=np.bool_),
        x + speed * TIME,
        y * full,
        0.0 * full,
        size[0] * full,
        size[1] * full,
        parked=speed == 0,
    )


def recording() -> Recording:
    """CAVs 1 and 2, a car before and one beside them, someone walking, a parked car, a station."""
    tracks = (
        track("1", 20.0, 0.0, 8.0),
        track("2", 30.0, 3.5, 9.0),
        track("11", 40.0, 0.0, 8.0),
        track("12", 15.0, 3.5, 8.0),
        track("13", 50.0, -6.0, 1.2, ObjectCategory.PEDESTRIAN, (0.6, 0.6)),
        track("14", 70.0, -4.0, 0.0),
    )
    pose = np.tile((*STATION, 0.0), (FRAMES, 1))
    views = (ObserverView("log", tracks), ObserverView("-1", (), pose, is_infrastructure=True))
    return Recording("small", "test", DT_S, FRAMES, views, road(), ("1", "2"))


def write_small_log(folder: Path, map_: HdMap | None = None) -> tuple[Path, Path]:
    """Writes folder/small (agents 1, 2, -1) and folder/map.pkl; returns both."""
    folder.mkdir(parents=True, exist_ok=True)
    write_v2xpnp(recording(), folder / "small", None, 0)
    write_vector_map(map_ or road(), folder / "map.pkl")
    return folder / "small", folder / "map.pkl"
