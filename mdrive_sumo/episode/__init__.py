"""The recorded episode: what happened, at the one resolution in which it is scored, stored and compared."""

from mdrive_sumo.episode.episode import (
    Ending,
    EpisodeRecord,
    NoteRecord,
    PlanRecord,
    ReceivedMessages,
    SignalChange,
    ThinkTime,
)
from mdrive_sumo.episode.episode_file import load_episode, save_episode
from mdrive_sumo.episode.quantization import quantised_frame
from mdrive_sumo.episode.recorder import Recorder

__all__ = [
    "Ending",
    "EpisodeRecord",
    "ReceivedMessages",
    "NoteRecord",
    "ThinkTime",
    "PlanRecord",
    "SignalChange",
    "Recorder",
    "load_episode",
    "quantised_frame",
    "save_episode",
]
