"""Camera images of a replay page, as one block of JSON that no name of a camera can break out of."""

import base64
import json
from collections.abc import Sequence
from typing import Any

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.camera_archive import CameraTrack

MAX_PAGE_BYTES = 12 * 2**20
"""Of all images of a page; of more, every second, third ... image is shown."""


def pack_camera_images(episode: EpisodeRecord, tracks: Sequence[CameraTrack]) -> str:
    """Return the images of the CAVs of an episode; "" without any."""
    of_cavs = [track for track in tracks if track.ego in episode.ego_ids and track.images]
    size = sum(len(image) for track in of_cavs for image in track.images.values())
    step = -(-size // MAX_PAGE_BYTES)
    packed = [_pack_track(episode, track, step) for track in of_cavs]
    return json.dumps(packed, separators=(",", ":")).replace("<", "\\u003c") if packed else ""


def _pack_track(episode: EpisodeRecord, track: CameraTrack, step: int) -> dict[str, Any]:
    ticks = [tick for tick in sorted(track.images) if tick < episode.ticks][::step]
    images = [{"tick": tick, "jpeg": base64.b64encode(track.images[tick]).decode()} for tick in ticks]
    return {"ego": episode.ego_ids.index(track.ego), "camera": track.camera, "images": images}
