"""The sensor of kind "objects": boxes of what is in sight, exact or with the errors of a profile."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, STANDARD
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import TAU, Bool, Float, wrap_angles
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.detection_noise import add_errors, draw_detected, draw_false_positives
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, derive_track_name
from mdrive_sumo.sensing.sensor_options import check_option_names, read_choice, read_number
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

OPTIONS = ("profile", "fov_deg", "yaw_deg", "free_space", "min_visible", "road_range_m")
SECTORS = 72
"""Sectors of free sight by default: one every 5 degrees."""
MAX_SECTORS = 720
"""Two for each degree."""
MAX_RANGE_M = 1000.0


class ObjectsSensor:
    """Detections, nearest first, under track names of the carrier's own; docs/detections.md describes the options.

    They are in the world as the carrier takes it to be: placed by its estimated pose (`SensorPose.estimate`).
    """

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError for unknown or bad options, or a range that is not in (0, 1000] m."""
        check_option_names(spec, OPTIONS)
        name = read_choice(spec, "profile", IDEAL, (*PROFILES, STANDARD))
        self._profile = PROFILES[fitting.standard_detector if name == STANDARD else name]
        self._half_fov = np.deg2rad(read_number(spec, "fov_deg", 360.0, 1.0, 360.0)) / 2
        self._yaw = np.deg2rad(read_number(spec, "yaw_deg", 0.0, -360.0, 360.0))
        self._sectors = _sectors(spec)
        self._min_visible = read_number(spec, "min_visible", self._profile.min_visible, 0.0, 1.0)
        if not 0.0 < spec.range_m <= MAX_RANGE_M:
            raise InputError(f"sensor 'objects': expected a range_m in (0, {MAX_RANGE_M:g}], found {spec.range_m!r}")
        range_m = spec.range_m
        if fitting.briefing is not None and fitting.briefing.desired_speed is None:  # the limits of the road count
            range_m = read_number(spec, "road_range_m", range_m, 0.1, MAX_RANGE_M)
        self._range_m = range_m * fitting.weather.objects_range
        self._exact = self._profile is PROFILES[IDEAL]
        self._carrier, self._seed, self._roads = fitting.carrier, fitting.seed, fitting.roads
        self._track_salt = fitting.track_salt
        self._names: dict[str, str] = {}
        self._history: deque[SightView] = deque(maxlen=self._profile.latency_ticks + 1)

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Objects:
        """Return the newest detections that are at least `latency_ticks` old; empty before there are any."""
        return self.defer(scene, eye)()

    def defer(self, scene: SensingFrame, eye: SensorPose) -> Callable[[], Objects]:
        """Return what computes the result of `sense` in this tick; it may be called later, or never."""
        self._history.append(SightView(eye, scene, load_building_edges(self._roads), self._range_m))
        due_tick = scene.tick - self._profile.latency_ticks
        ready = [view for view in self._history if view.scene.tick <= due_tick]
        return partial(self._detect, ready[-1]) if ready else self._detect_nothing

    def _detect_nothing(self) -> Objects:
        return replace(Objects.empty(), free_m=np.zeros(self._sectors))

    def _detect(self, view: SightView) -> Objects:
        eye, scene = view.eye, view.scene
        rows = self._find_detected_rows(view)
        if self._exact:  # one selection instead of two: this runs for every CAV in every tick
            near = scene.boxes.take(rows[_order_by_distance(scene.boxes.x[rows], scene.boxes.y[rows], eye)])
        else:
            seen = self._add_flaws(view, scene.boxes.take(rows))
            near = seen.take(_order_by_distance(seen.x, seen.y, eye))
        names = tuple(self._name(true_id) for true_id in near.ids)
        o = eye.place_by_estimate(near)
        free_m = view.free_sight(self._sectors) if self._sectors else np.zeros(0)
        return Objects(names, o.kind, o.x, o.y, o.yaw, o.speed, o.length, o.width, free_m)

    def _find_detected_rows(self, view: SightView) -> npt.NDArray[np.intp]:
        """Return the rows of detected objects, without false positives."""
        fractions = view.visible_fractions()
        boxes, eye = view.scene.boxes, view.eye
        shown = (fractions >= self._min_visible) & (fractions > 0.0)
        if self._half_fov < np.pi:
            shown &= self._is_in_field(boxes.x, boxes.y, eye)
        rows = np.flatnonzero(shown)
        if self._exact:
            return rows
        distance = portable.hypot(boxes.x[rows] - eye.x, boxes.y[rows] - eye.y)
        recall = self._profile.recall_at(distance, np.maximum(fractions[rows], self._profile.min_visible))
        ids = tuple(boxes.ids[row] for row in rows.tolist())
        return rows[draw_detected(self._seed, view.scene.tick, ids, recall)]

    def _is_in_field(self, x: Float, y: Float, eye: SensorPose) -> Bool:
        """Return an (N,) mask of the centres in the field of view."""
        if self._half_fov >= np.pi:
            return np.ones(len(x), dtype=np.bool_)
        bearings = wrap_angles(portable.atan2(y - eye.y, x - eye.x) - eye.yaw - self._yaw)
        return np.abs(bearings) <= self._half_fov

    def _add_flaws(self, view: SightView, truth: Objects) -> Objects:
        """Return the objects with noise, and with false positives where sight is free."""
        eye, tick = view.eye, view.scene.tick
        eye_xy = np.array((eye.x, eye.y))
        ghosts = draw_false_positives(self._profile, self._seed, tick, eye_xy, self._range_m)
        if ghosts.ids:
            free = view.free_sight(SECTORS)
            sector = (portable.atan2(ghosts.y - eye.y, ghosts.x - eye.x) - eye.yaw) % TAU / TAU * SECTORS
            between = sector.astype(int) % SECTORS
            sight = np.minimum(free[between], free[(between + 1) % SECTORS])
            open_to = portable.hypot(ghosts.x - eye.x, ghosts.y - eye.y) <= sight
            ghosts = ghosts.take(open_to & self._is_in_field(ghosts.x, ghosts.y, eye))
        return add_errors(self._profile, self._seed, tick, truth, eye_xy).concat(ghosts)

    def _name(self, true_id: str) -> str:
        name = self._names.get(true_id)
        if name is None:
            name = self._names[true_id] = derive_track_name(self._carrier, true_id, self._track_salt)
        return name


def _order_by_distance(x: Float, y: Float, eye: SensorPose) -> npt.NDArray[np.intp]:
    return np.argsort(portable.hypot(x - eye.x, y - eye.y), kind="stable")


def _sectors(spec: SensorSpec) -> int:
    """Return the number of free-sight sectors of the option `free_space`."""
    option = spec.options.get("free_space", False)
    if isinstance(option, bool):
        return SECTORS if option else 0
    return round(read_number(spec, "free_space", 0.0, 0.0, MAX_SECTORS))


@lru_cache(maxsize=8)
def load_building_edges(roads: RoadMap) -> BuildingEdges:
    """Return the building edges of a map, cached for all sensors."""
    return BuildingEdges(roads)
