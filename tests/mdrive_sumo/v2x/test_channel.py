"""The channel: which receiver gets which message when; chance depends on names and ticks only."""

import math
import statistics
from collections.abc import Iterable, Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.channel import Channel, DeliveryStatus, Position, SentMessage
from mdrive_sumo.v2x.comm_settings import CommSettings, LinkSettings
from mdrive_sumo.v2x.message_counts import MAX_COUNTED_TYPES, count_deliveries, count_exchanged
from mdrive_sumo.v2x.messages import Cam, Direction, Intention, Mcm, ReferencePose, decode, encode

NEAR: Mapping[str, Position] = {"a": (0.0, 0.0), "b": (30.0, 40.0), "c": (0.0, 200.0)}
Box = dict[str, tuple[Message, ...]]


def text(words: str) -> Message:
    return encode(words)


def cam(tick: int = 0) -> Message:
    return encode(Cam(ReferencePose(10.0, 20.0, 0.5, tick), 5.0, 0.0, 0.0, 4.9, 2.0))


def run(
    comm: CommSettings,
    said: Mapping[int, Mapping[str, tuple[Message, ...]]],
    ticks: int,
    places: Mapping[str, Position] = NEAR,
    seed: int = 1,
) -> tuple[list[Box], Channel]:
    """What every tick delivers."""
    channel, boxes = Channel(comm, seed), []
    for tick in range(ticks):
        boxes.append(channel.deliver(tick, tuple(places)))
        channel.send(tick, said.get(tick, {}), places)
    return boxes, channel


def fates(sent: Iterable[SentMessage]) -> list[dict[str, DeliveryStatus]]:
    return [{receiver: fate for receiver, (fate, _) in one.deliveries.items()} for one in sent]


@pytest.mark.parametrize(("latency", "arrival"), [(0, 1), (1, 1), (2, 2), (6, 6)])
def test_a_message_arrives_after_its_latency_and_never_in_its_own_tick(latency: int, arrival: int) -> None:
    boxes, channel = run(CommSettings(link=LinkSettings(latency_ticks=latency)), {3: {"a": (text("hi"),)}}, 12)
    expected = Message("text", b"hi", "a", 3)
    assert [tick for tick, box in enumerate(boxes) if box["b"]] == [3 + arrival]
    assert boxes[3 + arrival] == {"a": (), "b": (expected,), "c": (expected,)}
    assert channel.sent_messages() == (
        SentMessage(
            expected, {"b": (DeliveryStatus.DELIVERED, 3 + arrival), "c": (DeliveryStatus.DELIVERED, 3 + arrival)}
        ),
    )


def test_the_channel_sets_the_sender() -> None:
    boxes, _ = run(CommSettings(), {0: {"a": (Message("text", b"", "b", 99),)}}, 2)
    assert boxes[1]["c"] == (Message("text", b"", "a", 0),)


def test_messages_arrive_in_order_of_sending_whatever_the_latency() -> None:
    comm = CommSettings(link=LinkSettings(latency_ticks=3), by_type={"cam": LinkSettings(latency_ticks=1)})
    said = {
        0: {"b": (text("1"), text("2")), "a": (text("0"),)},
        2: {"a": (cam(),)},
    }
    boxes, _ = run(comm, said, 5)
    assert [message.payload for message in boxes[3]["c"]] == [b"0", b"1", b"2", cam().payload]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 9)), max_size=12), st.integers(0, 4))
def test_without_loss_everything_arrives_once_and_in_order(what: list[tuple[str, int]], latency: int) -> None:
    said: dict[int, dict[str, tuple[Message, ...]]] = {}
    for i, (sender, tick) in enumerate(what):
        said.setdefault(tick, {}).setdefault(sender, ())
        said[tick][sender] += (text(f"{i}"),)
    boxes, channel = run(CommSettings(link=LinkSettings(latency_ticks=latency)), said, 16)
    for receiver in NEAR:
        heard = [message for box in boxes for message in box[receiver]]
        posted = [one.message for one in channel.sent_messages() if one.message.sender != receiver]
        assert heard == posted  # the log is in order of ticks, senders, messages


def test_receivers_out_of_range_get_nothing() -> None:
    boxes, channel = run(CommSettings(link=LinkSettings(range_m=50.0)), {0: {"a": (text("x"),)}}, 2)
    assert (len(boxes[1]["b"]), len(boxes[1]["c"])) == (1, 0)  # b is at exactly 50 m
    assert fates(channel.sent_messages()) == [{"c": DeliveryStatus.OUT_OF_RANGE, "b": DeliveryStatus.DELIVERED}]


def test_range_is_that_of_the_moment_of_sending() -> None:
    channel = Channel(CommSettings(link=LinkSettings(range_m=100.0, latency_ticks=2)), 1)
    channel.send(0, {"a": (text("x"),)}, {"a": (0.0, 0.0), "b": (99.0, 0.0)})
    assert channel.deliver(1, ("a", "b"))["b"] == ()
    channel.send(1, {}, {"a": (0.0, 0.0), "b": (999.0, 0.0)})
    assert len(channel.deliver(2, ("a", "b"))["b"]) == 1


def test_road_side_units_send_but_do_not_hear() -> None:
    places = {**NEAR, "rsu": (0.0, 10.0)}
    channel = Channel(CommSettings(), 1)
    channel.send(0, {"rsu": (text("from the side"),), "a": (text("x"),)}, places, receivers=tuple(NEAR))
    assert {name: len(box) for name, box in channel.deliver(1, tuple(NEAR)).items()} == {"a": 1, "b": 2, "c": 2}
    assert all("rsu" not in one.deliveries for one in channel.sent_messages())


def test_a_receiver_that_has_ended_gets_nothing() -> None:
    channel = Channel(CommSettings(link=LinkSettings(latency_ticks=2)), 1)
    channel.send(0, {"a": (text("x"),)}, NEAR)
    channel.deliver(1, ("a", "b", "c"))
    assert set(channel.deliver(2, ("a", "b"))) == {"a", "b"}
    assert channel.sent_messages()[0].deliveries == {"b": (DeliveryStatus.DELIVERED, 2), "c": (DeliveryStatus.GONE, 2)}


def test_messages_that_were_due_between_two_calls_arrive_in_the_order_of_sending() -> None:
    channel = Channel(CommSettings(by_type={"cam": LinkSettings(latency_ticks=6)}), 1)
    channel.send(0, {"a": (cam(),), "b": (text("first"),)}, NEAR)
    assert [one.payload for one in channel.deliver(4, ("a", "b"))["a"]] == [b"first"]
    channel.send(4, {"b": (text("second"),)}, NEAR)
    assert [(one.tick, one.sender) for one in channel.deliver(8, ("a", "b", "c"))["c"]] == [(0, "a"), (4, "b")]
    assert channel.deliver(12, ("a", "b", "c")) == {"a": (), "b": (), "c": ()}
    (early, said, later) = channel.sent_messages()
    assert early.deliveries["b"] == later.deliveries["a"] == (DeliveryStatus.DELIVERED, 8)
    assert said.deliveries == {"a": (DeliveryStatus.DELIVERED, 4), "c": (DeliveryStatus.GONE, 4)}


def test_what_was_sent_earlier_arrives_first_whoever_sent_it() -> None:
    """Both were due between two calls: the slow one in tick 6, the quick one in tick 5."""
    channel = Channel(CommSettings(by_type={"cam": LinkSettings(latency_ticks=6)}), 1)
    channel.send(0, {"b": (cam(),)}, NEAR)
    channel.send(4, {"a": (text("later"),)}, NEAR)
    assert [(one.tick, one.sender) for one in channel.deliver(8, ("c",))["c"]] == [(0, "b"), (4, "a")]


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 9), st.booleans()), max_size=12),
    st.sets(st.integers(1, 15)),
)
def test_every_inbox_is_in_the_order_of_sending_whenever_it_is_read(
    what: list[tuple[str, int, bool]], reads: set[int]
) -> None:
    """Messages of one tick in the order of sender ids, those of one sender as it gave them."""
    channel = Channel(CommSettings(by_type={"cam": LinkSettings(latency_ticks=5)}), 1)
    boxes: list[Box] = []
    for tick in range(17):
        if tick in reads or tick == 16:
            boxes.append(channel.deliver(tick, tuple(NEAR)))
        said: dict[str, tuple[Message, ...]] = {}
        for i, (sender, when, slow) in enumerate(what):
            if when == tick:
                said[sender] = (*said.get(sender, ()), cam(i) if slow else text(f"{i}"))
        channel.send(tick, said, NEAR)
    log = [one.message for one in channel.sent_messages()]
    for receiver in NEAR:
        heard = [[log.index(one) for one in box[receiver]] for box in boxes]
        assert all(places == sorted(places) for places in heard)
        assert sorted(place for places in heard for place in places) == [
            i for i, one in enumerate(log) if one.sender != receiver
        ]


def test_messages_in_flight_have_no_fate_yet() -> None:
    _, channel = run(CommSettings(link=LinkSettings(latency_ticks=9)), {0: {"a": (text("x"),)}}, 5)
    assert fates(channel.sent_messages()) == [{}]


def test_a_channel_that_is_off_delivers_nothing() -> None:
    boxes, channel = run(CommSettings(on=False), {0: {"a": (text("x"),)}}, 5)
    assert not any(any(box.values()) for box in boxes)
    assert fates(channel.sent_messages()) == [{"b": DeliveryStatus.OFF, "c": DeliveryStatus.OFF}]


def test_malformed_messages_are_not_delivered() -> None:
    said = {0: {"a": (Message("cam", b"\1"), Message("own", b"\xff" * 65536), Message("own", b"\xff"), cam())}}
    _, channel = run(CommSettings(), said, 2)
    bad, good = (
        {"b": DeliveryStatus.MALFORMED, "c": DeliveryStatus.MALFORMED},
        {"b": DeliveryStatus.DELIVERED, "c": DeliveryStatus.DELIVERED},
    )
    assert fates(channel.sent_messages()) == [bad, bad, good, good]


@pytest.mark.parametrize(
    ("pattern", "muted"),
    [
        ("a/text", {"a text 0", "a text 1"}),
        ("*/text@1", {"a text 1", "b text 1"}),
        ("a/*@0", {"a text 0", "a cam 0"}),
        ("*/*", {f"{who} {what} {tick}" for who in "ab" for what in ("text", "cam") for tick in (0, 1)}),
        ("b/cam@001", {"b cam 1"}),
        ("c/*", set[str]()),
    ],
)
def test_muted_messages_are_not_delivered(pattern: str, muted: set[str]) -> None:
    said = {tick: {who: (text("x"), cam()) for who in "ab"} for tick in (0, 1)}
    _, channel = run(CommSettings(mute=(pattern,)), said, 3)
    silent = {
        f"{one.message.sender} {one.message.type} {one.message.tick}"
        for one in channel.sent_messages()
        if {fate for fate, _ in one.deliveries.values()} == {DeliveryStatus.MUTED}
    }
    assert silent == muted
    assert all(
        fate in (DeliveryStatus.MUTED, DeliveryStatus.DELIVERED)
        for one in fates(channel.sent_messages())
        for fate in one.values()
    )


def test_the_budget_is_for_any_second() -> None:
    comm = CommSettings(budget_bytes_s=250, header_bytes=20)
    said = {tick: {"a": (text("x" * 80),)} for tick in (0, 5, 10, 19, 20, 24, 25)}  # 100 bytes each
    _, channel = run(comm, said, 40)
    sent = [one.message.tick for one in channel.sent_messages() if one.deliveries["b"][0] is DeliveryStatus.DELIVERED]
    assert sent == [0, 5, 20, 25]  # 10 and 19 are beyond it; at 20 that of 0 is a second ago


def test_small_messages_still_fit_where_large_ones_do_not() -> None:
    _, channel = run(CommSettings(budget_bytes_s=100), {0: {"a": (text("x" * 80), text("x" * 21), text("x" * 20))}}, 3)
    assert [one.deliveries["b"][0] for one in channel.sent_messages()] == [
        DeliveryStatus.DELIVERED,
        DeliveryStatus.OVER_BUDGET,
        DeliveryStatus.DELIVERED,
    ]


def test_every_station_has_a_budget_of_its_own_and_muted_messages_cost_nothing() -> None:
    said = {0: {"a": (cam(), text("x" * 90)), "b": (text("x" * 90),)}}
    _, channel = run(CommSettings(budget_bytes_s=100, mute=("*/cam",)), said, 3)
    assert [one.deliveries["c"][0] for one in channel.sent_messages()] == [
        DeliveryStatus.MUTED,
        DeliveryStatus.DELIVERED,
        DeliveryStatus.DELIVERED,
    ]


LOSSY = CommSettings(link=LinkSettings(loss=0.3))
CHATTER = {tick: {"a": (text("x"), text("y")), "b": (text("z"),)} for tick in range(2000)}


def lost(channel: Channel, sender: str, receiver: str, payload: bytes) -> list[bool]:
    """By tick; what is still in flight is not lost."""
    log = [one for one in channel.sent_messages() if (one.message.sender, one.message.payload) == (sender, payload)]
    return [receiver in one.deliveries and one.deliveries[receiver][0] is DeliveryStatus.LOST for one in log]


def test_loss_has_the_given_probability_and_is_independent() -> None:
    _, channel = run(LOSSY, CHATTER, 2000)
    rows = [lost(channel, *of) for of in (("a", "b", b"x"), ("a", "c", b"x"), ("a", "b", b"y"), ("b", "c", b"z"))]
    # Four standard deviations of 2000 draws, of the mean and of correlations.
    assert all(abs(statistics.mean(row) - 0.3) < 4 * math.sqrt(0.3 * 0.7 / 2000) for row in rows)
    correlations = np.corrcoef(np.array([*rows, [*rows[0][1:], rows[0][0]]], dtype=float))
    assert np.abs(correlations - np.eye(5)).max() < 4 / math.sqrt(2000)


def test_losses_depend_on_names_ticks_and_seed_only() -> None:
    _, all_of_them = run(LOSSY, CHATTER, 300)
    pair = {name: NEAR[name] for name in "ab"}
    _, two_of_them = run(LOSSY, {tick: {"a": (text("x"),)} for tick in range(7, 300)}, 300, pair)
    _, other_seed = run(LOSSY, CHATTER, 300, seed=2)
    alone = lost(two_of_them, "a", "b", b"x")
    assert alone == lost(all_of_them, "a", "b", b"x")[7:]
    assert alone != lost(other_seed, "a", "b", b"x")[7:]


@pytest.mark.parametrize(("loss", "arrived"), [(0.0, 50), (1.0, 0)])
def test_no_loss_and_full_loss_are_exact(loss: float, arrived: int) -> None:
    boxes, _ = run(CommSettings(link=LinkSettings(loss=loss)), {tick: {"a": (text("x"),)} for tick in range(50)}, 51)
    assert sum(len(box["b"]) for box in boxes) == arrived


def test_types_have_links_of_their_own() -> None:
    comm = CommSettings(link=LinkSettings(loss=1.0), by_type={"cam": LinkSettings(latency_ticks=4)})
    boxes, _ = run(comm, {0: {"a": (text("x"), cam(), Message("own", b""))}}, 6)
    assert [tick for tick, box in enumerate(boxes) if box["b"]] == [4]
    assert [message.type for message in boxes[4]["b"]] == ["cam"]


def errors(comm: CommSettings, ticks: int, receiver: str = "b", sender: str = "a") -> np.ndarray:
    """(N, 3) x, y [m] and yaw [deg] by which each CAM's pose is wrong."""
    boxes, _ = run(comm, {tick: {sender: (cam(tick),)} for tick in range(ticks)}, ticks + 1)
    heard = [decode(message) for box in boxes for message in box[receiver]]
    rows = [(c.pose.x - 10.0, c.pose.y - 20.0, math.degrees(c.pose.yaw - 0.5)) for c in heard if isinstance(c, Cam)]
    return np.array(rows)


@pytest.mark.slow
def test_pose_errors_have_the_given_deviations_and_are_independent() -> None:
    found = errors(CommSettings(link=LinkSettings(pose_error_m=0.6, pose_error_deg=0.8)), 3000)
    assert found.shape == (3000, 3)
    deviations = np.array((0.6, 0.6, 0.8))
    assert (np.abs(found.mean(axis=0)) < 4 * deviations / math.sqrt(3000)).all()
    assert np.allclose(found.std(axis=0), deviations, rtol=4 / math.sqrt(6000))
    assert np.abs(np.corrcoef(found.T) - np.eye(3)).max() < 4 / math.sqrt(3000)


def test_pose_errors_of_an_episode_stay_the_same_for_a_pair() -> None:
    comm = CommSettings(link=LinkSettings(pose_error_m=0.6, pose_error_deg=0.6, pose_error_per="episode"))
    found = errors(comm, 20)
    assert np.ptp(found, axis=0).max() == 0.0 and np.abs(found).min() > 0
    for other in (errors(comm, 20, "c"), errors(comm, 20, "c", "b")):
        assert not np.allclose(found[0], other[0], atol=0.02)


def test_a_pose_error_changes_delivered_content_but_neither_text_nor_the_log() -> None:
    planned = np.array([[20.0, 20.0], [30.0, 20.0]])
    plan = encode(Mcm(ReferencePose(10.0, 20.0, 0.0, 0), 5.0, Intention.KEEP, Direction.FOLLOW, 0.2, planned))
    comm = CommSettings(link=LinkSettings(pose_error_m=2.0, pose_error_deg=0.0))
    boxes, channel = run(comm, {0: {"a": (plan, text("I am at (10, 20)"))}}, 2)
    (moved, spoken), others = boxes[1]["b"], boxes[1]["c"]
    read = decode(moved)
    assert isinstance(read, Mcm) and (moved.sender, moved.tick) == ("a", 0)
    shift = np.array((read.pose.x - 10.0, read.pose.y - 20.0))
    assert np.abs(shift).min() > 0.01
    assert np.allclose(read.planned, planned + shift, atol=0.011)
    assert spoken.payload == b"I am at (10, 20)"
    assert others[0].payload != moved.payload  # another receiver, another error
    assert channel.sent_messages()[0].message.payload == plan.payload


def test_what_is_counted() -> None:
    said = {0: {"a": (text("four"), Message("cam", b"")), "b": (text("xx"),)}}
    _, channel = run(CommSettings(link=LinkSettings(range_m=100.0)), said, 2)
    everything = {"sent": 3, "bytes": 6, "delivered": 2, "lost": 0, "out-of-range": 2, "gone": 0}
    assert count_deliveries(channel.sent_messages()) == everything | {
        "muted": 0,
        "over-budget": 0,
        "malformed": 2,
        "off": 0,
    }
    assert count_deliveries(()) == {}


def test_messages_are_exchanged_if_one_cav_gets_those_of_another() -> None:
    """Those of a road-side unit are not, nor those that no one hears."""
    places = {**NEAR, "rsu": (0.0, 10.0), "far": (9000.0, 0.0)}
    channel = Channel(CommSettings(link=LinkSettings(range_m=300.0)), 1)
    said = {"a": (text("1"), cam(), text("2")), "rsu": (text("3"),), "far": (cam(),)}
    channel.send(0, said, places, receivers=("a", "b", "c", "far"))
    assert count_exchanged(channel.sent_messages(), ("a", "b", "c", "far")) == {}
    channel.deliver(1, ("a", "b", "c", "far"))
    assert list(count_exchanged(channel.sent_messages(), ("a", "b", "c", "far")).items()) == [("cam", 1), ("text", 2)]


@pytest.mark.parametrize("types", [MAX_COUNTED_TYPES, MAX_COUNTED_TYPES + 5])
def test_of_many_types_the_first_are_counted_one_by_one_and_all_others_together(types: int) -> None:
    own = tuple(Message(f"own-{number:02}", b"x") for number in range(types))
    channel = Channel(CommSettings(), 1)
    channel.send(0, {"a": (*own, *own)}, NEAR)
    channel.deliver(1, ("b",))
    counts = count_exchanged(channel.sent_messages(), ("a", "b"))
    others = 2 * (types - MAX_COUNTED_TYPES)
    assert counts == {**{one.type: 2 for one in own[:MAX_COUNTED_TYPES]}, **({"(other)": others} if others else {})}
