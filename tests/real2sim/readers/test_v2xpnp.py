"""The V2XPnP reader on files made with PyYAML and with stand-ins of the original's map classes."""

import collections
import math
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from testing import v2xpnp_original
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import LaneKind
from real2sim.readers.v2xpnp import CATEGORY_BY_LABEL, read_v2xpnp
from real2sim.readers.v2xpnp_frame import _parse_regular, _parse_yaml, read_frame
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.recording import ObjectCategory

EXCERPT = SHARED_DATA / "v2xpnp_excerpt" / "2023-03-17-16-12-12_3_0"
POSE = [10.0, 20.0, 1.0, -4.0, 90.0, 2.0]


def thing(x: float = 0.0, y: float = 0.0, **more: Any) -> dict[str, Any]:
    return {
        "angle": [1.0, 30.0, 2.0],
        "attribute": "",
        "center": [0, 0, 0],
        "extent": [2.25, 0.95, 0.75],
        "location": [x, y, -2.0],
        "obj_type": "Car",
        **more,
    }


def frame(vehicles: dict[int, dict[str, Any]] | None = None, pose: list[float] = POSE, **more: Any) -> str:
    default = {7: thing(1.0, 2.0)}
    return yaml.dump(
        {
            "ego_speed": 0,
            "infra": False,
            "lidar_pose": list(pose),
            "true_ego_pose": list(pose),
            "vehicles": default if vehicles is None else vehicles,
            **more,
        }
    )


def log(folder: Path, agents: dict[str, list[str]]) -> Path:
    for agent, texts in agents.items():
        (folder / agent).mkdir(parents=True)
        for t, text in enumerate(texts):
            (folder / agent / f"{t:06d}.yaml").write_text(text)
    return folder


def test_units_and_frames(tmp_path: Path) -> None:
    turned = frame({7: thing(1.0, 2.0, center=[0.5, -0.25, 0])}, pose=[1, 2, 3, 4, -180, 6])
    station = frame({}, infra=True, pose=[5.0, 6.0, 7.0, 0.0, 45.0, 0.0])
    read = read_v2xpnp(log(tmp_path / "2023_1_0", {"1": [frame(), turned], "-1": [station, station]}), ())
    assert (read.id, read.source, read.dt_s, read.frame_count, read.cavs) == ("2023_1_0", "v2xpnp", 0.1, 2, ("1",))
    cav, infra = read.views
    assert (cav.observer, cav.is_infrastructure, infra.observer, infra.is_infrastructure) == ("1", False, "-1", True)
    np.testing.assert_allclose(cav.pose, [[10, 20, math.pi / 2], [1, 2, -math.pi]])
    np.testing.assert_allclose(infra.pose, [[5, 6, math.pi / 4]] * 2)
    (car,) = cav.tracks
    np.testing.assert_allclose(car.xy, [[1, 2], [1.5, 1.75]])
    np.testing.assert_allclose(car.yaw, math.radians(30))
    np.testing.assert_allclose((car.length[0], car.width[0]), (4.5, 1.9))
    assert (car.id, car.category, car.parked, infra.tracks) == ("7", ObjectCategory.CAR, False, ())
    assert read.notes == ("no vector map given",)


def test_frames_without_the_thing_are_invalid(tmp_path: Path) -> None:
    texts = [frame(), frame({3: thing(5.0, 5.0)}), frame({3: thing(6.0, 5.0), 7: thing(1.5, 2.0)})]
    first, second = read_v2xpnp(log(tmp_path / "a", {"1": texts}), ()).views[0].tracks
    assert (first.id, first.valid.tolist(), second.id, second.valid.tolist()) == (
        *("7", [True, False, True]),
        *("3", [False, True, True]),
    )
    for column in (first.x, first.y, first.yaw, first.length, first.width):
        assert np.isnan(column).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("label", "category"),
    [
        ("Car", ObjectCategory.CAR),
        ("PoliceCar", ObjectCategory.CAR),
        ("Van", ObjectCategory.VAN),
        ("Truck", ObjectCategory.TRUCK),
        ("LongVehicle", ObjectCategory.TRUCK),
        ("ConcreteTruck", ObjectCategory.TRUCK),
        ("Bus", ObjectCategory.BUS),
        ("Motorcycle", ObjectCategory.MOTORCYCLE),
        ("BicycleRider", ObjectCategory.BICYCLE),
        ("Cyclist", ObjectCategory.BICYCLE),
        ("Scooter", ObjectCategory.BICYCLE),
        ("Pedestrian", ObjectCategory.PEDESTRIAN),
        ("Child", ObjectCategory.PEDESTRIAN),
        ("TrashCan", ObjectCategory.STATIC),
        ("traffic_cone", ObjectCategory.STATIC),
    ],
)
def test_known_labels(tmp_path: Path, label: str, category: ObjectCategory) -> None:
    read = read_v2xpnp(log(tmp_path / "a", {"1": [frame({1: thing(obj_type=label)})]}), ())
    assert read.views[0].tracks[0].category is category
    assert read.notes == ("no vector map given",)


@pytest.mark.parametrize(
    ("half_length", "category"),
    [
        (0.3, ObjectCategory.PEDESTRIAN),
        (0.9, ObjectCategory.BICYCLE),
        (2.2, ObjectCategory.CAR),
        (6.0, ObjectCategory.TRUCK),
    ],
)
def test_unknown_labels_are_noted_and_classed_by_size(
    tmp_path: Path, half_length: float, category: ObjectCategory
) -> None:
    text = frame({1: thing(obj_type="Zeppelin", extent=[half_length, 0.3, 1.0])})
    read = read_v2xpnp(log(tmp_path / "a", {"1": [text]}), ())
    assert read.views[0].tracks[0].category is category
    assert "agent 1: 1 objects of unknown type 'Zeppelin' classed by size" in read.notes


def test_majority_decides_label_and_attribute(tmp_path: Path) -> None:
    texts = [frame({1: thing(obj_type=label, attribute=a)}) for label, a in (("Van", ""), *[("Car", "static")] * 2)]
    read = read_v2xpnp(log(tmp_path / "a", {"1": texts}), ())
    (track,) = read.views[0].tracks
    assert (track.category, track.parked) == (ObjectCategory.CAR, True)
    assert any(note.startswith("agent 1: object 1 changes its type") for note in read.notes)


def test_size_zero_is_unknown(tmp_path: Path) -> None:
    (track,) = read_v2xpnp(log(tmp_path / "a", {"1": [frame({1: thing(extent=[0, 0.5, 0])})]}), ()).views[0].tracks
    assert np.isnan(track.length[0])
    assert track.width[0] == 1.0


def test_other_yaml_files_are_skipped(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"1": [frame()]})
    for name in ("000000_additional.yaml", "000001_camera_gt.yaml", "data_protocol.yaml"):
        (folder / "1" / name).write_text("nothing of ours")
    assert read_v2xpnp(folder, ()).frame_count == 1


def test_first_frame_may_have_any_number(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"1": [frame(), frame()], "2": [frame(), frame()]})
    for agent in "12":
        (folder / agent / "000000.yaml").rename(folder / agent / "000002.yaml")
    assert read_v2xpnp(folder, ()).frame_count == 2


numbers = st.one_of(
    st.integers(-1000, 1000), st.floats(-1e6, 1e6), st.floats(-1000, 1000).map(lambda v: round(v, 3)), st.just(1e-7)
)
triples = st.lists(numbers, min_size=3, max_size=3)
things = st.fixed_dictionaries(
    {
        "angle": triples,
        "attribute": st.sampled_from(["", "static"]),
        "center": triples,
        "extent": triples,
        "location": triples,
        "obj_type": st.sampled_from(["Car", "Pedestrian", "No", "TRUE", "Traffic Cone", "cone", "Off", "TrashCan"]),
    },
    optional={"speed": numbers},
)
frames = st.fixed_dictionaries(
    {
        "ego_speed": st.just(0),
        "infra": st.booleans(),
        "lidar_pose": st.lists(numbers, min_size=6, max_size=6),
        "true_ego_pose": st.lists(numbers, min_size=6, max_size=6),
        "vehicles": st.dictionaries(st.integers(0, 500), things, max_size=5),
    },
    optional={"cam1_left": st.fixed_dictionaries({"cords": triples, "extrinsic": st.lists(triples, max_size=4)})},
)


@given(frames)
@settings(max_examples=150, deadline=None)
def test_fast_path_is_the_yaml_parser(raw: dict[str, Any]) -> None:
    text = yaml.dump(raw)
    fast, slow = _parse_regular(text), _parse_yaml(Path("f.yaml"), text)
    if any(v["obj_type"] in ("No", "TRUE", "Off", "Traffic Cone", "cone") for v in raw["vehicles"].values()):
        assert fast is None
        return
    assert fast is not None
    assert (fast.infrastructure, fast.sensor, fast.ids) == (slow.infrastructure, slow.sensor, slow.ids)
    assert (fast.labels, fast.static) == (slow.labels, slow.static)
    np.testing.assert_array_equal(fast.boxes, slow.boxes)


@pytest.mark.parametrize("bare", ["No", "TRUE", "Off", "Null"])
def test_labels_that_yaml_takes_for_something_else(bare: str) -> None:
    text = frame({1: thing()}).replace("Car", bare)
    assert _parse_regular(text) is None
    assert _parse_yaml(Path("f.yaml"), text).labels == (str(yaml.safe_load(bare)),)


def test_other_layouts_are_read_too(tmp_path: Path) -> None:
    box = "{location: [1, 2, 0], extent: [2, 1, 1], angle: [0, 9, 0], obj_type: Car}"
    text = f"lidar_pose: [1, 2, 3, 4, 5, 6]\nvehicles: {{7: {box}}}\n"
    assert _parse_regular(text) is None
    (tmp_path / "f.yaml").write_text(text)
    read = read_frame(tmp_path / "f.yaml")
    assert (read.ids, read.labels, read.static, read.infrastructure) == (("7",), ("Car",), (False,), False)
    assert read.boxes.tolist() == [[0, 9, 0, 0, 0, 0, 2, 1, 1, 1, 2, 0]]


@pytest.mark.parametrize("vehicles", ["vehicles:\n", "vehicles: {}\n", "", "vehicles: null\n"])
def test_a_frame_may_be_empty(tmp_path: Path, vehicles: str) -> None:
    (tmp_path / "f.yaml").write_text("lidar_pose: [1, 2, 3, 4, 5, 6]\n" + vehicles)
    assert read_frame(tmp_path / "f.yaml").ids == ()


def test_every_truncation_shows_unless_whole_objects_are_gone(tmp_path: Path) -> None:
    text = frame({7: thing(1.0, 2.0), 8: thing(3.0, 4.0), 9: thing(5.0, 6.0)})
    file = tmp_path / "f.yaml"
    silent: list[str] = []
    for cut in range(len(text)):
        file.write_text(text[:cut])
        try:
            read_frame(file)
        except InputError as error:
            assert str(file) in str(error)
        else:
            silent.append(text[:cut].splitlines()[-1].strip())
    # only a file that is complete without its rest: a pose and no objects, or fewer of them
    assert silent == ["- 2.0", "- 2.0", "vehicles:", "obj_type: Car", "obj_type: Car"]


def cut(text: str) -> str:
    return text[: len(text) // 2]


Spoil = Callable[[Path], object]
BAD: dict[str, tuple[Spoil, str]] = {
    "truncated YAML": (
        lambda f: (f / "1/000001.yaml").write_text(cut(frame())),
        "1/000001.yaml: expected a last line with its end",
    ),
    "cut within an object": (
        lambda f: (f / "1/000001.yaml").write_text(frame().split("    location:")[0]),
        "000001.yaml: object 7: expected obj_type, found only angle, attribute, center, extent",
    ),
    "object without place": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("location", "place")),
        "000001.yaml: object 7: location: expected 3 numbers, found None",
    ),
    "no YAML": (
        lambda f: (f / "1/000001.yaml").write_text("a: [1, 2\n"),
        "000001.yaml: expected well-formed YAML, found",
    ),
    "not text": (lambda f: (f / "1/000001.yaml").write_bytes(b"\xff\xfe\n"), "expected UTF-8 text"),
    "empty file": (lambda f: (f / "1/000001.yaml").write_text(""), "expected a last line"),
    "a list": (lambda f: (f / "1/000001.yaml").write_text("- 1\n"), "expected a mapping with lidar_pose"),
    "a YAML tag": (
        lambda f: (f / "1/000001.yaml").write_text("!!python/object/apply:os.system [exit]\n"),
        "expected well-formed YAML, found: could not determine a constructor",
    ),
    "no pose": (
        lambda f: (f / "1/000001.yaml").write_text("vehicles: {}\n"),
        "lidar_pose: expected 6 numbers, found None",
    ),
    "NaN pose": (
        lambda f: (f / "1/000001.yaml").write_text(frame(pose=[math.nan, *POSE[1:]])),
        "000001.yaml: lidar_pose: expected finite numbers, found [nan",
    ),
    "NaN box": (
        lambda f: (f / "1/000001.yaml").write_text(frame({9: thing(math.nan)})),
        "000001.yaml: object 9: location: expected finite numbers, found nan",
    ),
    "infinite box": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("- 2.25", "- 1.5e+400")),
        "object 7: extent: expected finite numbers, found inf",
    ),
    "text as number": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("- 30.0", "- north")),
        "object 7: angle: expected 3 numbers, found [1.0, 'north', 2.0]",
    ),
    "object is a number": (
        lambda f: (f / "1/000001.yaml").write_text(frame({7: 5})),  # pyright: ignore[reportArgumentType]
        "object 7: expected a mapping with location, found 5",
    ),
    "vehicles is a list": (
        lambda f: (f / "1/000001.yaml").write_text(frame(vehicles=[1])),  # pyright: ignore[reportArgumentType]
        "vehicles: expected a mapping of objects, found list",
    ),
    "a hole": (
        lambda f: (f / "1/000001.yaml").unlink(),
        "1: expected all frames from 000000 to 000002, found no 000001",
    ),
    "fewer frames": (lambda f: (f / "2/000002.yaml").unlink(), "2: expected the same frames as the other agents"),
    "more frames": (lambda f: (f / "2/000003.yaml").write_text(frame()), "1: expected the same frames"),
    "missing agent": (lambda f: (f / "1").rename(f / "9"), "expected agent folders without holes, found [2, 9]"),
    "missing station": (lambda f: (f / "2").rename(f / "-2"), "found [-2, 1] and no folder -1"),
    "empty agent folder": (lambda f: (f / "3").mkdir(), "3: expected frames 000000.yaml"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_logs(tmp_path: Path, case: str) -> None:
    folder = log(tmp_path / "a", {"1": [frame()] * 3, "2": [frame()] * 3})
    assert read_v2xpnp(folder, ()).frame_count == 3
    spoil, message = BAD[case]
    spoil(folder)
    with pytest.raises(InputError) as caught:
        read_v2xpnp(folder, ())
    assert message in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_agents(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected agent folders 1, 2, \.\.\. of CAVs, found none"):
        read_v2xpnp(tmp_path, ())
    with pytest.raises(InputError, match="expected a folder"):
        read_v2xpnp(tmp_path / "nowhere", ())


def test_agents_may_be_chosen(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"2": [frame()], "-2": [frame(infra=True)], "7": []})
    assert [view.observer for view in read_v2xpnp(folder, (), agents=("2", "-2")).views] == ["2", "-2"]
    with pytest.raises(InputError, match="5: expected an agent folder"):
        read_v2xpnp(folder, (), agents=("2", "5"))


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


@pytest.mark.parametrize("name", ["Map.__init__.__globals__", "Teapot", "LaneType.__class__"])
def test_no_other_name_of_the_module(tmp_path: Path, name: str) -> None:
    module = v2xpnp_original.MODULE
    text = b"\x80\x04" + b"".join(b"\x8c" + bytes((len(part),)) + part.encode() for part in (module, name)) + b"\x93."
    (tmp_path / "m.pkl").write_bytes(text)
    with pytest.raises(InputError) as caught:
        read_vector_map(tmp_path / "m.pkl")
    assert f"{module}.{name}; nothing was executed" in str(caught.value)


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
    assert "road_id: expected a whole number, found 'x'" in message(
        types.Map([lane(types, "x", 1, EAST)], None)  # pyright: ignore[reportArgumentType]
    )
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


# --- real frames


@pytest.fixture
def first_frames(tmp_path: Path) -> Path:
    """The first frame of each agent of the real log, which has holes after it."""
    for agent in ("1", "2", "-1"):
        (tmp_path / "log" / agent).mkdir(parents=True)
        (tmp_path / "log" / agent / "000000.yaml").symlink_to(EXCERPT / agent / "000000.yaml")
    return tmp_path / "log"


@needs_data
def test_real_frames(first_frames: Path) -> None:
    """What the format notes tell of these frames, measured by others."""
    read = read_v2xpnp(first_frames, ())
    views = {view.observer: {track.id: track for track in view.tracks} for view in read.views}
    assert {name: len(view) for name, view in views.items()} == {"1": 20, "2": 18, "-1": 15}
    poses = {view.observer: view.pose[0] for view in read.views}
    for observer, other, ghost in (("1", "2", "7"), ("2", "1", "30")):
        assert ghost not in views[other]
        assert 0.4 < math.dist(views[observer][ghost].xy[0], poses[other][:2]) < 1.0
    shared = views["1"].keys() & views["2"].keys()
    assert len(shared) == 15
    gaps = [math.dist(views["1"][k].xy[0], views["2"][k].xy[0]) for k in shared]
    assert np.median(gaps) < 0.15
    assert read.notes == ("no vector map given",)


@needs_data
def test_real_frames_have_the_regular_layout() -> None:
    for path in EXCERPT.glob("*/*.yaml"):
        text = path.read_text()
        fast, slow = _parse_regular(text), _parse_yaml(path, text)
        assert fast is not None
        assert (fast.ids, fast.sensor, fast.labels, fast.static) == (slow.ids, slow.sensor, slow.labels, slow.static)
        np.testing.assert_array_equal(fast.boxes, slow.boxes)


@needs_data
def test_real_excerpt_has_holes() -> None:
    with pytest.raises(InputError, match="1: expected all frames from 000000 to 000010, found no 000001"):
        read_v2xpnp(EXCERPT, ())


def test_labels_are_normalised() -> None:
    assert all(label.isalpha() and label == label.lower() for label in CATEGORY_BY_LABEL)
