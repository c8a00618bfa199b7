"""A crossing in SUMO for the tests of `mdrive_sumo.sumo`: the network, scenarios on it, and what overlaps."""

import gzip
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Actors, EgoState
from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.network_file import compute_net_checksum
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor

SIZE = (4.9, 2.0)
NODES = """<nodes>
    <node id="west" x="-150" y="0"/><node id="east" x="150" y="0"/><node id="x" x="0" y="0" type="{kind}"/>
    <node id="south" x="0" y="-150"/><node id="north" x="0" y="150"/></nodes>"""
EDGES = """<edges>
    <edge id="a" from="west" to="x" numLanes="2" speed="13.89"/>
    <edge id="b" from="x" to="east" numLanes="2" speed="13.89"/>
    <edge id="c" from="south" to="x" numLanes="1" speed="13.89"/>
    <edge id="d" from="x" to="north" numLanes="1" speed="13.89"/>
    </edges>"""


def compiled(folder: Path, kind: str) -> RoadMap:
    """A crossing of a road with two lanes (eastbound, y = -4.8 and -1.6) and one with one lane (northbound)."""
    netconvert = shutil.which("netconvert", path=str(Path(sys.executable).parent)) or shutil.which("netconvert")
    if netconvert is None:
        pytest.skip("needs netconvert")
    (folder / "n.nod.xml").write_text(NODES.format(kind=kind))
    (folder / "n.edg.xml").write_text(EDGES)
    subprocess.run(
        [netconvert, "-n", "n.nod.xml", "-e", "n.edg.xml", "-o", "n.net.xml", "--no-turnarounds", "true",
         "--offset.disable-normalization", "true"],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    xml = (folder / "n.net.xml").read_bytes()
    (folder / "map.net.xml.gz").write_bytes(gzip.compress(xml, mtime=0))
    about = NetworkFile(
        name="cross", origin="test", licence="none", offset=(0, 0), build=(), checksum=compute_net_checksum(xml)
    )
    (folder / "network.json").write_text(about.model_dump_json())
    return load_road_map(folder)


def scenario(
    *vehicles: BackgroundVehicle,
    action_step_s: float = 0.5,
    signals: str = "frozen-green",
    mode: str = "reactive",
    actors: tuple[Actor, ...] = (),
) -> Scenario:
    ego = Ego(id="e", start=Pose(x=0, y=0, yaw=0), lanes=("a_0",), route=((0, 0, 0), (1, 0, 0)))
    return Scenario(
        id="s", bucket="Test", category="test", network="cross", egos=(ego,), signals=signals,
        background=Background(vehicles=vehicles, action_step_s=action_step_s, mode=mode), actors=actors,
    )  # fmt: skip


def car(
    name: str, edges: tuple[str, ...] = ("a", "b"), lane: int = 0, pos: float = 20.0, speed: float = 12.0
) -> BackgroundVehicle:
    return BackgroundVehicle(id=name, depart_s=0, edges=edges, depart_lane=lane, depart_pos_m=pos, depart_speed=speed)


def overlap(ego: EgoState, actors: Actors) -> bool:
    mine = boxes_corners(*(np.array([v]) for v in (ego.x, ego.y, ego.yaw, *SIZE)))
    boxes = boxes_corners(actors.x, actors.y, actors.yaw, actors.length, actors.width)
    return bool(boxes_overlap(mine, boxes).any())
