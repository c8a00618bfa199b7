"""Instances: which models are drawn where in one tick, for road users and the lamps of traffic lights."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.sensing.camera.meshes import (
    SURFACE_OF_MATERIAL,
    Colour,
    Material,
    Mesh,
    build_block,
    build_mesh,
    join_meshes,
)
from mdrive_sumo.sensing.camera.road_user_models import FAR_MODELS, MODELS, RoadUserModel, choose_models
from mdrive_sumo.sensing.camera.static_scene import SignalLamps, StaticScene
from mdrive_sumo.sensing.lidar_world import assume_heights
from mdrive_sumo.sensing.sensing_frame import SensingFrame

INSTANCE = np.dtype(
    [("place", "<f4", 3), ("turn", "<f4", 2), ("size", "<f4", 3), ("paint", "u1", 4), ("tag", "<u4"), ("lamps", "<u4")]
)
"""A model in the world: its lowest middle point [m] relative to the scene's origin, cosine and sine of its yaw, length,
width and height [m], colour, 1 + row of the road user (0 for others), and the `SignalLamp`s that shine."""
INSTANCE_FORMAT = "3f4 2f4 3f4 4f1 2u4 /i"
Instances = npt.NDArray[np.void]
PAINTS: tuple[Colour, ...] = (
    *((225, 226, 228), (42, 44, 48), (128, 132, 136), (168, 172, 176), (150, 28, 32), (36, 72, 132)),
    *((62, 88, 66), (196, 178, 140), (88, 60, 46), (214, 150, 40), (70, 116, 160), (104, 40, 66)),
)
"""Colours of vehicles and clothes; the own colour of an object follows from its id and never changes."""
LAMP = build_mesh(
    build_block((0.0, -0.5, 0.0), (1.0, 0.5, 1.0)), (255, 255, 255), SemanticClass.TRAFFIC_LIGHT, Material.SIGNAL
)
LAMP_M = (0.05, 0.24, 0.24)
"""[m] Depth, width and height of a lamp of a traffic light."""
LIGHT_OF_LETTER: Mapping[str, tuple[float, Colour]] = {
    **dict.fromkeys("ru", (0.69, (255, 40, 32))),
    **dict.fromkeys("ys", (0.38, (255, 190, 30))),
    **dict.fromkeys("gG", (0.07, (40, 230, 110))),
}
"""Height of the lamp in the housing [m] and its colour by SUMO's letters; others are dark."""


MESHES: tuple[Mesh, ...] = (*(MODELS[model] for model in RoadUserModel), LAMP, *FAR_MODELS.values())
"""By `RoadUserModel`, then the lamp of a traffic light, then the simpler vehicles."""
MODEL_VERTICES = join_meshes(MESHES)
MODEL_FIRST: Int = np.cumsum([0, *map(len, MESHES)])
"""Index of the first vertex of each model, and the number of all."""
MODEL_SURFACE: Int = np.array([SURFACE_OF_MATERIAL[Material(int(mesh["kind"][0, 1]))] for mesh in MESHES])
"""Of each model: it consists of one."""
LAMP_MODEL = len(RoadUserModel)
FAR_MODEL: Int = np.arange(len(MESHES))
"""Which mesh stands for one that is far away."""
FAR_MODEL[list(FAR_MODELS)] = np.arange(LAMP_MODEL + 1, len(MESHES))
FAR_M_OF_FOCAL = 0.1
"""[m per pixel of the focal length] Beyond, a wheel covers less than 7 pixels."""


@dataclass(frozen=True, slots=True)
class SceneInstances:
    """All models of one tick, in the order of their kinds; arrays (N,)."""

    rows: Instances
    model: Int
    """Index into `MESHES`."""
    row: Int
    """Row of the road user in `SensingFrame.boxes`, -1 for a lamp."""
    centre: Float
    """(N, 2) [m], relative to the scene's origin."""
    radius: Float
    """[m]"""


def load_instances(scene: SensingFrame, static: StaticScene) -> SceneInstances:
    """Return the models of a tick, which all cameras share."""
    computed = scene.list_derived(SceneInstances)
    if not computed:
        computed.append(_build_instances(scene, static.lamps, static.origin))
    return computed[0]


def _build_instances(scene: SensingFrame, lamps: SignalLamps, origin: Float) -> SceneInstances:
    users, lit = _build_road_users(scene, origin), _build_lamps(lamps, scene.signals)
    rows = np.concatenate((users, lit))
    model = np.concatenate((choose_models(scene.boxes), np.full(len(lit), LAMP_MODEL)))
    order = np.argsort(model, kind="stable")
    rows = rows[order]
    size = rows["size"].astype(np.float64)
    return SceneInstances(
        rows,
        model[order],
        rows["tag"].astype(np.int64) - 1,
        rows["place"][:, :2].astype(np.float64),
        np.maximum(size[:, 0], size[:, 1]),
    )


def _build_road_users(scene: SensingFrame, origin: Float) -> Instances:
    boxes = scene.boxes
    every = np.zeros(len(boxes), dtype=INSTANCE)
    every["place"] = np.stack((boxes.x, boxes.y, np.zeros(len(boxes))), axis=-1) - origin
    every["turn"] = np.stack(scene.directions, axis=-1)
    every["size"] = np.stack((boxes.length, boxes.width, assume_heights(boxes.kind, boxes.length)), axis=-1)
    every["paint"][:, :3] = np.array([choose_paint(name) for name in boxes.ids]).reshape(-1, 3)
    every["tag"] = 1 + np.arange(len(boxes))
    every["lamps"] = [scene.signal_lamps.get(name, 0) for name in boxes.ids]
    return every


@lru_cache(maxsize=4096)
def choose_paint(name: str) -> Colour:
    """Return the colour of a road user, which follows from its id."""
    return PAINTS[blake2b(name.encode(), digest_size=1).digest()[0] % len(PAINTS)]


def _build_lamps(lamps: SignalLamps, signals: Mapping[str, str]) -> Instances:
    """Return the lamps that shine."""
    instances = np.zeros(len(lamps.names), dtype=INSTANCE)
    lit = np.zeros(len(lamps.names), dtype=np.bool_)
    for i, name in enumerate(lamps.names):
        light, _, index = name.rpartition(":")
        letter = signals.get(light, "")[int(index) : int(index) + 1]
        if letter in LIGHT_OF_LETTER and letter:
            height, colour = LIGHT_OF_LETTER[letter]
            lit[i] = True
            instances["place"][i] = lamps.place[i] + (0.0, 0.0, height)
            instances["paint"][i, :3] = colour
    instances["turn"] = lamps.turn
    instances["size"] = LAMP_M
    return instances[lit]
