"""Recordings of strangers: what they announce is checked before memory is taken, and their parts fit together."""

import io
import json
import re
import resource
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.contract import Control, Message, Note, Plan
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, Contact, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, load_episode, quantize_frame, save_episode
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage

Members = dict[str, bytes]


def record() -> EpisodeRecord:
    recorder = Recorder("s", {}, {"0": (4.9, 2.0), "1": (4.9, 2.0)})
    for tick in range(9):
        contacts = (Contact("0", "1", Kind.VEHICLE),) if tick == 5 else ()
        egos = {"0": EgoState(tick, 0, 0, 20), "1": EgoState(0, tick, 1, 2)}
        frame = quantize_frame(Frame(tick, egos, Actors.empty(), {"t": "g"}, contacts))
        recorder.add(frame, {"0": Control(0.5, 0, 0)}, {"0": Plan(np.eye(3, 2), 0.2)}, {})
        recorder.note(tick, "0", (Note("why", "x"),))
    sent = SentMessage(Message("cam", b"abc", "0", 1), {"1": (DeliveryStatus.DELIVERED, 2)})
    return recorder.finish([Ending("0", 8, End.ARRIVED), Ending("1", 8, End.ARRIVED)], (sent,))


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Members:
    path = tmp_path_factory.mktemp("e") / "e.npz"
    save_episode(record(), path)
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write(path: Path, members: Members) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def announce(head: str, data: bytes = b"") -> bytes:
    text = head.encode() + b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def with_array(name: str, data: bytes) -> Callable[[Members], Members]:
    return lambda members: {**members, f"{name}.npy": data}


def as_member(array: Any) -> bytes:
    found = io.BytesIO()
    np.save(found, array)
    return found.getvalue()


def with_header(**changes: Any) -> Callable[[Members], Members]:
    def change(members: Members) -> Members:
        header = json.loads(bytes(np.load(io.BytesIO(members["header.npy"])))) | changes
        return {**members, "header.npy": as_member(np.frombuffer(json.dumps(header).encode(), np.uint8))}

    return change


DAMAGE: dict[str, tuple[Callable[[Members], Members], str]] = {
    "an unbalanced header": (with_array("quanta", announce("{'descr': '|i1', 'shape': ((9,")), "damaged header"),
    "a header with code": (
        with_array("quanta", announce("{'descr': __import__('os'), 'fortran_order': False, 'shape': ()}")),
        "quanta: damaged header",
    ),
    "nested brackets": (with_array("quanta", announce("(" * 900)), "damaged header"),
    "a long header": (with_array("quanta", announce(" " * 60000)), "quanta: damaged header"),
    "1e12 elements": (
        with_array("quanta", announce("{'descr': '<i4', 'fortran_order': False, 'shape': (250000000000, 1, 4)}")),
        r"quanta: the shape \(250000000000, 1, 4\) does not fit its",
    ),
    "1e30 elements": (
        with_array("quanta", announce(f"{{'descr': '<i4', 'fortran_order': False, 'shape': ({10**30}, 1, 4)}}")),
        "does not fit its",
    ),
    "no elements in 1e12 columns": (
        with_array("valid", announce("{'descr': '|u1', 'fortran_order': False, 'shape': (0, 1000000000000)}")),
        "valid: arrays of different shapes",
    ),
    "objects": (
        with_array("header", announce("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", b"\x80\x04N.")),
        "header: uint8 of 1 dimensions expected",
    ),
    "another array": (with_array("extra", as_member(np.zeros(3))), r"found \['extra\.npy'\]"),
    "fewer bytes": (
        with_array("kind", announce("{'descr': '|u1', 'fortran_order': False, 'shape': (3,)}", b"\0\0")),
        r"kind: the shape \(3,\) does not fit",
    ),
    "no digests": (lambda members: {n: d for n, d in members.items() if n != "digests.npy"}, "no array digests"),
    "a missing row": (with_array("digests", as_member(np.zeros((8, 8), np.uint8))), "digests: arrays of different sh"),
    "an unknown kind": (with_array("kind", as_member(np.full(2, 99, np.uint8))), "an unknown kind of road user"),
    "no size": (with_array("length", as_member(np.full(2, np.nan))), "a length or width that is no size"),
    "a receiver that does not exist": (
        with_array("fates", as_member(np.array([[0, 7, 0, 1]], np.int32))),
        "fates: an index that does not exist",
    ),
    "a header that is a list": (with_array("header", as_member(np.frombuffer(b"[1]", np.uint8))), "corrupt file"),
    "deep JSON": (with_array("header", as_member(np.frombuffer(b"[" * 100_000, np.uint8))), "corrupt file"),
    "too many CAVs": (with_header(egos=3), "ids and egos do not fit together"),
    "CAVs below zero": (with_header(egos=-1), "ids and egos do not fit together"),
    "a name twice": (with_header(ids=["0", "0"]), "ids and egos do not fit together"),
    "a number for a name": (with_header(ids=[0, 1]), "header: ids.0: expected a valid string"),
    "an unknown ending": (with_header(endings=[{"ego": "0", "tick": 1, "end": "?"}]), "header: endings.0.end: "),
    "an ending of a stranger": (
        with_header(
            endings=[{"ego": "x", "tick": 1, "end": "arrived", "failure": None, "text": "", "failed_tick": None}]
        ),
        "header: no CAV 'x'",
    ),
    "a negative payload": (with_header(messages=[["0", 1, "cam", -3], ["0", 1, "cam", 6]]), "negative number"),
    "a tick beyond all": (with_header(notes=[[10**30, "0", "k", "t"]]), "header: "),
    "more points than there are": (with_header(plans=[[0, "0", 0.2, 10**9]]), "plan_points: arrays of different"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_recording_is_refused_in_a_sentence(name: str, members: Members, tmp_path: Path) -> None:
    change, message = DAMAGE[name]
    path = write(tmp_path / "e.npz", change(members))
    tracemalloc.start()
    with pytest.raises(InputError, match=message) as caught:
        load_episode(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6
    assert str(caught.value).startswith(f"{path}: expected a recording of mdrive-sumo, found a corrupt file (")
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_gigabytes_is_refused_unread(members: Members, tmp_path: Path) -> None:
    """The size in the directory is announced only; a true bomb of that size packs into a few MB."""
    path = write(tmp_path / "e.npz", members)
    data = bytearray(path.read_bytes())
    at = data.index(b"PK\x01\x02") + 24
    data[at : at + 4] = (2**31).to_bytes(4, "little")
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    with pytest.raises(InputError, match=r"expected a recording of at most 1073741824 bytes, found one of 21\d+$"):
        load_episode(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_utime - before < 1


NAMES = sorted(re.findall(r"\w+", "header kind length width valid quanta controls plan_points payloads fates digests"))


@pytest.mark.slow
@given(
    name=st.sampled_from(NAMES),
    damage=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=3),
    cut=st.one_of(st.none(), st.integers(0, 300)),
)
@settings(max_examples=150)
def test_arrays_with_changed_bytes_are_read_or_refused(
    name: str,
    damage: list[tuple[int, int]],
    cut: int | None,
    members: Members,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    data = bytearray(members[f"{name}.npy"])
    for place, byte in damage:
        data[place % len(data)] = byte
    path = write(tmp_path_factory.getbasetemp() / "damaged.npz", {**members, f"{name}.npy": bytes(data[:cut])})
    try:
        episode = load_episode(path)
        assert episode.x.shape == episode.valid.shape
    except InputError as error:
        assert "\n" not in str(error)
