"""CAMs as ETSI EN 302 637-2 V1.4.1 encodes them; the ASN.1 types are those that pycrate ships."""

import math
from typing import Any

from pycrate_asn1dir.ITS_CAM_2 import CAM_PDU_Descriptions

from mdrive_sumo.export.etsi_values import (
    PASSENGER_CAR,
    ROADSIDE_UNIT,
    UNAVAILABLE_ALTITUDE,
    clamp,
    place_front,
    place_on_earth,
    to_confidence,
    to_delta_time,
    to_ellipse_axis,
    to_heading,
)
from mdrive_sumo.v2x.messages import Cam

PROTOCOL_VERSION, MESSAGE_ID = 2, 2


def encode_etsi_cam(cam: Cam, station: int, *, roadside: bool) -> bytes:
    """Return a CAM in UPER. station: its ETSI station id, 32 bits."""
    high_frequency = ("rsuContainerHighFrequency", {}) if roadside else _describe_motion(cam)
    message = {
        "header": {"protocolVersion": PROTOCOL_VERSION, "messageID": MESSAGE_ID, "stationID": station},
        "cam": {
            "generationDeltaTime": to_delta_time(cam.pose.tick),
            "camParameters": {
                "basicContainer": {
                    "stationType": ROADSIDE_UNIT if roadside else PASSENGER_CAR,
                    "referencePosition": describe_position(
                        *place_front(cam.pose, 0.0 if roadside else cam.length), cam.pose.position_sigma
                    ),
                },
                "highFrequencyContainer": high_frequency,
                **_describe_path(cam),
            },
        },
    }
    CAM_PDU_Descriptions.CAM.set_val(message)
    encoded = CAM_PDU_Descriptions.CAM.to_uper()
    assert isinstance(encoded, bytes), "expected the bytes of a CAM"
    return encoded


def describe_position(x: float, y: float, sigma: float) -> dict[str, Any]:
    """Return the reference position of a point [m] of the network; sigma: standard deviation of x and of y [m]."""
    place = place_on_earth(x, y)
    axis = to_ellipse_axis(sigma)
    return {
        "latitude": place.latitude,
        "longitude": place.longitude,
        "positionConfidenceEllipse": {
            "semiMajorConfidence": axis,
            "semiMinorConfidence": axis,
            "semiMajorOrientation": 0,
        },
        "altitude": {"altitudeValue": UNAVAILABLE_ALTITUDE, "altitudeConfidence": "unavailable"},
    }


def _describe_path(cam: Cam) -> dict[str, Any]:
    """Return the low-frequency container with the path history, each point relative to the one before; {} without."""
    if cam.path_history is None:
        return {}
    before = place_on_earth(*place_front(cam.pose, cam.length))
    points: list[dict[str, Any]] = []
    for x, y in cam.path_history.tolist():
        place = place_on_earth(x, y)
        position = {
            "deltaLatitude": clamp(place.latitude - before.latitude, -131_071, 131_071),
            "deltaLongitude": clamp(place.longitude - before.longitude, -131_071, 131_071),
            "deltaAltitude": 12_800,  # unavailable
        }
        points.append({"pathPosition": position})
        before = place
    vehicle = {"vehicleRole": "default", "exteriorLights": (0, 8), "pathHistory": points}
    return {"lowFrequencyContainer": ("basicVehicleContainerLowFrequency", vehicle)}


def _describe_motion(cam: Cam) -> tuple[str, dict[str, Any]]:
    """Return the high-frequency container of a vehicle. Its heading is that of travel, also backwards."""
    backwards = cam.speed < 0.0
    return "basicVehicleContainerHighFrequency", {
        "heading": {
            "headingValue": to_heading(cam.pose.yaw + (math.pi if backwards else 0.0)),
            "headingConfidence": to_confidence(math.degrees(cam.pose.yaw_sigma), 0.1),
        },
        "speed": {
            "speedValue": clamp(abs(cam.speed) * 100, 0, 16_382),
            "speedConfidence": to_confidence(cam.speed_sigma, 0.01),
        },
        "driveDirection": "backward" if backwards else "forward",
        "vehicleLength": {
            "vehicleLengthValue": clamp(cam.length * 10, 1, 1022),
            "vehicleLengthConfidenceIndication": "noTrailerPresent",
        },
        "vehicleWidth": clamp(cam.width * 10, 1, 61),
        "longitudinalAcceleration": {
            "longitudinalAccelerationValue": clamp(cam.acceleration * 10, -160, 160),
            "longitudinalAccelerationConfidence": 102,  # unavailable
        },
        "curvature": {"curvatureValue": 1023, "curvatureConfidence": "unavailable"},
        "curvatureCalculationMode": "unavailable",
        "yawRate": {
            "yawRateValue": clamp(math.degrees(cam.yaw_rate) * 100, -32_766, 32_766),
            "yawRateConfidence": "unavailable",
        },
    }
