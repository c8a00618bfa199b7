"""Small maps and their networks for tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, load_road_map
from real2sim.hd_map import HdMap
from real2sim.network import NetworkReport, build_network

EAST = np.column_stack((np.arange(0.0, 101.0, 5.0), np.zeros(21)))


def moved(line: Float, x: float = 0.0, y: float = 0.0) -> Float:
    return line + np.array((x, y))


def built(tmp_path: Path, hd_map: HdMap, *motions: Float) -> tuple[NetworkReport, RoadMap]:
    report = build_network(hd_map, motions, tmp_path / "net", "test")
    return report, load_road_map(tmp_path / "net")


def undirected(hd_map: HdMap) -> HdMap:
    return replace(hd_map, lanes={id_: replace(one, directed=False) for id_, one in hd_map.lanes.items()})


def on_lane(roads: RoadMap, x: float, y: float) -> str:
    near = roads.find_nearest_lanes(np.array([[x, y]]))
    assert near.distance[0] < 0.1
    return roads.driving[int(near.lane[0])].id
