"""What cameras cost on one core: `python tests/bench/cameras.py [NETWORK...]`; a part of `make bench`.

CPU time of a tick with 100 road users around the CAV, at the start of a packaged scenario: six images of 400x224 pixels
(the rig `vad` at half its size), and one of 900x256. Targets are those of issue 20, without a graphics card.
"""

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parent)]

import click  # noqa: E402
from cooperation import crowd  # noqa: E402

from mdrive_sumo.contract import SensorSpec  # noqa: E402
from mdrive_sumo.contract.camera_rigs import build_camera_rig  # noqa: E402
from mdrive_sumo.roads import find_network_folder, load_road_map  # noqa: E402
from mdrive_sumo.scenario.suite import load_suite  # noqa: E402
from mdrive_sumo.scenario.weather import WEATHERS  # noqa: E402
from mdrive_sumo.sensing.camera.camera_renderer import load_renderer  # noqa: E402
from mdrive_sumo.sensing.camera.camera_sensor import CameraSensor  # noqa: E402
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup  # noqa: E402

NETWORKS = ("town_crossing", "old_town", "main_street", "staggered", "freeway")
"""Dense ones, and a wide one."""
ROAD_USERS, REACH_M = 100, 80.0
REPEATS, FIRST = 30, 5
SIX = tuple(
    SensorSpec("camera", spec.id, options={**spec.options, "height": 224}) for spec in build_camera_rig("vad", 0.5)
)
WIDE = (SensorSpec("camera", options={"width": 900, "height": 256}),)
TARGETS = (("6 x 400x224", SIX, 20.0), ("900x256", WIDE, 8.0))


def build_scene(network: str) -> tuple[SensingFrame, SensorSetup]:
    """Road users around the first CAV of the first scenario in a network."""
    start = next(one for one in load_suite("mdrive@0").scenarios if one.network == network).egos[0].start
    roads, scene = load_road_map(find_network_folder(network)), crowd(ROAD_USERS, REACH_M)
    boxes = scene.boxes
    yaw = boxes.yaw.copy()
    yaw[0] = start.yaw
    moved = replace(boxes, x=boxes.x + start.x, y=boxes.y + start.y, yaw=yaw)
    lights = {light.rpartition(":")[0] for lane in roads.driving for light in lane.lights.values()}
    found = replace(scene, boxes=moved, signals=dict.fromkeys(lights, "rGyG" * 12))
    return found, SensorSetup("me", 1, roads, WEATHERS["default"], None)


def measure(scene: SensingFrame, setup: SensorSetup, specs: tuple[SensorSpec, ...]) -> float:
    """Median CPU time of a tick [ms]; nothing of a tick before is used."""
    cameras = [CameraSensor(spec, setup) for spec in specs]
    boxes = scene.boxes
    eye = SensorPose(float(boxes.x[0]), float(boxes.y[0]), float(boxes.yaw[0]), 0)
    times: list[float] = []
    for _ in range(REPEATS + FIRST):
        fresh = replace(scene, derived={})
        since = time.process_time()
        for camera in cameras:
            camera.sense(fresh, eye)
        times.append((time.process_time() - since) * 1e3)
    return statistics.median(times[FIRST:])


def print_rows(networks: tuple[str, ...]) -> None:
    """Print the time of every rig on every network."""
    click.echo(f"cameras drawn by {load_renderer().driver}, {ROAD_USERS} road users")
    for network in networks:
        scene, setup = build_scene(network)
        for name, specs, target in TARGETS:
            took = measure(scene, setup, specs)
            verdict = "ok" if took <= target else "MISSED"
            click.echo(f"{network:16} {name:12} {took:6.2f} ms a tick, target <= {target:g}: {verdict}")


if __name__ == "__main__":
    print_rows(tuple(sys.argv[1:]) or NETWORKS)
