"""Painters of perspective views: behind a CAV and from its driver's place, drawn by the camera renderer."""

import math
from abc import abstractmethod
from dataclasses import replace

import numpy as np
import shapely

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.episode.recorded_frame import rebuild_frame
from mdrive_sumo.report.render.cameras import PerspectiveCamera
from mdrive_sumo.report.render.canvas import parse_rgb
from mdrive_sumo.report.render.frame_painter import FramePainter
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.report.render.top_view_painter import build_route_layers
from mdrive_sumo.sensing.camera.camera_model import CameraModel, CameraMount, ImageKind
from mdrive_sumo.sensing.camera.camera_renderer import Picture, load_renderer
from mdrive_sumo.sensing.camera.instances import SceneInstances, load_instances
from mdrive_sumo.sensing.camera.lighting import LIGHT_OF_WEATHER, LIGHTS
from mdrive_sumo.sensing.camera.static_scene import load_static_scene
from mdrive_sumo.sensing.observation_builder import build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.signal_lamps import FORGET_TICKS, SignalLampObserver

DRIVER = CameraMount(0.4, 0.0, 1.4)
"""Eyes of a driver in the middle of the car: networks keep to either side."""
DRIVER_FOV_DEG = 80.0
BEHIND_M, ABOVE_M = 15.0, 5.5
"""[m] Place of the chase camera relative to the middle of the followed CAV."""
PITCH = math.radians(12.0)
"""Of the chase camera, downwards."""
CHASE_FOV_DEG = 60.0
AIM_M = 1.5
"""[m] Height of a car's roof. Where a building is in between, the chase camera moves straight towards it."""
LEAST_BEHIND_M = 4.0
"""[m] Nearer, the camera would be in the followed CAV."""
WALL_GAP_M = 0.5
"""[m] Between the camera and the wall that it has moved in front of."""
GROUND_CLASSES = (SemanticClass.ROAD, SemanticClass.ROAD_LINE, SemanticClass.SIDEWALK, SemanticClass.TERRAIN)
"""What routes are painted on; everything else stands in front of them."""


class PerspectivePainter(FramePainter):
    """Paints the image of a camera that follows a CAV, in the light of the scenario's weather."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool, follow: int) -> None:
        """Raises InputError without the extra `camera` or an OpenGL driver."""
        super().__init__(episode, size, messages)
        self.follow = follow
        self._renderer = load_renderer()
        self._light = LIGHTS[LIGHT_OF_WEATHER[episode.scenario.weather]]
        self._lamps = SignalLampObserver(episode.roads)
        self._observed = -1
        """The last tick that the lamps follow from."""

    def label_height(self, column: int) -> float:
        """Return the height [m] of the roof; the own label of a driver's view is behind the camera."""
        return float(self.episode.heights[column])

    @abstractmethod
    def build_picture(self, pose: tuple[float, float, float], scene: SensingFrame) -> Picture:
        """Return what the camera of a CAV at a pose sees."""

    def paint_world(self, tick: int) -> PerspectiveCamera:
        """Paint the image of the renderer, and return its camera."""
        pose = self.episode.find_pose(self.follow, tick)
        picture = self.build_picture(pose, self._build_scene(tick))
        self.canvas.paint_picture(self._renderer.draw(picture))
        model, (x, y, z) = picture.model, picture.view.place.tolist()
        camera = PerspectiveCamera(x, y, z, pose[2], model.mount.pitch, model.focal_px, *self.size)
        self.paint_on_ground(camera, picture)
        return camera

    def paint_on_ground(self, camera: PerspectiveCamera, picture: Picture) -> None:
        """Paint what lies on the ground of the picture."""

    def make_model(self, mount: CameraMount, fov_deg: float) -> CameraModel:
        """Return the camera at a place of the CAV."""
        return CameraModel(ImageKind.RGB, *self.size, fov_deg, mount)

    def make_picture(
        self, model: CameraModel, pose: tuple[float, float, float], scene: SensingFrame, without: int | None = None
    ) -> Picture:
        """Return what a camera sees. without: row of a road user that is left out."""
        static = load_static_scene(self.episode.roads)
        heading = np.array((math.cos(pose[2]), math.sin(pose[2])))
        instances = load_instances(scene, static)
        return Picture(model, model.find_view(*pose), static, instances, self._light, heading, without)

    def _build_scene(self, tick: int) -> SensingFrame:
        """Return the recorded frame of a tick, with the lamps that shine after the ticks before it."""
        if tick < self._observed:
            self._lamps, self._observed = SignalLampObserver(self.episode.roads), -1
        for past in range(max(self._observed + 1, tick - FORGET_TICKS), tick):
            self._build_frame(past)
        self._observed = tick
        return self._build_frame(tick)

    def _build_frame(self, tick: int) -> SensingFrame:
        record = self.episode.record
        sizes = {record.ids[i]: (float(record.length[i]), float(record.width[i])) for i in range(record.egos)}
        frame = build_sensing_frame(rebuild_frame(record, tick), sizes, self._lamps)
        signals = self.signals.find_states(tick)
        return SensingFrame(tick, frame.boxes, frame.egos, signals, signal_lamps=frame.signal_lamps)


class DriverViewPainter(PerspectivePainter):
    """Paints what a driver sees; the own CAV is left out."""

    def build_picture(self, pose: tuple[float, float, float], scene: SensingFrame) -> Picture:
        """Return what is seen from the middle of the CAV."""
        own = self.episode.record.ids[self.follow]
        row = scene.boxes.ids.index(own) if own in scene.boxes.ids else None
        return self.make_picture(self.make_model(DRIVER, DRIVER_FOV_DEG), pose, scene, row)


class ChaseViewPainter(PerspectivePainter):
    """Paints pictures from behind and above a CAV, with CAVs and their routes in their colours."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool, follow: int) -> None:
        super().__init__(episode, size, messages, follow)
        self._buildings = shapely.union_all(episode.roads.building_shapes)
        self._routes = build_route_layers(episode.scenario.egos)

    def build_picture(self, pose: tuple[float, float, float], scene: SensingFrame) -> Picture:
        """Return the picture of a camera behind the CAV, or as far behind it as no building is in between."""
        behind_m = self._find_distance(*pose)
        height_m = AIM_M + (ABOVE_M - AIM_M) * behind_m / BEHIND_M
        mount = CameraMount(-behind_m, 0.0, height_m, pitch=PITCH)
        picture = self.make_picture(self.make_model(mount, CHASE_FOV_DEG), pose, scene)
        return replace(picture, instances=self._colour_cavs(picture.instances, scene))

    def _find_distance(self, x: float, y: float, yaw: float) -> float:
        """Return how far behind the CAV the camera is [m]."""
        tail = x - BEHIND_M * math.cos(yaw), y - BEHIND_M * math.sin(yaw)
        hidden = shapely.LineString(((x, y), tail)).intersection(self._buildings)
        if hidden.is_empty:
            return BEHIND_M
        return max(LEAST_BEHIND_M, float(shapely.distance(shapely.Point(x, y), hidden)) - WALL_GAP_M)

    def _colour_cavs(self, instances: SceneInstances, scene: SensingFrame) -> SceneInstances:
        """Return the models with CAVs in the colours of their routes."""
        record, rows = self.episode.record, instances.rows.copy()
        for column in range(record.egos):
            if record.ids[column] in scene.boxes.ids:
                own = instances.row == scene.boxes.ids.index(record.ids[column])
                rows["paint"][own, :3] = parse_rgb(self.episode.colours[column])
        return replace(instances, rows=rows)

    def paint_on_ground(self, camera: PerspectiveCamera, picture: Picture) -> None:
        """Paint the routes where the picture shows the ground."""
        before = self.canvas.to_array()
        for layer in self._routes:
            self.canvas.fill(camera.project(layer.areas), layer.colour)
        classes = self._renderer.draw(replace(picture, model=replace(picture.model, kind=ImageKind.SEMANTIC)))
        is_ground = np.isin(classes, GROUND_CLASSES)[..., None]
        self.canvas.paint_picture(np.where(is_ground, self.canvas.to_array(), before))
