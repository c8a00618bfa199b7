"""Malformed messages: what results say of them."""

from collections.abc import Mapping

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.channel import Channel, SentMessage, count_bytes, count_deliveries, count_malformed, is_malformed
from mdrive_sumo.v2x.comm_settings import CommSettings
from mdrive_sumo.v2x.messages import MAX_PAYLOAD_BYTES, encode


def send(said: Mapping[int, Mapping[str, tuple[Message, ...]]]) -> tuple[SentMessage, ...]:
    channel = Channel(CommSettings(), 1)
    for tick, outgoing in said.items():
        channel.deliver(tick, ("a", "b"))
        channel.send(tick, outgoing, {"a": (0.0, 0.0), "b": (30.0, 40.0)})
    return channel.sent_messages()


def test_malformed_messages_are_counted_by_what_is_wrong_and_their_bytes_are_not() -> None:
    said = {
        tick: {"a": (encode("four"), Message("cam", b"x" * tick), Message("own", b"ok")), "b": ()} for tick in (1, 2)
    }
    sent = send(said)
    assert count_malformed(sent) == {"cam: expected at least 18 bytes": 2}
    assert [is_malformed(one) for one in sent] == [False, True, False] * 2
    assert count_bytes(sent) == count_deliveries(sent)["bytes"] == 12
    assert count_malformed(()) == {}


def test_kinds_of_malformed_messages_are_limited() -> None:
    large = tuple(Message(f"own-{number}", bytes(MAX_PAYLOAD_BYTES + 1)) for number in range(20))
    counts = count_malformed(send({0: {"a": large, "b": ()}}))
    assert len(counts) == 9 and counts["(other)"] == 12
