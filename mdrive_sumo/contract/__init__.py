"""What crosses the border between the benchmark and an agent: plain scalars, strings and arrays.

An agent is one object for one CAV. It is asked once for its `SensorSpec`s, is given one `Briefing`, and then answers
every `Observation` (20 Hz) with one `Reply`. Nothing here needs more than numpy, because it also crosses process and
machine borders; `schema()` publishes the same facts as data (`mdrive-sumo schema contract`).

Frames: world frame of the network, metres, seconds, radians counter-clockwise from +x; a pose is the box centre.
"""

from mdrive_sumo.contract.briefing import Briefing, JunctionControl, JunctionKind, StopSign, TrafficLight, VehicleFacts
from mdrive_sumo.contract.exchange import (
    DRIVER,
    EXCHANGE,
    LABELS,
    REMARK,
    STANDSTILL,
    Agent,
    Control,
    Message,
    Note,
    Observation,
    OwnState,
    Plan,
    Privileged,
    Reply,
    check_sensors,
    read_label,
    read_sensors,
)
from mdrive_sumo.contract.reason import MAX_OTHER_NAME, MAX_OTHERS, REASON, Cause, Reason, ReasonLog
from mdrive_sumo.contract.reply_check import (
    CONTROL_STEP,
    MAX_DETECTIONS,
    MAX_MESSAGES,
    MAX_NOTES,
    MAX_PLAN_POINTS,
    NAME,
    ReplyError,
    check_reply,
)
from mdrive_sumo.contract.schema import CONTRACT, schema
from mdrive_sumo.contract.sensors import (
    CameraImage,
    Detections,
    Gnss,
    Imu,
    Objects,
    PointCloud,
    Raster,
    SemanticClass,
    SensingTrack,
    SensorSpec,
    TrackName,
    join_sensing_tracks,
)

__all__ = [
    "Detections",
    "Gnss",
    "Imu",
    "Objects",
    "PointCloud",
    "CameraImage",
    "SemanticClass",
    "Raster",
    "SensorSpec",
    "SensingTrack",
    "TrackName",
    "join_sensing_tracks",
    "Briefing",
    "JunctionControl",
    "JunctionKind",
    "StopSign",
    "TrafficLight",
    "VehicleFacts",
    "DRIVER",
    "EXCHANGE",
    "LABELS",
    "REMARK",
    "STANDSTILL",
    "Agent",
    "Control",
    "Message",
    "Note",
    "Observation",
    "OwnState",
    "Plan",
    "Privileged",
    "MAX_OTHER_NAME",
    "MAX_OTHERS",
    "REASON",
    "Cause",
    "Reason",
    "ReasonLog",
    "Reply",
    "read_label",
    "check_sensors",
    "read_sensors",
    "CONTROL_STEP",
    "MAX_DETECTIONS",
    "MAX_MESSAGES",
    "MAX_NOTES",
    "MAX_PLAN_POINTS",
    "NAME",
    "ReplyError",
    "check_reply",
    "CONTRACT",
    "schema",
]
