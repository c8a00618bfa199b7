"""The recorded episode, at the resolution in which it is scored, stored and compared."""

from mdrive_sumo.episode.episode import (
    ATTACKERS,
    SENSING_TRACK,
    Ending,
    EpisodeRecord,
    NoteRecord,
    PlanRecord,
    ReceivedMessages,
)
from mdrive_sumo.episode.episode_file import drop_payloads, load_episode, save_episode
from mdrive_sumo.episode.episode_schema import SignalEntry, ThinkTimeEntry, build_episode_schema
from mdrive_sumo.episode.quantization import quantize_frame
from mdrive_sumo.episode.recorded_frame import rebuild_frame
from mdrive_sumo.episode.recorder import Recorder

__all__ = [
    "ATTACKERS",
    "SENSING_TRACK",
    "Ending",
    "EpisodeRecord",
    "ReceivedMessages",
    "NoteRecord",
    "ThinkTimeEntry",
    "PlanRecord",
    "SignalEntry",
    "Recorder",
    "build_episode_schema",
    "drop_payloads",
    "load_episode",
    "quantize_frame",
    "rebuild_frame",
    "save_episode",
]
