"""The sending half of perception sharing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.planning import LENGTH, WIDTH, briefing, own, seen, things
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.contract import Briefing, Message, Objects
from mdrive_sumo.contract.detector_profiles import LIDAR_SINGLE, PROFILES, DetectionProfile
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.messages import (
    CAM,
    CPM,
    MAX_OBJECTS,
    MESSAGE_REACH_M,
    Cam,
    Cpm,
    Denm,
    EventCause,
    ReferencePose,
    decode,
)


def sent(tick: int, objects: Objects, station: AwarenessService | None = None) -> tuple[Message, ...]:
    return (station or AwarenessService(briefing(), 80.0)).compose_messages(
        seen(tick, own(1.0, 2.0, 0.5, 6.0), objects)
    )


def told(objects: Objects) -> Cpm:
    content = decode(sent(7, objects)[1])
    assert isinstance(content, Cpm)
    return content


def test_it_sends_own_state_and_detections() -> None:
    first, second = sent(7, things((20.0, 3.0, 0.2, 4.0), (30.0, 0.0, 0.0, 0.0)))
    assert (first.type, second.type) == (CAM, CPM)
    cam, cpm = decode(first), decode(second)
    assert isinstance(cam, Cam)
    assert (cam.pose.x, cam.pose.y, cam.pose.tick) == (pytest.approx(1.0), pytest.approx(2.0), 7)
    assert (cam.speed, cam.length, cam.width) == (pytest.approx(6.0), pytest.approx(LENGTH), pytest.approx(WIDTH))
    assert isinstance(cpm, Cpm)
    assert cpm.range_m == pytest.approx(80.0)
    assert cpm.objects.x == pytest.approx([20.0, 30.0], abs=0.011)
    assert cpm.objects.ids == ("t00000000", "t00000001")
    assert cpm.age.tolist() == [0, 0]


def test_it_says_how_old_and_how_exact_its_detections_are() -> None:
    profile = PROFILES[LIDAR_SINGLE]
    content = decode(sent(7, things((51.0, 2.0, 0.2, 4.0)), AwarenessService(briefing(), 80.0, LIDAR_SINGLE))[1])
    assert isinstance(content, Cpm)
    assert content.age.tolist() == [2]
    assert content.sigmas[0] == pytest.approx((profile.spread * 1.5, profile.yaw_sigma, profile.speed_sigma), abs=0.006)


def test_it_says_how_exact_its_own_state_is() -> None:
    state = replace(own(1.0, 2.0, 0.5, 6.0), position_sigma=0.2, yaw_sigma=math.radians(0.2), speed_sigma=0.06)
    cam, cpm = (decode(m) for m in AwarenessService(briefing(), 80.0).compose_messages(seen(0, state, things())))
    assert isinstance(cam, Cam) and isinstance(cpm, Cpm)
    assert cam.pose == cpm.pose
    assert (cam.pose.position_sigma, cam.speed_sigma) == (0.2, 0.06)
    assert cam.pose.yaw_sigma == pytest.approx(math.radians(0.2))


def test_it_sends_at_10_hz_for_any_rate_of_observations() -> None:
    station = AwarenessService(briefing(), 80.0)
    assert [tick for tick in range(8) if sent(tick, things(), station)] == [0, 2, 4, 6]
    station = AwarenessService(briefing(), 80.0)
    asked = (0, 3, 4, 5, 6, 9, 10)  # a measured agent clock leaves out ticks
    assert [tick for tick in asked if sent(tick, things(), station)] == [0, 3, 4, 6, 9, 10]


def test_what_a_message_cannot_carry_is_left_out_the_nearest_stay() -> None:
    assert told(things((20.0, 0, 0, 0), (1.0 + MESSAGE_REACH_M, 2.0, 0, 0))).objects.ids == ("t00000000",)
    many = things(*((0.2 * i, 5.0, 0.0, 0.0) for i in range(MAX_OBJECTS + 20)))
    objects = told(many).objects
    assert len(objects.ids) == MAX_OBJECTS
    assert objects.x == pytest.approx(np.arange(MAX_OBJECTS) * 0.2, abs=0.011)


NUMBERS = st.lists(st.one_of(st.floats(), st.floats(-200.0, 200.0)), max_size=6)


@given(xs=NUMBERS, profile=st.sampled_from(list(PROFILES.values())), own=st.floats(-200.0, 200.0))
def test_compiled_functions_return_what_the_python_text_does(
    xs: list[float], profile: DetectionProfile, own: float
) -> None:
    x, y, pose = np.array(xs), np.array(xs[::-1]), ReferencePose(own, 2.0, 0.3, 0)
    compare_twins("v2x_awareness_service_compute_sigmas", profile, pose, x, y)
    compare_twins("v2x_awareness_service_compute_sigmas", replace(profile, spread_doubles_m=0.0), pose, x, y)
    compare_twins("v2x_awareness_service_find_rows_within", x, y, own, 2.0, 150.0)
    with pytest.raises(ValueError, match="expected as many y as x"):
        get_compiled("v2x_awareness_service_compute_sigmas")(profile, pose, x, np.zeros(7))


ETSI = replace(briefing(), v2x_rate="etsi")


def drive(station: AwarenessService, speed: float, ticks: range, *rows: tuple[float, ...]) -> dict[int, list[object]]:
    """Contents by tick of a car that drives along x among objects (x, y, yaw, speed)."""
    sent: dict[int, list[object]] = {}
    for tick in ticks:
        state = own(speed * tick * 0.05, 0.0, 0.0, speed)
        sent[tick] = [decode(one) for one in station.compose_messages(seen(tick, state, things(*rows)))]
    return sent


def test_by_the_rules_of_etsi_a_standing_car_sends_once_a_second() -> None:
    sent = drive(AwarenessService(ETSI, 80.0), 0.0, range(61), (20.0, 3.0, 0.2, 0.0))
    kinds = {tick: tuple(type(one) for one in contents) for tick, contents in sent.items() if contents}
    assert kinds == dict.fromkeys((0, 20, 40, 60), (Cam, Cpm))


@pytest.mark.parametrize("about", [briefing(), ETSI])
def test_a_car_that_shares_no_objects_sends_cams_in_the_same_ticks_and_no_cpm(about: Briefing) -> None:
    whole, part = (
        drive(AwarenessService(about, 80.0, shares_objects=shares), 0.0, range(61), (20.0, 3.0, 0.2, 0.0))
        for shares in (True, False)
    )
    assert {tick: [type(one) for one in sent if isinstance(one, Cam)] for tick, sent in whole.items()} == {
        tick: [type(one) for one in sent] for tick, sent in part.items()
    }
    assert any(isinstance(one, Cpm) for sent in whole.values() for one in sent)


def test_by_the_rules_of_etsi_cams_have_the_way_that_the_car_came() -> None:
    sent = drive(AwarenessService(ETSI, 80.0), 10.0, range(81))
    cams = [one for contents in sent.values() for one in contents if isinstance(one, Cam)]
    assert [cam.pose.tick for cam in cams] == list(range(0, 81, 10))
    assert [None if cam.path_history is None else len(cam.path_history) for cam in cams] == [0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert cams[-1].path_history == pytest.approx(np.array(((30.0, 0.0), (20.0, 0.0), (10.0, 0.0), (0.0, 0.0))))


def test_by_the_rules_of_etsi_a_car_warns_before_it_collides() -> None:
    sent = drive(AwarenessService(ETSI, 80.0), 10.0, range(0, 10, 2), (18.0, 0.0, 0.0, 0.0))
    denms = [one for contents in sent.values() for one in contents if isinstance(one, Denm)]
    assert [denm.cause for denm in denms] == [EventCause.COLLISION_RISK] * 5
    assert (denms[0].length, denms[0].speed, denms[0].sequence) == (LENGTH, 10.0, 0)


def test_by_the_rules_of_etsi_a_cpm_fits_into_one_packet() -> None:
    many = [(0.2 * i, 5.0, 0.0, 0.0) for i in range(150)]
    station = AwarenessService(ETSI, 80.0)
    messages = [station.compose_messages(seen(tick, own(), things(*many))) for tick in range(0, 6, 2)]
    cpms = [one for sent in messages for one in sent if one.type == CPM]
    assert all(len(cpm.payload) <= 1398 for cpm in cpms)
    assert [len(told.objects) for told in map(decode, cpms) if isinstance(told, Cpm)] == [65, 65, 20]


def test_it_waits_when_another_service_of_the_car_has_sent() -> None:
    station = AwarenessService(briefing(), 80.0)
    station.postpone(7)
    assert [bool(sent(tick, things(), station)) for tick in range(7, 12)] == [False, True, False, True, False]
