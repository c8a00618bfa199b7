"""Logs of strangers are read in a process with limits: whatever happens there is one sentence here."""

import math
import pickle
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.scenarionet_samples import description
from testing.small_log import recording, road, write_small_log

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import HdMap, StopLine
from real2sim.pipeline import limited_reader
from real2sim.pipeline.limited_reader import read_log_limited, read_vector_map_limited
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.pipeline.recording_transfer import TransferError, decode_value, encode_value
from real2sim.recording import Recording

MISBEHAVIOUR = {
    "os.abort()": r"expected a complete file, found one that crashes its reader \(SIGABRT\) or needs over 6 GiB",
    "ctypes.string_at(8)": r"expected a complete file, found one that crashes its reader \(SIGSEGV\)",
    "bytearray(2**40)": "expected a file that is read within 6 GiB of memory, found one that needs more",
    "sum(iter(int, 1))": "expected a file that is read within 1 s of processor time, found one that needs more",
    "os._exit(0)": "expected an answer of its reader, found none and the exit code 0",
    "os._exit(9)": "expected an answer of its reader, found none and the exit code 9",
    "{}['heading']": r"expected a valid file, its reader failed: KeyError in sitecustomize\.py:6: 'heading'",
    "object()": r"expected a valid file, its reader failed: TypeError in .*found object",
    "StopLine(np.zeros(2))": "expected an answer of its reader, found: expected a Recording, ",
}
"""What a reader does with a file -> sentence."""


@pytest.mark.slow
@pytest.mark.parametrize("deed", MISBEHAVIOUR)
def test_a_reader_that_misbehaves_costs_a_sentence(deed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import ctypes, os\nimport numpy as np\nfrom real2sim.hd_map import StopLine\n"
        "from real2sim.pipeline import log_source\n"
        f"def read(log):\n    return {deed}\nlog_source.READERS['scenarionet'] = read\n"
        "from real2sim.readers import input_checks\ninput_checks.check_extent = lambda path, found: None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(limited_reader, "CPU_S", 1)
    with pytest.raises(InputError, match=rf"^/a/log\.pkl: {MISBEHAVIOUR[deed]}") as caught:
        read_log_limited(LogSource("scenarionet", Path("/a/log.pkl")))
    assert "\n" not in str(caught.value)


def nest(levels: int) -> object:
    """A list of 4^levels numbers in a few hundred bytes."""
    found: list[object] = [0.0] * 4
    for _ in range(levels):
        found = [found] * 4
    return found


FLOODS = {
    "a memo of 64 GiB": (b"\x80\x04}r\xff\xff\xff\xff.", "log.pkl: expected a complete pickle, found: MemoryError$"),
    "numbers that share their parts": (
        pickle.dumps(description(metadata={"ts": nest(20), "dataset": "", "sdc_id": ""})),
        r"expected a file that is read within (6 GiB of memory|1 s of processor time), found one that needs more",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("flood", FLOODS)
def test_a_small_pickle_that_asks_for_much(flood: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, sentence = FLOODS[flood]
    path = tmp_path / "log.pkl"
    path.write_bytes(data)
    monkeypatch.setattr(limited_reader, "CPU_S", 1)
    with pytest.raises(InputError, match=sentence):
        read_log_limited(LogSource("scenarionet", path))


@pytest.mark.slow
def test_a_log_and_a_map_are_read_as_without_limits(tmp_path: Path) -> None:
    folder, map_ = write_small_log(tmp_path)
    source = LogSource("v2xpnp", folder, (map_,))
    assert same(read_log_limited(source), read_log(source))
    assert encode_value(read_vector_map_limited(map_)) == encode_value(read_log(source).map)
    with pytest.raises(InputError, match=r"^[^\n]*absent: expected a folder with one folder an agent, found none$"):
        read_log_limited(LogSource("v2xpnp", tmp_path / "absent", (map_,)))


def same(found: Recording, wanted: Recording) -> bool:
    """Two recordings are equal to the last bit and of the same types."""
    assert repr(found) == repr(wanted)
    return encode_value(found) == encode_value(wanted)


def test_a_recording_comes_back_unchanged() -> None:
    full = recording()
    assert same(decode_value(encode_value(full), Recording), full)
    place = HdMap(road().lanes, (np.eye(3, 2),), (StopLine(np.eye(2), ("1_0",), "stop"),), {"a": ("1_0",)}, True)
    back = decode_value(encode_value(place), HdMap)
    assert repr(back) == repr(place)
    assert math.isnan(back.lanes["1_0"].width)
    assert back.lanes["1_0"].centre.flags.writeable


BYTES = encode_value(recording())


@pytest.mark.parametrize("word", ["01,", "f8,f8", "O", "<M8", ">f8", ""])
def test_an_array_of_another_kind_is_refused(word: str) -> None:
    plain = msgpack.unpackb(BYTES)
    plain["views"][0]["tracks"][0]["x"]["dtype"] = word
    with pytest.raises(TransferError, match=f"expected an array of float64, found '{word}'"):
        decode_value(msgpack.packb(plain), Recording)


@given(
    cut=st.integers(0, len(BYTES)), damage=st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 255)), max_size=3)
)
@settings(max_examples=100)
def test_damaged_bytes_are_a_recording_or_refused(cut: int, damage: list[tuple[int, int]]) -> None:
    data = bytearray(BYTES)
    for place, byte in damage:
        data[place % len(data)] = byte
    try:
        assert isinstance(decode_value(bytes(data[:cut] if cut % 2 else data), Recording), Recording)
    except TransferError as error:
        assert str(error).startswith("expected a Recording, found: ") and "\n" not in str(error)
