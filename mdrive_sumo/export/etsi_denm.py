"""DENMs as ETSI EN 302 637-3 V1.3.1 encodes them; the ASN.1 types are those that pycrate ships."""

import math
from typing import Any

from pycrate_asn1dir.ITS_DENM_3 import DENM_PDU_Descriptions

from mdrive_sumo.export.etsi_values import (
    MS_PER_TICK,
    PASSENGER_CAR,
    UNAVAILABLE_ALTITUDE,
    clamp,
    place_on_earth,
    to_confidence,
    to_heading,
)
from mdrive_sumo.v2x.messages import Denm, Termination

PROTOCOL_VERSION, MESSAGE_ID = 2, 1
LONGEST_VALIDITY_S = 86_400


def encode_etsi_denm(denm: Denm, station: int) -> bytes:
    """Return a DENM in UPER. station: the ETSI station id of its sender, 32 bits.

    A cancellation has the management container alone (EN 302 637-3, 8.2.1).
    """
    has_ended = denm.termination is Termination.CANCELLATION
    message = {
        "header": {"protocolVersion": PROTOCOL_VERSION, "messageID": MESSAGE_ID, "stationID": station},
        "denm": {"management": _describe_event(denm, station)} | ({} if has_ended else _describe_situation(denm)),
    }
    DENM_PDU_Descriptions.DENM.set_val(message)
    encoded = DENM_PDU_Descriptions.DENM.to_uper()
    assert isinstance(encoded, bytes), "expected the bytes of a DENM"
    return encoded


def _describe_event(denm: Denm, station: int) -> dict[str, Any]:
    """Return the management container. ETSI counts validity in whole seconds: it is rounded up."""
    place = place_on_earth(denm.x, denm.y)
    ended = {"termination": "isCancellation"} if denm.termination is Termination.CANCELLATION else {}
    return ended | {
        "actionID": {"originatingStationID": station, "sequenceNumber": denm.sequence},
        "detectionTime": denm.detection_tick * MS_PER_TICK,
        "referenceTime": denm.pose.tick * MS_PER_TICK,
        "eventPosition": {
            "latitude": place.latitude,
            "longitude": place.longitude,
            "positionConfidenceEllipse": {
                "semiMajorConfidence": 4095,  # unavailable, as the next two
                "semiMinorConfidence": 4095,
                "semiMajorOrientation": 3601,
            },
            "altitude": {"altitudeValue": UNAVAILABLE_ALTITUDE, "altitudeConfidence": "unavailable"},
        },
        "validityDuration": clamp(math.ceil(denm.validity_s), 0, LONGEST_VALIDITY_S),
        "stationType": PASSENGER_CAR,
    }


def _describe_situation(denm: Denm) -> dict[str, Any]:
    """Return what has happened, and how the sender moves; it states no trace."""
    return {
        "situation": {
            "informationQuality": 0,  # unavailable
            "eventType": {"causeCode": int(denm.cause), "subCauseCode": denm.sub_cause},
        },
        "location": {
            "eventSpeed": {"speedValue": clamp(abs(denm.speed) * 100, 0, 16_382), "speedConfidence": 127},
            "eventPositionHeading": {
                "headingValue": to_heading(denm.pose.yaw),
                "headingConfidence": to_confidence(math.degrees(denm.pose.yaw_sigma), 0.1),
            },
            "traces": [[]],
        },
    }
