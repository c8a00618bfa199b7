"""A busy scenario for the benches: a grid of roads, CAVs and background vehicles that all have ways for a minute."""

import gzip
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.roads import NetworkFile, RoadMap, build_lane_route, load_road_map
from mdrive_sumo.roads.network_file import compute_net_checksum
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose

BIN = Path(sys.executable).parent
VEHICLES = 84
"""Background vehicles."""


def grid(folder: Path) -> RoadMap:
    """A 4 x 4 grid with 120 m blocks and two lanes a direction, as in spec/sumo_pitfalls."""
    netgenerate = shutil.which("netgenerate", path=str(BIN))
    if netgenerate is None:
        raise InputError(f"bench: expected netgenerate ({format_installation('convert')}), found none")
    subprocess.run(
        [netgenerate, "--grid", "--grid.number", "6", "--grid.length", "120", "-L", "2", "--no-turnarounds",
         "-o", "grid.net.xml"],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    xml = (folder / "grid.net.xml").read_bytes()
    (folder / "map.net.xml.gz").write_bytes(gzip.compress(xml, mtime=0))
    about = NetworkFile(
        name="grid", origin="netgenerate", licence="none", offset=(0, 0), build=(), checksum=compute_net_checksum(xml)
    )
    (folder / "network.json").write_text(about.model_dump_json())
    return load_road_map(folder)


def walk(roads: RoadMap, rng: np.random.Generator, lane_id: str, length: float) -> list[str]:
    """A random way along lanes without lane changes."""
    lanes, gone = [lane_id], roads.lanes[lane_id].centre.length
    while gone < length and roads.lanes[lanes[-1]].successors:
        lanes.append(str(rng.choice(roads.lanes[lanes[-1]].successors)))
        gone += roads.lanes[lanes[-1]].centre.length
    return lanes


def busy_scenario(roads: RoadMap, cavs: int, vehicles: int, action_step_s: float) -> Scenario:
    """CAVs and background vehicles spread over the grid, all with ways for a minute."""
    rng = np.random.default_rng(7)
    roadway = [lane.id for lane in roads.driving if not lane.junction and lane.centre.length > 80]
    starts = [str(lane) for lane in rng.permutation(roadway)]
    egos = [_ego(str(i), roads, walk(roads, rng, starts[i], 700.0)) for i in range(cavs)]
    slots = [(lane, pos) for lane in starts[cavs:] for pos in (20.0, 50.0, 80.0)][:vehicles]
    background = [_vehicle(f"bg{i}", roads, walk(roads, rng, lane, 900.0), pos) for i, (lane, pos) in enumerate(slots)]
    return Scenario(
        id=f"bench-{cavs}-{vehicles}", bucket="Bench", category="bench", network="grid", egos=tuple(egos),
        background=Background(vehicles=tuple(background), action_step_s=action_step_s),
    )  # fmt: skip


def _ego(name: str, roads: RoadMap, lanes: list[str]) -> Ego:
    route = build_lane_route(roads, lanes, 10.0, roads.lanes[lanes[-1]].centre.length)
    points = tuple((float(x), float(y), float(yaw)) for (x, y), yaw in zip(route.xy, route.yaw, strict=True))
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), lanes=route.lanes, route=points)


def _vehicle(name: str, roads: RoadMap, lanes: list[str], pos: float) -> BackgroundVehicle:
    edges = tuple(roads.lanes[lane].edge for lane in lanes if not roads.lanes[lane].junction)
    return BackgroundVehicle(
        id=name, depart_s=0, edges=edges, depart_lane=roads.lanes[lanes[0]].index, depart_pos_m=pos
    )
