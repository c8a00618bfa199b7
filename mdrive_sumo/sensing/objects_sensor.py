"""The sensor of kind "objects": boxes of what is in sight, exact or with the errors of a profile."""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, STANDARD, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import TAU, Bool, Float, wrap_angles
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.detection_noise import (
    FalsePositive,
    add_errors,
    build_false_positives,
    draw_detected,
    draw_false_positives,
)
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, TrackNames
from mdrive_sumo.sensing.sensor_options import check_option_names, read_choice, read_number
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

OPTIONS = ("profile", "fov_deg", "yaw_deg", "free_space", "min_visible", "road_range_m")
SECTORS = 72
"""Sectors of free sight by default: one every 5 degrees."""
MAX_SECTORS = 720
"""Two for each degree."""
MAX_RANGE_M = 1000.0


@dataclass(frozen=True, slots=True)
class Detector:
    """What an objects sensor detects, and how well."""

    profile: DetectionProfile
    is_exact: bool
    """Whether it has no errors at all."""
    half_fov: float
    """Half the field of view [rad]."""
    yaw: float
    """Direction of the middle of the field of view, relative to the carrier [rad]."""
    min_visible: float
    """Visible share below which nothing is detected."""
    sectors: int
    """Sectors of free sight."""
    range_m: float
    seed: int


class ObjectsSensor:
    """Detections, nearest first, under track names of the carrier's own; docs/detections.md describes the options.

    They are in the world as the carrier takes it to be: placed by its estimated pose (`SensorPose.estimate`).
    """

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError for unknown or bad options, or a range that is not in (0, 1000] m."""
        check_option_names(spec, OPTIONS)
        name = read_choice(spec, "profile", IDEAL, (*PROFILES, STANDARD))
        profile = PROFILES[fitting.standard_detector if name == STANDARD else name]
        if not 0.0 < spec.range_m <= MAX_RANGE_M:
            raise InputError(f"sensor 'objects': expected a range_m in (0, {MAX_RANGE_M:g}], found {spec.range_m!r}")
        range_m = spec.range_m
        if fitting.briefing is not None and fitting.briefing.desired_speed is None:  # the limits of the road count
            range_m = read_number(spec, "road_range_m", range_m, 0.1, MAX_RANGE_M)
        self._detector = Detector(
            profile=profile,
            is_exact=profile is PROFILES[IDEAL],
            half_fov=math.radians(read_number(spec, "fov_deg", 360.0, 1.0, 360.0)) / 2,
            yaw=math.radians(read_number(spec, "yaw_deg", 0.0, -360.0, 360.0)),
            min_visible=read_number(spec, "min_visible", profile.min_visible, 0.0, 1.0),
            sectors=_sectors(spec),
            range_m=range_m * fitting.weather.objects_range,
            seed=fitting.seed,
        )
        self._buildings = load_building_edges(fitting.roads)
        self._names = TrackNames(fitting.carrier, fitting.track_salt)
        self._history: deque[SightView] = deque(maxlen=profile.latency_ticks + 1)

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Objects:
        """Return the newest detections that are at least `latency_ticks` old; empty before there are any."""
        return self.defer(scene, eye)()

    def defer(self, scene: SensingFrame, eye: SensorPose) -> Callable[[], Objects]:
        """Return what computes the result of `sense` in this tick; it may be called later, or never."""
        self._history.append(SightView(eye, scene, self._buildings, self._detector.range_m))
        due_tick = scene.tick - self._detector.profile.latency_ticks
        ready = [view for view in self._history if view.scene.tick <= due_tick]
        return partial(self._detect, ready[-1]) if ready else self._detect_nothing

    def _detect_nothing(self) -> Objects:
        return replace(Objects.empty(), free_m=np.zeros(self._detector.sectors))

    def _detect(self, view: SightView) -> Objects:
        detector, eye = self._detector, view.eye
        ghosts = draw_false_positives(
            detector.profile, detector.seed, view.scene.tick, (eye.x, eye.y), detector.range_m
        )
        return detect(detector, view, ghosts, self._names)


@twin
def detect(detector: Detector, view: SightView, ghosts: list[FalsePositive], names: Mapping[str, str], /) -> Objects:
    """Return what a detector tells of a scene, nearest first, where the carrier takes itself to see it.

    ghosts: false positives, which are told where sight is free. names: of tracks, by true id.
    """
    eye = view.eye
    seen = _detect_boxes(detector, view)
    if ghosts:
        seen = seen.concat(_select_free(detector, view, build_false_positives(ghosts)))
    near = seen.take(np.argsort(portable.hypot(seen.x - eye.x, seen.y - eye.y), kind="stable"))
    told = eye.place_by_estimate(near)
    free_m = view.free_sight(detector.sectors) if detector.sectors else np.zeros(0)
    return replace(told, ids=tuple([names[true_id] for true_id in near.ids]), free_m=free_m)


def _detect_boxes(detector: Detector, view: SightView) -> Objects:
    """Return the detected boxes of the scene, with errors, under their true ids."""
    eye, boxes, tick, profile = view.eye, view.scene.boxes, view.scene.tick, detector.profile
    fractions = view.visible_fractions()
    rows = np.flatnonzero((fractions >= detector.min_visible) & (fractions > 0.0))
    rows = rows[_is_in_field(detector, eye, boxes.x[rows], boxes.y[rows])]
    seen = boxes.take(rows)
    if detector.is_exact:
        return seen
    distance = portable.hypot(seen.x - eye.x, seen.y - eye.y)
    recall = profile.recall_at(distance, np.maximum(fractions[rows], profile.min_visible))
    seen = seen.take(draw_detected(detector.seed, tick, seen.ids, recall))
    return add_errors(profile, detector.seed, tick, seen, (eye.x, eye.y))


def _is_in_field(detector: Detector, eye: SensorPose, x: Float, y: Float) -> Bool:
    """Return an (N,) mask of the centres in the field of view."""
    if detector.half_fov >= math.pi:
        return np.ones(len(x), dtype=np.bool_)
    bearings = wrap_angles(portable.atan2(y - eye.y, x - eye.x) - eye.yaw - detector.yaw)
    return np.abs(bearings) <= detector.half_fov


def _select_free(detector: Detector, view: SightView, ghosts: Objects) -> Objects:
    """Return the false positives in the field of view where sight is free."""
    eye, free = view.eye, view.free_sight(SECTORS)
    sector = (portable.atan2(ghosts.y - eye.y, ghosts.x - eye.x) - eye.yaw) % TAU / TAU * SECTORS
    between = sector.astype(int) % SECTORS
    sight = np.minimum(free[between], free[(between + 1) % SECTORS])
    is_free = portable.hypot(ghosts.x - eye.x, ghosts.y - eye.y) <= sight
    return ghosts.take(is_free & _is_in_field(detector, eye, ghosts.x, ghosts.y))


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
