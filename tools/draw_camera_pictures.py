"""Draw the pictures of docs/cameras.md: every camera rig, lights and kinds of images.

python -m tools.draw_camera_pictures docs/images
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.contract.camera_rigs import RIGS, build_camera_rig
from mdrive_sumo.core.output_files import make_parents
from mdrive_sumo.core.state import EgoState, Kind
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.roads import Lane, RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.camera.camera_sensor import CameraSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.signal_lamps import SignalLamp
from tools.tool_command import HELP, ToolCommand

NETWORK = "city_crossing"
STOP_M = 24.0
"""[m] From the CAV to the end of its lane."""
ROW_PX, GAP_PX, COLUMNS = 150, 4, 3
LIGHTS = ("day", "cloudy", "dusk", "night", "rain", "fog")
COLOURS, MOST_BYTES = (256, 192, 128, 64), 60_000
"""Palettes of a picture, of which the first that is small enough is taken."""
Pixels = npt.NDArray[Any]
OTHERS: Sequence[tuple[float, float, float, float, float, Kind, SignalLamp]] = (
    (11.0, 0.0, 0.0, 4.6, 1.85, Kind.VEHICLE, SignalLamp.BRAKE),
    (19.0, 0.2, 0.0, 6.2, 2.1, Kind.VEHICLE, SignalLamp.BRAKE | SignalLamp.LEFT),
    (16.0, 3.4, 0.0, 4.4, 1.8, Kind.VEHICLE, SignalLamp.RIGHT),
    (8.0, 7.2, math.pi, 4.6, 1.85, Kind.VEHICLE, SignalLamp(0)),
    (24.0, 7.2, math.pi, 12.0, 2.5, Kind.VEHICLE, SignalLamp(0)),
    (-9.0, 0.0, 0.0, 8.5, 2.5, Kind.VEHICLE, SignalLamp(0)),
    (-8.0, 7.2, math.pi, 4.6, 1.85, Kind.VEHICLE, SignalLamp.LEFT),
    (7.0, -3.1, 1.2, 0.6, 0.6, Kind.PEDESTRIAN, SignalLamp(0)),
    (13.0, -3.4, 0.0, 0.6, 0.6, Kind.PEDESTRIAN, SignalLamp(0)),
    (15.5, -1.7, 0.0, 1.8, 0.6, Kind.CYCLIST, SignalLamp(0)),
    (4.5, 3.3, 0.0, 2.2, 0.8, Kind.VEHICLE, SignalLamp(0)),
    (22.0, -3.3, 0.0, 1.2, 0.5, Kind.STATIC, SignalLamp(0)),
)
"""Ahead and to the left of the CAV [m], yaw relative to it, length, width [m], kind, lamps."""


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
def main(folder: Path) -> None:
    """Write rig-NAME.png for every rig, and lights.png."""
    roads = load_road_map(find_network_folder(NETWORK))
    scene = _build_scene(_find_lane(roads), roads)
    for name in RIGS:
        images = [_take(scene, roads, spec) for spec in build_camera_rig(name, _find_scale(name))]
        _save(folder / f"rig-{name}.png", images, [spec.id for spec in build_camera_rig(name)])
    options = {"width": 420, "height": 236, "fov_deg": 80.0, "x": 0.4, "z": 1.5}
    lights = [_take(scene, roads, SensorSpec("camera", options={**options, "light": light})) for light in LIGHTS]
    _save(folder / "camera-lights.png", lights, LIGHTS)
    labels = ("rgb", "semantic", "instance", "depth")
    kinds = [_take(scene, roads, SensorSpec("camera", options={**options, "kind": kind})) for kind in labels]
    _save(folder / "camera-kinds.png", [_colour(image) for image in kinds], labels)


def _find_lane(roads: RoadMap) -> Lane:
    """Return the longest lane that ends at a traffic light and has one to the left."""
    lanes = [lane for lane in roads.driving if lane.lights and lane.left and not lane.right]
    return max(lanes, key=lambda lane: lane.centre.length)


def _build_scene(lane: Lane, roads: RoadMap) -> SensingFrame:
    """Return a CAV before a traffic light, with road users of all kinds."""
    s = lane.centre.length - STOP_M
    (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
    cos, sin = math.cos(yaw), math.sin(yaw)
    rows = [(x, y, yaw, 4.9, 1.85)]
    rows += [(x + cos * a - sin * b, y + sin * a + cos * b, yaw + turn, *size) for a, b, turn, *size, _, _ in OTHERS]
    columns = np.array(rows).T
    ids = ("me", *(f"picture-{i}" for i in range(len(OTHERS))))
    kind = np.array([Kind.VEHICLE, *(other[5] for other in OTHERS)], dtype=np.uint8)
    boxes = Objects(ids, kind, columns[0], columns[1], columns[2], np.zeros(len(rows)), columns[3], columns[4])
    lights = {light.rpartition(":")[0] for one in roads.driving for light in one.lights.values()}
    lamps = {name: int(other[6]) for name, other in zip(ids[1:], OTHERS, strict=True)}
    return SensingFrame(
        0, boxes, {"me": EgoState(x, y, yaw, 8.0)}, dict.fromkeys(lights, "rrGGyy" * 12), signal_lamps=lamps
    )


def _find_scale(name: str) -> float:
    """Return the scale at which the rows of a picture have their height."""
    return min(1.0, 2 * ROW_PX / min(camera.size[1] for camera in RIGS[name]))


def _take(scene: SensingFrame, roads: RoadMap, spec: SensorSpec) -> Pixels:
    setup = SensorSetup("me", 0, roads, WEATHERS["default"], None)
    me = scene.egos["me"]
    image = CameraSensor(spec, setup).sense(scene, SensorPose(me.x, me.y, me.yaw, 0))
    assert image is not None, "a camera that gives an image in tick 0"
    return np.asarray(image.pixels)


def _colour(image: Pixels) -> Pixels:
    """Return labels and depths as colours."""
    if image.ndim == 3:
        return image
    if image.dtype == np.float32:
        return np.repeat((255 * np.exp(-image / 25.0)).astype(np.uint8)[..., None], 3, axis=2)
    colours = np.random.default_rng(4).integers(40, 256, (64, 3), dtype=np.uint8)
    return np.where(image[..., None] < 0, 0, colours[image.astype(np.int64) % 64]).astype(np.uint8)


def _save(path: Path, images: Sequence[Pixels], labels: Sequence[str]) -> None:
    """Write images side by side, in rows of one height."""
    pictures = [Image.fromarray(image) for image in images]
    pictures = [one.resize((round(one.width * ROW_PX / one.height), ROW_PX), Image.Resampling.BOX) for one in pictures]
    columns = 2 if len(pictures) == 4 else COLUMNS
    rows = [list(zip(pictures, labels, strict=True))[i : i + columns] for i in range(0, len(pictures), columns)]
    width = max(sum(one.width + GAP_PX for one, _ in row) for row in rows) - GAP_PX
    whole = Image.new("RGB", (width, len(rows) * (ROW_PX + GAP_PX) - GAP_PX), "white")
    pen = ImageDraw.Draw(whole)
    for number, row in enumerate(rows):
        left = 0
        for one, label in row:
            whole.paste(one, (left, number * (ROW_PX + GAP_PX)))
            place = left + 5, number * (ROW_PX + GAP_PX) + 3
            pen.text(place, label, fill="white", stroke_width=1, stroke_fill="black")
            left += one.width + GAP_PX
    make_parents(path)
    for colours in COLOURS:
        whole.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= MOST_BYTES:
            break
    echo(f"{path} {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
