"""Recordings: resolution, exact storage, chained digests, corrupt files."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.contract import Control, Message, Note, Plan
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, Contact, EgoState, End, FailureReason, Frame, Kind
from mdrive_sumo.episode import (
    Ending,
    EpisodeRecord,
    Recorder,
    ThinkTimeEntry,
    load_episode,
    quantize_frame,
    save_episode,
)
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage

SIZES = {"0": (4.9, 2.0), "1": (4.9, 2.0)}


def actors(ids: tuple[str, ...], x: float) -> Actors:
    n = len(ids)
    column = np.linspace(x, x + 10, n) if n else np.zeros(0)
    return Actors(
        ids,
        np.zeros(n, dtype=np.uint8),
        column,
        column,
        column / 100,
        column / 3,
        np.full(n, 5.0),
        np.full(n, 1.8),
    )


def recorded(ticks: int = 40, seed: int = 0) -> EpisodeRecord:
    rng = np.random.default_rng(seed)
    recorder = Recorder("s", {"seed": seed}, SIZES, {"0": "0badcafe", "rsu": "rsu"})
    for tick in range(ticks):
        egos = {"0": EgoState(*rng.normal(0, 50, 4))}
        if tick < ticks // 2:
            egos["1"] = EgoState(*rng.normal(0, 50, 4))
        around = actors(("a", "b", "c")[: 1 + tick % 3], float(tick))
        contacts = (Contact("0", "a", Kind.VEHICLE),) if tick == 5 else ()
        frame = quantize_frame(Frame(tick, egos, around, {"t": "gr"[tick // 20 % 2]}, contacts))
        controls = {ego: Control(0.1234, 0.0, -0.5) for ego in egos}
        plans = {"0": Plan(rng.normal(0, 50, (5, 2)), 0.2)}
        recorder.add(frame, controls, plans, {})
        recorder.note(tick, "0", (Note("why", f"{tick} ü"),) if tick % 7 == 0 else ())
    endings = [
        Ending("0", ticks - 1, End.ARRIVED),
        Ending("1", ticks // 2 - 1, End.AGENT_FAILED, FailureReason.TIMEOUT, "act: …", failed_tick=3),
    ]
    return recorder.finish(endings, tuple(sent(tick, rng) for tick in range(ticks)), (ThinkTimeEntry("0", 3, 2),))


def sent(tick: int, rng: np.random.Generator) -> SentMessage:
    fates = {"1": (DeliveryStatus.DELIVERED, tick + 6), "0": (DeliveryStatus.LOST, tick)}
    receivers = ("0", "1")[: int(rng.integers(3))]
    return SentMessage(Message("cam", rng.bytes(int(rng.integers(40))), "rsu", tick), {r: fates[r] for r in receivers})


def equal(a: EpisodeRecord, b: EpisodeRecord) -> bool:
    arrays = all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("kind", "length", "width", "valid", "quanta", "controls", "digests")
    )
    facts = all(
        getattr(a, name) == getattr(b, name)
        for name in (
            "scenario",
            "about",
            "ids",
            "egos",
            "contacts",
            "signals",
            "endings",
            "messages",
            "notes",
            "thinking",
            "pseudonyms",
        )
    )
    plans = len(a.plans) == len(b.plans) and all(
        p.tick == q.tick and p.ego == q.ego and np.allclose(p.points, q.points, atol=1e-9)
        for p, q in zip(a.plans, b.plans, strict=True)
    )
    return arrays and facts and plans


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), ticks=st.integers(2, 60))
def test_what_is_loaded_is_what_was_saved(tmp_path_factory: pytest.TempPathFactory, seed: int, ticks: int) -> None:
    episode = recorded(ticks, seed)
    path = tmp_path_factory.mktemp("e") / "e.npz"
    save_episode(episode, path)
    assert equal(load_episode(path), episode)


def test_columns_hold_what_the_frames_said() -> None:
    episode = recorded()
    assert episode.ids == ("0", "1", "a", "b", "c")
    assert episode.ego_ids == ("0", "1")
    assert episode.valid[:, 1].tolist() == [tick < 20 for tick in range(40)]
    assert episode.x[4, 2] == pytest.approx(4.0)
    assert episode.speed[4, 2] == pytest.approx(4 / 3, abs=1e-3)
    assert episode.control_values[0, 0].tolist() == pytest.approx([0.1234, 0.0, -0.5])
    assert [(change.tick, change.state) for change in episode.signals] == [(0, "g"), (20, "r")]
    assert episode.contacts == ((5, Contact("0", "a", Kind.VEHICLE)),)
    assert episode.find_ending("1").failure is FailureReason.TIMEOUT


@given(st.floats(-1e5, 1e5), st.floats(-4, 4), st.floats(-40, 40))
def test_quantising_twice_is_quantising_once(x: float, yaw: float, speed: float) -> None:
    frame = Frame(0, {"0": EgoState(x, -x, yaw, speed)}, Actors.empty(), {})
    once = quantize_frame(frame)
    assert quantize_frame(once).egos == once.egos
    assert abs(once.egos["0"].x - x) <= 0.5e-3 + 1e-9
    assert abs(once.egos["0"].yaw - yaw) <= 0.5e-4 + 1e-9


def test_frames_hold_exactly_what_the_recording_gives_back(tmp_path: Path) -> None:
    recorder = Recorder("s", {}, SIZES)
    frame = quantize_frame(Frame(0, {"0": EgoState(1.23456, 2.0, 3.00009, 4.0)}, actors(("a",), 0.3337), {}))
    recorder.add(frame, {}, {}, {})
    save_episode(recorder.finish([]), tmp_path / "e.npz")
    episode = load_episode(tmp_path / "e.npz")
    ego = frame.egos["0"]
    assert (episode.x[0, 0], episode.yaw[0, 0]) == (ego.x, ego.yaw)
    assert episode.x[0, 2] == frame.actors.x[0]


def test_every_value_moves_the_digest_from_its_tick_on() -> None:
    episode = recorded()
    assert episode.digest == recorded().digest
    other = recorded(seed=1)
    assert not (episode.digests[0] == other.digests[0]).all()


@pytest.mark.parametrize("what", ["ego", "control", "signal", "actor", "contact", "name", "message", "sender"])
def test_the_digest_covers(what: str) -> None:
    def run(change: bool) -> np.ndarray:
        recorder = Recorder("s", {}, SIZES)
        for tick in range(3):
            now = change and tick == 1
            around = actors(("b" if now and what == "name" else "a",), 1.001 if now and what == "actor" else 1.0)
            contacts = (Contact("0", "a", Kind.VEHICLE),) if now and what == "contact" else ()
            ego = EgoState(0.001 if now and what == "ego" else 0.0, 0, 0, 0)
            signals = {"t": "r" if now and what == "signal" else "g"}
            message = Message(
                "text", b"b" if now and what == "message" else b"a", "2" if now and what == "sender" else "1"
            )
            heard = {"0": (message,)}
            controls = {"0": Control(0.0001 if now and what == "control" else 0.0, 0, 0)}
            recorder.add(quantize_frame(Frame(tick, {"0": ego}, around, signals, contacts)), controls, {}, heard)
        return recorder.finish([]).digests

    same = (run(True) == run(False)).all(axis=1)
    assert same.tolist() == [True, False, False]


def test_a_corrupt_recording_gets_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "e.npz"
    with pytest.raises(InputError, match="expected a recording, found no file"):
        load_episode(path)
    save_episode(recorded(), path)
    whole = path.read_bytes()
    for data in (b"", b"PK", whole[: len(whole) // 2], b"nonsense" * 100):
        path.write_bytes(data)
        with pytest.raises(InputError, match="found a corrupt file"):
            load_episode(path)
    np.savez(path, header=np.frombuffer(b'{"format": "mdrive-sumo/episode/9"}', dtype=np.uint8))
    with pytest.raises(InputError, match=r"expected the format mdrive-sumo/episode/3, found 'mdrive-sumo/episode/9'"):
        load_episode(path)
    np.savez(path, header=np.array([object()], dtype=object))
    with pytest.raises(InputError, match="found a corrupt file"):
        load_episode(path)


def test_a_failed_agent_without_its_tick_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "e.npz"
    save_episode(recorded(), path)
    with np.load(path) as data:
        arrays = dict(data)
    header = json.loads(bytes(arrays["header"]))
    for ending, failed_tick in ((header["endings"][1], None), (header["endings"][0], 3)):
        ending["failed_tick"] = failed_tick
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        np.savez(path, **arrays)
        with pytest.raises(InputError, match="an agent that failed in no tick"):
            load_episode(path)


def test_every_flipped_byte_is_found_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "e.npz"
    episode = recorded(10)
    save_episode(episode, path)
    whole = bytearray(path.read_bytes())
    for position in range(0, len(whole), max(len(whole) // 60, 1)):
        damaged = bytearray(whole)
        damaged[position] ^= 0x55
        path.write_bytes(damaged)
        try:
            assert equal(load_episode(path), episode)
        except InputError as error:
            assert "corrupt" in str(error)
