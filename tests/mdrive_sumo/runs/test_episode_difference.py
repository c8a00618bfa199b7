"""The first difference between two episodes, which `verify` names."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import Actors, Contact, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame
from mdrive_sumo.runs.episode_difference import (
    find_content_difference,
    find_first_difference,
    find_parting,
    find_separation,
)

TICKS = 8
PEDAL = Control(throttle=0.5, brake=0.0, steer=0.0)


def frame(tick: int, **changes: object) -> Frame:
    egos = {name: EgoState(x=tick * 0.4, y=y, yaw=0.0, speed=8.0) for name, y in (("0", 0.0), ("1", 5.0))}
    return replace(Frame(tick, egos, Actors.empty(), {"light": "G"}), **changes)


def episode(frames: list[Frame], pedals: dict[int, Control] | None = None, end: int = TICKS - 1) -> EpisodeRecord:
    recorder = Recorder("s", {}, {"0": (4.9, 2.0), "1": (4.9, 2.0)})
    for seen in frames:
        controls = dict.fromkeys(seen.egos, (pedals or {}).get(seen.tick, PEDAL))
        recorder.add(quantize_frame(seen), controls, {}, {})
    return recorder.finish([Ending(ego, end, End.ARRIVED) for ego in ("0", "1")])


FRAMES = [frame(tick) for tick in range(TICKS)]
RECORDED = episode(FRAMES)
TRACK, OBJECT = {"sensing_track": "sensor"}, {"sensing_track": "object"}


def changed(tick: int, **changes: object) -> EpisodeRecord:
    return episode([*FRAMES[:tick], frame(tick, **changes), *FRAMES[tick + 1 :]])


@given(
    tick=st.integers(0, TICKS - 1),
    ego=st.sampled_from(("0", "1")),
    field=st.sampled_from(("x", "y", "yaw", "speed")),
)
def test_the_first_changed_state_is_named(tick: int, ego: str, field: str) -> None:
    state = FRAMES[tick].egos[ego]
    egos = {**FRAMES[tick].egos, ego: replace(state, **{field: getattr(state, field) + 0.002})}
    difference = find_first_difference(RECORDED, changed(tick, egos=egos))
    assert difference is not None
    assert difference.tick == tick
    assert difference.text.startswith(f"{field} of '{ego}' is ")
    was, now = getattr(state, field), getattr(egos[ego], field)
    assert difference.text.endswith(f"is {now:.4f}, was {was:.4f}")


def test_equal_episodes_have_no_difference() -> None:
    assert find_first_difference(RECORDED, episode(FRAMES)) is None
    assert find_content_difference(RECORDED, episode(FRAMES)) is None


@pytest.mark.parametrize(
    ("forged", "text"),
    [
        (replace(RECORDED, quanta=RECORDED.quanta + (RECORDED.valid[..., None] * 7)), "x of '0' is 0.0000, was 0.0070"),
        (replace(RECORDED, controls=RECORDED.controls + np.int16(1)), "throttle of '0' is 0.5000, was 0.5001"),
        (replace(RECORDED, contacts=((3, Contact("0", "1", Kind.VEHICLE)),)), "contacts of the recording are not"),
        (replace(RECORDED, width=RECORDED.width / 2), "width of the recording are not"),
    ],
    ids=["states", "controls", "contacts", "sizes"],
)
def test_a_recording_changed_beside_its_digests_is_found(forged: EpisodeRecord, text: str) -> None:
    """An attack: `rescore` reads the states, and only the digests were compared."""
    assert find_first_difference(forged, episode(FRAMES)) is None
    difference = find_content_difference(forged, episode(FRAMES))
    assert difference is not None and text in difference.text


def test_a_recording_that_claims_another_sensing_track_is_found() -> None:
    lists, carried, old = (replace(RECORDED, about=about) for about in (TRACK | OBJECT, TRACK, {}))
    difference = find_content_difference(carried, lists)
    assert difference is not None
    assert difference.text == "sensing track sensor in the recording, object in the episode"
    assert find_content_difference(old, lists) is None  # recorded before tracks existed


@pytest.mark.parametrize(
    ("again", "tick", "text"),
    [
        (episode(FRAMES, {3: replace(PEDAL, throttle=0.6)}), 3, "throttle of '0' is 0.6000, was 0.5000"),
        (changed(2, egos={"0": FRAMES[2].egos["0"]}), 2, "'1' is missing"),
        (changed(4, signals={"light": "r"}), 4, "traffic lights change to {'light': 'r'}, changed to {}"),
        (changed(5, contacts=(Contact("0", "1", Kind.VEHICLE),)), 5, "contacts are [('0', '1')], were none"),
        (episode(FRAMES[:-1]), TICKS - 1, "the episode has 7 ticks, had 8"),
        (episode(FRAMES, end=6), 6, "'0' ends arrived in tick 6, ended arrived in tick 7"),
    ],
)
def test_the_first_difference_is_named(again: EpisodeRecord, tick: int, text: str) -> None:
    difference = find_first_difference(RECORDED, again)
    assert difference is not None
    assert (difference.tick, difference.text) == (tick, text)


@given(st.integers(0, TICKS - 1), st.sampled_from(["0", "1"]), st.floats(0.1, 30.0))
def test_parting_is_the_first_tick_in_which_a_cav_differs(tick: int, ego: str, metres: float) -> None:
    """From that tick on the CAV is so far to the side; other road users count for nothing."""
    moved = [_shift(seen, ego, metres) if seen.tick >= tick else seen for seen in FRAMES]
    other = episode(moved)
    found = find_parting(RECORDED, other)
    assert found and found.tick == tick and found.text.startswith(f"CAV {ego} has y ")
    assert found.text.endswith(" m")
    back = find_parting(other, RECORDED)
    assert back and back.tick == tick
    apart = find_separation(RECORDED, other, metres - 0.05)
    assert apart and (apart.tick, apart.text) == (tick, f"CAV {ego}")
    assert find_separation(RECORDED, other, metres + 0.05) is None


def _shift(seen: Frame, ego: str, metres: float) -> Frame:
    state = seen.egos[ego]
    return replace(seen, egos={**seen.egos, ego: replace(state, y=state.y + metres)})


def test_parting_of_equal_and_of_shorter_episodes() -> None:
    assert find_parting(RECORDED, changed(3, signals={"light": "r"})) is None
    found = find_parting(RECORDED, episode(FRAMES[:5], end=4))
    assert found and (found.tick, found.text) == (5, "one episode ends")
    gone = {name: state for name, state in FRAMES[6].egos.items() if name == "0"}
    found = find_parting(RECORDED, changed(6, egos=gone))
    assert found and (found.tick, found.text) == (6, "CAV 1 has ended in one of them")
