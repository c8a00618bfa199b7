"""Tracks: which messages the CAVs of an agent may exchange. The channel enforces it, whatever the agent declares.

single-agent         the channel is off: no messages, none of road-side units either
perception-sharing   CAM, CPM and features arrive; texts, manoeuvres (MCM), warnings (DENM) and own types are lost
negotiation          everything arrives
joint                one program for all CAVs, which needs no messages; they arrive nevertheless
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mdrive_sumo.contract import SensingTrack, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.sensing.lidar_sensor import HIT_IDS
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, find_object_source
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.content import CAM, CPM, FEATURE
from server.enums import ChallengeTrack

_LOST = LinkSettings(loss=1.0)
_SHARED = MappingProxyType({CAM: LinkSettings(), CPM: LinkSettings(), FEATURE: LinkSettings()})
COMM_BY_TRACK: Mapping[ChallengeTrack, CommSettings] = MappingProxyType(
    {
        ChallengeTrack.SINGLE: PRESETS["off"],
        ChallengeTrack.SHARING: CommSettings(link=_LOST, by_type=_SHARED),
        ChallengeTrack.NEGOTIATION: PRESETS["ideal"],
        ChallengeTrack.JOINT: PRESETS["ideal"],
    }
)
"""The V2X channel of each track; ideal but for what is forbidden, as in the paper."""
TRACK_LABELS: Mapping[ChallengeTrack, tuple[str, str]] = {
    ChallengeTrack.SINGLE: ("Single agent", "each vehicle for itself, without messages"),
    ChallengeTrack.SHARING: (
        "Perception sharing",
        "vehicles and road-side units send what they perceive (CAM, CPM, features)",
    ),
    ChallengeTrack.NEGOTIATION: ("Negotiation", "every message arrives, also manoeuvres, texts and types of your own"),
    ChallengeTrack.JOINT: (
        "Joint",
        "one program drives all vehicles: no limit of communication holds, so it is ranked apart",
    ),
}
"""Display name of each track, and what it allows."""


SENSING_LABELS: Mapping[SensingTrack, tuple[str, str]] = {
    SensingTrack.OBJECT: ("Object track", "the evaluator gives the agent lists of objects (objects, bev)"),
    SensingTrack.SENSOR: (
        "Sensor track",
        "only what a car carries: LiDAR, GNSS, IMU, speedometer, map and messages, no lists of objects",
    ),
}
"""Display name of each sensing track, and what it means. It follows from what the agent declares in its episodes."""


def check_sensing(sensors: Sequence[SensorSpec], *, sensor_track_only: bool) -> None:
    """Raises InputError, for the participant, for a sensor that gives objects in a phase of the sensor track."""
    if sensor_track_only and (source := find_object_source(sensors)):
        carried = ", ".join(name for name in SENSOR_KINDS if not find_object_source([SensorSpec(name)]))
        raise InputError(
            f"sensor {source:.60}: expected sensors of the sensor track, which this phase is for ({carried}"
            f" without {HIT_IDS}), found one that lists objects"
        )


def check_style(style: str, track: ChallengeTrack) -> None:
    """Raises InputError, for the participant, if an agent of that style (of its `Manifest`) may not be in the track."""
    if (style == "joint") == (track is ChallengeTrack.JOINT):
        return
    kind = "an agent for each CAV" if style != "joint" else "one agent for all CAVs"
    wanted = (
        "one agent for all CAVs (get_entry_point)"
        if track is ChallengeTrack.JOINT
        else "an agent for each CAV (class Agent)"
    )
    raise InputError(f"track {track}: expected {wanted} in agents.py, found {kind}")
