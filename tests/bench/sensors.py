"""What sensors cost the evaluator: `python tests/bench/sensors.py`; prices of `sensing.sensor_kinds` are from it.

CPU time of a call on a dense and a wide packaged network, with 100 boxes around the car (20 in a raster), and the
price of the same sensor. The writing of the arrays for the box (`frame_file`) is part of both.
"""

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import click  # noqa: E402
from cooperation import BOXES, crowd, with_houses  # noqa: E402

from mdrive_sumo.contract import SensorSpec  # noqa: E402
from mdrive_sumo.roads import find_network_folder, load_road_map  # noqa: E402
from mdrive_sumo.scenario.suite import load_suite  # noqa: E402
from mdrive_sumo.scenario.weather import WEATHERS  # noqa: E402
from mdrive_sumo.sensing.briefing_builder import build_briefing  # noqa: E402
from mdrive_sumo.sensing.camera.camera_sensor import CameraSensor  # noqa: E402
from mdrive_sumo.sensing.lidar_sensor import LidarSensor  # noqa: E402
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor  # noqa: E402
from mdrive_sumo.sensing.raster_sensor import RasterSensor  # noqa: E402
from mdrive_sumo.sensing.sensing_frame import SensorPose, SensorSetup  # noqa: E402
from mdrive_sumo.sensing.sensor_kinds import price_sensor  # noqa: E402
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts  # noqa: E402

REPEATS = 25
SPECS = (
    SensorSpec("objects"),
    SensorSpec("objects", options={"free_space": True}),
    SensorSpec("objects", options={"free_space": 720}),
    SensorSpec("lidar"),
    SensorSpec("lidar", options={"hit_ids": True, "noise_m": 0.02, "dropout": 0.1}),
    SensorSpec("lidar", options={"roll_deg": 5.0}),
    SensorSpec("lidar", options={"profile": "lmdrive"}),
    SensorSpec("lidar", options={"profile": "lmdrive", "roll_deg": 5.0, "hit_ids": True, "noise_m": 0.02}),
    *(SensorSpec("bev", options={"size": size}) for size in (64, 256, 512, 800, 1024)),
    *(SensorSpec("camera", options={"width": width, "height": height}) for width, height in ((400, 224), (900, 256))),
    SensorSpec("bev", options={"size": 1024, "metres_per_pixel": 5.0}),
    SensorSpec("bev", options={"size": 16, "metres_per_pixel": 5.0}),
)


def cpu_ms(work: Callable[[], object]) -> tuple[float, float]:
    """Median and maximum CPU time of a call [ms]."""
    times: list[float] = []
    for _ in range(REPEATS + 2):
        since = time.process_time()
        work()
        times.append((time.process_time() - since) * 1e3)
    return statistics.median(times[2:]), max(times[2:])


def measure(network: str) -> None:
    """Print a row for every sensor."""
    scenario = next(s for s in load_suite("mdrive@0").scenarios if s.network == network)
    town = load_road_map(find_network_folder(network))
    told = build_briefing(scenario.egos[0], town, to_vehicle_facts(MKZ_2017), 0, 60.0)
    scene, start = crowd(BOXES, 80.0), scenario.egos[0].start
    walls = SensorSetup("me", 1, with_houses(town, 40), WEATHERS["default"], told)
    plain = SensorSetup("me", 1, town, WEATHERS["default"], told)
    near, centre = scene.boxes.take(slice(1, 21)), SensorPose(0.0, 0.0, 0.0, 0)
    here = SensorPose(start.x, start.y, start.yaw, 0)
    for spec in SPECS:
        if spec.kind == "bev":
            raster = RasterSensor(spec, plain)
            found = cpu_ms(lambda raster=raster: raster.draw(scene, here, near).pixels.tobytes())
        elif spec.kind == "lidar":
            lidar = LidarSensor(spec, walls)
            found = cpu_ms(lambda lidar=lidar: lidar.sense(scene, centre).points.tobytes())  # pyright: ignore
        elif spec.kind == "camera":
            camera = CameraSensor(spec, plain)
            found = cpu_ms(lambda camera=camera: camera.sense(scene, here).pixels.tobytes())  # pyright: ignore
        else:
            objects = ObjectsSensor(spec, walls)
            found = cpu_ms(lambda objects=objects: objects.sense(scene, centre))
        name = " ".join((spec.kind, *(f"{key}={value}" for key, value in spec.options.items())))
        click.echo(f"{network:16} {name:62} {found[0]:8.2f} ms  max {found[1]:8.2f}  price {price_sensor(spec):7.2f}")


if __name__ == "__main__":
    for each in sys.argv[1:] or ("town_crossing", "freeway"):
        measure(each)
