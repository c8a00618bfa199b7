"""DrivingReward: the driving score of the protocol, as it grows from decision to decision.

The potential of a CAV is RC x IP so far (mode `mdrive`), from 0 to 1, and a reward is the change of the potential. So
the rewards of an episode add up to its driving score, as far as it is known while driving: route completion and
collisions are; red lights, stop signs and lanes are found in finished episodes, whose score the infos of the last step
hold.
"""

import math

import numpy as np

from mdrive_sumo.core.state import Frame
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scoring import criteria
from mdrive_sumo.scoring.metrics.collisions import INFRACTION_BY_KIND, find_new_contacts

FIRST_TICKS = 1024
"""Ticks for which there is room at first: most episodes are shorter, and the room doubles when it is full."""


class DrivingReward:
    """The reward of one CAV."""

    def __init__(self, ego: Ego) -> None:
        self._id = ego.id
        self._reference = criteria.build_route_reference(ego)
        self._progress = criteria.RouteProgress()
        self._xy = np.empty((FIRST_TICKS, 2))
        """(ticks, 2) box centres [m] from tick 0 on; `_count` rows are filled."""
        self._count = 0
        self._ticks: list[int] = []
        self._others: list[str] = []
        self._factors: list[float] = []
        """Of all contacts, new or not."""
        self._penalty = 1.0
        self._rewarded = 0.0

    @property
    def potential(self) -> float:
        """RC x IP so far, from 0 to 1."""
        return criteria.compute_completion_percent(self._progress, self._reference) / 100.0 * self._penalty

    def add(self, frame: Frame) -> None:
        """Take a frame in which the CAV is in the world; of every tick from 0 on."""
        state = frame.egos[self._id]
        self._progress = criteria.update_progress(
            self._progress, self._reference, frame.tick, state.x, state.y, state.speed
        )
        if self._count == len(self._xy):
            self._xy = np.concatenate((self._xy, np.empty_like(self._xy)))
        self._xy[self._count] = state.x, state.y
        self._count += 1
        touched = [contact for contact in frame.contacts if contact.ego == self._id]
        if touched:
            self._ticks += [frame.tick] * len(touched)
            self._others += [contact.other for contact in touched]
            self._factors += [INFRACTION_BY_KIND[contact.kind][1] for contact in touched]
            new = find_new_contacts(self._xy[: self._count], self._ticks, self._others)
            self._penalty = math.prod(self._factors[i] for i in new)

    def take_reward(self) -> float:
        """Return the change of the potential since the last call."""
        potential = self.potential
        reward, self._rewarded = potential - self._rewarded, potential
        return reward
