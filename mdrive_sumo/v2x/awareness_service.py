"""What a CAV tells the others of itself and of what it sees: CAMs and CPMs."""

import numpy as np

from mdrive_sumo.contract import Briefing, Message, Objects, Observation
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.messages import MAX_OBJECTS, MAX_SECTORS, REACH_M, Cam, Cpm, ReferencePose, encode

INTERVAL_TICKS = TICKS_PER_SECOND // 10
"""Both are sent at 10 Hz, the fastest that ETSI allows (EN 302 637-2, TS 103 324)."""


class AwarenessService:
    """The sending half of perception sharing."""

    def __init__(self, briefing: Briefing, range_m: float, latency_ticks: int = 0) -> None:
        """latency_ticks: how old what the own detector tells is."""
        self._vehicle, self._range, self._latency = briefing.vehicle, range_m, latency_ticks
        self._due_tick = 0

    def compose_messages(self, seen: Observation) -> tuple[Message, ...]:
        """What is to be sent in this tick; who was not asked in the very tick sends in the next one."""
        if seen.tick < self._due_tick or seen.objects is None:
            return ()
        self._due_tick = seen.tick - seen.tick % INTERVAL_TICKS + INTERVAL_TICKS
        own = seen.own
        pose = ReferencePose(own.x, own.y, own.yaw, seen.tick)
        size = self._vehicle.length, self._vehicle.width
        cam = Cam(pose, own.speed, own.acceleration, own.yaw_rate, *size)
        objects = _sendable(seen.objects, own.x, own.y)
        cpm = Cpm(pose, self._range, objects, age=np.full(len(objects.ids), self._latency, dtype=np.uint8))
        return encode(cam), encode(cpm)


def _sendable(objects: Objects, x: float, y: float) -> Objects:
    """As many of the nearest as a message can carry."""
    reach = np.maximum(np.abs(objects.x - x), np.abs(objects.y - y)) < REACH_M / 2
    rows = np.flatnonzero(reach)[:MAX_OBJECTS]
    assert len(objects.free_m) <= MAX_SECTORS, "the sensor's option free_space is bounded"
    return objects.take(rows)
