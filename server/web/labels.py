"""Tracks as people read them."""

from collections.abc import Mapping

from server.enums import Track

TRACKS: Mapping[Track, tuple[str, str]] = {
    Track.SINGLE: ("Single agent", "each vehicle for itself, without messages"),
    Track.SHARING: ("Perception sharing", "vehicles and road-side units send what they perceive (CAM and CPM)"),
    Track.NEGOTIATION: ("Negotiation", "every message arrives, also manoeuvres, texts and types of your own"),
    Track.JOINT: ("Joint", "one program drives all vehicles: no limit of communication holds, so it is ranked apart"),
}
"""Name, and what it allows."""
