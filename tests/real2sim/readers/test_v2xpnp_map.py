"""V2XPnP's vector maps: pickles of the original classes, malicious ones, choice of the map."""

import collections
import math
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing import v2xpnp_original
from testing.v2xpnp_samples import frame, log, thing

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import LaneKind
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_map import read_vector_map


# --- the vector map
@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch) -> Any:
    return v2xpnp_original.installed(monkeypatch)


def lane(types: Any, road: int, number: int, xy: list[tuple[float, float]], **more: Any) -> Any:
    fields = {"type": types.LaneType.Driving, "entry_lanes": [], "exit_lanes": [], "boundary": [], **more}
    return types.Lane(road_id=road, lane_id=number, polyline=[types.MapPoint(x, y, 0.0) for x, y in xy], **fields)


def dumped(path: Path, features: list[Any], types: Any, states: Any = None, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(types.Map(features, states), protocol))
    return path


EAST = [(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)]


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_map_of_the_originals_classes(tmp_path: Path, types: Any, protocol: int) -> None:
    boundary = [types.MapPoint(x, y, 0.0) for x, y in ((90.0, 1.7), (10.0, 1.7), (10.0, -1.8), (90.0, -1.8))]
    features = [
        lane(types, 3, 1, EAST, boundary=boundary, exit_lanes=["4_1"], entry_lanes=["9_9"]),
        lane(types, 4, 1, [(100.0, 0.0), (150.0, 0.0)], type=types.LaneType.Sidewalk),
        lane(types, 4, 2, EAST, type=types.LaneType.Shoulder),
        lane(types, 4, 3, EAST, type=types.LaneType.ParkingLane),
        lane(types, 5, 1, EAST, type=types.LaneType.Unknown),
        lane(types, 6, 1, EAST[:1]),
        lane(types, 4, 1, EAST),
        types.Crosswalk([types.MapPoint(x, y, 0.0) for x, y in ((0, 0), (1, 0), (1, 5), (0, 5))], 1),
        types.Crosswalk([types.MapPoint(0, 0, 0)], 2),
        types.RoadLine(3, "dashed", []),
        types.WalkButton(types.MapPoint(0, 0, 0), 4),
    ]
    states = [types.DynamicState(0.1, [types.TrafficSignalLaneState(lane=n, state="STOP") for n in (0, 7, 77)])]
    found, notes = read_vector_map(dumped(tmp_path / "m.pkl", features, types, states, protocol))
    assert [(k.id, k.kind, k.group, k.directed) for k in found.lanes.values()] == [
        ("3_1", LaneKind.DRIVING, "3", False),
        ("4_1", LaneKind.SIDEWALK, "4", False),
        ("4_2", LaneKind.SHOULDER, "4", False),
        ("4_3", LaneKind.PARKING, "4", False),
    ]
    first = found.lanes["3_1"]
    np.testing.assert_array_equal(first.centre, EAST)
    np.testing.assert_array_equal(first.left, [(10.0, 1.7), (90.0, 1.7)])
    np.testing.assert_array_equal(first.right, [(10.0, -1.8), (90.0, -1.8)])
    assert (first.entries, first.exits) == (("9_9",), ("4_1",))
    assert [polygon.shape for polygon in found.crosswalks] == [(4, 2)]
    assert found.signals == {"3_1": ("3_1",)}
    assert notes == (
        "m.pkl: skipped 1 crosswalks with less than 3 points",
        "m.pkl: skipped 1 lanes of unknown type",
        "m.pkl: skipped 1 lanes with less than 2 points",
        "m.pkl: skipped 1 lanes with the id of another one",
        "m.pkl: skipped 2 signal states of unknown lanes",
    )


def test_map_with_arrays_and_ordered_dicts(tmp_path: Path, types: Any) -> None:
    plain = lane(types, 1, 1, EAST)
    plain.polyline = np.array([(x, y, 3.0) for x, y in EAST])
    plain.type, plain.road_id = 1, np.int64(1)
    plain.extra = collections.OrderedDict(a=1)
    found, _ = read_vector_map(dumped(tmp_path / "m.pkl", [plain], types))
    np.testing.assert_array_equal(found.lanes["1_1"].centre, EAST)


class Exploit:
    def __init__(self, call: Callable[..., object], *arguments: object) -> None:
        self.call, self.arguments = call, arguments

    def __reduce__(self) -> Any:
        return self.call, self.arguments


@pytest.mark.parametrize("kind", [r"posix\.system", r"(builtins|__builtin__)\.eval"])
@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_exploits_are_refused_by_name_and_do_not_run(tmp_path: Path, types: Any, kind: str, protocol: int) -> None:
    ran = tmp_path / "ran"
    shell = Exploit(os.system, f"touch {ran}")
    code = shell if "system" in kind else Exploit(eval, f"__import__('pathlib').Path({str(ran)!r}).touch()")
    pickle.loads(pickle.dumps(code, protocol))
    assert ran.exists()  # it does work where it is let
    ran.unlink()
    for features in ([code], [lane(types, 1, 1, EAST, boundary=code)], [lane(types, 1, 1, EAST), code]):
        path = dumped(tmp_path / "m.pkl", features, types, protocol=max(protocol, 2))
        with pytest.raises(InputError, match=f"{kind}; nothing was executed"):
            read_vector_map(path)
    (tmp_path / "m.pkl").write_bytes(pickle.dumps(code, protocol))
    with pytest.raises(InputError, match=kind):
        read_vector_map(tmp_path / "m.pkl")
    assert not ran.exists()


@pytest.mark.parametrize("name", ["Map.__init__.__globals__", "Teapot", "LaneType.__class__", "Tea\npot"])
def test_no_other_name_of_the_module(tmp_path: Path, name: str) -> None:
    module = v2xpnp_original.MODULE
    text = b"\x80\x04" + b"".join(b"\x8c" + bytes((len(part),)) + part.encode() for part in (module, name)) + b"\x93."
    (tmp_path / "m.pkl").write_bytes(text)
    with pytest.raises(InputError) as caught:
        read_vector_map(tmp_path / "m.pkl")
    shown = name.replace("\n", r"\n")  # found by the fuzz job: the sentence had two lines
    assert f"{module}.{shown}; nothing was executed" in str(caught.value)


def test_bad_maps(tmp_path: Path, types: Any) -> None:
    path = tmp_path / "m.pkl"
    good = dumped(path, [lane(types, 1, 1, EAST)], types).read_bytes()

    def message(content: Any) -> str:
        path.write_bytes(content if isinstance(content, bytes) else pickle.dumps(content))
        with pytest.raises(InputError) as caught:
            read_vector_map(path)
        assert str(path) in str(caught.value)
        return str(caught.value)

    assert "expected a complete pickle" in message(good[:-20])
    assert "expected a complete pickle" in message(b"<xml/>")
    assert "expected a complete pickle" in message(b"")
    assert "expected a pickled Map" in message({"lanes": []})
    assert "expected lanes, found none among 0" in message(types.Map([], None))
    assert "expected lanes, found none among 1" in message(types.Map([types.RoadLine(1, "a", [])], None))
    assert "map_features: expected a list, found str" in message(types.Map("roads", None))
    assert "lane 1_1: polyline: expected finite" in message(
        types.Map([lane(types, 1, 1, [(0, 0), (math.nan, 1)])], None)
    )
    assert "lane 1_1: type: expected a whole number" in message(types.Map([lane(types, 1, 1, EAST, type="a")], None))
    assert "road_id: expected a whole number, found 'x'" in message(types.Map([lane(types, "x", 1, EAST)], None))
    path.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        read_vector_map(path)


def test_the_nearest_map_is_chosen(tmp_path: Path, types: Any) -> None:
    folder = log(tmp_path / "a", {"1": [frame({n: thing(10.0 * n, 2.0) for n in range(1, 9)})]})
    here = dumped(tmp_path / "here.pkl", [lane(types, 1, 1, EAST)], types)
    there = dumped(tmp_path / "there.pkl", [lane(types, 2, 1, [(x, 500.0) for x, _ in EAST])], types)
    partly = dumped(tmp_path / "partly.pkl", [lane(types, 3, 1, [(0.0, 0.0), (10.0, 0.0)])], types)
    for maps in ([here, there, partly], [there, partly, here], here):
        read = read_v2xpnp(folder, maps)
        assert list(read.map.lanes) == ["1_1"]
        assert "map: here.pkl, 0.0% of track points more than 30 m from any lane" in read.notes
    with pytest.raises(InputError, match=r"there.pkl, found 100% of their points .*median 498 m.*another place"):
        read_v2xpnp(folder, there)
