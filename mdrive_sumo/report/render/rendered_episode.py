"""RenderedEpisode: one recorded episode with all that a picture of it shows."""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.palette import (
    LIGHT,
    choose_colours,
)
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.sensing.lidar_world import assume_heights
from mdrive_sumo.v2x.channel import DeliveryStatus

COLOUR_OF_LETTER = {"r": "bad", "u": "bad", "y": "warn", "s": "warn", "g": "good", "G": "good"}
"""Names of colours by SUMO's letters; others, such as a light that is off, are muted."""
LINK_TYPES = ("cpm", "mcm", "feature")
"""Types of messages that are drawn as lines; CAMs are too many."""
LINK_TICKS = 4
"""How long a delivered message is drawn."""


class SignalStates:
    """The recorded states of traffic lights."""

    def __init__(self, record: EpisodeRecord) -> None:
        self._ticks: defaultdict[str, list[int]] = defaultdict(list)
        self._states: defaultdict[str, list[str]] = defaultdict(list)
        for change in record.signals:
            self._ticks[change.light].append(change.tick)
            self._states[change.light].append(change.state)

    def find_colour(self, light: str, tick: int) -> str:
        """Return the colour of a light "tls:index" in a tick."""
        name, _, index = light.rpartition(":")
        letter = self._find_state(name, tick)[int(index) : int(index) + 1]
        return LIGHT[COLOUR_OF_LETTER.get(letter, "muted")]

    def find_states(self, tick: int) -> dict[str, str]:
        """Return the state (SUMO letters) of every light "tls" in a tick."""
        return {name: self._find_state(name, tick) for name in list(self._ticks)}

    def _find_state(self, name: str, tick: int) -> str:
        last = bisect_right(self._ticks[name], tick) - 1
        return self._states[name][last] if last >= 0 else ""


@dataclass(frozen=True, slots=True)
class MessageLink:
    """A message that a receiver got a moment ago, from place to place (2, 2) [m]."""

    type: str
    ends: Float


@dataclass(frozen=True)
class RenderedEpisode:
    """What was recorded, the scenario as the seed drew it, its network, and the scores."""

    record: EpisodeRecord
    scenario: Scenario
    roads: RoadMap
    result: ScenarioResult

    @property
    def agent(self) -> str:
        """Name of the agent."""
        return str(self.record.about.get("agent", ""))

    @cached_property
    def colours(self) -> list[str]:
        """Colours by column: CAVs by their order, others by their kind."""
        return choose_colours(self.record)

    @cached_property
    def heights(self) -> Float:
        """Assumed heights (N,) [m] of the boxes: a recording is flat."""
        return assume_heights(self.record.kind, self.record.length)

    @cached_property
    def _last_present(self) -> Int:
        """The last tick (T, N) up to each in which a road user was present; 0 before the first."""
        ticks = np.where(self.record.valid, np.arange(self.record.ticks)[:, None], 0)
        return np.maximum.accumulate(ticks, axis=0)

    def find_pose(self, column: int, tick: int) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] of a road user; after its end those of its last tick."""
        record, last = self.record, int(self._last_present[tick, column])
        return float(record.x[last, column]), float(record.y[last, column]), float(record.yaw[last, column])

    def list_present(self, tick: int) -> list[int]:
        """Return the columns of all road users that are in the world in a tick."""
        return np.flatnonzero(self.record.valid[tick]).tolist()

    def list_links(self, tick: int) -> list[MessageLink]:
        """Return the messages that were delivered within the last ticks, between places as they are now."""
        recent = {link for past in range(tick - LINK_TICKS + 1, tick + 1) for link in self._deliveries.get(past, ())}
        return [
            MessageLink(type_, np.array((self._find_station(sender, tick), self._find_station(receiver, tick))))
            for type_, sender, receiver in sorted(recent)
        ]

    @cached_property
    def _deliveries(self) -> Mapping[int, list[tuple[str, str, str]]]:
        """Type, sender and receiver of the drawn messages by the tick of delivery."""
        stations = {*self.record.ego_ids, *(rsu.id for rsu in self.scenario.rsus)}
        deliveries_by_tick: defaultdict[int, list[tuple[str, str, str]]] = defaultdict(list)
        for sent in self.record.messages:
            message = sent.message
            if message.type.lower() not in LINK_TYPES or message.sender not in stations:
                continue
            for receiver, (status, tick) in sent.deliveries.items():
                if status is DeliveryStatus.DELIVERED and receiver in stations:
                    deliveries_by_tick[tick].append((message.type.lower(), message.sender, receiver))
        return deliveries_by_tick

    def _find_station(self, station: str, tick: int) -> tuple[float, float]:
        if station in self.record.ego_ids:
            return self.find_pose(self.record.ego_ids.index(station), tick)[:2]
        return next((rsu.x, rsu.y) for rsu in self.scenario.rsus if rsu.id == station)
