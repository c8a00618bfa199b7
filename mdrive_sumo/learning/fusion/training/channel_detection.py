"""detect_over_channel: the boxes that a detector finds when maps travel as messages over a channel."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes, merge_boxes
from mdrive_sumo.agents.learned.fusion_network import EncodedScan
from mdrive_sumo.agents.learned.fusion_spec import (
    DELAYS_TICKS,
    FEATURE_CELL_M,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FUSIONS,
    GRID_VERSION,
    LEAST_CONFIDENCE,
    MAX_CAVS,
    TILE_CELLS,
)
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.sharing_channels import ArrivedMap, SharingChannel, find_arrived, list_map_delays
from mdrive_sumo.learning.fusion.training.detect_frames import answer_own, decode_answer
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore
from mdrive_sumo.v2x.feature_map import assemble_feature_map, encode_feature_map
from mdrive_sumo.v2x.messages import Feature, FeatureGrid, ReferencePose, decode

GRID = FeatureGrid(
    "measured", GRID_VERSION, FEATURE_CELL_M, FEATURE_CELLS, FEATURE_CELLS, FEATURE_CHANNELS, tile_cells=TILE_CELLS
)
CPM_BYTES, BOX_BYTES = 23, 21
"""A CPM without free sight, and each object of it (docs/v2x.md)."""
BATCH = 16
"""Frames whose maps are in memory at once."""


@dataclass(frozen=True, slots=True)
class SentMap:
    """What a car made of a scan, and its packets."""

    sizes: tuple[int, ...]
    """Bytes of the payload of each packet."""
    packets: tuple[Feature, ...] = ()
    scan: EncodedScan | None = None
    boxes: DetectedBoxes | None = None
    """Of late fusion."""


@dataclass(slots=True)
class ChannelUse:
    """What was sent and what of it arrived, in sums over senders of frames."""

    senders: int = 0
    heard: int = 0
    """Senders of which something arrived in time."""
    sent_bytes: int = 0
    """Payloads within the budget, of the newest maps."""
    age_ticks: int = 0
    """Sum over the senders that were heard."""
    tiles: int = 0
    """Packets of the newest maps within the budget."""
    arrived: int = 0
    """Those that were used, of maps of any age."""

    def describe(self) -> dict[str, float]:
        """Return bytes of a map, and the shares and the mean age of what arrived."""
        heard = max(self.heard, 1)
        return {
            "map_bytes": self.sent_bytes / max(self.senders, 1),
            "heard": self.heard / max(self.senders, 1),
            "age_ms": 1e3 * self.age_ticks / heard / TICKS_PER_SECOND,
            "packets_arrived": self.arrived / max(self.tiles, 1),
        }


@dataclass(slots=True)
class ChannelDetections:
    """Boxes of every frame over one channel."""

    found: list[DetectedBoxes] = field(default_factory=list[DetectedBoxes])
    use: ChannelUse = field(default_factory=ChannelUse)


def detect_over_channels(
    network: FusionNetwork,
    frames: FusionFrames,
    store: FrameStore,
    channels: Sequence[SharingChannel],
    is_late: bool = False,
) -> dict[str, ChannelDetections]:
    """Return the boxes of every frame by the name of each channel, with true poses.

    network: of FUSIONS, or a `none` for late fusion. store: of the same frames.
    """
    found = {channel.name: ChannelDetections() for channel in channels}
    delays = sorted({delay for channel in channels for delay in list_map_delays(channel)})
    for begin in range(0, len(frames), BATCH):
        rows = range(begin, min(begin + BATCH, len(frames)))
        maps = _make_maps(network, store, _list_scans(frames, rows, delays), is_late)
        for channel in channels:
            arrived = [_send(frames, row, channel, maps, found[channel.name].use) for row in rows]
            found[channel.name].found += (
                [_merge_late(frames, row, one, maps) for row, one in zip(rows, arrived, strict=True)]
                if is_late
                else _fuse(network, frames, rows, arrived, maps, store.device)
            )
    return found


def measure_point_bytes(frames: FusionFrames) -> float:
    """Return the mean bytes of a sender's newest scan as early fusion shares it, by zlib: no codec of ours has it."""
    scans = frames.scan[:, 1:, 0]
    sizes = [
        len(zlib.compress(np.diff(frames.get_scan(int(scan)), prepend=np.uint32(0)).tobytes(), 9))
        for scan in np.unique(scans[scans >= 0])
    ]
    return float(np.mean(sizes)) if sizes else 0.0


def _list_scans(frames: FusionFrames, rows: range, delays: Sequence[int]) -> list[int]:
    """Return the scans that cars of some frames share, and the own ones."""
    scans = frames.scan[rows.start : rows.stop][:, :, list(delays)]
    return np.unique(scans[scans >= 0]).tolist()


def _make_maps(network: FusionNetwork, store: FrameStore, scans: list[int], is_late: bool) -> dict[int, SentMap]:
    """Return what cars make of scans, by scan."""
    made: dict[int, SentMap] = {}
    for begin in range(0, len(scans), 4 * BATCH):
        part = scans[begin : begin + 4 * BATCH]
        grids = store.build_grids(torch.tensor(part, device=store.device))
        with torch.no_grad():
            if is_late:
                for scan, boxes in zip(part, decode_answer(answer_own(network, grids)), strict=True):
                    made[scan] = SentMap((CPM_BYTES + BOX_BYTES * len(boxes.scores),), boxes=boxes)
                continue
            features, confidence = network.encoder(grids)
        arrays = features.float().cpu().numpy(), torch.sigmoid(confidence.float()).cpu().numpy()
        for scan, *encoded in zip(part, *arrays, strict=True):
            made[scan] = _encode(EncodedScan(*encoded))
    return made


def _encode(scan: EncodedScan) -> SentMap:
    pose = ReferencePose(0.0, 0.0, 0.0, 0)
    messages = encode_feature_map(scan.features, scan.confidence, pose, GRID, least_confidence=LEAST_CONFIDENCE)
    packets = [decode(message) for message in messages]
    features = tuple(packet for packet in packets if isinstance(packet, Feature))
    return SentMap(tuple(len(message.payload) for message in messages), features, scan)


def _send(
    frames: FusionFrames, row: int, channel: SharingChannel, maps: Mapping[int, SentMap], use: ChannelUse
) -> dict[int, ArrivedMap]:
    """Return what the own car has of each sender of a frame, and count it."""
    cars = np.flatnonzero(frames.scan[row, :, 0] >= 0).tolist()
    sizes = {
        car: {
            delay: maps[int(scan)].sizes[: channel.packets]
            for delay in (list_map_delays(channel) if car else (0,))
            if (scan := frames.scan[row, car, delay]) >= 0
        }
        for car in cars
    }
    arrived = find_arrived(frames, row, channel, sizes)
    for car in cars[1:]:
        use.senders += 1
        use.sent_bytes += sum(sizes[car][0])
        use.tiles += len(sizes[car][0])
        if car in arrived:
            use.heard += 1
            use.age_ticks += DELAYS_TICKS[arrived[car].delay]
            use.arrived += len(arrived[car].packets)
    return arrived


def _merge_late(
    frames: FusionFrames, row: int, arrived: Mapping[int, ArrivedMap], maps: Mapping[int, SentMap]
) -> DetectedBoxes:
    """Return the own boxes with those that arrived."""
    cars = [(0, 0), *((car, one.delay) for car, one in sorted(arrived.items()))]
    boxes = [maps[int(frames.scan[row, car, delay])].boxes for car, delay in cars]
    poses = np.array([frames.true_pose[row, car, delay] for car, delay in cars])
    return merge_boxes([each for each in boxes if each is not None], poses)


def _fuse(
    network: FusionNetwork,
    frames: FusionFrames,
    rows: range,
    arrived: Sequence[Mapping[int, ArrivedMap]],
    maps: Mapping[int, SentMap],
    device: torch.device,
) -> list[DetectedBoxes]:
    """Return the boxes of some frames, of the own features and the tiles that arrived."""
    cells = FEATURE_CELLS, FEATURE_CELLS
    features = np.zeros((len(rows), MAX_CAVS, FEATURE_CHANNELS, *cells), np.float32)
    there = np.zeros((len(rows), MAX_CAVS, *cells), np.float32)
    pose, age = np.zeros((len(rows), MAX_CAVS, 3), np.float32), np.zeros((len(rows), MAX_CAVS), np.float32)
    for i, row in enumerate(rows):
        own = maps[int(frames.scan[row, 0, 0])].scan
        assert own is not None, "maps of a fusion"
        features[i, 0], there[i, 0] = own.features, 1.0
        for car, one in arrived[i].items():
            packets = maps[int(frames.scan[row, car, one.delay])].packets
            received = assemble_feature_map([packets[number] for number in one.packets], GRID)
            features[i, car], there[i, car] = received.features, received.arrived
            pose[i, car] = frames.true_pose[row, car, one.delay]
            age[i, car] = DELAYS_TICKS[one.delay] / TICKS_PER_SECOND
    tensors = (torch.from_numpy(each).to(device) for each in (features, there, pose, age))
    with torch.no_grad():
        return decode_answer(network(*tensors))


def has_maps(detector: str) -> bool:
    """Return whether what a detector shares goes through `detect_over_channels`."""
    return detector in (*FUSIONS, "late")
