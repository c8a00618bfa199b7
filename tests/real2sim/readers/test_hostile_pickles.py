"""Pickles that are made to crash the reader, each loaded in a child process: a crash fails the test, not the run."""

import pickle
import signal
import subprocess
import sys
from collections import Counter, OrderedDict, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from real2sim.readers.safe_pickle import load_pickle

LOAD = """
import sys
from pathlib import Path
from mdrive_sumo.core.errors import InputError
from real2sim.readers.safe_pickle import load_pickle
try:
    found = load_pickle(Path(sys.argv[1]))
    print(repr(found), [type(one) for one in found])
except InputError as error:
    print("refused:", error)
"""
ADDRESS = b"\x00\x00\x41\x41\x41\x41\x00\x00"
"""Bytes that numpy took for the address of an object: 0x414141410000."""


def name(module: str, attribute: str) -> bytes:
    return b"c" + module.encode() + b"\n" + attribute.encode() + b"\n"


def text(value: str) -> bytes:
    return b"\x8c" + bytes([len(value)]) + value.encode()


def data(value: bytes) -> bytes:
    return b"C" + bytes([len(value)]) + value


ONE = b"K\x01\x85"
DTYPE_O = name("numpy", "dtype") + text("O8") + b"\x89\x88\x87R"
DTYPE_F8 = name("numpy", "dtype") + text("f8") + b"\x89\x88\x87R"
AS_OBJECTS = b"(K\x03" + text("|") + b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x3ftb"
"""State of the dtype "O"."""
AS_RECORD = b"(K\x03" + text("|") + b"N" + text("a") + b"\x85}" + text("a") + DTYPE_O + b"K\x00\x86sK\x08K\x01K\x3ftb"
"""State of a dtype with one field of objects."""
EMPTY = name("numpy._core.multiarray", "_reconstruct") + name("numpy", "ndarray") + b"K\x00\x85" + data(b"b") + b"\x87R"


def fill(dtype: bytes, buffer: bytes = ADDRESS) -> bytes:
    return EMPTY + b"(K\x01" + ONE + dtype + b"\x89" + data(buffer) + b"tb"


ATTACKS = {
    "a call of ndarray": name("numpy", "ndarray") + b"(" + ONE + text("O") + data(ADDRESS) + b"tR",
    "a new ndarray": name("numpy", "ndarray") + b"(" + ONE + text("O") + data(ADDRESS) + b"t\x81",
    "an array of objects": fill(DTYPE_O),
    "a float made a record": fill(DTYPE_F8 + AS_RECORD),
    "a scalar of objects": name("numpy._core.multiarray", "scalar") + DTYPE_O + data(ADDRESS) + b"\x86R",
    "a buffer of objects": name("numpy._core.numeric", "_frombuffer")
    + b"("
    + data(ADDRESS)
    + DTYPE_O
    + ONE
    + text("C")
    + b"tR",
    "more elements than bytes": EMPTY + b"(K\x01J\xff\xff\xff\x7f\x85" + DTYPE_F8 + b"\x89" + data(ADDRESS) + b"tb",
    "a negative shape": EMPTY + b"(K\x01J\xff\xff\xff\xff\x85" + DTYPE_F8 + b"\x89" + data(ADDRESS) + b"tb",
    "a trillion empty rows": EMPTY
    + b"(K\x01\x8a\x06\x00\x00\x00\x00\x00\x01K\x00\x86"
    + DTYPE_F8
    + b"\x89"
    + data(b"")
    + b"tb",
    "text beyond Unicode": fill(
        name("numpy", "dtype") + text("U2") + b"\x89\x88\x87R(K\x03" + text("<") + b"NNNK\x08K\x04K\x08tb",
        b"\xff" * 8,
    ),
    "attributes of a constructor": EMPTY[: EMPTY.index(b"cnumpy\n")] + b"N}" + text("_function") + b"Ns\x86b",
    "attributes of a class": name("numpy", "dtype") + b"N}" + text("__new__") + b"Ns\x86b",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("attack", ATTACKS)
def test_a_pickle_that_makes_numpy_read_an_address_is_refused(attack: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.pkl"
    path.write_bytes(b"\x80\x04]" + ATTACKS[attack] + b"a.")
    done = subprocess.run([sys.executable, "-c", LOAD, path], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, (signal.Signals(-done.returncode).name, done.stderr)
    assert done.stdout.startswith(f"refused: {path}: expected a complete pickle, found: "), done.stdout
    assert done.stdout.count("\n") == 1


def test_the_state_of_a_dtype_does_not_change_its_kind(tmp_path: Path) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(b"\x80\x04" + fill(DTYPE_F8 + AS_OBJECTS) + b".")
    found = load_pickle(path)
    assert found.dtype == np.float64
    assert found.tobytes() == ADDRESS


ARRAYS: tuple[Any, ...] = (
    np.arange(6.0).reshape(2, 3),
    np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.arange(6, dtype=">i4"),
    np.array([[True, False]]),
    np.array(["ä", "longer", ""]),
    np.array(["ä"], dtype=">U3"),
    np.zeros((0, 3), np.float32),
    np.array(2.5),
    np.uint8(7),
    np.float64(0.1),
    np.str_("word"),
    np.arange(24.0).reshape(2, 3, 4).transpose(1, 2, 0),
)


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("number", range(len(ARRAYS)))
def test_plain_arrays_are_read_as_numpy_reads_them(number: int, protocol: int, tmp_path: Path) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps({"a": ARRAYS[number], "b": ARRAYS[number]}, protocol))
    found, wanted = load_pickle(path), pickle.loads(path.read_bytes())["a"]
    assert found["a"].dtype == wanted.dtype
    assert found["a"].shape == wanted.shape
    assert np.array_equal(found["a"], wanted)
    assert np.array_equal(found["b"], wanted)


CONTAINERS: tuple[Any, ...] = (
    defaultdict(int, {"VEHICLE": 3}),
    defaultdict(dict, {"a": {}}),
    defaultdict(None, {1: 2}),
    OrderedDict(b=1, a=2),
    Counter("aab"),
    {"PEDESTRIAN", "VEHICLE"},
    frozenset((1, 2)),
    b"bytes",
    b"",
)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("number", range(len(CONTAINERS)))
def test_containers_of_pythons_library_are_read_as_plain_ones(number: int, protocol: int, tmp_path: Path) -> None:
    """MetaDrive leaves a defaultdict(int) in the metadata of every description that it writes."""
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps([CONTAINERS[number]], protocol))
    (found,) = load_pickle(path)
    assert found == CONTAINERS[number]
    assert type(found) in (dict, set, frozenset, bytes)


INT = name("builtins", "int")
CONTAINER_ATTACKS = {
    "a call of int": INT + text("9" * 200) + b"\x85R",
    "a default that is a function": name("collections", "defaultdict") + name("numpy", "dtype") + b"\x85R",
    "a default that is a value": name("collections", "defaultdict") + text("int") + b"\x85R",
    "a set of a number": name("builtins", "set") + b"K\x01\x85R",
    "a set of dicts": name("builtins", "set") + b"]}a\x85R",
    "another encoding": name("_codecs", "encode") + text("a") + text("rot13") + b"\x86R",
    "bytes of a number": name("builtins", "bytes") + b"J\xff\xff\xff\x7f\x85R",
    "attributes of a default": INT + b"N}" + text("_function") + b"Ns\x86b",
    "attributes of dict": name("metadrive.scenario.scenario_description", "ScenarioDescription")
    + b"N}"
    + text("keys")
    + b"Ns\x86b",
    "items of a factory": INT + b"(" + text("a") + b"Nu",
}


@pytest.mark.parametrize("attack", CONTAINER_ATTACKS)
def test_containers_do_only_what_their_writer_does(attack: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.pkl"
    path.write_bytes(b"\x80\x04]" + CONTAINER_ATTACKS[attack] + b"a.")
    with pytest.raises(InputError, match="expected a complete pickle, found: "):
        load_pickle(path)


@pytest.mark.slow
@given(damage=st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), min_size=1, max_size=4))
@settings(max_examples=200)
def test_bytes_that_are_changed_are_read_or_refused(
    damage: list[tuple[int, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = bytearray(pickle.dumps({"a": np.arange(3.0), "b": np.array(["x"]), "c": [1, {"d": np.float64(2)}]}))
    for place, byte in damage:
        whole[place % len(whole)] = byte
    path = tmp_path_factory.getbasetemp() / "damaged.pkl"
    path.write_bytes(whole)
    try:
        load_pickle(path)
    except InputError as error:
        assert "\n" not in str(error)
