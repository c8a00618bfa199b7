"""The V2XPnP writer: exact without noise, and with the noise that was measured on the real frames with it."""

import math
import pickle
import re
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from testing import v2xpnp_original
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.geometry import Float, wrap_angles
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.scenarionet import read_scenarionet
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.observation_noise import ObservationNoise, assign_numbers, simulate_observers
from real2sim.writers.v2xpnp import LABEL_BY_CATEGORY, write_v2xpnp, write_views
from real2sim.writers.v2xpnp_map import assign_lane_numbers, write_vector_map

REAL = SHARED_DATA / "real_logs/scenarionet_nuscenes/sd_nuscenes_scene-0757.pkl"
EXCERPT = SHARED_DATA / "v2xpnp_excerpt" / "2023-03-17-16-12-12_3_0"
FRAMES = 60
HALF_MM = 0.00051


def track(
    name: str, x: Any, y: Any, yaw: Any = 0.0, category: ObjectCategory = ObjectCategory.CAR, **more: Any
) -> RecordedTrack:
    size = {ObjectCategory.PEDESTRIAN: (0.6, 0.5), ObjectCategory.TRUCK: (12.0, 3.0)}.get(category, (4.5, 1.9))
    columns = [np.broadcast_to(np.asarray(v, dtype=np.float64), FRAMES).copy() for v in (x, y, yaw, *size)]
    return RecordedTrack(name, category, np.ones(FRAMES, dtype=np.bool_), *columns, **more)


def scene(
    *tracks: RecordedTrack, cavs: tuple[str, ...] = (), stations: tuple[tuple[float, float, float], ...] = ()
) -> Recording:
    posts = [ObserverView(f"post {i}", (), np.tile(pose, (FRAMES, 1)), True) for i, pose in enumerate(stations)]
    return Recording("scene", "test", 0.1, FRAMES, (ObserverView("log", tracks), *posts), HdMap(), cavs)


def same_tracks(written: RecordedTrack, found: RecordedTrack) -> None:
    assert (found.id, found.category, found.parked) == (written.id, written.category, written.parked)
    np.testing.assert_array_equal(found.valid, written.valid)
    there = written.valid
    np.testing.assert_allclose(found.xy, np.where(there[:, None], written.xy, np.nan), atol=HALF_MM)
    turn = wrap_angles(found.yaw - written.yaw)[there]
    np.testing.assert_allclose(turn, 0.0, atol=math.radians(HALF_MM))
    np.testing.assert_allclose(found.length[there], written.length[there], atol=2 * HALF_MM)
    np.testing.assert_allclose(found.width[there], written.width[there], atol=2 * HALF_MM)


@st.composite
def tracks(draw: st.DrawFn, name: str, frames: int) -> RecordedTrack:
    valid = np.array(draw(st.lists(st.booleans(), min_size=frames, max_size=frames).filter(any)))

    def column(low: float, high: float) -> Float:
        drawn = draw(st.lists(st.floats(low, high), min_size=frames, max_size=frames))
        return np.where(valid, np.array(drawn), np.nan)

    return RecordedTrack(
        name,
        draw(st.sampled_from(list(ObjectCategory))),
        valid,
        *(column(-5000, 5000), column(-5000, 5000), column(-math.pi, math.pi), column(0.1, 30), column(0.1, 5)),
        parked=draw(st.booleans()),
    )


@st.composite
def views(draw: st.DrawFn, observer: str, frames: int) -> ObserverView:
    names = draw(st.lists(st.integers(0, 999).map(str), max_size=4, unique=True))
    pose = np.array(
        draw(st.lists(st.tuples(*[st.floats(-300, 300)] * 2, st.floats(-3.14, 3.14)), min_size=frames, max_size=frames))
    )
    return ObserverView(observer, tuple(draw(tracks(name, frames)) for name in names), pose, observer.startswith("-"))


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    frames = draw(st.integers(1, 4))
    observers = draw(st.sampled_from([("1",), ("1", "2"), ("1", "-1"), ("1", "2", "-1", "-2")]))
    drawn = tuple(draw(views(observer, frames)) for observer in observers)
    return Recording("log", "v2xpnp", 0.1, frames, drawn, HdMap(), tuple(o for o in observers if not o.startswith("-")))


@given(recordings())
@settings(max_examples=60, deadline=None)
def test_what_is_written_is_read(written: Recording) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_views(written, Path(folder) / "log")
        read = read_v2xpnp(Path(folder) / "log", ())
        for file in Path(folder).glob("log/*/*.yaml"):  # the layout is PyYAML's own, as in the real files
            assert yaml.dump(yaml.safe_load(file.read_text())) == file.read_text()
    assert (read.id, read.dt_s, read.frame_count, read.cavs) == ("log", 0.1, written.frame_count, written.cavs)
    for before, after in zip(written.views, read.views, strict=True):
        assert (after.observer, after.is_infrastructure) == (before.observer, before.is_infrastructure)
        np.testing.assert_allclose(after.pose[:, :2], before.pose[:, :2], atol=HALF_MM)
        np.testing.assert_allclose(wrap_angles(after.pose[:, 2] - before.pose[:, 2]), 0, atol=math.radians(HALF_MM))
        found = {track.id: track for track in after.tracks}
        assert found.keys() == {track.id for track in before.tracks}
        for one in before.tracks:
            same_tracks(one, found[one.id])


def test_without_noise_everyone_sees_everything_but_itself(tmp_path: Path) -> None:
    t = np.arange(FRAMES) * 0.1
    truth = scene(
        track("ego", 10 * t, 0.0),
        track("other", 100 - 8 * t, 3.5, math.pi),
        track("walker", 20.0, 5 + t, 1.5, ObjectCategory.PEDESTRIAN),
        track("kerb", 40.0, -4.0, parked=True),
        cavs=("ego", "other"),
        stations=((5.0, 9.0, 1.0),),
    )
    ids = write_v2xpnp(truth, tmp_path / "log", None, 0)
    assert ids == {"ego": "0", "other": "1", "walker": "2", "kerb": "3"}
    read = read_v2xpnp(tmp_path / "log", ())
    assert [view.observer for view in read.views] == ["1", "2", "-1"]
    for view, own in zip(read.views, ("ego", "other", None), strict=True):
        expected = [replace(one, id=ids[one.id]) for one in truth.views[0].tracks if one.id != own]
        assert [one.id for one in view.tracks] == [one.id for one in expected]
        for before, after in zip(expected, view.tracks, strict=True):
            same_tracks(before, after)
    np.testing.assert_allclose(read.views[0].pose, np.column_stack((10 * t, 0 * t, 0 * t)), atol=HALF_MM)
    np.testing.assert_allclose(read.views[2].pose, np.tile((5, 9, 1), (FRAMES, 1)), atol=HALF_MM)
    assert "ego_speed: 0\ninfra: true\n" in (tmp_path / "log/-1/000000.yaml").read_text()


def test_unknown_sizes_and_yaws(tmp_path: Path) -> None:
    nothing = np.full(FRAMES, np.nan)
    walker = replace(
        track("7", 1.0, 2.0, category=ObjectCategory.PEDESTRIAN), yaw=nothing, length=nothing, width=nothing
    )
    truth = scene(track("3", 0.0, 0.0), walker, cavs=("3",))
    write_v2xpnp(truth, tmp_path / "log", None, 0)
    (found,) = read_v2xpnp(tmp_path / "log", ()).views[0].tracks
    assert found.id == "7"
    assert np.isnan(found.length).all()
    assert (found.yaw == 0).all()
    assert simulate_observers(truth, ObservationNoise(), 0).views[0].tracks[0].id == "7"


# --- noise


@pytest.fixture(scope="module")
def observed() -> tuple[Recording, Recording]:
    """A scene in which nothing hides anything, and what two CAVs and a station noted of it."""
    t = np.arange(FRAMES) * 0.1
    far = [track(str(n), 40 * math.cos(n / 6), 40 * math.sin(n / 6), n / 6) for n in range(2, 34)]
    walkers = [
        track(str(n), 25 * math.cos(n), 25 * math.sin(n) + t, math.pi / 2, ObjectCategory.PEDESTRIAN)
        for n in range(34, 60)
    ]
    turning = track("60", 30.0, 60.0, wrap_angles(math.radians(25) * t))
    truth = scene(
        track("0", 0.5 * t, 0.0), track("1", 5 + 0.5 * t, 5.0, 1.0), *far, *walkers, turning,
        cavs=("0", "1"), stations=((3.0, -6.0, 0.5),),
    )  # fmt: skip
    return truth, simulate_observers(truth, ObservationNoise(min_visible_share=0.0), 3)


def by_id(view: ObserverView) -> dict[str, RecordedTrack]:
    return {track.id: track for track in view.tracks}


def both(seen: Recording) -> tuple[dict[str, RecordedTrack], dict[str, RecordedTrack], list[str], list[str]]:
    """The views of both CAVs, and which cars and walkers are in both."""
    first, second = by_id(seen.views[0]), by_id(seen.views[1])
    shared = sorted(first.keys() & second.keys() - {"60"})
    walkers = [k for k in shared if first[k].category is ObjectCategory.PEDESTRIAN]
    cars = [k for k in shared if k not in walkers]
    assert min(len(cars), len(walkers)) > 15
    return first, second, cars, walkers


def test_a_cav_is_missing_from_its_own_view_only(observed: tuple[Recording, Recording]) -> None:
    first, second, station = map(by_id, observed[1].views)
    assert ("0" in first, "1" in first) == (False, True)
    assert ("0" in second, "1" in second) == (True, False)
    assert ("0" in station, "1" in station) == (True, True)
    assert observed[1].cavs == ("1", "2")


def test_positions_differ_by_what_was_measured(observed: tuple[Recording, Recording]) -> None:
    truth, seen = observed
    first, second = by_id(seen.views[0]), by_id(seen.views[1])
    gaps = np.concatenate([np.hypot(*(first[k].xy - second[k].xy).T) for k in first.keys() & second.keys()])
    assert 0.07 < np.nanmedian(gaps) < 0.13
    assert np.nanmax(gaps) < 0.9
    true = by_id(truth.views[0])
    error = np.concatenate([first[k].x - true[k].x for k in first])
    assert abs(np.nanmean(error)) < 0.02
    one = first["2"].x - 40 * math.cos(2 / 6)  # errors last: neighbours in time are alike
    assert np.nanmedian(np.abs(np.diff(one))) < 0.5 * np.nanstd(error)


def test_sizes_are_constant_in_a_view_and_differ_between_views(observed: tuple[Recording, Recording]) -> None:
    first, second, cars, _ = both(observed[1])
    ratios = [np.nanmedian(first[k].length) / np.nanmedian(second[k].length) for k in cars]
    assert 0.05 < np.std(ratios) < 0.15
    for name, one in first.items():
        spread = float(np.nanstd(one.length))
        assert spread > 0.03 if one.category is ObjectCategory.PEDESTRIAN else spread < 1e-9, name


def test_yaws_are_junk_for_walkers_exact_for_cars_and_late_in_turns(observed: tuple[Recording, Recording]) -> None:
    first, second, cars, walkers = both(observed[1])
    for names, low, high in ((cars, 0.0, 1.0), (walkers, 20.0, 180.0)):
        apart = np.concatenate([np.abs(wrap_angles(first[k].yaw - second[k].yaw)) for k in names])
        assert low < np.degrees(np.nanmedian(apart)) < high
    truth = by_id(observed[0].views[0])["60"]
    lag = np.degrees(wrap_angles(truth.yaw - first["60"].yaw))[30:]
    assert 8 < np.nanmedian(lag) < 13


def test_the_lidar_is_not_the_box(observed: tuple[Recording, Recording]) -> None:
    truth, seen = observed
    turns: list[float] = []
    for view, cav in zip(seen.views[:2], ("0", "1"), strict=True):
        car = by_id(truth.views[0])[cav]
        assert (np.abs(np.hypot(*(view.pose[:, :2] - car.xy).T) - 0.7) < 0.25).all()
        turn = wrap_angles(view.pose[:, 2] - car.yaw)
        assert np.ptp(turn) < 1e-9
        turns.append(abs(math.degrees(turn[0])))
    assert 0.1 < max(turns) <= 5.0
    np.testing.assert_array_equal(seen.views[2].pose, truth.views[1].pose)


def test_tracks_have_gaps(observed: tuple[Recording, Recording]) -> None:
    truth, seen = observed
    whole = simulate_observers(truth, ObservationNoise(min_visible_share=0.0, gaps_per_s=0.0), 3)
    share = 0.05 * 0.1 * 3  # gaps a second, seconds a frame, mean length of a gap [frames]
    for with_gaps, without in zip(seen.views, whole.views, strict=True):
        kept, full = by_id(with_gaps), by_id(without)
        missing = np.array([full[k].valid & ~kept[k].valid for k in kept])
        assert share / 3 < missing.mean() < share * 3
        assert not any((kept[k].valid & ~full[k].valid).any() for k in kept)


def test_range_and_occlusion() -> None:
    wall = track("1", 20.0, 0.0, math.pi / 2, ObjectCategory.TRUCK)
    truth = scene(
        track("0", 0.0, 0.0), wall, track("2", 40.0, 0.0), track("3", 0.0, 100.0), track("4", 0.0, -130.0),
        cavs=("0",), stations=((0.0, 5.0, 0.0),),
    )  # fmt: skip
    cav, station = map(
        by_id, simulate_observers(truth, ObservationNoise(gaps_per_s=0.0, label_error_probability=0.0), 0).views
    )
    assert cav.keys() == {"1", "3"}  # 2 is behind the truck, 4 out of range
    assert station.keys() == {"0", "1"}
    assert by_id(simulate_observers(truth, ObservationNoise(cav_range_m=200.0), 0).views[0]).keys() == {"1", "3", "4"}


def test_labels_and_attributes_disagree() -> None:
    angles = [(n, n / 100 * math.pi) for n in range(2, 200)]
    ring = [track(str(n), 180 * math.cos(a), 180 * math.sin(a), a + math.pi / 2, parked=n % 2 == 0) for n, a in angles]
    truth = scene(*(track(str(n), 0.0, 5.0 * n) for n in range(2)), *ring, cavs=("0", "1"))
    noise = ObservationNoise(min_visible_share=0.0, cav_range_m=500.0)
    first, second = map(by_id, simulate_observers(truth, noise, 0).views)
    shared = [k for k in first.keys() & second.keys() if k not in "01"]
    assert len(shared) > 100  # the CAVs hide some from each other
    assert 0 < sum(first[k].parked != second[k].parked for k in shared) < 0.3 * len(shared)
    assert any(first[k].category != second[k].category for k in shared)
    standing = [one for view in (first, second) for one in view.values() if int(one.id) >= 2]
    assert {one.category for one in standing} == {ObjectCategory.CAR, ObjectCategory.VAN}
    wrong = [one.parked != (int(one.id) % 2 == 0) for one in standing]
    assert 0.005 < np.mean(wrong) < 0.12


def test_the_seed_decides(observed: tuple[Recording, Recording], tmp_path: Path) -> None:
    truth, seen = observed
    noise = ObservationNoise(min_visible_share=0.0)
    again, other = simulate_observers(truth, noise, 3), simulate_observers(truth, noise, 4)
    np.testing.assert_array_equal(again.views[0].tracks[5].x, seen.views[0].tracks[5].x)
    assert not np.array_equal(other.views[0].tracks[5].x, seen.views[0].tracks[5].x, equal_nan=True)
    fewer = replace(truth, views=(ObserverView("log", truth.views[0].tracks[:20]),))  # others' noise is their own
    np.testing.assert_array_equal(
        by_id(simulate_observers(fewer, noise, 3).views[0])["9"].y, by_id(seen.views[0])["9"].y
    )
    write_v2xpnp(truth, tmp_path / "log", noise, 3)
    for before, after in zip(seen.views, read_v2xpnp(tmp_path / "log", ()).views, strict=True):
        found = by_id(after)
        for one in before.tracks:
            same_tracks(one, found[one.id])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda r: replace(r, dt_s=0.2), "frames 0.1 s apart, not 0.2 s"),
        (lambda r: replace(r, views=(replace(r.views[0], observer="log"),)), "not those of view 'log'"),
        (lambda r: replace(r, views=(ObserverView("1", (track("a", 0, 0),), np.zeros((FRAMES, 3))),)), "view '1'"),
    ],
)
def test_what_the_format_cannot_say_is_refused(tmp_path: Path, spoil: Any, message: str) -> None:
    good = Recording(
        "a", "test", 0.1, FRAMES, (ObserverView("1", (track("5", 0, 0),), np.zeros((FRAMES, 3))),), HdMap()
    )
    write_views(good, tmp_path / "good")
    with pytest.raises(ValueError, match=message):
        write_views(spoil(good), tmp_path / "bad")
    assert not (tmp_path / "bad").exists()


def test_a_cav_must_be_there_throughout() -> None:
    one = track("a", 0, 0)
    one.valid[3] = False
    with pytest.raises(ValueError, match="CAV a must be there in every frame, it is absent in 1"):
        simulate_observers(scene(one, cavs=("a",)), None, 0)


def test_numbers_are_kept_and_names_are_counted() -> None:
    assert assign_numbers(scene(track("7", 0, 0), track("30", 0, 0))) == {"7": "7", "30": "30"}
    assert assign_numbers(scene(track("07", 0, 0), track("7", 0, 0))) == {"07": "0", "7": "1"}


def test_a_log_of_four_agents_and_84_actors_is_read_in_seconds(tmp_path: Path) -> None:
    rows = np.random.default_rng(0).uniform(-60, 60, (84, 2))
    crowd = [track(str(n), x, y) for n, (x, y) in enumerate(rows.tolist())]
    truth = scene(*crowd, cavs=("0", "1"), stations=((0.0, 0.0, 0.0), (9.0, 9.0, 0.0)))
    write_v2xpnp(truth, tmp_path / "log", None, 0)
    begin = time.perf_counter()
    read = read_v2xpnp(tmp_path / "log", ())
    assert (time.perf_counter() - begin) * 100 / FRAMES < 10.0
    assert sum(int(one.valid.sum()) for view in read.views for one in view.tracks) == FRAMES * (4 * 84 - 2)


# --- the vector map


@st.composite
def lanes(draw: st.DrawFn, name: str) -> MapLane:
    count = draw(st.integers(2, 8))
    along = np.cumsum(np.array(draw(st.lists(st.floats(0.5, 20.0), min_size=count, max_size=count))))
    turn, x, y = draw(st.floats(-3.14, 3.14)), *draw(st.tuples(st.floats(-500, 500), st.floats(-500, 500)))
    ahead, aside = np.array((math.cos(turn), math.sin(turn))), np.array((-math.sin(turn), math.cos(turn)))
    centre = np.array((x, y)) + along[:, None] * ahead
    sides = [
        centre + aside * draw(st.floats(1.0, 3.0)) * sign if draw(st.booleans()) else centre[:0] for sign in (1, -1)
    ]
    near = st.lists(st.sampled_from(["0_1", "1_1", "1_-2", "9_9"]), max_size=2).map(tuple)
    kind = draw(st.sampled_from([LaneKind.DRIVING, LaneKind.SIDEWALK, LaneKind.SHOULDER, LaneKind.PARKING]))
    group = name.partition("_")[0]
    return MapLane(name, kind, centre, *sides, draw(near), draw(near), group=group, directed=False)


@st.composite
def maps(draw: st.DrawFn) -> HdMap:
    names = draw(st.lists(st.sampled_from(["0_1", "0_2", "1_1", "1_-2", "12_3"]), min_size=1, unique=True))
    crossing = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 9.0), (0.0, 9.5)))
    signals = {name: (name,) for name in names if draw(st.booleans())}
    return HdMap({name: draw(lanes(name)) for name in names}, (crossing,) * draw(st.integers(0, 2)), (), signals)


@given(maps())
@settings(max_examples=100, deadline=None)
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


@needs_data
def test_a_real_log_and_its_map_survive(tmp_path: Path) -> None:
    real = read_scenarionet(REAL)
    cars = [one for one in real.views[0].tracks if one.valid.all() and one.category is ObjectCategory.CAR]
    cav = max(cars, key=lambda one: math.dist(one.xy[0], one.xy[-1]))
    truth = replace(real, dt_s=0.1, cavs=(cav.id,))
    ids = write_v2xpnp(truth, tmp_path / "log", None, 0)
    names = write_vector_map(real.map, tmp_path / "m.pkl")
    read = read_v2xpnp(tmp_path / "log", tmp_path / "m.pkl")
    found = by_id(read.views[0])
    assert len(found) == len(real.views[0].tracks) - 1 > 10
    for one in real.views[0].tracks:
        if one is not cav:
            np.testing.assert_allclose(found[ids[one.id]].xy, one.xy, atol=HALF_MM)
    assert len(read.map.lanes) == len(real.map.lanes)
    for lane in real.map.lanes.values():
        np.testing.assert_array_equal(read.map.lanes[names[lane.id]].centre, lane.centre)


# --- against the real thing


def outline(path: Path) -> tuple[str, set[str]]:
    """Head and objects of a frame file, every value replaced by its type: what is left is keys, order and layout."""
    text = re.sub(r"-?[0-9]+\.[0-9]+(e-?[0-9]+)?$", "FLOAT", path.read_text(), flags=re.MULTILINE)
    text = re.sub(r"^  [0-9]+:$", "  ID:", text, flags=re.MULTILINE)
    text = re.sub(r"obj_type: [A-Z][A-Za-z]+$", "obj_type: LABEL", text, flags=re.MULTILINE)
    text = re.sub(r"attribute: (''|static)$", "attribute: WORD", text, flags=re.MULTILINE)
    head, *objects = text.split("  ID:\n")
    return head, set(objects)


def typed(value: object) -> object:
    """A loaded frame with types for values; all objects of a frame must be alike."""
    if isinstance(value, dict):
        if all(isinstance(key, int) for key in value):
            return {"id": {repr(typed(one)) for one in value.values()}}
        return {key: typed(one) for key, one in value.items()}
    return [typed(one) for one in value] if isinstance(value, list) else type(value).__name__


@needs_data
def test_files_are_like_the_real_ones_key_by_key(tmp_path: Path) -> None:
    t = np.arange(FRAMES) * 0.1
    things = [track("0", 10 * t, 0.0), track("1", 30.0, 5.0, 1.0, parked=True), track("2", 9.0, t, 1.0)]
    walkers = [track("3", 20.0, 5 + t, category=ObjectCategory.PEDESTRIAN)]
    truth = scene(*things, *walkers, cavs=("0", "2"), stations=((5.0, 9.0, 1.0),))
    write_v2xpnp(truth, tmp_path / "log", ObservationNoise(), 0)
    real = sorted(EXCERPT.glob("*/*.yaml"))
    assert {path.parent.name for path in real} == {"1", "2", "-1"}
    assert {path.parent.name for path in (tmp_path / "log").glob("*/*.yaml")} == {"1", "2", "-1"}
    for path in real:
        written = tmp_path / "log" / path.parent.name / path.name
        assert written.is_file()  # six digits, from 000000 on
        head, objects = outline(written)
        real_head, real_objects = outline(path)
        assert head == real_head
        assert len(objects) == 1
        assert objects == real_objects
        assert typed(yaml.safe_load(written.read_text())) == typed(yaml.safe_load(path.read_text()))
    labels = {box["obj_type"] for path in real for box in yaml.safe_load(path.read_text())["vehicles"].values()}
    assert labels <= set(LABEL_BY_CATEGORY.values())
