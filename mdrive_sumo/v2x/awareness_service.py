"""Cooperative awareness and collective perception services of a CAV (ETSI EN 302 637-2 and TS 103 324)."""

import numpy as np

from mdrive_sumo.contract import Briefing, Message, Objects, Observation
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.messages import MAX_OBJECTS, MAX_SECTORS, MESSAGE_REACH_M, Cam, Cpm, ReferencePose, encode

INTERVAL_TICKS = TICKS_PER_SECOND // 10
"""CAMs and CPMs are sent at 10 Hz, the fastest that ETSI allows (EN 302 637-2, TS 103 324)."""


class AwarenessService:
    """Composes the CAMs and CPMs of one CAV."""

    def __init__(self, briefing: Briefing, range_m: float, detector: str = IDEAL) -> None:
        """Configure the service; detector: error profile of the own detections, which states their age and errors."""
        self._vehicle, self._range, self._profile = briefing.vehicle, range_m, PROFILES[detector]
        self._due_tick = 0

    def compose_messages(self, observation: Observation) -> tuple[Message, ...]:
        """Return the messages of this tick; a CAV without observation in the due tick sends with its next one."""
        if observation.tick < self._due_tick or observation.objects is None:
            return ()
        self.postpone(observation.tick)
        own = observation.own
        pose = ReferencePose(own.x, own.y, own.yaw, observation.tick, own.position_sigma, own.yaw_sigma)
        size = self._vehicle.length, self._vehicle.width
        cam = Cam(pose, own.speed, own.acceleration, own.yaw_rate, *size, own.speed_sigma)
        objects = _select_objects(observation.objects, own.x, own.y)
        return encode(cam), encode(build_cpm(pose, self._range, objects, self._profile))

    def postpone(self, tick: int) -> None:
        """Wait for the next interval: the messages of this one have been sent in `tick`, also by another service."""
        self._due_tick = tick - tick % INTERVAL_TICKS + INTERVAL_TICKS


def build_cpm(
    pose: ReferencePose, range_m: float, objects: Objects, profile: DetectionProfile, roadside: bool = False
) -> Cpm:
    """Return the CPM of a station at that pose with detections of that profile, their age and standard deviations."""
    sigmas = compute_sigmas(profile, pose, objects.x, objects.y)
    age = np.full(len(objects.ids), profile.latency_ticks, dtype=np.uint8)
    return Cpm(pose, range_m, objects, age, roadside, sigmas)


@twin
def compute_sigmas(profile: DetectionProfile, pose: ReferencePose, x: Float, y: Float, /) -> Float:
    """Return the standard deviations (N, 3) that a CPM states of detections at x, y (N,) [m], see `Cpm.sigmas`."""
    sigmas = np.empty((len(x), 3))
    sigmas[:, 0] = profile.spread_at(portable.hypot(x - pose.x, y - pose.y))
    sigmas[:, 1], sigmas[:, 2] = profile.yaw_sigma, profile.speed_sigma
    return sigmas


def _select_objects(objects: Objects, x: float, y: float) -> Objects:
    """Return the nearest objects, as many as a message can carry."""
    assert len(objects.free_m) <= MAX_SECTORS, "the sensor's option free_space is bounded"
    rows = find_rows_within(objects.x, objects.y, x, y, MESSAGE_REACH_M / 2)
    return objects if len(objects) == len(rows) <= MAX_OBJECTS else objects.take(rows[:MAX_OBJECTS])


@twin
def find_rows_within(x: Float, y: Float, centre_x: float, centre_y: float, reach_m: float, /) -> Int:
    """Return the rows of places x, y (N,) [m] nearer than reach_m to a centre, along and across the axes."""
    return np.flatnonzero(np.maximum(np.abs(x - centre_x), np.abs(y - centre_y)) < reach_m)
