"""An agent that knows a recording: it plans what its CAV did there, and detects what was there."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import Briefing, Detections, Observation, Plan, Reply, SensorSpec
from mdrive_sumo.episode import load_episode

RECORDED_DRIVE = "recorded-drive"
TRUTH_RANGE_M = 70.0


class RecordedDrive:
    """Options: `recording`, its path. Needs `--ids scenario`, to know which CAV it is."""

    label = "joint"

    def __init__(self, config: Mapping[str, object]) -> None:
        self._episode = load_episode(Path(str(config["recording"])))

    def sensors(self) -> tuple[SensorSpec, ...]:
        return ()

    def start(self, briefing: Briefing) -> None:
        self._column = self._episode.ids.index(briefing.ego_id)
        size = (self._episode.length[self._column], self._episode.width[self._column])
        assert (briefing.vehicle.length, briefing.vehicle.width) == size

    def act(self, seen: Observation) -> Reply:
        e, now, own = self._episode, seen.tick, self._column
        present = np.flatnonzero(e.valid[:, own])
        ticks = np.clip(now + 10 * np.arange(1, 7), present[0], present[-1])
        near = e.valid[now] & (np.hypot(e.x[now] - e.x[now, own], e.y[now] - e.y[now, own]) <= TRUTH_RANGE_M)
        near[own] = False
        rows = np.flatnonzero(near)
        boxes = np.stack((e.x[now, rows], e.y[now, rows], e.yaw[now, rows], e.length[rows], e.width[rows]), axis=-1)
        points = np.stack((e.x[ticks, own], e.y[ticks, own]), axis=-1)
        return Reply(plan=Plan(points, 0.5), detections=Detections(boxes, np.ones(len(boxes))))


def register_recorded_drive(patch: pytest.MonkeyPatch) -> None:
    """Make the agent a built-in one, which needs no process of its own."""
    for module in ("runs.open_agents", "runs.agent_spec"):
        patch.setattr(f"mdrive_sumo.{module}.AGENTS", {**AGENTS, RECORDED_DRIVE: RecordedDrive})
