"""ETSI messages and frames: bits by hand, CAMs read back by pycrate, any content of ours fits into its fields."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from pycrate_asn1dir.ITS_CAM_2 import CAM_PDU_Descriptions
from pycrate_asn1dir.ITS_DENM_3 import DENM_PDU_Descriptions
from testing.message_samples import PLACE, cams, cpm_with, cpms, denms

from mdrive_sumo.export.etsi_cam import encode_etsi_cam
from mdrive_sumo.export.etsi_cpm import CpmSender, encode_etsi_cpm
from mdrive_sumo.export.etsi_denm import encode_etsi_denm
from mdrive_sumo.export.etsi_values import (
    LATITUDE_M,
    LONGITUDE_M,
    EarthPlace,
    place_front,
    place_on_earth,
    to_confidence,
    to_delta_time,
    to_ellipse_axis,
    to_heading,
)
from mdrive_sumo.export.geonetworking import FrameSender, build_frame
from mdrive_sumo.export.uper_writer import UperWriter
from mdrive_sumo.v2x.messages import Cam, Cpm, Denm, EventCause, ReferencePose, Termination, encode

MOST_BYTES = 1398
"""A GeoNetworking packet carries at most so many (EN 302 636-4-1, itsGnMaxSduSize), BTP's 4 among them."""


def test_bits_by_hand() -> None:
    """X.691: a number of -3 to 4 has 3 bits from its least; a flag one; the rest of the last byte is 0."""
    bits = UperWriter()
    bits.add_flags(True, False)
    bits.add_integer(2, -3, 4)  # 5 = 101
    bits.add_choice(2, 3)  # 10
    bits.add_integer(7, 7, 7)  # no bits
    bits.add_bits(0x5, 4)  # 0101
    assert bits.to_bytes() == bytes((0b10_101_10_0, 0b101_00000))
    assert UperWriter().to_bytes() == b""


@pytest.mark.parametrize(("value", "lowest", "highest"), [(5, 0, 4), (-1, 0, 4)])
def test_numbers_out_of_their_range_are_refused(value: int, lowest: int, highest: int) -> None:
    with pytest.raises(ValueError, match=f"expected a number from 0 to 4, found {value}"):
        UperWriter().add_integer(value, lowest, highest)
    with pytest.raises(ValueError, match="expected a value of 2 bits, found 4"):
        UperWriter().add_bits(4, 2)


def test_steps_by_hand() -> None:
    assert [to_heading(math.radians(yaw)) for yaw in (90, 0, -90, 180, 91)] == [0, 900, 1800, 2700, 3590]
    assert place_on_earth(LONGITUDE_M, -2 * LATITUDE_M) == EarthPlace(-20_000_000, 10_000_000)
    assert place_front(ReferencePose(10.0, 20.0, math.pi / 2, 0), 5.0) == pytest.approx((10.0, 22.5))
    # 95 % of a normal distribution lie within 1.96 standard deviations; in the plane within 2.45.
    assert [to_confidence(sigma, 0.01) for sigma in (0.0, 0.05, 0.6, 9.0)] == [1, 10, 118, 126]
    assert [to_ellipse_axis(sigma) for sigma in (0.0, 0.2, 99.0)] == [0, 49, 4094]
    assert [to_delta_time(tick) for tick in (0, 1, 1310, 1311)] == [0, 50, 65_500, 14]


def test_a_cam_by_hand() -> None:
    pose = ReferencePose(0.0, 0.0, math.pi, 3, 0.2, 0.01)
    decoded = decode_cam(encode_etsi_cam(Cam(pose, -2.0, -1.5, 0.1, 4.9, 2.0, 0.1), 7, roadside=False))
    assert decoded["header"] == {"protocolVersion": 2, "messageID": 2, "stationID": 7}
    assert decoded["cam"]["generationDeltaTime"] == 150
    basic = decoded["cam"]["camParameters"]["basicContainer"]
    # The middle of the front is 2.45 m west of the centre.
    assert basic["referencePosition"]["longitude"] == round(-2.45 / LONGITUDE_M * 1e7)
    kind, motion = decoded["cam"]["camParameters"]["highFrequencyContainer"]
    assert kind == "basicVehicleContainerHighFrequency"
    # It points west and drives backwards: it travels east.
    assert (motion["driveDirection"], motion["heading"]["headingValue"]) == ("backward", 900)
    assert motion["speed"] == {"speedValue": 200, "speedConfidence": 20}
    assert motion["longitudinalAcceleration"]["longitudinalAccelerationValue"] == -15
    assert motion["yawRate"]["yawRateValue"] == 573
    assert (motion["vehicleLength"]["vehicleLengthValue"], motion["vehicleWidth"]) == (49, 20)


def decode_cam(data: bytes) -> Any:
    CAM_PDU_Descriptions.CAM.from_uper(data)
    return CAM_PDU_Descriptions.CAM.get_val()


def test_a_road_side_unit_has_no_motion() -> None:
    pose = ReferencePose(0.0, 0.0, 0.0, 0)
    parameters = decode_cam(encode_etsi_cam(Cam(pose, 0, 0, 0, 4.0, 2.0), 1, roadside=True))["cam"]["camParameters"]
    assert parameters["basicContainer"]["stationType"] == 15
    assert parameters["basicContainer"]["referencePosition"]["longitude"] == 0
    assert parameters["highFrequencyContainer"] == ("rsuContainerHighFrequency", {})


@pytest.mark.slow
@given(cams())
def test_every_cam_fits(cam: Cam) -> None:
    pose = decode_cam(encode_etsi_cam(cam, 2**32 - 1, roadside=False))["cam"]["camParameters"]["basicContainer"]
    place = pose["referencePosition"]
    x, y = place["longitude"] * LONGITUDE_M / 1e7, place["latitude"] * LATITUDE_M / 1e7
    assert math.dist((x, y), place_front(cam.pose, cam.length)) < 0.009  # half a step of 1.1 cm along each


def test_a_path_history_is_in_steps_from_point_to_point() -> None:
    """From the middle of the front, 2 m ahead of the centre, back to two former places."""
    path = np.array([(-3.0, 0.0), (-10.0, 5.0)])
    cam = Cam(ReferencePose(0.0, 0.0, 0.0, 0), 0, 0, 0, 4.0, 2.0, path_history=path)
    parameters = decode_cam(encode_etsi_cam(cam, 1, roadside=False))["cam"]["camParameters"]
    kind, vehicle = parameters["lowFrequencyContainer"]
    assert kind == "basicVehicleContainerLowFrequency" and vehicle["exteriorLights"] == (0, 8)
    steps = [
        (point["pathPosition"]["deltaLongitude"], point["pathPosition"]["deltaLatitude"])
        for point in vehicle["pathHistory"]
    ]
    by_hand = [(-5.0 / LONGITUDE_M, 0.0), (-7.0 / LONGITUDE_M, 5.0 / LATITUDE_M)]
    assert np.allclose(steps, np.array(by_hand) * 1e7, atol=1.0)


DENM_BY_HAND = Denm(
    ReferencePose(0.0, 0.0, 0.0, 40, 0.2, 0.01),
    sequence=7,
    cause=EventCause.DANGEROUS_SITUATION,
    sub_cause=1,
    x=10.0,
    y=0.0,
    detection_tick=20,
    validity_s=1.5,
    speed=6.0,
    length=4.9,
    width=2.0,
)


def decode_denm(data: bytes) -> Any:
    DENM_PDU_Descriptions.DENM.from_uper(data)
    return DENM_PDU_Descriptions.DENM.get_val()


def test_a_denm_by_hand() -> None:
    decoded = decode_denm(encode_etsi_denm(DENM_BY_HAND, 5))
    assert decoded["header"] == {"protocolVersion": 2, "messageID": 1, "stationID": 5}
    management = decoded["denm"]["management"]
    assert management["actionID"] == {"originatingStationID": 5, "sequenceNumber": 7}
    assert (management["detectionTime"], management["referenceTime"], management["validityDuration"]) == (1000, 2000, 2)
    assert management["eventPosition"]["longitude"] == round(10 / LONGITUDE_M * 1e7)
    assert decoded["denm"]["situation"]["eventType"] == {"causeCode": 99, "subCauseCode": 1}
    assert decoded["denm"]["location"]["eventSpeed"]["speedValue"] == 600
    assert decoded["denm"]["location"]["eventPositionHeading"] == {"headingValue": 900, "headingConfidence": 12}


def test_a_cancellation_has_the_management_container_alone() -> None:
    ended = replace(DENM_BY_HAND, termination=Termination.CANCELLATION)
    decoded = decode_denm(encode_etsi_denm(ended, 5))["denm"]
    assert decoded.keys() == {"management"} and decoded["management"]["termination"] == "isCancellation"


@pytest.mark.slow
@given(denms())
def test_every_denm_fits(denm: Denm) -> None:
    assert decode_denm(encode_etsi_denm(denm, 2**32 - 1))["header"]["stationID"] == 2**32 - 1


def make_sender(cpm: Cpm) -> CpmSender:
    return CpmSender(2**32 - 1, 30.0, 2.6, tuple(i % 256 for i in range(len(cpm.objects.ids))))


@pytest.mark.slow
@given(cpms())
def test_every_cpm_fits(cpm: Cpm) -> None:
    (data,) = encode_etsi_cpm(cpm, make_sender(cpm))
    assert data.startswith(bytes((1, 14, 255, 255, 255, 255)))
    assert data[-1] | 0xFF == 0xFF and len(data) + 4 <= MOST_BYTES


@pytest.mark.parametrize(("count", "segments"), [(0, 1), (50, 1), (51, 2), (255, 6)])
def test_a_cpm_is_cut_into_packets(count: int, segments: int) -> None:
    kind = np.full(count, 3, dtype=np.uint8)  # static: the longest
    cpm = cpm_with(count, kind=kind)
    packets = list(encode_etsi_cpm(cpm, make_sender(cpm)))
    assert len(packets) == segments
    assert max(len(packet) for packet in packets) + 4 <= MOST_BYTES


def test_sizes() -> None:
    """Those that docs/pcap.md states."""
    cam, cpm = Cam(PLACE, 1.0, 0.0, 0.0, 4.9, 2.0), cpm_with(10, 72)
    (data,) = encode_etsi_cpm(cpm, make_sender(cpm))
    assert [len(encode(one).payload) for one in (cam, cpm)] == [29, 305]
    assert [len(encode_etsi_cam(cam, 1, roadside=False)), len(data)] == [41, 299]


def test_a_frame_by_hand() -> None:
    sender = FrameSender(0xA1B2C3D4, 5, EarthPlace(-1, 2), 1000, -0.02, 3599, 0.5)
    frame = build_frame("cam", b"\xaa", sender)
    assert frame.hex(" ") == (
        "ff ff ff ff ff ff 02 00 a1 b2 c3 d4 89 47 "  # Ethernet: to all
        "11 00 1a 01 "  # version 1, common header; 60 s; one hop
        "20 50 02 80 00 05 01 00 "  # BTP-B; single-hop broadcast; DP2; mobile; 5 bytes; one hop
        "14 00 02 00 a1 b2 c3 d4 00 00 03 e8 ff ff ff ff 00 00 00 02 ff fe 0e 0f "  # a car, 1 s, accurate, -2 cm/s
        "00 00 00 00 07 d1 00 00 aa"  # port 2001
    )
