"""The radio of an episode: what reaches whom and why not; no order of stations and no worker changes it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.radio.path_loss import CARRIER_GHZ, LinkClass, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_medium import LOAD_TICKS, AirLink, RadioLoss, RadioMedium, Reception, Transmission
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile, RadioSettings
from mdrive_sumo.v2x.radio.transmit_gate import TransmitGate

ITS_G5, LTE_V2X = RadioSettings(RadioProfile.ITS_G5), RadioSettings(RadioProfile.LTE_V2X)
SETTINGS = st.sampled_from([ITS_G5, LTE_V2X])
XY = st.tuples(st.floats(-800.0, 800.0), st.floats(-800.0, 800.0))
PLACES = st.lists(XY, min_size=3, max_size=6)
KINDS = st.sampled_from(LinkClass)


def make_scene(places: list[tuple[float, float]], kind: LinkClass = LinkClass.LOS, background: int = 0) -> RadioScene:
    """The last `background` places are those of background vehicles; all links are of one class."""
    n = len(places) - background
    names = tuple(f"cav{i}" for i in range(n))
    classes = np.full((n, len(places)), kind, dtype=np.uint8)
    blocker = np.full(classes.shape, 1.5 if kind is LinkClass.NLOSV else 0.0)
    heights = np.full(len(places), 1.5)
    return RadioScene(names, np.array(places), heights, np.full(background, 15.0), classes, blocker)


def transmit(
    settings: RadioSettings, scene: RadioScene, size: int = 200, luck: float = 0.5, *, tick: int = 0, seed: int = 7
) -> Reception:
    """What becomes of a message of the first station to all others."""
    others = scene.stations[1:]
    message = Transmission(scene.stations[0], size, others, (luck,) * len(others))
    return RadioMedium(settings, RadioEnvironment.URBAN, seed).transmit(tick, scene, [message])[0]


def hear(scene: RadioScene, seed: int) -> AirLink:
    """The link between the first two stations."""
    medium = RadioMedium(ITS_G5, RadioEnvironment.URBAN, seed)
    medium.transmit(0, scene, [Transmission(scene.stations[0], 200, (), ())])
    return medium.list_links(0)["cav0"]["cav1"]


def test_the_power_of_a_free_link_is_the_formula_and_its_shadowing() -> None:
    """Over seeds: 23 + 3 + 3 dBm less 86.2 dB at 100 m, with 3 dB of shadowing."""
    scene = make_scene([(0.0, 0.0), (100.0, 0.0)])
    levels = [hear(scene, seed).power_dbm for seed in range(150)]
    median = 29.0 - (38.77 + 33.4 + 18.2 * math.log10(CARRIER_GHZ))
    assert np.mean(levels) == pytest.approx(median, abs=0.8)
    assert np.std(levels) == pytest.approx(3.0, abs=0.5)


@given(SETTINGS, PLACES, KINDS, st.integers(0, 3000), st.floats(0.0, 0.999), st.floats(0.0, 10.0), st.integers(0, 3000))
def test_power_never_loses_and_size_never_gains_a_receiver(
    settings: RadioSettings,
    places: list[tuple[float, float]],
    kind: LinkClass,
    size: int,
    luck: float,
    more_db: float,
    more: int,
) -> None:
    """On an empty channel, for the same luck."""
    scene = make_scene(places, kind)
    lost = set(transmit(settings, scene, size, luck).losses)
    assert set(transmit(replace(settings, power_dbm=23.0 + more_db), scene, size, luck).losses) <= lost
    assert set(transmit(settings, scene, size + more, luck).losses) >= lost


@given(PLACES, KINDS, st.randoms(use_true_random=False))
def test_links_are_reciprocal_and_no_order_of_stations_changes_them(
    places: list[tuple[float, float]], kind: LinkClass, random: object
) -> None:
    scene = make_scene(places, kind)
    count = len(places)
    messages = [
        Transmission(sender, 300, tuple(r for r in scene.stations if r != sender), (0.4,) * (count - 1))
        for sender in scene.stations
    ]
    medium = RadioMedium(ITS_G5, RadioEnvironment.URBAN, 3)
    received = medium.transmit(0, scene, messages)
    links = medium.list_links(0)
    assert all(links[b][a] == link for a, others in links.items() for b, link in others.items())
    backwards = RadioMedium(ITS_G5, RadioEnvironment.URBAN, 3).transmit(0, scene, messages[::-1])[::-1]
    assert [one.losses for one in backwards] == [one.losses for one in received]
    without = make_scene(places[:2], kind)
    alone = transmit(ITS_G5, without, 300, 0.4, seed=3)
    assert hear(without, 3) == links["cav0"]["cav1"]
    assert alone.losses.get("cav1") == received[0].losses.get("cav1")


def test_a_message_is_on_air_after_access_and_airtime_of_all_its_packets() -> None:
    scene = make_scene([(0.0, 0.0), (50.0, 0.0)])
    access = 32e-6 + 6 * 13e-6 + 7.5 * 13e-6
    assert transmit(ITS_G5, scene, 29).arrival_s == pytest.approx(access + 320e-6)
    gap = 2144e-6 / 0.03 - 2144e-6  # until the second packet may go: the station uses 3 % of the air time
    two_packets = transmit(ITS_G5, scene, 1398 + 29, tick=40).arrival_s
    assert two_packets == pytest.approx(2.0 + access + 2144e-6 + gap + access + 320e-6, rel=1e-3)
    assert transmit(LTE_V2X, scene, 29).arrival_s == pytest.approx(0.052 + 1e-3)


def test_messages_queue_behind_congestion_control_and_expire() -> None:
    """20 kB are 31 ms of airtime, in 3 % of it that takes a second: one message arrives, the next are too late."""
    scene = make_scene([(0.0, 0.0), (20.0, 0.0)])
    message = Transmission("cav0", 18_000, ("cav1",), (0.99,))
    medium = RadioMedium(ITS_G5, RadioEnvironment.URBAN, 1)
    received = medium.transmit(0, scene, [message] * 3)
    assert [math.isfinite(one.arrival_s) for one in received] == [True, False, False]
    assert 0.8 < received[0].arrival_s <= 1.0
    assert not received[1].losses
    small = message._replace(payload_bytes=29)
    assert math.isinf(medium.transmit(0, scene, [small])[0].arrival_s)  # queued behind what was sent
    assert medium.transmit(8, scene, [small])[0].arrival_s > received[0].arrival_s
    assert medium.list_busy_ratios()[0].ratio == 0.0


def test_a_flood_knows_no_congestion_control_and_keeps_the_channel_busy() -> None:
    """18 750 bytes in every tick are 29 ms of airtime each: more than half of all time, as a neighbour measures."""
    scene = make_scene([(0.0, 0.0), (20.0, 0.0), (40.0, 0.0)])
    flood = Transmission("cav0", 18_750, ("cav1", "cav2"), (0.99, 0.99), is_gated=False)
    own = Transmission("cav1", 200, ("cav0", "cav2"), (0.99, 0.99))
    medium = RadioMedium(ITS_G5, RadioEnvironment.URBAN, 1)
    received = [medium.transmit(tick, scene, [flood, own]) for tick in range(41)]
    assert all(math.isfinite(both[0].arrival_s) for both in received)
    busy = {one.station: one.ratio for one in medium.list_busy_ratios() if one.tick == 40}
    assert busy["cav0"] < 0.05
    assert busy["cav1"] == pytest.approx(busy["cav2"], abs=0.01)
    assert 0.4 < busy["cav1"] < 0.6


def test_congestion_control_lets_a_station_send_less_on_a_busy_channel() -> None:
    """TS 102 687: from a share of 3 %, each 200 ms nearer to the share that holds the busy ratio at 68 %."""
    gate, gaps = TransmitGate(), list[float]()
    for i in range(100):
        gaps.append(gate.find_opening(1.0, 3e-3) - 1.0 + 3e-3)
        gate.update(4 * i, 0.9)
    assert gaps[0] == pytest.approx(0.1)
    assert gaps == sorted(gaps)
    assert 0.3 < gaps[-1] <= 1.0
    assert TransmitGate().find_opening(1.0, 1e-4) == pytest.approx(1.0 - 1e-4 + 0.025)


def test_the_reasons_share_the_lucks_in_their_order() -> None:
    """Behind a building at 300 m a packet is lost by path loss up to its error rate, and arrives above."""
    scene = make_scene([(0.0, 0.0), (300.0, 0.0)], LinkClass.NLOSB)
    outcomes = [transmit(ITS_G5, scene, 200, luck, seed=2).losses.get("cav1") for luck in np.linspace(0.0, 0.999, 40)]
    lost = outcomes.count(RadioLoss.PATH_LOSS)
    assert outcomes == [RadioLoss.PATH_LOSS] * lost + [None] * (40 - lost)


@pytest.mark.parametrize("settings", [ITS_G5, LTE_V2X])
def test_background_vehicles_load_the_channel_and_spoil_packets(settings: RadioSettings) -> None:
    """150 CAM senders within 600 m, behind buildings: the channel is busy, and some packets of ours collide."""
    ring = [(600.0 * math.cos(0.7 * i) * (i / 150), 600.0 * math.sin(0.7 * i) * (i / 150)) for i in range(150)]
    scene = make_scene([(0.0, 0.0), (90.0, 0.0), *ring], LinkClass.NLOSB, background=150)
    medium = RadioMedium(settings, RadioEnvironment.URBAN, 5)
    reasons: set[RadioLoss] = set()
    for luck in np.linspace(0.0, 0.9, 200):
        reasons |= {
            *medium.transmit(0, scene, [Transmission("cav0", 1000, ("cav1",), (float(luck),))])[0].losses.values()
        }
    assert 0.02 < medium.list_busy_ratios()[0].ratio < 0.6
    assert RadioLoss.COLLISION in reasons


def test_the_load_follows_stations_that_leave_between_measurements() -> None:
    medium = RadioMedium(ITS_G5, RadioEnvironment.URBAN, 5)
    three, two = (make_scene([(0.0, 0.0), (90.0, 0.0), (50.0, 9.0)][:n]) for n in (3, 2))
    message = Transmission("cav0", 100, ("cav1",), (0.5,))
    medium.transmit(0, three, [message])
    medium.transmit(1, two, [message])
    assert medium.is_load_due(LOAD_TICKS)
    assert not medium.is_load_due(LOAD_TICKS - 1)
    assert len(medium.list_busy_ratios()) == 3
