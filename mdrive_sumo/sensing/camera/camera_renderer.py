"""CameraRenderer: draws a static scene and the road users of a tick with OpenGL, without a display."""

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import SemanticClass, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sensing.camera.camera_model import FAR_M, CameraModel, CameraView, ImageKind
from mdrive_sumo.sensing.camera.instances import INSTANCE, INSTANCE_FORMAT, Instances
from mdrive_sumo.sensing.camera.lighting import Lighting
from mdrive_sumo.sensing.camera.meshes import VERTEX, VERTEX_FORMAT, Material, Mesh, build_mesh, build_quads
from mdrive_sumo.sensing.camera.shaders import SKY_FRAGMENT, SKY_VERTEX, write_fragment_shader, write_vertex_shader
from mdrive_sumo.sensing.camera.static_scene import Chunks, StaticScene

if TYPE_CHECKING:
    import moderngl

LAYER_OFFSET = 4.0
"""Depth units by which each layer of the ground lies behind the one above it: all are at height 0."""
TERRAIN_M = (5.0, 20.0, 80.0, 300.0, 1200.0)
"""[m] Half sides of the squares that make up the terrain around the camera."""
TERRAIN_QUADS = 8 * len(TERRAIN_M) - 4
TERRAIN = (96, 118, 74)
MOST_INSTANCES = 256
"""Of one draw call."""
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
    instances: Sequence[tuple[Mesh, Instances]]
    light: Lighting
    heading: Float
    """(2,) direction of the head lamps."""
    exposure: float = 1.0


class CameraRenderer:
    """OpenGL objects of this process: programs, targets, and the meshes of scenes and models."""

    def __init__(self) -> None:
        """Raises InputError without moderngl or a driver."""
        self._context = _create_context()
        self._context.front_face = "cw"  # row 0 is the top: the image is drawn upside down
        self._programs: dict[tuple[ImageKind, bool], moderngl.Program] = {}
        self._targets: dict[tuple[ImageKind, int, int], moderngl.Framebuffer] = {}
        self._arrays: dict[tuple[int, int], tuple[Any, moderngl.VertexArray]] = {}
        """By ids of program and mesh, with the mesh, so that its id stays its own."""
        self._places = self._context.buffer(reserve=MOST_INSTANCES * INSTANCE.itemsize, dynamic=True)
        self._terrain = self._context.buffer(reserve=6 * TERRAIN_QUADS * VERTEX.itemsize, dynamic=True)
        self._sky = self._context.program(vertex_shader=SKY_VERTEX.strip(), fragment_shader=SKY_FRAGMENT.strip())
        corners = np.array(((-1, -1), (3, -1), (-1, 3)), dtype=np.float32)
        self._sky_corners = self._context.simple_vertex_array(
            self._sky, self._context.buffer(corners.tobytes()), "corner"
        )

    @property
    def driver(self) -> str:
        """Name of what draws, e.g. that of a graphics card or "llvmpipe"."""
        return str(self._context.info["GL_RENDERER"])

    def draw(self, picture: Picture) -> npt.NDArray[Any]:
        """Return an image: (H, W, 3) uint8 for rgb, else (H, W): uint8 classes, float32 [m], uint32 1 + row."""
        model = picture.model
        components, dtype = _TEXTURES[model.kind]
        target = self._get_target(model)
        target.use()
        self._prepare_target(target, model.kind)
        self._draw_instances(picture)
        self._draw_static(picture)
        if model.kind is ImageKind.RGB:
            self._draw_sky(picture)
        shape = (model.height, model.width, components)[: 3 if components > 1 else 2]
        image = np.empty(shape, dtype=_ELEMENTS[dtype])
        target.read_into(image, components=components, alignment=1, dtype=dtype)
        return image

    def _get_target(self, model: CameraModel) -> "moderngl.Framebuffer":
        key = model.kind, model.width, model.height
        if key not in self._targets:
            size, (components, dtype) = (model.width, model.height), _TEXTURES[model.kind]
            colour = self._context.texture(size, 4 if components == 3 else components, dtype=dtype)
            self._targets[key] = self._context.framebuffer([colour], self._context.depth_renderbuffer(size))
        return self._targets[key]

    def _prepare_target(self, target: "moderngl.Framebuffer", kind: ImageKind) -> None:
        background = {ImageKind.SEMANTIC: float(SemanticClass.SKY), ImageKind.DEPTH: FAR_M}.get(kind, 0.0)
        _clear(target, kind, background)
        self._context.enable(self._context.DEPTH_TEST | self._context.CULL_FACE)
        self._context.polygon_offset = 0.0, 0.0

    def _draw_static(self, picture: Picture) -> None:
        """Draw solids, then the ground from top to bottom: a pixel is shaded once."""
        scene, context = picture.scene, self._context
        program = self._prepare_program(picture, instanced=False)
        vertices = self._load_array(program, scene.vertices)
        for first, count in _list_runs(scene.solids, picture):
            vertices.render(vertices=count, first=first)
        for depth, layer in enumerate(reversed(scene.ground)):
            context.polygon_offset = 0.0, LAYER_OFFSET * depth
            for first, count in _list_runs(layer, picture):
                vertices.render(vertices=count, first=first)
        context.polygon_offset = 0.0, LAYER_OFFSET * len(scene.ground)
        self._terrain.write(_build_terrain(picture).tobytes())
        self._load_array(program, self._terrain).render()
        context.polygon_offset = 0.0, 0.0

    def _draw_sky(self, picture: Picture) -> None:
        """Fill what nothing has covered."""
        model, light = picture.model, picture.light
        self._context.disable(self._context.CULL_FACE)
        self._context.depth_func = "<="
        spread = np.diag((1.0, -model.width / 2 / model.focal_px, -model.height / 2 / model.focal_px))
        _set(self._sky, "rays", picture.view.axes @ spread)
        for name, value in (("zenith", light.zenith), ("horizon", light.horizon), ("exposure", picture.exposure)):
            self._sky[name].value = value
        self._sky_corners.render()
        self._context.depth_func = "<"

    def _draw_instances(self, picture: Picture) -> None:
        program = self._prepare_program(picture, instanced=True)
        origin = picture.scene.origin
        for mesh, all_places in picture.instances:
            centre, radius = all_places["place"][:, :2] + origin[:2], all_places["size"][:, 0].astype(np.float64)
            places = all_places[picture.model.may_show(picture.view, centre, radius)]
            for part in (places[i : i + MOST_INSTANCES] for i in range(0, len(places), MOST_INSTANCES)):
                self._places.orphan()
                self._places.write(part.tobytes())
                self._load_array(program, mesh, self._places).render(instances=len(part))

    def _load_array(self, program: Any, mesh: Any, rows: Any = None) -> Any:
        """Return the vertex array of a mesh, or of a buffer with vertices; it is kept with its mesh."""
        key = id(program), id(mesh)
        if key not in self._arrays:
            buffer = self._context.buffer(mesh.tobytes()) if isinstance(mesh, np.ndarray) else mesh
            content: list[tuple[Any, ...]] = [(buffer, VERTEX_FORMAT, *_VERTEX_NAMES)]
            if rows is not None:
                content.append((rows, INSTANCE_FORMAT, *_INSTANCE_NAMES))
            self._arrays[key] = mesh, self._context.vertex_array(program, content, skip_errors=True)
        return self._arrays[key][1]

    def _prepare_program(self, picture: Picture, instanced: bool) -> Any:
        kind = picture.model.kind
        if (kind, instanced) not in self._programs:
            self._programs[kind, instanced] = self._context.program(
                vertex_shader=write_vertex_shader(instanced), fragment_shader=write_fragment_shader(kind)
            )
        program = self._programs[kind, instanced]
        _set(program, "clip", picture.model.build_clip_matrix(picture.view, picture.scene.origin))
        _set(program, "eye", picture.view.place - picture.scene.origin)
        _set(program, "ahead", picture.view.axes[:, 0])
        if kind is ImageKind.RGB:
            _set_light(program, picture)
        return program


@lru_cache(maxsize=1)
def load_renderer() -> CameraRenderer:
    """Return the renderer of this process: a context takes half a second. Raises InputError."""
    return CameraRenderer()


def check_renderer(sensors: Iterable[SensorSpec]) -> None:
    """Raise InputError if one of the sensors is a camera and nothing here can render its images."""
    if any(spec.kind == "camera" for spec in sensors):
        load_renderer()


def _create_context() -> Any:
    try:
        import moderngl
    except ImportError:
        raise InputError(
            'camera: expected the package moderngl, which renders images, found none; pip install "mdrive-sumo[camera]"'
        ) from None
    os.environ.setdefault("LP_NUM_THREADS", "0")  # Mesa's software renderer: a worker process has one core
    try:
        create: Any = moderngl.create_context  # its stub takes no name of a backend
        return create(standalone=True, require=330, backend="egl")
    except Exception as error:  # noqa: BLE001 - moderngl raises bare Exception without a driver
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            "camera: expected an OpenGL driver that renders without a display (EGL; on Debian the packages libegl1 and "
            f"libgl1-mesa-dri), found none: {reason}"
        ) from None


def _clear(target: Any, kind: ImageKind, value: float) -> None:
    """Fill a target; moderngl clears with floats, which integer textures do not take."""
    if kind in (ImageKind.RGB, ImageKind.DEPTH):
        target.clear(value, value, value, 1.0, depth=1.0)
        return
    texture = target.color_attachments[0]
    target.clear(depth=1.0)
    dtype = _ELEMENTS[_TEXTURES[kind][1]]
    texture.write(np.full(texture.width * texture.height, value, dtype=dtype).tobytes(), alignment=1)


def _set(program: Any, name: str, value: Float) -> None:
    """Set a vector or matrix; names that a kind of image does not use are left out. GLSL wants columns first."""
    if name in program:
        program[name].write(np.ascontiguousarray(value.T, dtype=np.float32).tobytes())


def _set_light(program: Any, picture: Picture) -> None:
    light = picture.light
    level = math.sqrt(1.0 - light.elevation * light.elevation)
    _set(program, "ground", picture.scene.origin)
    _set(program, "heading", picture.heading)
    _set(program, "to_sun", np.array((0.6 * level, -0.8 * level, light.elevation)))
    for name in ("sun", "ambient", "horizon", "fog_per_m", "wet"):
        program[name].value = getattr(light, name)
    program["lamps"].value = float(light.lamps)
    program["exposure"].value = picture.exposure


def _build_terrain(picture: Picture) -> Mesh:
    """Return a square of grass around the camera, in pieces that grow with the distance.

    Software renderers compute the depth of a piece from its corners. Those of one large piece lie so far outside the
    image that rounding put the grass in front of the road.
    """
    (x, y, _), quads = picture.view.place - picture.scene.origin, list[Sequence[tuple[float, float, float]]]()
    for inner, outer in pairwise((0.0, *TERRAIN_M)):
        sides = ((-outer, -inner), (-inner, inner), (inner, outer))
        for left, right in sides:
            for low, high in sides:
                is_hole = inner > 0.0 and left == low == -inner
                if left < right and low < high and not is_hole:
                    corners = ((left, low), (right, low), (right, high), (left, high))
                    quads.append([(x + dx, y + dy, 0.0) for dx, dy in corners])
    return build_mesh(build_quads(np.array(quads)), TERRAIN, SemanticClass.TERRAIN, Material.ROUGH)


def _list_runs(chunks: Chunks, picture: Picture) -> list[tuple[int, int]]:
    """Return first and number of vertices of the visible chunks; neighbours are drawn together."""
    runs: list[tuple[int, int]] = []
    visible = np.flatnonzero(chunks.find_visible(picture.model, picture.view, picture.scene.origin))
    for first, count in zip(chunks.first[visible].tolist(), chunks.count[visible].tolist(), strict=True):
        if runs and sum(runs[-1]) == first:
            runs[-1] = runs[-1][0], runs[-1][1] + count
        else:
            runs.append((first, count))
    return runs
