"""DrivingReward: the driving score of the protocol, as it grows from decision to decision.

The potential of a CAV is RC x IP so far (mode `mdrive`), from 0 to 1, and a reward is the change of the potential. So
the rewards of an episode add up to its driving score. The rules are those of `scoring`, which take a drive piece by
piece as well as whole; only infractions of plug-ins are found in finished episodes alone.
"""

import math
from collections.abc import Mapping

import numpy as np

from mdrive_sumo.core.state import Frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scoring import criteria
from mdrive_sumo.scoring.metrics import red_lights, stop_signs
from mdrive_sumo.scoring.metrics.collisions import INFRACTION_BY_KIND, find_new_contacts
from mdrive_sumo.scoring.metrics.ego_track import TrackPiece
from mdrive_sumo.scoring.metrics.lane_infractions import LaneWatch

FIRST_TICKS = 1024
"""Ticks for which there is room at first: most episodes are shorter, and the room doubles when it is full."""


class DrivingReward:
    """The reward of one CAV."""

    def __init__(self, ego: Ego, scenario: Scenario, roads: RoadMap) -> None:
        self._id = ego.id
        self._roads = roads
        self._reference = criteria.build_route_reference(ego)
        self._progress = criteria.RouteProgress()
        self._lanes = LaneWatch(self._reference)
        self._stop_signs = stop_signs.StopSignWatch(roads)
        has_lights = scenario.signals != "frozen-green"
        self._stop_lines = red_lights.StopLineWatch(roads, ego) if has_lights else None
        self._states = np.empty((FIRST_TICKS, 4))
        """(ticks, 4) x, y [m], yaw [rad], speed [m/s] from tick 0 on; `_count` rows are filled."""
        self._count = 0
        self._judged = 0
        """Ticks whose lanes, stop signs and lights are judged: those up to the latest decision."""
        self._signals: list[Mapping[str, str]] = []
        """States of the lights in each tick that is not judged."""
        self._ticks: list[int] = []
        self._others: list[str] = []
        self._factors: list[float] = []
        """Of all contacts, new or not."""
        self._has_new_contacts = False
        """Since the latest decision."""
        self._collision_penalty = 1.0
        self._rule_penalty = 1.0
        """Product of the factors of stop signs and red lights."""
        self._rewarded = 0.0

    @property
    def potential(self) -> float:
        """RC x IP so far, from 0 to 1."""
        completion = criteria.compute_completion_percent(self._progress, self._reference) / 100.0
        return completion * self._collision_penalty * self._rule_penalty * (1.0 - self._lanes.wrong_share)

    def add(self, frame: Frame) -> None:
        """Take a frame in which the CAV is in the world; of every tick from 0 on."""
        state = frame.egos[self._id]
        self._progress = criteria.update_progress(
            self._progress, self._reference, frame.tick, state.x, state.y, state.speed
        )
        if self._count == len(self._states):
            self._states = np.concatenate((self._states, np.empty_like(self._states)))
        self._states[self._count] = state.x, state.y, state.yaw, state.speed
        self._count += 1
        self._signals.append(frame.signals)
        touched = [contact for contact in frame.contacts if contact.ego == self._id]
        if touched:
            self._ticks += [frame.tick] * len(touched)
            self._others += [contact.other for contact in touched]
            self._factors += [INFRACTION_BY_KIND[contact.kind][1] for contact in touched]
            self._has_new_contacts = True

    def take_reward(self) -> float:
        """Return the change of the potential since the last call."""
        self._judge_rules()
        potential = self.potential
        reward, self._rewarded = potential - self._rewarded, potential
        return reward

    def _judge_rules(self) -> None:
        """Give the ticks since the last call to the rules."""
        if self._has_new_contacts:
            new = find_new_contacts(self._states[: self._count, :2].copy(), self._ticks, self._others)
            self._collision_penalty = math.prod(self._factors[i] for i in new)
            self._has_new_contacts = False
        states = self._states[self._judged : self._count]
        xy = states[:, :2].copy()  # the search for lanes takes rows without gaps
        piece = TrackPiece(xy, states[:, 2], states[:, 3], self._roads.find_nearest_lanes(xy), self._roads)
        self._lanes.add(piece)
        for _ in self._stop_signs.add(piece):
            self._rule_penalty *= stop_signs.PENALTY_FACTOR
        for crossing in self._stop_lines.add(xy) if self._stop_lines is not None else ():
            shown = self._signals[crossing.tick - self._judged]
            if red_lights.is_red(shown[crossing.light.rpartition(":")[0]], crossing.light):
                self._rule_penalty *= red_lights.PENALTY_FACTOR
        self._judged = self._count
        self._signals.clear()
