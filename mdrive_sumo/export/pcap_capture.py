"""Capture files (pcap): the messages of a recording as frames of ETSI ITS, for Wireshark and other tools."""

import hashlib
import json
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.export.etsi_cam import encode_etsi_cam
from mdrive_sumo.export.etsi_cpm import CpmSender, encode_etsi_cpm
from mdrive_sumo.export.etsi_denm import encode_etsi_denm
from mdrive_sumo.export.etsi_values import (
    MS_PER_TICK,
    PASSENGER_CAR,
    ROADSIDE_UNIT,
    SIGMAS_95_PLANE,
    place_on_earth,
    to_heading,
)
from mdrive_sumo.export.geonetworking import FrameSender, build_frame, make_mac
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.v2x.channel import NOT_TRANSMITTED, DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import Cam, Content, Cpm, Denm, MessageError, ReferencePose, decode

MAGIC, VERSION, SNAP_BYTES, ETHERNET = 0xA1B2C3D4, (2, 4), 65_535, 1
"""Of a pcap file with microseconds, and its link type."""


PSEUDONYM = re.compile(r"[0-9a-f]{8}")


class _Frame(NamedTuple):
    tick: int
    data: bytes


def write_pcap(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write SCENARIO.pcap and SCENARIO.stations.json per recording.

    Raises InputError for a recording without a message that ETSI has a format for.
    """
    for recording in recordings:
        capture = _Capture(recording)
        frames = list(capture.list_frames())
        if not frames:
            raise InputError(
                f"export: {recording.name}: expected a recording with CAMs, CPMs or DENMs that were transmitted, found"
                f" {_describe_counts(capture.left_out)}"
            )
        write_bytes(folder / f"{recording.name}.pcap", _pack_file(frames))
        write_text(folder / f"{recording.name}.stations.json", json.dumps(capture.describe(), indent=1) + "\n")


def _describe_counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "no message"


def _pack_file(frames: Iterable[_Frame]) -> bytes:
    """Return the file; the frames of one tick are a microsecond apart, in the order of sending."""
    parts = [struct.pack("<IHHiIII", MAGIC, *VERSION, 0, 0, SNAP_BYTES, ETHERNET)]
    placed: Counter[int] = Counter()
    for tick, data in frames:
        seconds, ms = divmod(tick * MS_PER_TICK, 1000)
        parts.append(struct.pack("<IIII", seconds, ms * 1000 + placed[tick], len(data), len(data)))
        parts.append(data)
        placed[tick] += 1
    return b"".join(parts)


class _Capture:
    """The frames of one recording, its stations, and what has no frame."""

    def __init__(self, recording: ScoredRecording) -> None:
        self._record = recording.record
        self._pseudonyms = {real: pseudonym for pseudonym, real in recording.record.pseudonyms.items()}
        self._column = {ego: i for i, ego in enumerate(recording.record.ego_ids)}
        self._stations = {
            sent.message.sender: self._find_station(sent.message.sender) for sent in self._record.messages
        }
        self._object_ids: dict[str, dict[str, int]] = {}
        self.left_out: Counter[str] = Counter()
        """Messages without a frame, by type or by why they were not transmitted."""

    def _find_station(self, sender: str) -> int:
        """Return the ETSI station id: the pseudonym, which is one of 32 bits; of a station without one, a hash."""
        pseudonym = self._pseudonyms.get(sender, "")
        if PSEUDONYM.fullmatch(pseudonym):
            return int(pseudonym, 16)
        return int.from_bytes(hashlib.blake2b(sender.encode(), digest_size=4).digest(), "big")

    def list_frames(self) -> Iterator[_Frame]:
        """Yield all frames in the order of sending."""
        for sent in self._record.messages:
            if sent.message.tick < 0:
                raise InputError(f"export: expected messages from tick 0 on, found one of tick {sent.message.tick}")
            if (reason := _find_reason(sent)) is not None:
                self.left_out[f"{sent.message.type} ({reason})"] += 1
                continue
            try:
                content = decode(sent.message)
            except MessageError:  # a type of the agents' own
                content = ""
            packets = list(self._encode(sent, content))
            if not packets:
                self.left_out[sent.message.type] += 1
            for payload, sender in packets:
                yield _Frame(sent.message.tick, build_frame(sent.message.type, payload, sender))

    def _encode(self, sent: SentMessage, content: Content) -> Iterator[tuple[bytes, FrameSender]]:
        """Yield the packets of a message with their senders; nothing if ETSI has no format for it here."""
        station = self._stations[sent.message.sender]
        roadside = sent.message.sender not in self._column
        if isinstance(content, Cam):
            yield (
                encode_etsi_cam(content, station, roadside=roadside),
                self._describe_sender(station, content.pose, roadside, content.speed),
            )
        elif isinstance(content, Denm):
            yield (
                encode_etsi_denm(content, station),
                self._describe_sender(station, content.pose, roadside, content.speed),
            )
        elif isinstance(content, Cpm):
            payloads = encode_etsi_cpm(content, self._describe_cpm_sender(sent, content))
            for payload in payloads:
                yield payload, self._describe_sender(station, content.pose, content.roadside, 0.0)

    def _describe_sender(self, station: int, pose: ReferencePose, roadside: bool, speed: float) -> FrameSender:
        return FrameSender(
            station,
            ROADSIDE_UNIT if roadside else PASSENGER_CAR,
            place_on_earth(pose.x, pose.y),
            pose.tick * MS_PER_TICK,
            speed,
            to_heading(pose.yaw),
            pose.position_sigma * SIGMAS_95_PLANE,
        )

    def _describe_cpm_sender(self, sent: SentMessage, cpm: Cpm) -> CpmSender:
        sender, record = sent.message.sender, self._record
        column = self._column.get(sender)
        size = (0.0, 0.0) if column is None else (float(record.length[column]), float(record.width[column]))
        known = self._object_ids.setdefault(sender, {})
        for name in cpm.objects.ids:
            known.setdefault(name, len(known) % 256)  # ETSI's ids have 8 bits, ours 32
        return CpmSender(self._stations[sender], *size, tuple(known[name] for name in cpm.objects.ids))

    def describe(self) -> dict[str, object]:
        """Return which station is which, and how many messages are left out."""
        return {
            "stations": {
                sender: {"station_id": station, "mac": make_mac(station).hex(":")}
                for sender, station in sorted(self._stations.items())
            },
            "left_out": dict(sorted(self.left_out.items())),
        }


def _find_reason(sent: SentMessage) -> DeliveryStatus | None:
    """Return why a message was not transmitted; None if it was."""
    first = next(iter(sent.deliveries.values()), None)  # of all receivers, or of none
    return first.status if first is not None and first.status in NOT_TRANSMITTED else None
