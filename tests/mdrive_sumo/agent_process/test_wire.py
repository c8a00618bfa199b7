"""Messages and frames: what the trusted side writes arrives as it was, large arrays through a file."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.agent_process import frame_file, wire_protocol
from mdrive_sumo.agent_process.frame_reader import FrameReader
from mdrive_sumo.contract import Briefing, Message, Objects, Observation, OwnState, PointCloud, VehicleFacts

OWN = OwnState(1.0, 2.0, 0.5, 3.0, 0.0, 0.0, 0.0)
CLOUD = np.arange(24_000, dtype=np.float32).reshape(-1, 4)


def seen(tick: int, cloud: np.ndarray) -> Observation:
    scan = PointCloud(cloud, np.zeros(0, dtype=np.int32), ())
    objects = Objects(("a",), np.zeros(1, dtype=np.uint8), *(np.full(1, float(i)) for i in range(6)))
    return Observation(tick, OWN, objects, {"light": "g"}, (Message("cam", b"hi", "b", 3),), lidar={"top": scan})


def same(first: Observation, second: Observation) -> bool:
    arrays = [(a.lidar["top"].points, a.objects.x if a.objects else None) for a in (first, second)]
    rest = [(a.tick, a.own, dict(a.signals), a.messages, a.objects.ids if a.objects else None) for a in (first, second)]
    return rest[0] == rest[1] and all(np.array_equal(x, y) for x, y in zip(*arrays, strict=True))


@pytest.fixture
def folder(tmp_path: Path):
    made = frame_file.FrameFolder(tmp_path)
    yield made
    made.close()


def test_an_observation_arrives_as_it_was() -> None:
    first = seen(4, CLOUD)
    assert same(wire_protocol.decode(wire_protocol.encode(first)), first)


def test_large_arrays_travel_through_the_frame_file(folder: frame_file.FrameFolder) -> None:
    reader = FrameReader(folder.path)
    for tick in range(4):
        first = seen(tick, CLOUD + tick)
        folder.begin()
        data = wire_protocol.encode_frame({"tick": tick, "value": first}, folder.store)
        assert len(data) < 1500
        found = wire_protocol.decode(data[wire_protocol.LENGTH.size :], reader.load)
        assert found["tick"] == tick and same(found["value"], first)


def test_an_agent_may_keep_what_it_was_shown(folder: frame_file.FrameFolder) -> None:
    reader, kept = FrameReader(folder.path), []
    for tick in range(5):
        folder.begin()
        data = wire_protocol.encode_frame({"value": seen(tick, CLOUD + tick)}, folder.store)[
            wire_protocol.LENGTH.size :
        ]
        kept.append(wire_protocol.decode(data, reader.load)["value"].lidar["top"].points)
    assert [int(points[0, 0]) for points in kept] == [0, 1, 2, 3, 4]


def test_the_frame_before_can_be_read_while_the_next_is_written(folder: frame_file.FrameFolder) -> None:
    reader, places = FrameReader(folder.path), []
    for value in (1.0, 2.0):
        folder.begin()
        places.append(folder.store(np.full(1000, value)))
    found = np.zeros(1000)
    reader.load(found, places[0])
    assert found.tolist() == [1.0] * 1000


def test_several_arrays_of_a_frame_lie_beside_each_other(folder: frame_file.FrameFolder) -> None:
    arrays = [np.full((1000 + i, 3), i, dtype=np.float64) for i in range(5)]
    folder.begin()
    data = wire_protocol.encode_frame({"value": arrays}, folder.store)[wire_protocol.LENGTH.size :]
    found = wire_protocol.decode(data, FrameReader(folder.path).load)["value"]
    assert all(np.array_equal(a, b) for a, b in zip(arrays, found, strict=True))


@pytest.mark.slow
def test_a_frame_may_grow(folder: frame_file.FrameFolder) -> None:
    reader = FrameReader(folder.path)
    for size in (5_000, 500_000, 50, 3_000_000):
        folder.begin()
        first, second = np.full(size, 7.0), np.full(size, 8.0)
        places = folder.store(first), folder.store(second)
        for array, place in zip((first, second), places, strict=True):
            found = np.zeros(size)
            reader.load(found, place)
            assert np.array_equal(found, array)


def test_a_full_disk_is_an_error_of_ours(folder: frame_file.FrameFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space"):
        folder.store(np.zeros(10_000))


def test_a_place_beyond_the_frame_is_an_error(folder: frame_file.FrameFolder) -> None:
    reader = FrameReader(folder.path)
    with pytest.raises(OSError, match="expected a frame of at least"):
        reader.load(np.zeros(10), 1 << 40)
    array = {"": "array", "dtype": "<f8", "shape": (9,), "offset": 0}
    with pytest.raises(wire_protocol.WireError, match="expected a frame of at least"):
        wire_protocol.decode(wire_protocol.msgpack.packb(array), reader.load)
    with pytest.raises(wire_protocol.WireError, match="expected no array outside the message"):
        wire_protocol.decode(wire_protocol.msgpack.packb(array))


def test_a_closed_folder_is_gone_and_readers_keep_what_they_have(tmp_path: Path) -> None:
    folder = frame_file.FrameFolder(tmp_path)
    assert folder.path.parent == tmp_path
    folder.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_next_one_removes_what_a_killed_process_left_and_nothing_else(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from mdrive_sumo.agent_process.frame_file import FrameFolder;"
        "print(FrameFolder(Path(sys.argv[1])).path.name, flush=True); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
    left = tmp_path / done.stdout.strip()
    assert done.returncode == -9 and left.is_dir()
    alive = frame_file.FrameFolder(tmp_path)
    assert not left.exists()
    another = frame_file.FrameFolder(tmp_path)
    assert alive.path.is_dir()
    for folder in (alive, another):
        folder.close()


def test_only_the_owner_writes(folder: frame_file.FrameFolder) -> None:
    modes = {path.name: path.stat().st_mode & 0o777 for path in folder.path.iterdir()}
    assert set(modes) == {"0", "1"}
    assert all(mode & 0o022 == 0 for mode in modes.values())
    reader = FrameReader(folder.path)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.pwrite(reader._files[0], b"x", 0)


def test_a_briefing_arrives_as_it_was(folder: frame_file.FrameFolder) -> None:
    facts = VehicleFacts(*(float(i) for i in range(1, 10)))
    xy = np.random.default_rng(0).normal(size=(400, 2))
    first = Briefing("a", 1, 0.05, 60.0, facts, xy, *(np.arange(400.0) for _ in range(4)))
    folder.begin()
    data = wire_protocol.encode_frame({"value": first}, folder.store)[wire_protocol.LENGTH.size :]
    found = wire_protocol.decode(data, FrameReader(folder.path).load)["value"]
    assert np.array_equal(found.route_xy, xy) and found.vehicle == facts


@pytest.mark.parametrize("value", [object(), {1, 2}, np.zeros(2, dtype=complex).dtype, lambda: 0])
def test_what_the_contract_does_not_know_does_not_travel(value: object) -> None:
    with pytest.raises(TypeError, match="expected a value of the contract"):
        wire_protocol.encode(value)


@pytest.mark.slow
def test_the_agents_side_imports_little() -> None:
    """What the host needs must be there in a box that has numpy and msgpack only."""
    code = (
        "import sys; import mdrive_sumo.agent_process.host, mdrive_sumo.agent_process.carla_adapter;"
        "print(*sorted({name.partition('.')[0] for name in sys.modules} - set(sys.stdlib_module_names)))"
    )
    done = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, env=_bare(), check=True)
    found = {
        name for name in done.stdout.split() if "cython" not in name
    }  # what numpy's compiled parts call themselves
    assert found == {"__main__", "mdrive_sumo", "msgpack", "numpy"}


@pytest.mark.slow
def test_the_agents_side_reads_modules_as_python_does(tmp_path: Path) -> None:
    """Its own way of reading saves the supervisor of a box two calls a module."""
    contents = {
        "empty": b"",
        "short": b"x = 1\r\n",
        "long": bytes(range(256)) * 700,
    }  # longer than what is read at once
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    code = (
        "import sys; from importlib.machinery import SourceFileLoader as Loader; before = Loader.get_data\n"
        "import mdrive_sumo.agent_process.host\n"
        "assert Loader.get_data is not before\n"
        "for path in sys.argv[1:]: assert Loader('x', path).get_data(path) == before(Loader('x', path), path)\n"
        "try: Loader('x', 'no').get_data('no')\n"
        "except FileNotFoundError: print('told')"
    )
    command = [sys.executable, "-S", "-c", code, *(str(tmp_path / name) for name in contents)]
    assert subprocess.run(command, capture_output=True, text=True, env=_bare(), check=True).stdout == "told\n"


def _bare() -> dict[str, str]:
    return {"PYTHONPATH": os.pathsep.join((str(Path(wire_protocol.__file__).parents[2]), *sys.path[1:]))}
