"""V2XPnP's map writer: the reader and the original classes read what it writes."""

import math
import pickle
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing import v2xpnp_original
from testing.sampling import examples

from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.writers.v2xpnp_map import assign_lane_numbers, write_vector_map


# --- the vector map
@st.composite
def lanes(draw: st.DrawFn, name: str) -> MapLane:
    count = draw(st.integers(2, 8))
    along = np.cumsum(np.array(draw(st.lists(st.floats(0.5, 20.0), min_size=count, max_size=count))))
    turn, x, y = draw(st.floats(-3.14, 3.14)), *draw(st.tuples(st.floats(-500, 500), st.floats(-500, 500)))
    ahead, aside = np.array((math.cos(turn), math.sin(turn))), np.array((-math.sin(turn), math.cos(turn)))
    centre = np.array((x, y)) + along[:, None] * ahead
    left, right = (
        centre + aside * draw(st.floats(1.0, 3.0)) * sign if draw(st.booleans()) else centre[:0] for sign in (1, -1)
    )
    near = st.lists(st.sampled_from(["0_1", "1_1", "1_-2", "9_9"]), max_size=2).map(tuple)
    kind = draw(st.sampled_from([LaneKind.DRIVING, LaneKind.SIDEWALK, LaneKind.SHOULDER, LaneKind.PARKING]))
    group = name.partition("_")[0]
    return MapLane(name, kind, centre, left, right, draw(near), draw(near), group=group, directed=False)


@st.composite
def maps(draw: st.DrawFn) -> HdMap:
    names = draw(st.lists(st.sampled_from(["0_1", "0_2", "1_1", "1_-2", "12_3"]), min_size=1, unique=True))
    crossing = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 9.0), (0.0, 9.5)))
    signals = {name: (name,) for name in names if draw(st.booleans())}
    return HdMap({name: draw(lanes(name)) for name in names}, (crossing,) * draw(st.integers(0, 2)), (), signals)


@given(maps())
@settings(max_examples=examples(25, 100), deadline=None)
def test_a_map_that_is_written_is_read(written: HdMap) -> None:
    with tempfile.TemporaryDirectory() as folder:
        names = write_vector_map(written, Path(folder) / "m.pkl")
        read, notes = read_vector_map(Path(folder) / "m.pkl")
    assert (notes, names) == ((), {name: name for name in written.lanes})
    assert list(read.lanes) == list(written.lanes)
    for name, before in written.lanes.items():
        after = read.lanes[name]
        assert replace(after, centre=before.centre, left=before.left, right=before.right, width=before.width,
                       speed_limit=before.speed_limit) == before  # fmt: skip
        for line in ("centre", "left", "right"):
            np.testing.assert_array_equal(getattr(after, line), getattr(before, line))
    assert read.signals == written.signals
    assert [polygon.tolist() for polygon in read.crosswalks] == [polygon.tolist() for polygon in written.crosswalks]


def test_the_originals_classes_unpickle_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = np.array(((0.0, 0.0), (10.0, 0.5)))
    given_map = HdMap(
        {"2_1": MapLane("2_1", LaneKind.SHOULDER, line, left=line + 1, right=line - 1, exits=("3_1",))},
        crosswalks=(np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))),),
        signals={"light": ("2_1",)},
    )
    write_vector_map(given_map, tmp_path / "m.pkl")
    types = v2xpnp_original.installed(monkeypatch)
    with (tmp_path / "m.pkl").open("rb") as file:
        found = pickle.load(file)
    assert isinstance(found, types.Map)
    lane, crosswalk = found.map_features
    assert isinstance(lane, types.Lane)
    assert lane == types.Lane(
        road_id=2,
        lane_id=1,
        type=types.LaneType.Shoulder,
        polyline=[types.MapPoint(0.0, 0.0, 0.0), types.MapPoint(10.0, 0.5, 0.0)],
        entry_lanes=[],
        exit_lanes=["3_1"],
        boundary=[types.MapPoint(*p, 0.0) for p in ((1.0, 1.0), (11.0, 1.5), (-1.0, -1.0), (9.0, -0.5))],
    )
    assert crosswalk == types.Crosswalk([types.MapPoint(*p, 0.0) for p in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))], 0)
    assert found.dynamic_states == [types.DynamicState(0.0, [types.TrafficSignalLaneState(0, "UNKNOWN")])]


def test_lanes_of_other_sources_are_numbered(tmp_path: Path) -> None:
    line = np.array(((0.0, 0.0), (10.0, 0.0)))
    rows = [
        MapLane("right", LaneKind.DRIVING, line - 3, left_neighbour="left", entries=("alone", "gone")),
        MapLane("left", LaneKind.DRIVING, line, right_neighbour="right", exits=("alone",)),
        MapLane("alone", LaneKind.BIKE, line + 9, left_neighbour="gone"),
        MapLane("g1", LaneKind.DRIVING, line, group="g"),
        MapLane("g2", LaneKind.DRIVING, line, group="g"),
    ]
    found = HdMap({lane.id: lane for lane in rows})
    assert assign_lane_numbers(found) == {"left": (0, 1), "right": (0, 2), "alone": (1, 1), "g1": (2, 1), "g2": (2, 2)}
    names = write_vector_map(found, tmp_path / "m.pkl")
    read, _ = read_vector_map(tmp_path / "m.pkl")
    assert set(read.lanes) == set(names.values())
    assert read.lanes[names["right"]].entries == ("1_1", "gone")
    assert read.lanes[names["left"]].exits == ("1_1",)
    assert read.lanes[names["alone"]].kind is LaneKind.SHOULDER


def test_neighbours_in_a_circle_end() -> None:
    line = np.array(((0.0, 0.0), (10.0, 0.0)))
    rows = [MapLane(a, LaneKind.DRIVING, line, left_neighbour=b) for a, b in (("a", "b"), ("b", "a"))]
    numbers = assign_lane_numbers(HdMap({lane.id: lane for lane in rows}))
    assert len(set(numbers.values())) == 2
