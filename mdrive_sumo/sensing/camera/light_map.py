"""The light map: shadows and lamplight on the ground around a car, seen from above, as a texture.

All cameras of a car share the map of a tick. A shadow is a body flattened along the rays of the sun, so it falls on the
ground only, not on walls or other bodies. Channels, each the most of what lies there: red the sun hidden by anything,
green the sky hidden by bodies close by, blue light of lamps. Alpha is how bright the ground is from place to place.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.sensing.camera.draw_commands import COLUMNS, list_chunk_commands
from mdrive_sumo.sensing.camera.gl_context import GrowingBuffer, RecentObjects
from mdrive_sumo.sensing.camera.instances import INSTANCE, INSTANCE_FORMAT, INSTANCE_NAMES, Instances, SceneInstances
from mdrive_sumo.sensing.camera.light_map_shaders import write_shadow_shaders, write_spot_shaders
from mdrive_sumo.sensing.camera.lighting import Lighting
from mdrive_sumo.sensing.camera.meshes import FIRST_GROUND, VERTEX_FORMAT, VERTEX_NAMES
from mdrive_sumo.sensing.camera.picture import MAP_PIXEL_M, MAP_PX, Picture
from mdrive_sumo.sensing.camera.road_user_models import SHADOW_MODELS, RoadUserModel
from mdrive_sumo.sensing.camera.static_scene import Chunks, StaticScene
from mdrive_sumo.sensing.lidar_returns import draw_bits
from mdrive_sumo.sensing.lidar_world import BUILDING_M

TILE_PX, TILE_STEP_PX, MOST_TILES = 640, 256, 8
"""Pixels along a side of a tile with what stands still and from one to the next, and how many are kept (1.6 MB each).
A tile reaches half a map beyond every place that is nearer to its middle than to those of others."""
WEAR_PX, WEAR_GRIDS = TILE_STEP_PX, {64: 2, 16: 3, 4: 3, 1: 2}
"""Pixels after which worn ground repeats itself, and the weights of grids by the pixels between their lines: 12.8 m to
0.2 m. By eye."""
SPOT = np.dtype([("middle", "<f4", 2), ("turn", "<f4", 2), ("reach", "<f4", 2), ("core", "<f4", 2), ("gain", "<f4", 4)])
"""A soft rectangle on the ground: its middle [m] relative to the scene's origin, cosine and sine of its yaw, half its
length and width [m] to where it ends and within which it is full, and what it adds to the channels."""
SPOT_FORMAT = "2f4 2f4 2f4 2f4 4f4 /i"
SPOT_NAMES = ("middle", "turn", "reach", "core", "gain")
Spots = npt.NDArray[np.void]
HIDDEN_SKY, SKY_REACH = 0.85, 0.25
"""Share of the sky that a body hides from the ground under it, and of its width up to where the ground beside it is
still darker; by eye."""
BEAM_M = (9.0, 10.0, 2.6)
"""[m] Middle of the light of a vehicle's dipped head lamps, from its front, and half its length and width: by eye."""
BEAM, POOL, POOL_M = 0.55, 1.0, 13.0
"""Brightness of that light and of that below a street lamp, and the radius [m] of the latter: by eye."""
_MOTORS = (RoadUserModel.CAR, RoadUserModel.VAN, RoadUserModel.TRUCK, RoadUserModel.BUS, RoadUserModel.MOTORCYCLE)


def build_spots(instances: SceneInstances, light: Lighting) -> Spots:
    """Return what is darker because a body is close, and what lamps light."""
    users = instances.rows[instances.row >= 0]
    half, soft = users["size"][:, :2] / 2, SKY_REACH * users["size"][:, 1:2]
    groups = [_build_spots(users["place"][:, :2], users["turn"], half, soft, HIDDEN_SKY, 1)]
    if light.lamps:
        has_motor = np.isin(instances.model[instances.row >= 0], _MOTORS)
        motors = users[has_motor]
        ahead = (motors["size"][:, :1] / 2 + BEAM_M[0]) * motors["turn"]
        groups.append(_build_spots(motors["place"][:, :2] + ahead, motors["turn"], 0.0, BEAM_M[1:], BEAM, 2))
    return np.concatenate(groups)


def _build_spots(
    middle: Float, turn: npt.ArrayLike, core: npt.ArrayLike, soft: npt.ArrayLike, gain: float, channel: int
) -> Spots:
    """Return spots that are full within `core` and end `soft` [m] beyond."""
    spots = np.zeros(len(middle), dtype=SPOT)
    spots["middle"], spots["turn"], spots["core"] = middle, turn, core
    spots["reach"] = spots["core"] + np.asarray(soft, dtype=np.float32)
    spots["gain"][:, channel] = gain
    return spots


SHADOW_VERTICES = np.concatenate([SHADOW_MODELS[model].reshape(-1, 3) for model in RoadUserModel]).astype(np.float32)
SHADOW_FIRST: Int = np.cumsum([0, *(3 * len(SHADOW_MODELS[model]) for model in RoadUserModel)])
"""Index of the first vertex of each model's shadow, and the number of all."""


class _Tile(NamedTuple):
    """A piece of the ground with the shadows and lamps of what stands still."""

    scene: StaticScene
    light: Lighting
    column: int
    row: int

    @property
    def cell(self) -> Int:
        """Lower left pixel (2,), counted from the world's origin."""
        return TILE_STEP_PX * np.array((self.column, self.row)) - TILE_PX // 2


class LightMapPainter:
    """Draws light maps, and keeps tiles with what stands still."""

    def __init__(self, context: Any, get_solids: Callable[[StaticScene], Any]) -> None:
        """get_solids: returns the buffer with the vertices of a scene."""
        self._context, self._get_solids = context, get_solids
        self._programs = {
            is_instanced: context.program(*write_shadow_shaders(is_instanced)) for is_instanced in (False, True)
        }
        self._spot_program = context.program(*write_spot_shaders())
        self._corners = context.buffer(np.array(((-1, -1), (1, -1), (-1, 1), (1, 1)), dtype=np.float32).tobytes())
        self._models = context.buffer(SHADOW_VERTICES.tobytes())
        self._instances, self._spots, self._commands = (GrowingBuffer(context) for _ in range(3))
        self._tiles = RecentObjects[_Tile](MOST_TILES, self._draw_tile)
        self._texture = context.texture((MAP_PX, MAP_PX), 4)
        self._texture.repeat_x = self._texture.repeat_y = False
        self._target = context.framebuffer([self._texture])
        self._tile_target = context.framebuffer([context.texture((TILE_PX, TILE_PX), 4)])
        self._shaded: Instances = np.zeros(0, dtype=INSTANCE)
        self._shown: tuple[SceneInstances, Lighting, tuple[int, ...]] | None = None

    def show(self, picture: Picture) -> Instances:
        """Have the map of a picture as texture 0, drawn unless the picture before had the same.

        Returns the instances with what shadows and lamps of what stands still do to them.
        """
        cell = picture.map_cell
        shown, wanted = self._shown, (picture.instances, picture.light, tuple(cell.tolist()))
        if shown is None or shown[0] is not wanted[0] or shown[1:] != wanted[1:]:
            self._shown = wanted
            self._draw(picture, cell)
        self._texture.use(0)
        return self._shaded

    def _draw(self, picture: Picture, cell: Int) -> None:
        column, row = ((cell + (MAP_PX + TILE_STEP_PX) // 2) // TILE_STEP_PX).tolist()
        tile = _Tile(picture.scene, picture.light, column, row)
        x, y = (cell - tile.cell).tolist()
        pixels = self._tiles.get(tile)
        origin = picture.scene.origin[:2]
        self._shaded = shade_instances(picture.instances.rows, pixels, tile.cell * MAP_PIXEL_M - origin)
        still = pixels[y : y + MAP_PX, x : x + MAP_PX].copy()
        still[0] = still[-1] = still[:, 0] = still[:, -1] = (0, 0, 0, 128)  # what lies beyond the map has no shadow
        self._texture.write(still)
        self._target.use()
        self._target.viewport = (1, 1, MAP_PX - 2, MAP_PX - 2)
        self._place(cell * MAP_PIXEL_M - origin + MAP_PIXEL_M, MAP_PX - 2, picture.light)
        with _MostOfAll(self._context):
            self._draw_users(picture.instances, picture.light)
            self._draw_spots(build_spots(picture.instances, picture.light))

    def _place(self, corner: Float, pixels: int, light: Lighting) -> None:
        """Say where the map lies: corner (2,) [m] relative to the scene's origin."""
        x, y, z = light.to_sun
        for program in (*self._programs.values(), self._spot_program):
            program["area"] = (*corner.tolist(), 2.0 / (pixels * MAP_PIXEL_M))
            if "slope" in program:
                program["slope"] = (-x / z, -y / z)

    def _draw_users(self, instances: SceneInstances, light: Lighting) -> None:
        chosen = np.flatnonzero(instances.row >= 0)
        if not len(chosen) or max(light.sun) == 0.0:
            return
        number = np.bincount(instances.model[chosen], minlength=len(RoadUserModel))
        commands = np.zeros((len(RoadUserModel), COLUMNS), dtype=np.uint32)
        commands[:, 0], commands[:, 1], commands[:, 2] = np.diff(SHADOW_FIRST), number, SHADOW_FIRST[:-1]
        commands[:, 3] = np.cumsum(number) - number
        buffer = self._instances.write(instances.rows[chosen].tobytes())
        content = [(self._models, "3f4", "position"), (buffer, INSTANCE_FORMAT, *INSTANCE_NAMES)]
        array = self._context.vertex_array(self._programs[True], content, skip_errors=True)
        array.render_indirect(self._commands.write(commands.tobytes()), count=len(commands))

    def _draw_spots(self, spots: Spots) -> None:
        if len(spots):
            content = [(self._corners, "2f4", "corner"), (self._spots.write(spots.tobytes()), SPOT_FORMAT, *SPOT_NAMES)]
            array = self._context.vertex_array(self._spot_program, content)
            array.render(self._context.TRIANGLE_STRIP, vertices=4, instances=len(spots))

    def _draw_tile(self, tile: _Tile) -> npt.NDArray[np.uint8]:
        """Return the pixels (TILE_PX, TILE_PX, 4) of what stands still."""
        scene, light = tile.scene, tile.light
        corner = tile.cell * MAP_PIXEL_M - scene.origin[:2]
        self._tile_target.use()
        self._tile_target.clear()
        self._place(corner, TILE_PX, light)
        with _MostOfAll(self._context):
            runs = list_chunk_commands(scene.chunks, find_shading_chunks(scene.chunks, corner, light))
            if len(runs.commands) and max(light.sun) > 0.0:
                content = [(self._get_solids(scene), VERTEX_FORMAT, *VERTEX_NAMES)]
                array = self._context.vertex_array(self._programs[False], content, skip_errors=True)
                array.render_indirect(self._commands.write(runs.commands.tobytes()), count=len(runs.commands))
            if light.street:
                self._draw_spots(_build_spots(scene.street_lamps, (1.0, 0.0), 0.0, POOL_M, POOL, 2))
        pixels = np.empty((TILE_PX, TILE_PX, 4), dtype=np.uint8)
        self._tile_target.read_into(pixels, components=4, alignment=1)
        first = tile.cell % WEAR_PX
        rows, columns = (np.arange(start, start + TILE_PX) % WEAR_PX for start in (first[1], first[0]))
        pixels[:, :, 3] = _build_wear()[np.ix_(rows, columns)]
        return pixels


@lru_cache(maxsize=1)
def _build_wear() -> npt.NDArray[np.uint8]:
    """Return how bright worn ground is (WEAR_PX, WEAR_PX): the mean of random numbers on grids of several widths."""
    total = np.zeros((WEAR_PX, WEAR_PX), dtype=np.int64)
    for width, weight in WEAR_GRIDS.items():
        count = WEAR_PX // width
        corners = (draw_bits(width, count * count) & np.uint64(255)).astype(np.int64).reshape(count, count)
        for axis in (0, 1):
            corners = _blend(corners, np.roll(corners, -1, axis=axis), width, axis)
        total += weight * corners
    return (total // sum(WEAR_GRIDS.values())).astype(np.uint8)


def _blend(values: Int, following: Int, width: int, axis: int) -> Int:
    """Return values with `width` steps from each to the one that follows along an axis."""
    share = np.tile(np.arange(width), values.shape[axis]).reshape((-1, 1) if axis == 0 else (1, -1))
    return (values.repeat(width, axis) * (width - share) + following.repeat(width, axis) * share) // width


def shade_instances(rows: Instances, pixels: npt.NDArray[np.uint8], corner: Float) -> Instances:
    """Return instances with the shadow and lamplight of a tile (TILE_PX, TILE_PX, 4) at their middle, front and rear.

    corner: (2,) lower left corner of the tile [m] relative to the scene's origin. Beyond the tile there is none.
    """
    shaded = rows.copy()
    reach = rows["turn"] * (rows["size"][:, :1] / 3)
    places = np.stack([rows["place"][:, :2] + share * reach for share in (-1, 0, 1)]).astype(np.float64) - corner
    x, y = np.moveaxis(np.floor(places / MAP_PIXEL_M).astype(np.int64), -1, 0)
    inside = (x >= 0) & (x < TILE_PX) & (y >= 0) & (y < TILE_PX)
    values = pixels[np.where(inside, y, 0), np.where(inside, x, 0)] * inside[..., None]
    mean = values.astype(np.int64).sum(axis=0) // len(places)
    shaded["shade"][:, 0], shaded["shade"][:, 1] = mean[:, 0], mean[:, 2]
    return shaded


class _MostOfAll:
    """While it is open, a pixel keeps the most of what is drawn there."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __enter__(self) -> None:
        context = self._context
        context.disable(context.DEPTH_TEST | context.CULL_FACE)
        context.enable(context.BLEND)
        context.blend_equation = context.MAX

    def __exit__(self, *_: object) -> None:
        self._context.disable(self._context.BLEND)


def find_shading_chunks(chunks: Chunks, corner: Float, light: Lighting) -> Bool:
    """Return which chunks (K,) of solids may throw a shadow into a tile with this corner [m] relative to the origin."""
    half_m = TILE_PX * MAP_PIXEL_M / 2
    away = np.abs(chunks.centre - (corner + half_m)).max(axis=1)
    return (chunks.surface < FIRST_GROUND) & (away < half_m + chunks.radius + BUILDING_M / light.elevation)
