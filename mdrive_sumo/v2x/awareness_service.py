"""Cooperative awareness and collective perception services of a CAV (ETSI EN 302 637-2 and TS 103 324)."""

import numpy as np

from mdrive_sumo.contract import Briefing, Message, Objects, Observation
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.messages import MAX_OBJECTS, MAX_SECTORS, REACH_M, Cam, Cpm, ReferencePose, encode

INTERVAL_TICKS = TICKS_PER_SECOND // 10
"""CAMs and CPMs are sent at 10 Hz, the fastest that ETSI allows (EN 302 637-2, TS 103 324)."""


class AwarenessService:
    """Composes the CAMs and CPMs of one CAV."""

    def __init__(self, briefing: Briefing, range_m: float, latency_ticks: int = 0) -> None:
        """Configure the service; latency_ticks: age of the own detections."""
        self._vehicle, self._range, self._latency = briefing.vehicle, range_m, latency_ticks
        self._due_tick = 0

    def compose_messages(self, observation: Observation) -> tuple[Message, ...]:
        """Return the messages of this tick; a CAV without observation in the due tick sends with its next one."""
        if observation.tick < self._due_tick or observation.objects is None:
            return ()
        self._due_tick = observation.tick - observation.tick % INTERVAL_TICKS + INTERVAL_TICKS
        own = observation.own
        pose = ReferencePose(own.x, own.y, own.yaw, observation.tick)
        size = self._vehicle.length, self._vehicle.width
        cam = Cam(pose, own.speed, own.acceleration, own.yaw_rate, *size)
        objects = _select_objects(observation.objects, own.x, own.y)
        cpm = Cpm(pose, self._range, objects, age=np.full(len(objects.ids), self._latency, dtype=np.uint8))
        return encode(cam), encode(cpm)


def _select_objects(objects: Objects, x: float, y: float) -> Objects:
    """Return the nearest objects, as many as a message can carry."""
    reach = np.maximum(np.abs(objects.x - x), np.abs(objects.y - y)) < REACH_M / 2
    rows = np.flatnonzero(reach)[:MAX_OBJECTS]
    assert len(objects.free_m) <= MAX_SECTORS, "the sensor's option free_space is bounded"
    return objects.take(rows)
