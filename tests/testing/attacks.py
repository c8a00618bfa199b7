"""Agents that want a score without driving for it; docs/findings.md has their numbers. No tests in here."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mdrive_sumo.agents.sensorless import ConstantSpeedAgent
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.geometry import box_corners, boxes_corners, boxes_overlap

LOOK_AHEAD_S = 0.1
GAP_M = 0.2


class Quitter(ConstantSpeedAgent):
    """Drives blindly and crashes its own process just before an impact."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__({})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return a perfect detector."""
        return (SensorSpec("objects", range_m=30.0),)

    def act(self, seen: Observation) -> Reply:
        """Return the reply of blind driving; raise if a box comes too near within the look-ahead."""
        assert seen.objects is not None
        own, ahead = seen.own, seen.objects.advance(LOOK_AHEAD_S)
        way = own.speed * LOOK_AHEAD_S
        x, y = own.x + way * math.cos(own.yaw), own.y + way * math.sin(own.yaw)
        mine = box_corners(x, y, own.yaw, self._length + GAP_M, self._width + GAP_M)
        others = boxes_corners(ahead.x, ahead.y, ahead.yaw, ahead.length, ahead.width)
        if len(others) and boxes_overlap(np.broadcast_to(mine, others.shape), others).any():
            raise RuntimeError("quit")
        return super().act(seen)

    def start(self, briefing: Briefing) -> None:
        """Take the dimensions of the car."""
        super().start(briefing)
        self._length, self._width = briefing.vehicle.length, briefing.vehicle.width


class OddQuitter(Quitter):
    """Only every second CAV quits; the others drive on blindly."""

    def start(self, briefing: Briefing) -> None:
        """Draw whether this CAV quits."""
        super().start(briefing)
        self._quits = bool(briefing.seed % 2)

    def act(self, seen: Observation) -> Reply:
        """Return the reply of Quitter or of blind driving."""
        return super().act(seen) if self._quits else ConstantSpeedAgent.act(self, seen)
