"""CameraRenderer: draws a static scene and the road users of a tick with OpenGL, without a display."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import SemanticClass, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.sensing.camera.camera_model import FAR_PLANE_M, CameraModel, CameraView, ImageKind
from mdrive_sumo.sensing.camera.gl_context import RecentObjects, create_context
from mdrive_sumo.sensing.camera.instances import (
    FAR_M_OF_FOCAL,
    FAR_MODEL,
    INSTANCE_FORMAT,
    MODEL_FIRST,
    MODEL_SURFACE,
    MODEL_VERTICES,
    SceneInstances,
)
from mdrive_sumo.sensing.camera.lighting import Lighting
from mdrive_sumo.sensing.camera.meshes import VERTEX_FORMAT, Material, Mesh, Surface, build_mesh, build_quads
from mdrive_sumo.sensing.camera.shaders import FOG_STEPS, VIEW_FLOATS, write_shaders, write_sky_shaders
from mdrive_sumo.sensing.camera.static_scene import GROUND_LAYERS, Chunks, StaticScene

COLUMNS = 5
"""Vertices, instances, first vertex, first instance, padding: moderngl strides as for indexed drawing."""


@dataclass(frozen=True, slots=True)
class CommandRuns:
    """Commands (C, COLUMNS), and for each surface its first command and their number."""

    commands: npt.NDArray[np.uint32]
    surfaces: tuple[tuple[Surface, int, int], ...]


def list_chunk_commands(chunks: Chunks, visible: Bool) -> CommandRuns:
    """Return commands for the visible chunks (K,); neighbours of one surface are drawn together."""
    rows = np.flatnonzero(visible)
    first, count, surface = chunks.first[rows], chunks.count[rows], chunks.surface[rows]
    starts = np.ones(len(rows), dtype=np.bool_)
    starts[1:] = (first[1:] != first[:-1] + count[:-1]) | (surface[1:] != surface[:-1])
    begin = np.flatnonzero(starts)
    commands = np.zeros((len(begin), COLUMNS), dtype=np.uint32)
    if len(begin):
        commands[:, 0] = np.add.reduceat(count, begin)
    commands[:, 1], commands[:, 2] = 1, first[begin]
    return CommandRuns(commands, _find_surfaces(surface[begin]))


def list_instance_commands(models: Int) -> CommandRuns:
    """Return a command for each model (index into `MESHES`) among the instances (N,), which are in this order."""
    number = np.bincount(models, minlength=len(MODEL_SURFACE))
    present = np.flatnonzero(number)
    commands = np.zeros((len(present), COLUMNS), dtype=np.uint32)
    commands[:, 0], commands[:, 1], commands[:, 2] = (
        MODEL_FIRST[present + 1] - MODEL_FIRST[present],
        number[present],
        MODEL_FIRST[present],
    )
    commands[:, 3] = np.cumsum(number[present]) - number[present]
    order = np.argsort(MODEL_SURFACE[present], kind="stable")
    return CommandRuns(commands[order], _find_surfaces(MODEL_SURFACE[present[order]]))


def _find_surfaces(surface: Int) -> tuple[tuple[Surface, int, int], ...]:
    """Return the runs of equal surfaces of commands (C,), which are ordered by them."""
    runs = ((kind, *np.searchsorted(surface, (kind, kind + 1)).tolist()) for kind in Surface)
    return tuple((kind, first, end - first) for kind, first, end in runs if end > first)


if TYPE_CHECKING:
    import moderngl

TERRAIN_M = (-1200.0, -200.0, -30.0, 30.0, 200.0, 1200.0)
"""[m] Edges of the squares of terrain around the camera: depths in small triangles are exact."""
TERRAIN = (96, 118, 74)
MOST_SCENES, MOST_TARGETS = 2, 32
"""Networks and kinds and sizes of images whose objects are kept: a worker may drive many."""
_TEXTURES = {
    ImageKind.RGB: (3, "f1"),
    ImageKind.SEMANTIC: (1, "u1"),
    ImageKind.DEPTH: (1, "f4"),
    ImageKind.INSTANCE: (1, "u4"),
}
_ELEMENTS = {"f1": np.uint8, "u1": np.uint8, "f4": np.float32, "u4": np.uint32}
_VERTEX_NAMES = ("position", "normal", "colour", "kind")
_INSTANCE_NAMES = ("place", "turn", "size", "paint", "tag")


@dataclass(frozen=True, slots=True)
class Picture:
    """What is drawn: a camera in a scene, with road users and light."""

    model: CameraModel
    view: CameraView
    scene: StaticScene
    instances: SceneInstances
    light: Lighting
    heading: Float
    """(2,) direction of the head lamps."""
    without: int | None = None
    """Row of the road user that carries the camera."""
    exposure: float = 1.0


@dataclass(frozen=True, slots=True)
class _ProgramKey:
    kind: ImageKind
    surface: Surface = Surface.PLAIN
    is_instanced: bool = False
    has_lamps: bool = False


class _VertexArrays:
    """A buffer with vertices, and how each program reads it."""

    def __init__(self, renderer: "CameraRenderer", vertices: Any, instances: Any = None) -> None:
        self._renderer = renderer
        self._content: list[Any] = [(vertices, VERTEX_FORMAT, *_VERTEX_NAMES)]
        if instances is not None:
            self._content.append((instances, INSTANCE_FORMAT, *_INSTANCE_NAMES))
        self._arrays: dict[_ProgramKey, Any] = {}

    def get(self, key: _ProgramKey) -> Any:
        if key not in self._arrays:
            self._arrays[key] = self._renderer.build_vertex_array(key, self._content)
        return self._arrays[key]


class CameraRenderer:
    """OpenGL objects of this process: programs, targets, and the meshes of scenes and models."""

    def __init__(self) -> None:
        """Raises InputError without moderngl or a driver."""
        context = self._context = create_context()
        context.front_face = "cw"  # row 0 is the top: the image is drawn upside down
        self._programs: dict[_ProgramKey, moderngl.Program] = {}
        self._targets = RecentObjects[tuple[ImageKind, int, int]](MOST_TARGETS, self._build_target)
        self._scenes = RecentObjects[StaticScene](MOST_SCENES, self._build_scene)
        self._view = context.buffer(reserve=4 * VIEW_FLOATS, dynamic=True)
        self._view.bind_to_uniform_block(0)
        self._commands = _GrowingBuffer(context)
        self._instances = _GrowingBuffer(context)
        self._models = RecentObjects[Any](1, self._build_models)
        terrain = self._terrain = context.buffer(reserve=_build_terrain().nbytes, dynamic=True)
        self._terrain_arrays = _VertexArrays(self, terrain)
        vertex, fragment = write_sky_shaders()
        self._sky = context.program(vertex_shader=vertex, fragment_shader=fragment)
        corners = np.array(((-1, -1), (3, -1), (-1, 3)), dtype=np.float32)
        self._sky_corners = context.simple_vertex_array(self._sky, context.buffer(corners.tobytes()), "corner")

    @property
    def driver(self) -> str:
        """Name of what draws, e.g. that of a graphics card or "llvmpipe"."""
        return str(self._context.info["GL_RENDERER"])

    def draw(self, picture: Picture) -> npt.NDArray[Any]:
        """Return an image: (H, W, 3) uint8 for rgb, else (H, W): uint8 classes, float32 [m], uint32 1 + row."""
        model = picture.model
        components, dtype = _TEXTURES[model.kind]
        target = self._targets.get((model.kind, model.width, model.height))
        target.use()
        self._prepare_target(target, model.kind)
        self._view.write(_pack_view(picture).tobytes())
        self._draw_instances(picture)
        self._draw_static(picture)
        if model.kind is ImageKind.RGB:
            self._draw_sky(picture)
        shape = (model.height, model.width, components)[: 3 if components > 1 else 2]
        image = np.empty(shape, dtype=_ELEMENTS[dtype])
        target.read_into(image, components=components, alignment=1, dtype=dtype)
        return image

    def build_vertex_array(self, key: _ProgramKey, content: list[Any]) -> Any:
        """Return how a program reads buffers."""
        return self._context.vertex_array(self._get_program(key), content, skip_errors=True)

    def _get_program(self, key: _ProgramKey) -> Any:
        if key not in self._programs:
            vertex, fragment = write_shaders(key.kind, key.surface, key.is_instanced, key.has_lamps)
            program: Any = self._context.program(vertex_shader=vertex, fragment_shader=fragment)
            program["View"].binding = 0
            self._programs[key] = program
        return self._programs[key]

    def _build_target(self, key: tuple[ImageKind, int, int]) -> "moderngl.Framebuffer":
        kind, *size = key
        components, dtype = _TEXTURES[kind]
        colour = self._context.texture(size, 4 if components == 3 else components, dtype=dtype)
        return self._context.framebuffer([colour], self._context.depth_renderbuffer(size))

    def _build_scene(self, scene: StaticScene) -> _VertexArrays:
        return _VertexArrays(self, self._context.buffer(scene.vertices.tobytes()))

    def _build_models(self, instances: Any) -> _VertexArrays:
        return _VertexArrays(self, self._context.buffer(MODEL_VERTICES.tobytes()), instances)

    def _prepare_target(self, target: "moderngl.Framebuffer", kind: ImageKind) -> None:
        background = {ImageKind.SEMANTIC: float(SemanticClass.SKY), ImageKind.DEPTH: FAR_PLANE_M}.get(kind, 0.0)
        _clear(target, kind, background)
        self._context.enable(self._context.DEPTH_TEST | self._context.CULL_FACE)

    def _draw_instances(self, picture: Picture) -> None:
        """Draw the road users and lamps that may be in the picture."""
        instances, view = picture.instances, picture.view
        visible = picture.model.may_show(view, instances.centre + picture.scene.origin[:2], instances.radius)
        if picture.without is not None:
            visible &= instances.row != picture.without
        chosen = np.flatnonzero(visible)
        if not len(chosen):
            return
        away = instances.centre[chosen] + picture.scene.origin[:2] - view.place[:2]
        is_far = portable.hypot(away[:, 0], away[:, 1]) > FAR_M_OF_FOCAL * picture.model.focal_px
        models = np.where(is_far, FAR_MODEL[instances.model[chosen]], instances.model[chosen])
        order = np.argsort(models, kind="stable")
        buffer = self._instances.write(instances.rows[chosen[order]].tobytes())
        self._draw_runs(picture, self._models.get(buffer), list_instance_commands(models[order]), True)

    def _draw_static(self, picture: Picture) -> None:
        scene = picture.scene
        visible = picture.model.may_show(picture.view, scene.chunks.centre + scene.origin[:2], scene.chunks.radius)
        self._draw_runs(picture, self._scenes.get(scene), list_chunk_commands(scene.chunks, visible), False)
        self._terrain.write(_place_terrain(picture).tobytes())
        self._terrain_arrays.get(_choose_program(picture, Surface.ROUGH, False)).render()

    def _draw_runs(self, picture: Picture, arrays: _VertexArrays, runs: CommandRuns, is_instanced: bool) -> None:
        """Draw parts of a buffer, with one call for each surface."""
        if not len(runs.commands):
            return
        buffer = self._commands.write(runs.commands.tobytes())
        for surface, first, count in runs.surfaces:
            arrays.get(_choose_program(picture, surface, is_instanced)).render_indirect(
                buffer, count=count, first=first
            )

    def _draw_sky(self, picture: Picture) -> None:
        """Fill what nothing has covered."""
        model, program = picture.model, self._sky
        self._context.disable(self._context.CULL_FACE)
        self._context.depth_func = "<="
        spread = np.diag((1.0, -model.width / 2 / model.focal_px, -model.height / 2 / model.focal_px))
        rays: Any = program["rays"]
        rays.write(np.ascontiguousarray((picture.view.axes @ spread).T, dtype=np.float32).tobytes())
        self._sky_corners.render()
        self._context.depth_func = "<"


class _GrowingBuffer:
    """A buffer that is written anew for each image."""

    def __init__(self, context: Any) -> None:
        self._context, self._buffer = context, context.buffer(reserve=16384, dynamic=True)

    def write(self, content: bytes) -> Any:
        if len(content) > self._buffer.size:
            self._buffer = self._context.buffer(reserve=2 * len(content), dynamic=True)
        self._buffer.orphan()
        self._buffer.write(content)
        return self._buffer


@lru_cache(maxsize=1)
def load_renderer() -> CameraRenderer:
    """Return the renderer of this process: a context takes half a second. Raises InputError."""
    return CameraRenderer()


def check_renderer(sensors: Iterable[SensorSpec]) -> None:
    """Raise InputError if one of the sensors is a camera and nothing here can render its images."""
    if any(spec.kind == "camera" for spec in sensors):
        load_renderer()


def _choose_program(picture: Picture, surface: Surface, is_instanced: bool) -> _ProgramKey:
    """Return the program of a surface; labels and depths look the same on all."""
    if picture.model.kind is not ImageKind.RGB:
        return _ProgramKey(picture.model.kind, is_instanced=is_instanced)
    return _ProgramKey(ImageKind.RGB, surface, is_instanced, picture.light.lamps)


def _clear(target: Any, kind: ImageKind, value: float) -> None:
    """Fill a target; moderngl clears with floats, which integer textures do not take."""
    if kind in (ImageKind.RGB, ImageKind.DEPTH):
        target.clear(value, value, value, 1.0, depth=1.0)
        return
    texture = target.color_attachments[0]
    target.clear(depth=1.0)
    dtype = _ELEMENTS[_TEXTURES[kind][1]]
    texture.write(np.full(texture.width * texture.height, value, dtype=dtype).tobytes(), alignment=1)


def _pack_view(picture: Picture) -> npt.NDArray[np.float32]:
    """Return the uniform block of the shaders: the matrix, columns first, and rows of four."""
    light, exposure, origin = picture.light, picture.exposure, picture.scene.origin
    level = math.sqrt(1.0 - light.elevation * light.elevation)
    fog = light.fog_per_m / FOG_STEPS
    rows = (
        (*(picture.view.place - origin), 0.0),
        (*picture.view.axes[:, 0], light.wet),
        (*origin, exposure),
        (0.6 * level, -0.8 * level, light.elevation, 0.0),
        (*light.sun, 0.0),
        (*light.ambient, 0.0),
        (*(exposure * value for value in light.horizon), fog),
        (*(exposure * value for value in light.zenith), 0.0),
        (*picture.heading, 0.0, 0.0),
    )
    clip = picture.model.build_clip_matrix(picture.view, origin)
    return np.concatenate((clip.T.reshape(-1), np.array(rows).reshape(-1))).astype(np.float32)


@lru_cache(maxsize=1)
def _build_terrain() -> Mesh:
    """Return squares of grass around a camera at the origin."""
    quads = [
        ((west, south, 0.0), (east, south, 0.0), (east, north, 0.0), (west, north, 0.0))
        for west, east in pairwise(TERRAIN_M)
        for south, north in pairwise(TERRAIN_M)
    ]
    triangles = build_quads(np.array(quads))
    return build_mesh(triangles, TERRAIN, SemanticClass.TERRAIN, Material.ROUGH, GROUND_LAYERS + 1)


def _place_terrain(picture: Picture) -> Mesh:
    """Return the terrain around the camera."""
    terrain = _build_terrain().copy()
    terrain["position"][:, :2] += (picture.view.place - picture.scene.origin)[:2].astype(np.float32)
    return terrain
