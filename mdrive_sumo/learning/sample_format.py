"""The format of training data: WebDataset shards (tar files), one sample per CAV and decision, and `dataset.json`.

A sample is the files of one shard whose names begin with its key: `KEY.labels.npz`, `KEY.RIG-CAMERA.jpg`,
`KEY.instruction.txt`, `KEY.about.json`. docs/training.md has the table.
"""

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.agents.learned.system_spec import (
    LIDAR_CELLS,
    LIDAR_LAYERS,
    NAVIGATION_SIZE,
    PLAN_POINTS,
    ROUTE_POINTS,
)
from mdrive_sumo.contract import CameraImage

FORMAT = "mdrive-sumo/training-data/1"
DATASET_FILE = "dataset.json"
PLACES_FOLDER = "places"
"""Folder of the places of training scenarios, beside those of the data sets."""
SPLITS = ("train", "val", "test")
"""Of training scenarios, by place; what is reported comes from `test`."""
SCENARIOS_PER_PLACE = 10
"""Training scenarios with neighbouring indices that share a place. So 3 000 scenarios take 300 places: at 0.2 s each a
minute on one core, beside hours of driving. Chosen."""
SHARD_SCENARIOS = 4
"""Scenarios of one shard: with six cameras about 100 MB."""
LABELS_SUFFIX, INSTRUCTION_SUFFIX, ABOUT_SUFFIX, IMAGE_ENDING = "labels.npz", "instruction.txt", "about.json", ".jpg"
BOX_COLUMNS = ("x", "y", "yaw", "length", "width", "speed", "class", "is_visible", "id")
"""Columns of `boxes`; class is a `RoadUserModel`, id a number that is unique and constant in its episode."""
VISIBLE = BOX_COLUMNS.index("is_visible")
MAX_BOXES = 48
"""The nearest ones of a sample, which `load_arrays` keeps."""
MAX_LANES, LANE_POINTS = 40, 10
OCCUPANCY_LAYERS = 1 + PLAN_POINTS
"""Now, and at each time of the plan."""
OCCUPANCY_SHAPE = OCCUPANCY_LAYERS, LIDAR_CELLS, LIDAR_CELLS
OCCUPANCY_BYTES = math.prod(OCCUPANCY_SHAPE) // 8


@dataclass(frozen=True, slots=True)
class LabelArray:
    """An array of `labels.npz`. A dimension that is a text has any length, the same wherever the text stands."""

    dtype: str
    shape: tuple[int | str, ...]
    meaning: str
    is_optional: bool = False


LABELS: Mapping[str, LabelArray] = MappingProxyType(
    {
        "own": LabelArray("float32", (6,), "own state, estimated: x, y, yaw (world), speed, acceleration, yaw rate"),
        "navigation": LabelArray("float32", (NAVIGATION_SIZE,), "navigation vector, with the speed of the speedometer"),
        "route": LabelArray("float32", (ROUTE_POINTS, 4), "x, y (ego frame), half lane width [m], speed limit [m/s]"),
        "expert_plan": LabelArray("float32", (PLAN_POINTS, 2), "the expert's answer [m, ego frame], every 0.5 s"),
        "expert_control": LabelArray("float32", (3,), "throttle, brake, steer of the tracker that follows its plan"),
        "boxes": LabelArray("float32", ("N", len(BOX_COLUMNS)), f"what is within 60 m: {', '.join(BOX_COLUMNS)}"),
        "futures": LabelArray("float32", ("N", PLAN_POINTS, 3), "x, y, yaw of the boxes at the plan's times or NaN"),
        "occupancy": LabelArray("uint8", (OCCUPANCY_BYTES,), f"packed bits of {OCCUPANCY_SHAPE}: now, and later"),
        "lane_graph": LabelArray("float32", ("L", LANE_POINTS, 2), "centre lines within 40 m [m, ego frame]"),
        "lidar": LabelArray("uint8", (LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS), "LiDAR histogram", is_optional=True),
        "perturbed": LabelArray("uint8", (), "1: what the car does at this tick is not what the expert wants"),
    }
)
"""Frame of boxes, futures, occupancy and lanes: the true ego frame now, x ahead, y left of the box centre."""


class SampleAbout(BaseModel):
    """`KEY.about.json`: where a sample comes from."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenario: str
    network: str
    seed: int
    """Of the episode."""
    cav: str
    """Id in the scenario."""
    tick: int
    expert: str
    round: int
    """0: the expert drove; from 1 on the learner of that round of DAgger."""


class CollectedScenario(BaseModel):
    """One index of the scenario generator and what became of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    index: int
    status: Literal["done", "none", "failed"]
    """"none": the generator has no scenario of this index."""
    scenario: str = ""
    reason: str = ""
    """Why it failed."""
    ticks: int = 0
    """CAV ticks driven, at 20 Hz."""
    samples: int = 0
    dropped: int = 0
    """Samples left out because the CAV failed soon after, see docs/training.md."""


class ShardEntry(BaseModel):
    """One shard of a data set."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    samples: int
    bytes: int
    checksum: str
    """SHA-256 of the file, "sha256:HEX"."""
    scenarios: tuple[CollectedScenario, ...]


class DatasetFile(BaseModel):
    """`dataset.json`: what a folder of shards holds. Written anew after every shard."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["mdrive-sumo/training-data/1"] = FORMAT
    program: str
    """Version of mdrive-sumo."""
    split: str
    seed: int = Field(ge=0)
    expert: str
    rigs: tuple[str, ...]
    perturbation: float
    """Rate of perturbations, 1: as in docs/training.md, 0: none."""
    driver: str
    """Checksum of the weights of the learner that drove; "": the expert drove."""
    mix: float
    """Share of the segments that the expert drove although a learner was given."""
    round: int
    share: float = 1.0
    """Share of the decisions that were kept, in turns of 3 s."""
    suite: str = ""
    """Of takes, the suites whose scenarios people drove; else one in place of the training scenarios, in tests."""
    requested: int
    """Scenarios asked for."""
    samples: int
    shards: tuple[ShardEntry, ...]


def format_key(episode: str, cav: int, tick: int) -> str:
    """Return the key of a sample; episode: letters, digits and "-"; cav: position in the scenario file."""
    return f"{episode}_c{cav}_{tick:05d}"


def split_key(key: str) -> tuple[str, int]:
    """Return what names the CAV's drive, and the tick. Raises ValueError for a text that is no key."""
    drive, _, tick = key.rpartition("_")
    if not drive:
        raise ValueError(f"expected EPISODE_CAV_TICK, found {key!r:.80}")
    return drive, int(tick)


def find_scenario_index(drive: str) -> int:
    """Return the index of the scenario of a CAV's drive, EPISODE_CAV. Raises ValueError for a text that names none."""
    return int(drive.partition("_")[0].rpartition("-")[2])


def build_training_data_schema() -> dict[str, Any]:
    """Return the published schema: JSON Schema of `dataset.json` and `about.json`, and the arrays of `labels.npz`."""
    arrays = {
        name: {"dtype": one.dtype, "shape": list(one.shape), "meaning": one.meaning, "optional": one.is_optional}
        for name, one in LABELS.items()
    }
    return {
        "format": FORMAT,
        "dataset.json": DatasetFile.model_json_schema(),
        "KEY.about.json": SampleAbout.model_json_schema(),
        "KEY.labels.npz": arrays,
    }


QUALITY = 90
"""Quality of the JPEG files, with full colour resolution (4:4:4): a 200 x 112 image of a street takes about 9 kB."""


def encode_image(image: CameraImage) -> bytes:
    """Return an RGB image as a JPEG file."""
    buffer = io.BytesIO()
    Image.fromarray(image.pixels).save(buffer, "JPEG", quality=QUALITY, subsampling=0)
    return buffer.getvalue()


def decode_image(data: bytes) -> npt.NDArray[np.uint8]:
    """Return the pixels (H, W, 3) of a JPEG file. Raises OSError for a damaged one."""
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))
