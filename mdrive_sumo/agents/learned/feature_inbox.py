"""FeatureInbox: what arrived of the maps of others, and which of it a detector gets."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.fusion_spec import MAX_AGE_TICKS
from mdrive_sumo.contract import Message, Note, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import DT
from mdrive_sumo.perception.late_fusion import FusionLimits
from mdrive_sumo.v2x.feature_map import FeatureMap, assemble_feature_map
from mdrive_sumo.v2x.messages import FEATURE, Feature, FeatureGrid, MessageError, ReferencePose
from mdrive_sumo.v2x.shared_reading import decode_shared

MAX_MAP_PACKETS = 64
"""Of one map: those that a reply has room for. More are the work of a sender that wastes our memory."""


@dataclass(frozen=True, slots=True)
class ReceivedMap:
    """A map of another car, for the frame of the own scan."""

    sender: str
    map: FeatureMap
    pose: npt.NDArray[np.float32]
    """(3,) x, y [m], yaw [rad] of the sender in the own frame."""
    age_s: float
    """[s] How much older than the own scan its scan is."""


class FeatureInbox:
    """Packets of one car's senders, by map, until they are too old."""

    def __init__(
        self,
        grid: FeatureGrid,
        limits: FusionLimits,
        others: tuple[FeatureGrid, ...] = (),
        max_age_ticks: int = MAX_AGE_TICKS,
    ) -> None:
        """grid: of the maps that are read here. limits: the senders whose maps are used. others: grids that are read
        elsewhere. max_age_ticks: older maps are dropped."""
        self._grid, self._limits, self._others, self._max_age_ticks = grid, limits, others, max_age_ticks
        self._packets: dict[str, dict[ReferencePose, list[Feature]]] = {}
        """Packets by sender and by the pose that all packets of a map have."""
        self._refused: set[str] = set()
        """Senders of which a note says that their maps are of another grid."""

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store packets; return notes about unreadable ones, and about senders whose maps are of another grid."""
        notes: list[Note] = []
        for message in messages:
            if message.type != FEATURE:
                continue
            try:
                content = decode_shared(message)
            except MessageError as error:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {error}"))
                continue
            assert isinstance(content, Feature), "its type is FEATURE"
            if content.grid == self._grid:
                packets = self._packets.setdefault(message.sender, {}).setdefault(content.pose, [])
                packets[MAX_MAP_PACKETS - 1 :] = [content]
            elif content.grid not in self._others and message.sender not in self._refused:
                self._refused.add(message.sender)
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {self._describe(content)}"))
        return tuple(notes)

    def _describe(self, content: Feature) -> str:
        other, grid = content.grid, self._grid
        return (
            f"expected the grid {grid.name} version {grid.version}, found {other.name} version {other.version}"
            f" ({other.channels} x {other.rows} x {other.columns} of {other.cell_m:g} m): another detector, other"
            " weights or another version; its maps are not used"
        )

    def collect(self, tick: int, own: OwnState) -> list[ReceivedMap]:
        """Return the newest map of each sender in use for the own scan of a tick and pose, the nearest sender first.

        Maps newer than the own scan wait for the next one, and those more than `max_age_ticks` older are forgotten.
        """
        self._forget_before(tick - self._max_age_ticks)
        newest = {
            sender: max(poses, key=lambda pose: (pose.tick, len(maps[pose])))
            for sender, maps in self._packets.items()
            if (poses := [pose for pose in maps if pose.tick <= tick])
        }
        gaps = {sender: portable.hypot(pose.x - own.x, pose.y - own.y) for sender, pose in newest.items()}
        near = sorted((gap, sender) for sender, gap in gaps.items() if gap <= self._limits.max_distance_m)
        return [self._assemble(sender, newest[sender], tick, own) for _, sender in near[: self._limits.max_senders]]

    def _forget_before(self, tick: int) -> None:
        for sender, maps in list(self._packets.items()):
            recent = {pose: packets for pose, packets in maps.items() if pose.tick >= tick}
            if recent:
                self._packets[sender] = recent
            else:
                del self._packets[sender]

    def _assemble(self, sender: str, pose: ReferencePose, tick: int, own: OwnState) -> ReceivedMap:
        place = convert_to_frame(np.array((pose.x, pose.y)), np.array((own.x, own.y, own.yaw)))
        relative = np.array((*place, wrap_angle(pose.yaw - own.yaw)), dtype=np.float32)
        found = assemble_feature_map(self._packets[sender][pose], self._grid)
        return ReceivedMap(sender, found, relative, (tick - pose.tick) * DT)
