"""Environmental awareness: of which road users around it a CAV knows, by its own sensors and by messages.

The environmental awareness ratio: known road users divided by all that are relevant (Günther, Riebl, Wolf, Facchi:
"The effect of decentralized congestion control on collective perception in dense traffic scenarios", 2018).
"""

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.replay_data import MIN_VISIBLE_FRACTION, SIGHT_RANGE_M
from mdrive_sumo.report.replay_scene import build_boxes
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from mdrive_sumo.study.channel.link_measures import RING_M
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import CAM, CPM, Cpm, MessageError, decode

RELEVANT_M = SIGHT_RANGE_M
"""Vehicles, cyclists and pedestrians within this distance of a CAV are relevant: as far as its sensors may see."""
EVERY_TICKS = TICKS_PER_SECOND // 2
"""Ticks between two looks: 2 a second; line of sight costs about a millisecond a CAV."""
FRESH_TICKS = TICKS_PER_SECOND
"""A message counts for a second: by then ETSI's rules have a station, or an object, told of again."""
SAME_USER_M = 2.0
"""An object of a CPM is the road user that was nearest to it, if within this distance or half its length."""


@dataclass
class AwarenessCounts:
    """Counts over recordings of relevant road users, by ring of distances, and of those that a CAV knew of."""

    relevant: Counter[int] = field(default_factory=Counter[int])
    seen: Counter[int] = field(default_factory=Counter[int])
    """By own sensors."""
    told: Counter[int] = field(default_factory=Counter[int])
    """By messages."""
    known: Counter[int] = field(default_factory=Counter[int])
    """By either."""

    def add(self, record: EpisodeRecord, roads: RoadMap) -> None:
        """Add a recording."""
        buildings, messages = BuildingEdges(roads), _ToldRoadUsers(record)
        moving = record.kind != Kind.STATIC
        for tick in range(0, record.ticks, EVERY_TICKS):
            present = np.flatnonzero(record.valid[tick])
            scene = SensingFrame(tick, build_boxes(record, tick), {})
            for row, ego in enumerate(present[present < record.egos].tolist()):
                distances = portable.hypot(scene.boxes.x - scene.boxes.x[row], scene.boxes.y - scene.boxes.y[row])
                relevant = (distances <= RELEVANT_M) & moving[present] & (present != ego)
                if not relevant.any():
                    continue
                eye = SensorPose(float(scene.boxes.x[row]), float(scene.boxes.y[row]), float(scene.boxes.yaw[row]), row)
                seen = SightView(eye, scene, buildings, SIGHT_RANGE_M).visible_fractions() >= MIN_VISIBLE_FRACTION
                told = np.isin(present, messages.list_told(record.ids[ego], tick))
                rings = (distances // RING_M).astype(np.int64)
                for counts, mask in (
                    (self.relevant, relevant),
                    (self.seen, relevant & seen),
                    (self.told, relevant & told),
                    (self.known, relevant & (seen | told)),
                ):
                    counts.update(rings[mask].tolist())

    def compute_ratio(self, counts: Counter[int]) -> float | None:
        """Return the share of relevant road users that are in these counts; None without any."""
        total = self.relevant.total()
        return counts.total() / total if total else None


class _ToldRoadUsers:
    """Of which road users each CAV was told."""

    def __init__(self, record: EpisodeRecord) -> None:
        self._record = record
        self._arrivals: dict[str, list[tuple[int, int, int]]] = {}
        """By receiver: tick of arrival, tick of sending, index of the message; in the order of arrival."""
        self._told: dict[int, list[int]] = {}
        for i, sent in enumerate(record.messages):
            if sent.message.type in (CAM, CPM):
                for receiver, delivery in sent.deliveries.items():
                    if delivery.status is DeliveryStatus.DELIVERED:
                        self._arrivals.setdefault(receiver, []).append((delivery.tick, sent.message.tick, i))
        for arrivals in self._arrivals.values():
            arrivals.sort()

    @cached_property
    def _column(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self._record.ids)}

    def list_told(self, receiver: str, tick: int) -> list[int]:
        """Return the columns of road users that fresh messages told the receiver of."""
        told: set[int] = set()
        for arrival, sent_tick, i in self._arrivals.get(receiver, ()):
            if arrival > tick:
                break
            if tick - sent_tick <= FRESH_TICKS:
                told.update(self._find_told(i))
        return sorted(told)

    def _find_told(self, i: int) -> list[int]:
        """Return the columns that a message tells of: its sender, and the road users of its objects."""
        if i not in self._told:
            sent = self._record.messages[i]
            sender = self._column.get(sent.message.sender)
            told = [] if sender is None else [sender]
            self._told[i] = told + (self._match_objects(sent) if sent.message.type == CPM else [])
        return self._told[i]

    def _match_objects(self, sent: SentMessage) -> list[int]:
        """Return the road users that were where the objects of a CPM were measured."""
        record = self._record
        try:
            cpm = decode(sent.message)
        except MessageError:
            return []
        if not isinstance(cpm, Cpm):
            return []
        matched: list[int] = []
        for x, y, age in zip(cpm.objects.x.tolist(), cpm.objects.y.tolist(), cpm.age.tolist(), strict=True):
            tick = min(max(cpm.pose.tick - age, 0), record.ticks - 1)
            present = np.flatnonzero(record.valid[tick])
            if not len(present):
                continue
            gaps = portable.hypot(record.x[tick, present] - x, record.y[tick, present] - y)
            nearest = int(gaps.argmin())
            column = int(present[nearest])
            if gaps[nearest] <= max(SAME_USER_M, record.length[column] / 2):
                matched.append(column)
        return matched
