"""Tracks as people read them."""

from collections.abc import Mapping

from server.enums import ChallengeTrack

TRACK_LABELS: Mapping[ChallengeTrack, tuple[str, str]] = {
    ChallengeTrack.SINGLE: ("Single agent", "each vehicle for itself, without messages"),
    ChallengeTrack.SHARING: (
        "Perception sharing",
        "vehicles and road-side units send what they perceive (CAM and CPM)",
    ),
    ChallengeTrack.NEGOTIATION: ("Negotiation", "every message arrives, also manoeuvres, texts and types of your own"),
    ChallengeTrack.JOINT: (
        "Joint",
        "one program drives all vehicles: no limit of communication holds, so it is ranked apart",
    ),
}
"""Name, and what it allows."""
