"""The finished, read-only record of one run of one scenario."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import CONTROL_STEP, Message, Note, TrackName, join_sensing_tracks
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Contact, End, FailureReason
from mdrive_sumo.episode.episode_schema import SignalEntry, ThinkTimeEntry
from mdrive_sumo.episode.quantization import Quanta, from_quanta
from mdrive_sumo.v2x.channel import SentMessage
from mdrive_sumo.v2x.message_counts import is_malformed
from mdrive_sumo.v2x.radio.radio_medium import BusyRatio

SENSING_TRACK = "sensing_track"
"""Key of `EpisodeRecord.about`: a `contract.SensingTrack`; absent in recordings of logs, which no agent drove."""
ATTACKERS = "attackers"
"""Key of `EpisodeRecord.about`: ids of the stations that lied, with spaces between them; absent in honest runs."""
ReceivedMessages: TypeAlias = Mapping[str, tuple[Message, ...]]
"""The messages that each CAV receives in a tick."""


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one CAV and its tick, the last one in which it is in the world.

    The other fields belong to `End.AGENT_FAILED`: the agent failed in `failed_tick`, and the CAV then braked to a stop.
    """

    ego: str
    tick: int
    end: End
    failure: FailureReason | None = None
    text: str = ""
    failed_tick: int | None = None


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """A plan that an agent returned in `tick`: points (K, 2) [m], rounded to 1 cm."""

    tick: int
    ego: str
    interval_s: float
    points: Float


@dataclass(frozen=True, slots=True)
class NoteRecord:
    """A note that an agent left in a tick."""

    tick: int
    ego: str
    note: Note


@dataclass(frozen=True)
class EpisodeRecord:
    """T ticks of N road users, CAVs first.

    Arrays are (T, N): column i is `ids[i]`; the first `egos` columns are the CAVs in the order of the scenario file.
    """

    scenario: str
    """Scenario id."""
    about: Mapping[str, Any]
    """Scalars that identify the run: seed, agent, versions ..."""
    ids: tuple[str, ...]
    egos: int
    kind: npt.NDArray[np.uint8]
    """(N,) values of `state.Kind`."""
    length: Float
    """(N,) [m]"""
    width: Float
    """(N,) [m]"""
    valid: Bool
    """(T, N): whether the road user is in the world."""
    quanta: Quanta
    """(T, N, 4): x, y, yaw, speed as whole multiples of `quantization.RESOLUTION`; 0 where not valid."""
    controls: npt.NDArray[np.int16]
    """(T, egos, 3): throttle, brake, steer applied after each tick, in multiples of `contract.CONTROL_STEP`."""
    plans: tuple[PlanRecord, ...]
    contacts: tuple[tuple[int, Contact], ...]
    """(tick, contact), in order."""
    signals: tuple[SignalEntry, ...]
    endings: tuple[Ending, ...]
    digests: npt.NDArray[np.uint8]
    """(T, 8): the chained digest after each tick."""
    messages: tuple[SentMessage, ...] = ()
    """All messages sent over the channel, in the order of sending, with their delivery."""
    busy_ratios: tuple[BusyRatio, ...] = ()
    """Load of a radio, as every station measured it; empty for other channels."""
    notes: tuple[NoteRecord, ...] = ()
    dropped_notes: int = 0
    """Notes beyond the limits of an episode, which were not kept; see `recorder.NoteLog`."""
    dropped_payloads: tuple[str, ...] = ()
    """Types of messages whose valid payloads were not kept, sorted: zeros stand for them, see `drop_payloads`."""
    thinking: tuple[ThinkTimeEntry, ...] = ()
    pseudonyms: Mapping[str, str] = field(default_factory=dict[str, str])
    """Id in the scenario of every CAV and road-side unit by the id that agents knew it by; empty if they knew it by
    the same. Payloads of messages and texts of notes contain the ids of agents, everything else those of the scenario.
    """

    @property
    def sensing_track(self) -> TrackName:
        """Whether any CAV was given objects: a value of `SensingTrack`; "" in recordings without one."""
        track = self.about.get(SENSING_TRACK)
        return join_sensing_tracks([track]) if isinstance(track, str) else ""

    def is_payload_dropped(self, sent: SentMessage) -> bool:
        """Return whether zeros stand for the payload of a message."""
        return sent.message.type in self.dropped_payloads and not is_malformed(sent)

    @property
    def ticks(self) -> int:
        """Number of recorded frames."""
        return len(self.valid)

    @property
    def ego_ids(self) -> tuple[str, ...]:
        """The CAVs in the order of the scenario file."""
        return self.ids[: self.egos]

    @property
    def digest(self) -> str:
        """Digest of the whole episode, hexadecimal."""
        return self.digests[-1].tobytes().hex()

    @cached_property
    def _values(self) -> Float:
        return from_quanta(self.quanta)

    @property
    def x(self) -> Float:
        """(T, N) [m]"""
        return self._values[..., 0]

    @property
    def y(self) -> Float:
        """(T, N) [m]"""
        return self._values[..., 1]

    @property
    def yaw(self) -> Float:
        """(T, N) [rad]"""
        return self._values[..., 2]

    @property
    def speed(self) -> Float:
        """(T, N) along yaw [m/s]"""
        return self._values[..., 3]

    @property
    def control_values(self) -> Float:
        """(T, egos, 3) throttle, brake in [0, 1], steer in [-1, 1]."""
        return self.controls.astype(np.float64) * CONTROL_STEP

    def restore_name(self, station: str) -> str:
        """Return the scenario's id of a station that an agent names; the same text for anything else."""
        return self.pseudonyms.get(station, station)

    def restore_names(self, text: str) -> str:
        """Return a text of an agent with the scenario's ids of stations."""
        if not self.pseudonyms:
            return text
        return self._pseudonym_pattern.sub(lambda match: self.pseudonyms[match[0]], text)

    @cached_property
    def _pseudonym_pattern(self) -> re.Pattern[str]:
        return re.compile(rf"\b(?:{'|'.join(map(re.escape, self.pseudonyms))})\b")

    def find_ending(self, ego: str) -> Ending:
        """Return the end of a CAV."""
        return next(ending for ending in self.endings if ending.ego == ego)
