"""The motion of a take from tick 0 on, as one block of bytes for scrubbing in a page (`/takes/{n}/motion`).

    u32                  length H of the header, a multiple of 4
    H bytes              JSON, padded with spaces: `take`, `ticks`, `origin` [x, y], `cavs` [ids], `names` (rows of the
                         table of names, as in frames), `signals` [[tick, light, letters], ...] (every change, in order)
    u32 x (ticks + 1)    number of the first row of each tick, and of all rows
    rows x 20 bytes      rows of all ticks, `protocol.ROW`, as in frames

All numbers are little-endian. Names and rows are complete in themselves: numbers differ from those of frames.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.state import Frame
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.episode.recorded_frame import rebuild_frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.prepared_run import recording_path
from server.drive.message_socket import MessageSocket
from server.drive.protocol import ROW_BYTES
from server.drive.worker.drive_context import DriveContext
from server.drive.worker.frame_builder import FrameBuilder, Origin
from server.drive.worker.orders import MotionLoaded

MAX_CACHED_BYTES = 2**26
"""64 MB: the motions of 40 takes of a minute with 90 road users."""


class MotionCache:
    """The motions of the takes that were finished last: to build one from a recording of a minute takes a second."""

    def __init__(self, limit_bytes: int = MAX_CACHED_BYTES) -> None:
        self._limit = limit_bytes
        self._motions: dict[int, bytes] = {}

    def add(self, take: int, motion: bytes) -> None:
        """Keep a motion; drop the oldest ones if there are too many bytes."""
        self._motions[take] = motion
        while sum(map(len, self._motions.values())) > self._limit:
            del self._motions[next(iter(self._motions))]

    def find(self, take: int) -> bytes | None:
        """Return a motion, None if it is not kept."""
        return self._motions.get(take)


def pack_motion(take: int, frames: FrameBuilder, cavs: Sequence[str]) -> bytes:
    """Return the motion of all ticks that were added."""
    header = {
        "take": take,
        "ticks": len(frames.rows),
        "origin": frames.origin,
        "cavs": list(cavs),
        "names": frames.names,
        "signals": frames.signals,
    }
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    counts = [len(rows) // ROW_BYTES for rows in frames.rows]
    begins = np.concatenate(([0], np.cumsum(counts, dtype=np.int64))).astype("<u4")
    return b"".join((len(text).to_bytes(4, "little"), text, begins.tobytes(), *frames.rows))


def make_motion_sender(context: DriveContext, folder: Path, take: int) -> Callable[[MessageSocket], None]:
    """Return what sends the motion of a finished take. Raises InputError without recording."""
    path = recording_path(folder, context.scenario.id)
    if not path.is_file():
        raise InputError(f"take {take}: expected the recording of a finished take, found none in {folder}")

    def send_motion(connection: MessageSocket) -> None:
        motion = pack_recorded_motion(take, load_episode(path), context.roads, context.origin)
        connection.send(MotionLoaded(take, motion))

    return send_motion


def pack_recorded_motion(take: int, record: EpisodeRecord, roads: RoadMap, origin: Origin) -> bytes:
    """Return the motion of a recording."""
    frames = FrameBuilder(roads, origin)
    changes: dict[int, dict[str, str]] = {}
    for entry in record.signals:
        changes.setdefault(entry.tick, {})[entry.light] = entry.state
    letters: dict[str, str] = {}
    for tick in range(record.ticks):
        if tick in changes:
            letters = letters | changes[tick]
        frame = rebuild_frame(record, tick)
        frames.add(build_frozen(Frame, tick, frame.egos, frame.actors, letters, ()))
    return pack_motion(take, frames, record.ego_ids)
