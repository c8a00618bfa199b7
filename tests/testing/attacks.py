"""Agents that want a score without driving for it; docs/findings.md has their numbers. No tests in here."""

import math
from collections.abc import Mapping
from typing import Any

from mdrive_sumo.agents.constant_speed import ConstantSpeedAgent
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec

LOOK_AHEAD_S = 0.4
GAP_M = 0.5


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
        x, y = (
            own.x + own.speed * LOOK_AHEAD_S * math.cos(own.yaw),
            own.y + own.speed * LOOK_AHEAD_S * math.sin(own.yaw),
        )
        for ox, oy, length in zip(ahead.x, ahead.y, ahead.length, strict=True):
            if math.hypot(ox - x, oy - y) < (length + 4.9) / 2 * 0.75 + GAP_M:
                raise RuntimeError("quit")
        return super().act(seen)


class OddQuitter(Quitter):
    """Only every second CAV quits; the others drive on blindly."""

    def start(self, briefing: Briefing) -> None:
        """Draw whether this CAV quits."""
        super().start(briefing)
        self._quits = bool(briefing.seed % 2)

    def act(self, seen: Observation) -> Reply:
        """Return the reply of Quitter or of blind driving."""
        return super().act(seen) if self._quits else ConstantSpeedAgent.act(self, seen)
