"""The figures of issue B: sensors, the channel, and the cooperative baseline on the real suite."""

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Message, Objects, SensorSpec
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.core.state import EgoState, Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.briefing_builder import build_briefing
from mdrive_sumo.sensing.lidar_sensor import LidarSensor
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.radio_scene_builder import RadioSceneBuilder
from mdrive_sumo.sensing.raster_sensor import RasterSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from mdrive_sumo.v2x.channel import Channel
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.v2x.messages import Cam, Cpm, Direction, Intention, Mcm, ReferencePose, encode, format_track_name
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile, RadioSettings
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

Row = tuple[str, float, str, str]
BOXES = 100
REPEATS = 200
CAVS = 8


def median_ms(work: Callable[[], object]) -> float:
    """Median of many calls [ms], the first ones left out: caches fill."""
    times: list[float] = []
    for _ in range(REPEATS + 10):
        since = time.perf_counter()
        work()
        times.append(time.perf_counter() - since)
    return statistics.median(times[10:]) * 1e3


def crowd(count: int, reach: float) -> SensingFrame:
    """Cars and people around the origin, none on it; the first box is the observer's."""
    rng = np.random.default_rng(0)
    radius, angle = rng.uniform(6.0, reach, count), rng.uniform(-np.pi, np.pi, count)
    people = rng.random(count) < 0.2
    size = np.where(people[:, None], (0.5, 0.5), (4.6, 1.9))
    rows = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-np.pi, np.pi, count)))
    boxes = Objects(
        ids=("me", *(f"b{i}" for i in range(count))),
        kind=np.concatenate(((Kind.VEHICLE,), np.where(people, Kind.PEDESTRIAN, Kind.VEHICLE))).astype(np.uint8),
        x=np.append(0.0, rows[:, 0]),
        y=np.append(0.0, rows[:, 1]),
        yaw=np.append(0.0, rows[:, 2]),
        speed=np.zeros(count + 1),
        length=np.append(4.9, size[:, 0]),
        width=np.append(2.0, size[:, 1]),
    )
    return SensingFrame(0, boxes, {"me": EgoState(0.0, 0.0, 0.0, 5.0)})


def with_houses(roads: RoadMap, count: int) -> RoadMap:
    """The map with houses around the origin."""
    rng = np.random.default_rng(1)
    places = [
        (r * np.cos(a), r * np.sin(a), a)
        for r, a in zip(rng.uniform(25, 80, count), rng.uniform(-3, 3, count), strict=True)
    ]
    polygons = [box_corners(x, y, yaw, 14.0, 10.0).tolist() for x, y, yaw in places]
    houses = tuple(Building(id=f"h{i}", polygon=tuple(map(tuple, p))) for i, p in enumerate(polygons))
    return replace(roads, buildings=houses)


def sensor_rows() -> Iterator[Row]:
    """Each sensor with a hundred boxes and forty houses around the car."""
    suite = load_suite("interdrive@0")
    scenario = next(s for s in suite.scenarios if s.network == "town_crossing")
    town = load_road_map(find_network_folder("town_crossing"))
    told = build_briefing(scenario.egos[0], town, to_vehicle_facts(MKZ_2017), 0, 60.0)
    scene, eye = crowd(BOXES, 80.0), SensorPose(0.0, 0.0, 0.0, 0)
    houses = with_houses(town, 40)
    fitting = SensorSetup("me", 1, houses, WEATHERS["default"], told)
    lidar = LidarSensor(SensorSpec("lidar"), fitting)
    yield "LiDAR scan, default profile, 100 boxes", median_ms(lambda: lidar.sense(scene, eye)), "ms", "<= 0.7"
    buildings = BuildingEdges(houses)
    visibility = median_ms(lambda: SightView(eye, scene, buildings, 100.0).visible_fractions())
    yield "visibility of 100 actors, an observer", visibility, "ms", "<= 0.15"
    objects = ObjectsSensor(SensorSpec("objects", range_m=100.0, options={"free_space": True}), fitting)
    yield "objects sensor with free sight, 100 actors", median_ms(lambda: objects.sense(scene, eye)), "ms", ""
    near = scene.boxes.take(slice(1, 21))
    start = scenario.egos[0].start
    raster = RasterSensor(SensorSpec("bev"), SensorSetup("me", 1, town, WEATHERS["default"], told))
    here = SensorPose(start.x, start.y, start.yaw, 0)
    yield "raster 256 x 256, 20 boxes", median_ms(lambda: raster.draw(scene, here, near)), "ms", "<= 0.6"


def channel_row() -> Iterator[Row]:
    """Eight CAVs that each send CAM, CPM (ten objects) and MCM in every tick; posting and delivering."""
    said = {f"cav_{i}": _everything(i) for i in range(CAVS)}
    places = {name: (10.0 * i, 0.0) for i, name in enumerate(said)}
    channel, ticks = Channel(PRESETS["realistic"], 0), iter(range(10**9))

    def tick() -> None:
        now = next(ticks)
        channel.deliver(now, tuple(said))
        channel.send(now, said, places)

    yield "channel, 8 CAVs with CAM, CPM, MCM at 20 Hz, a tick", median_ms(tick), "ms", "<= 0.1"


def radio_row() -> Iterator[Row]:
    """The same CAVs, sending CAM and CPM at 10 Hz and MCM at 5 Hz among 84 connected vehicles between forty houses.

    Scene, links, load every 200 ms and fates; the mean, because what a tick costs depends on what is due in it.
    """
    boxes = crowd(CAVS + 84 - 1, 150.0).boxes
    boxes = replace(boxes, kind=np.full_like(boxes.kind, Kind.VEHICLE))
    egos = {f"cav_{i}": EgoState(float(boxes.x[i]), float(boxes.y[i]), float(boxes.yaw[i]), 5.0) for i in range(CAVS)}
    frame = SensingFrame(0, replace(boxes, ids=(*egos, *boxes.ids[CAVS:])), egos)
    houses = with_houses(load_road_map(find_network_folder("town_crossing")), 40)
    places, said = (
        {name: (ego.x, ego.y) for name, ego in egos.items()},
        {name: _everything(i) for i, name in enumerate(egos)},
    )
    radio = RadioSettings(RadioProfile.ITS_G5, connected_background=1.0)
    channel, builder = Channel(replace(PRESETS["its-g5"], radio=radio), 0), RadioSceneBuilder(radio, houses, 0)

    def drive(first: int) -> None:
        for now in range(first, first + RADIO_TICKS):
            channel.deliver(now, tuple(egos))
            if now % 2 == 0:
                outgoing = {name: messages[: 3 if now % 4 == 0 else 2] for name, messages in said.items()}
                scene = builder.build(frame, tuple(egos), {}, channel.is_background_due(now))
                channel.send(now, outgoing, places, scene=scene)

    rounds = iter(range(0, 10**9, RADIO_TICKS))
    yield (
        "radio its-g5, 8 CAVs at 10 Hz, 84 connected vehicles, a tick",
        median_ms(lambda: drive(next(rounds))) / RADIO_TICKS,
        "ms",
        "<= 0.2",
    )


RADIO_TICKS = 20
"""Ticks of a round of the radio's row."""


def _everything(i: int) -> tuple[Message, ...]:
    pose, z = ReferencePose(10.0 * i, 0.0, 0.3, 7), np.linspace(1.0, 20.0, 10)
    boxes = Objects(tuple(map(format_track_name, range(10))), np.zeros(10, np.uint8), z, z, z / 9, z, z / 4, z / 9)
    points = np.column_stack((np.linspace(0, 30, 20), np.zeros(20)))
    return (
        encode(Cam(pose, 5.0, 0.1, 0.0, 4.9, 2.0)),
        encode(Cpm(pose, 80.0, boxes, np.zeros(10, np.uint8))),
        encode(Mcm(pose, 5.0, Intention.KEEP, Direction.STRAIGHT, 0.2, points, points)),
    )
