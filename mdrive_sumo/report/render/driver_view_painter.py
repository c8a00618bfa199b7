"""DriverViewPainter: what a driver of a CAV sees, drawn by the camera renderer from a recording."""

import math

import numpy as np

from mdrive_sumo.episode.recorded_frame import rebuild_frame
from mdrive_sumo.report.render.cameras import ChaseCamera
from mdrive_sumo.report.render.frame_painter import FramePainter
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.sensing.camera.camera_model import CameraModel, CameraMount, ImageKind
from mdrive_sumo.sensing.camera.camera_renderer import Picture, load_renderer
from mdrive_sumo.sensing.camera.instances import load_instances
from mdrive_sumo.sensing.camera.lighting import LIGHT_OF_WEATHER, LIGHTS
from mdrive_sumo.sensing.camera.static_scene import load_static_scene
from mdrive_sumo.sensing.observation_builder import build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.signal_lamps import FORGET_TICKS, SignalLampObserver

DRIVER = CameraMount(0.4, 0.0, 1.4)
"""Eyes of a driver in the middle of the car: networks keep to either side."""
FOV_DEG = 80.0


class DriverViewPainter(FramePainter):
    """Paints what is seen from a CAV in the light of the scenario's weather; the CAV itself is left out."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool, follow: int) -> None:
        """Raises InputError without the extra `camera` or an OpenGL driver."""
        super().__init__(episode, size, messages)
        self.follow = follow
        self._renderer = load_renderer()
        self._model = CameraModel(ImageKind.RGB, *size, FOV_DEG, DRIVER)
        self._light = LIGHTS[LIGHT_OF_WEATHER[episode.scenario.weather]]
        self._lamps = SignalLampObserver(episode.roads)
        self._observed = -1
        """The last tick that the lamps follow from."""

    def paint_world(self, tick: int) -> ChaseCamera:
        """Paint the image of the renderer, and return its camera."""
        x, y, yaw = self.episode.find_pose(self.follow, tick)
        scene, static = self._build_scene(tick), load_static_scene(self.episode.roads)
        heading = np.array((math.cos(yaw), math.sin(yaw)))
        view, instances = self._model.find_view(x, y, yaw), load_instances(scene, static)
        own = self.episode.record.ids[self.follow]
        row = scene.boxes.ids.index(own) if own in scene.boxes.ids else None
        picture = Picture(self._model, view, static, instances, self._light, heading, row)
        self.canvas.paint_picture(self._renderer.draw(picture))
        eye_x, eye_y, eye_z = view.place.tolist()
        return ChaseCamera(eye_x, eye_y, eye_z, yaw, 0.0, self._model.focal_px, *self.size)

    def label_height(self, column: int) -> float:
        """Return the height [m] of the roof; the own label is behind the camera."""
        return float(self.episode.heights[column])

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
        frame = rebuild_frame(record, tick)
        found = build_sensing_frame(frame, sizes, self._lamps)
        return SensingFrame(
            tick, found.boxes, found.egos, self.signals.find_states(tick), signal_lamps=found.signal_lamps
        )
