"""Load of the V2X channel: informative, no part of any score."""

from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.metric import ScalarMetric
from mdrive_sumo.v2x.message_counts import count_bytes


def compute_message_rate(episode: EpisodeRecord) -> float:
    """Return the payload bytes that all stations together send in a second; a message to many counts once.

    Malformed messages, which the channel never transmits, do not count.
    """
    return count_bytes(episode.messages) / (episode.ticks * DT)


MESSAGE_RATE = ScalarMetric("message_rate", "messages [B/s]", lambda scored: compute_message_rate(scored.episode), 0)
