"""The story of a CAV: reasons in words with the names of the recording, and what it did when."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from testing.view_runs import hit

from mdrive_sumo.contract import REASON, STANDSTILL, Cause, Message, Note, Reason
from mdrive_sumo.core.state import DT, Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, NoteRecord
from mdrive_sumo.episode.quantization import quantize_frame
from mdrive_sumo.episode.recorder import Recorder
from mdrive_sumo.report.reasons import SENTENCES, describe_reason, list_reasons
from mdrive_sumo.report.story import CavStory
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.v2x.channel import SentMessage
from mdrive_sumo.v2x.messages import (
    Denm,
    Direction,
    EventCause,
    Intention,
    Mcm,
    ReferencePose,
    Termination,
    encode,
)

CAR, WALKER, CONE = (40.0, 0.0), (20.0, 8.0), (5.0, -9.0)
"""Where the other road users stand: the car in the lane of the CAV, which drives along +x."""
SPEEDS = (0.0,) * 10 + tuple(0.2 * i for i in range(40)) + (8.0,) * 20
"""[m/s] in each tick: it stands for half a second, speeds up and drives."""
BRAKING = tuple(8.0 - 0.2 * i for i in range(40))
WAITING = (0.0,) * 60


def record(speeds: Sequence[float], *notes: tuple[int, Reason | str], **changed: Any) -> EpisodeRecord:
    recorder = Recorder("s", {"agent": "test", "seed": 0}, {"0": (4.5, 1.8)})
    kinds = np.array((Kind.VEHICLE, Kind.PEDESTRIAN, Kind.STATIC), dtype=np.uint8)
    x, y = np.array((CAR, WALKER, CONE)).T
    zeros = np.zeros(3)
    others = Actors(
        ("car", "anna", "cone"), kinds, x, y, zeros, zeros, np.array((4.5, 0.6, 0.4)), np.array((1.8, 0.6, 0.4))
    )
    along = np.concatenate(((0.0,), np.cumsum(np.array(speeds[:-1]) * DT)))
    for tick, (s, speed) in enumerate(zip(along.tolist(), speeds, strict=True)):
        state = EgoState(s, 0.0, 0.0, speed, 0.0, 0.0, 0.0)
        recorder.add(quantize_frame(Frame(tick, {"0": state}, others, {}, ())), {"0": STANDSTILL}, {}, {})
    noted = tuple(
        NoteRecord(tick, "0", reason.to_note() if isinstance(reason, Reason) else Note(REASON, reason))
        for tick, reason in notes
    )
    return replace(recorder.finish([Ending("0", len(speeds) - 1, End.ARRIVED)]), notes=noted, **changed)


def tell(episode: EpisodeRecord, *infractions: Infraction) -> list[str]:
    return make_story(episode, *infractions).tell()


def make_story(episode: EpisodeRecord, *infractions: Infraction) -> CavStory:
    ego = EgoResult(id="0", outcome=End.ARRIVED, reason="", ds=60.0, rc=100.0, ip=0.6, infractions=infractions)
    result = ScenarioResult(
        id="s", bucket="b", category="c", seed=0, status="ok", reason="", min_ttc=None, digest="",
        ticks=episode.ticks, ds=60.0, sr=0.0, rc=100.0, ip=0.6, egos=(ego,),
    )  # fmt: skip
    return CavStory(episode, "0", result, 100.0)


@pytest.mark.parametrize("cause", Cause)
@pytest.mark.parametrize("others", [(), ("CAV 1",), ("CAV 1", "pedestrian p", "vehicle v")])
@pytest.mark.parametrize("number", [None, 12.34])
def test_every_cause_is_a_sentence(cause: Cause, others: tuple[str, ...], number: float | None) -> None:
    text = describe_reason(Reason(cause, others, (1.0, 2.0), number, number, number), others)
    assert text and not set("{}") & set(text) and "None" not in text and "  " not in text
    assert text[0].islower() and text[-1] not in " ,:"
    assert SENTENCES.keys() == {*Cause}


@pytest.mark.parametrize(
    ("other", "position", "name"),
    [
        ("k3", CAR, "vehicle car"), ("k3", (41.5, 1.0), "vehicle car"), ("k3", WALKER, "pedestrian anna"),
        ("k3", CONE, "obstacle cone"), ("k3", (60.0, 0.0), "k3 (a false detection: nothing is there)"),
        ("00c0ffee", None, "CAV 0"), ("car", None, "vehicle car"), ("tls:2", None, "tls:2"),
        ("k3", (0.0, 0.0), "k3 (a false detection: nothing is there)"),  # the CAV itself stands there
    ],
)  # fmt: skip
def test_a_road_user_gets_the_name_of_the_recording(
    other: str, position: tuple[float, float] | None, name: str
) -> None:
    reason = Reason(Cause.YIELD, (other,), position, seconds=2.1)
    (noted,) = list_reasons(record(SPEEDS, (3, reason), pseudonyms={"00c0ffee": "0"}))
    which = "who" if "anna" in name else "which"
    assert noted.text == f"yields to {name}, {which} crosses in 2.1 s"
    assert noted.others == (name,)


def test_a_sentence_of_an_agents_own_stays_as_it_is() -> None:
    (noted,) = list_reasons(record(SPEEDS, (3, "waits for 00c0ffee\nand  yawns"), pseudonyms={"00c0ffee": "0"}))
    assert (noted.cause, noted.text) == (None, "waits for 0 and yawns")


@pytest.mark.parametrize(
    ("other", "position", "text"),
    [
        ("van\n   9.9 s  arrives", None, "yields to van 9.9 s arrives, which stands where their ways cross"),
        ("a\r\u2028b\x1b[2K\u202e", None, r"yields to a b\x1b[2K\u202e, which stands where their ways cross"),
        (" \t", None, "yields to another road user, which stands where their ways cross"),
        ("", CAR, "yields to vehicle car, which stands where their ways cross"),
        (
            "\n", (60.0, 0.0),
            "yields to something (a false detection: nothing is there), which stands where their ways cross",
        ),
    ],
)  # fmt: skip
def test_a_name_that_an_agent_gives_stays_within_its_line(
    other: str, position: tuple[float, float] | None, text: str
) -> None:
    (noted,) = list_reasons(record(SPEEDS, (3, Reason(Cause.YIELD, (other,), position))))
    assert noted.text == text


def test_a_reason_without_text_is_none() -> None:
    lines = tell(record(WAITING, (0, " \n"), (5, "")))
    assert lines[1].startswith("Its agent noted no reasons") and lines[2] == "   0.0 s  stands all the time"
    noted_later = tell(record(WAITING + SPEEDS, (0, ""), (40, "yawns"), (50, " ")))
    assert "   0.0 s  stands until 3.6 s (3.6 s): from 2.0 s yawns" in noted_later
    noted_after = tell(record(WAITING + SPEEDS, (100, "yawns")))
    assert "   0.0 s  stands until 3.6 s (3.6 s)" in noted_after


def test_a_distance_of_nothing_and_an_unknown_road_user_are_left_out() -> None:
    for distance_m in (-0.3, 0.0, 0.04):
        assert describe_reason(Reason(Cause.FOLLOW, ("a",), None, distance_m), ("CAV 1",)) == "follows CAV 1"
    assert describe_reason(Reason(Cause.FOLLOW, ("a",), None, 0.06), ("CAV 1",)) == "follows CAV 1, 0.1 m ahead"
    assert describe_reason(Reason(Cause.AVOID, seconds=2.0), ()) == "drives slower than it would alone"
    touching = make_story(record((8.0,) * 90 + (0.0,) * 20))  # 36 m: nose and tail overlap
    assert touching.tell_moment(105)[-1] == "Ahead of it: vehicle car close ahead, standing."


def test_the_story_has_departure_braking_standing_and_arrival_with_their_reasons() -> None:
    speeds = SPEEDS + BRAKING + WAITING + SPEEDS
    blocked = Reason(Cause.BLOCKED, ("k3",), CAR, 0.5)
    notes = ((0, Reason(Cause.FREE, speed=8.0)), (60, Reason(Cause.YIELD, ("k1",), WALKER, 9.0, 2.1)), (130, blocked))
    head, *lines = tell(
        record(speeds, *notes, (175, Reason(Cause.FREE, speed=8.0))), hit("1").model_copy(update={"tick": 90})
    )
    assert head == "CAV 0 of s (agent test, seed 0): arrived, DS 60.0, RC 100.0 %."
    assert lines == [
        "   0.6 s  departs: drives freely, at up to 8.0 m/s",
        "   3.5 s  brakes from 8.0 m/s to a stop: yields to pedestrian anna, who crosses in 2.1 s",
        "   4.5 s  infraction: hit vehicle 1 at 2.5 m/s",
        "   5.5 s  stands until 9.1 s (3.6 s): since 3.0 s yields to pedestrian anna, who crosses in 2.1 s; from 6.5 s"
        " is held up by vehicle car, which stands in its way, 0.5 m ahead",
        "   9.1 s  drives on: drives freely, at up to 8.0 m/s",
        "  12.0 s  arrives",
    ]


def test_without_reasons_the_recording_speaks() -> None:
    _, without, *lines = tell(record(SPEEDS + BRAKING + WAITING))
    assert without == "Its agent noted no reasons, so this is only what the recording shows."
    (braking,) = [line for line in lines if "brakes" in line]
    assert braking == "   3.5 s  brakes from 8.0 m/s to a stop, with vehicle car 19.7 m ahead, standing"


def test_a_car_that_never_moves_and_one_that_is_held_back() -> None:
    assert tell(record(WAITING, (0, Reason(Cause.STATIONARY))))[1:] == [
        "   0.0 s  stands all the time: stands, as this agent always does", "   3.0 s  arrives",
    ]  # fmt: skip
    held = record((4.0,) * 80, (0, Reason(Cause.FREE)), (20, Reason(Cause.FOLLOW, ("k3",), CAR, 30.0)), (50, "yawns"))
    assert "   1.0 s  holds back: follows vehicle car, 30 m ahead" in tell(held)


def test_a_loss_of_speed_by_contact_is_no_braking() -> None:
    lines = tell(record(SPEEDS + (2.0,) * 20, (60, Reason(Cause.FREE))))
    assert lines[2] == "   3.5 s  loses speed by contact: from 8.0 m/s to 2.0 m/s"
    after_braking = tell(record(SPEEDS + BRAKING[:20] + (1.0,) * 20, (60, Reason(Cause.FREE, speed=8.0))))
    free = "although its agent notes that it drives freely, at up to 8.0 m/s"
    assert after_braking[2].endswith(f"brakes from 8.0 m/s to 4.4 m/s, {free}")
    assert after_braking[3].endswith("loses speed by contact: from 4.2 m/s to 1.0 m/s")


def test_a_reason_of_another_time_is_told_with_its_time() -> None:
    speeds = (8.0,) * 60 + BRAKING + WAITING + SPEEDS[10:]
    lines = tell(
        record(speeds, (0, Reason(Cause.FREE, speed=8.0)), (140, Reason(Cause.BEND, (), None, 29.0, None, 6.6)))
    )
    free = "although its agent notes since 0.0 s that it drives freely, at up to 8.0 m/s"
    assert f"   3.0 s  brakes from 8.0 m/s to a stop, {free}" in lines
    (departure,) = [line for line in lines if "drives on" in line]
    assert departure.endswith("drives on: since 7.0 s drives towards a bend 29 m ahead that allows 6.6 m/s")


def test_a_moment_has_the_reason_of_the_story() -> None:
    notes = (60, Reason(Cause.BLOCKED, ("k3",), CAR, 20.0)), (80, Reason(Cause.FREE, speed=8.0))
    story = make_story(record(SPEEDS + BRAKING + WAITING, *notes))
    told = "is held up by vehicle car, which stands in its way, 20 m ahead"
    assert f"   3.5 s  brakes from 8.0 m/s to a stop: {told}" in story.tell()
    assert story.tell_moment(90)[1:3] == [
        f"Why, noted at 3.0 s (tick 60): it {told}.",
        "Noted later, at 4.0 s (tick 80): it drives freely, at up to 8.0 m/s.",
    ]
    assert story.tell_moment(75)[1:2] == [f"Why, noted at 3.0 s (tick 60): it {told}."]


def test_negotiation_is_told_when_it_changes() -> None:
    line = np.zeros((3, 2))
    asked = Mcm(
        ReferencePose(0.0, 0.0, 0.0, 5), 8.0, Intention.KEEP, Direction.FOLLOW, 0.2, line, line,
        {"00c0ffee": Intention.KEEP, "b": Intention.STOP}, {"c": True, "d": False}, ("00c0ffee", "b"), 99,
    )  # fmt: skip
    other_words = replace(asked, requests={"00c0ffee": Intention.FASTER, "b": Intention.STOP})
    sent = [(5, asked), (9, asked), (13, other_words), (17, replace(asked, requests={}, answers={}, group=()))]
    messages = [Message(encode(mcm).type, encode(mcm).payload, "0", tick) for tick, mcm in sent]
    said = Message("text", encode("I wait for 00c0ffee.").payload, "0", 20)
    channel = tuple(SentMessage(message, {}) for message in (*messages, Message("mcm", b"nonsense", "0", 18), said))
    names = {"00c0ffee": "0", "b": "1", "c": "2", "d": "3"}
    lines = [
        line[10:]
        for line in tell(record(SPEEDS, messages=channel, pseudonyms=names))
        if "negot" in line or "says" in line
    ]
    assert lines == [
        "negotiates with CAV 1: asks CAV 1 to stop, agrees with CAV 2, refuses CAV 3, will itself keep its speed",
        'says "I wait for 0."',
    ]


def test_a_conversation_is_quoted_with_its_rounds_and_its_order() -> None:
    line = np.zeros((3, 2))
    asked = Mcm(
        ReferencePose(0.0, 0.0, 0.0, 5), 8.0, Intention.KEEP, Direction.FOLLOW, 0.2, line, line,
        {"00c0ffee": Intention.KEEP, "b": Intention.SLOWER}, {"00c0ffee": True}, ("b", "00c0ffee"), 99,
    )  # fmt: skip
    texts = ("[0a0b0c0d 1] propose b>00c0ffee keep: b is nearest", "[0a0b0c0d 2 critic] All are too slow")
    said = (*(encode(text) for text in texts), encode(asked))
    channel = tuple(SentMessage(Message(one.type, one.payload, "0", 5 + i), {}) for i, one in enumerate(said))
    names = {"00c0ffee": "0", "b": "1"}
    lines = [line[10:] for line in tell(record(SPEEDS, messages=channel, pseudonyms=names))]
    assert 'says in round 1: "propose 1>0 keep: 1 is nearest"' in lines
    assert 'objects and opens round 2: "All are too slow"' in lines
    told = (
        "negotiates with CAV 1: asks all to pass in the order 1, 0, asks CAV 1 to slow down, will itself keep its speed"
    )
    assert told in lines


def test_each_event_that_it_warned_of_is_told_once() -> None:
    pose = ReferencePose(0.0, 0.0, 0.0, 5)
    brakes = Denm(pose, 0, EventCause.DANGEROUS_SITUATION, 1, 0.0, 0.0, 5, 1.0, 8.0, 4.9, 2.0)
    stands = replace(brakes, sequence=1, cause=EventCause.STATIONARY_VEHICLE)
    over = replace(stands, termination=Termination.CANCELLATION)
    sent = [("0", 5, brakes), ("0", 7, brakes), ("1", 8, brakes), ("0", 9, stands), ("0", 11, over)]
    messages = [replace(encode(denm), sender=sender, tick=tick) for sender, tick, denm in sent]
    channel = tuple(SentMessage(message, {}) for message in (*messages, Message("denm", b"nonsense", "0", 12)))
    lines = [line[10:] for line in tell(record(SPEEDS, messages=channel)) if "warns" in line]
    assert lines == ["warns of its emergency braking", "warns of itself, because it stands"]


def test_a_moment_says_what_holds_and_since_when() -> None:
    story = make_story(record(SPEEDS + BRAKING + WAITING, (60, Reason(Cause.BLOCKED, ("k3",), CAR, 20.0))))
    assert story.tell_moment(90) == [
        "At tick 90 (4.5 s) CAV 0 brakes at 4.0 m/s, since 3.5 s (tick 70).",
        "Why, noted at 3.0 s (tick 60): it is held up by vehicle car, which stands in its way, 20 m ahead.",
        "Ahead of it: vehicle car 13.6 m ahead, standing.",
    ]
    assert story.tell_moment(20)[1] == "Its agent has noted no reason."
    free = make_story(record(SPEEDS + BRAKING, (0, Reason(Cause.FREE, speed=8.0))))
    assert (
        free.tell_moment(90)[1]
        == "Its agent sees no reason, noted at 0.0 s (tick 0): it drives freely, at up to 8.0 m/s."
    )
    assert free.tell_moment(60)[1] == "Why, noted at 0.0 s (tick 0): it drives freely, at up to 8.0 m/s."


def test_a_moment_after_the_end_says_how_it_ended() -> None:
    episode = record(SPEEDS)
    gone = replace(episode, valid=np.where(np.arange(episode.ticks)[:, None] < 50, episode.valid, False))
    (line,) = make_story(gone).tell_moment(60)
    assert line == "At tick 60 (3.0 s) CAV 0 is not in the world any more: at 3.5 s it arrives."
