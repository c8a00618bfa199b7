"""Known scenes written as V2XPnP logs, with the noise of the real ones, and made into tracks and networks again."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.busy_log import ACTORS, QUIET, Crowd, busy_truth, make_busy_log
from testing.real_logs import READ
from testing.round_trip import Trip, as_truth, motions_of, there_and_back, windowed

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.hd_map import HdMap, LaneKind
from real2sim.network import build_network
from real2sim.network.lane_segment import measure_boundary_width
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.v2xpnp_map import write_vector_map

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

SHARE = 0.98
"""Of the moving vehicles that were visible long enough, found again one to one."""
CM = 0.01


def check(trip: Trip, median_m: float = 0.15, p95_m: float = 0.5) -> None:
    """The issue asks for 0.3 m and 1.0 m; noise is 0.06 m."""
    assert trip.visible
    assert len(trip.found) >= SHARE * len(trip.visible), trip.missing
    assert trip.duplicates == []
    assert trip.ghosts == []
    assert np.median(trip.errors) < median_m
    assert np.percentile(trip.errors, 95) < p95_m
    assert trip.errors.max() < 2.0


@pytest.fixture(scope="module")
def busy() -> Recording:
    return busy_truth(crowd=QUIET)


@pytest.fixture(scope="module")
def trip(busy: Recording, tmp_path_factory: pytest.TempPathFactory) -> Trip:
    folder = tmp_path_factory.mktemp("trip")
    write_vector_map(busy.map, folder / "map.pkl")
    return there_and_back(busy, folder / "log", folder / "map.pkl")


@pytest.mark.full
def test_the_busy_log_is_as_large_as_its_speed_target_says(tmp_path: Path) -> None:
    log, vector_map = make_busy_log(tmp_path, noise=None)
    found = read_v2xpnp(log, vector_map)
    assert (found.frame_count, [view.observer for view in found.views]) == (101, ["1", "2", "-1", "-2"])
    assert len({track.id for view in found.views for track in view.tracks}) == ACTORS == 84
    moving = [track for track in busy_truth().views[0].tracks if not track.parked]
    assert len(moving) > 60
    assert sum(track.category.kind is Kind.PEDESTRIAN for track in moving) == 12


@pytest.mark.full  # the converted suite of test_round_trip_convert is the same drive
def test_a_drive_in_sumo_comes_back(trip: Trip) -> None:
    check(trip)
    assert len(trip.visible) > 20
    cavs = {thing.id for thing in trip.truth[:2]}
    assert {trip.owners[track] for track in trip.cleaned.cavs.values()} == cavs
    assert trip.cleaned.cavs.keys() == {"1", "2"}
    for track, thing in trip.owners.items():  # no track is taken for another kind of road user
        kinds = {t.category.kind for t in trip.truth if t.id == thing}
        assert {t.category.kind for t in trip.tracks if t.id == track} == kinds


def car(name: str, seen: Bool) -> RecordedTrack:
    """A car that drives at 8 m/s and turns at 10 degrees a second."""
    yaw = np.radians(np.arange(len(seen)) * 1.0)
    x, y = 0.8 * np.cumsum(np.cos(yaw)), 0.8 * np.cumsum(np.sin(yaw))
    full = np.where(seen, 1.0, np.nan)
    return RecordedTrack(name, ObjectCategory.CAR, seen, x * full, y * full, yaw * full, 4.5 * full, 1.8 * full)


def seen_by(*tracks: RecordedTrack) -> Recording:
    views = tuple(ObserverView(f"-{n}", (track,), is_infrastructure=True) for n, track in enumerate(tracks, start=1))
    return Recording("log", "test", 0.1, len(tracks[0].x), views, HdMap())


def test_an_object_observed_alternately_is_one_track() -> None:
    """Never in one frame by both, as behind a row of cars that hides it now from one and now from the other."""
    turn = np.arange(80) // 8 % 2 == 0
    found = clean_recording(seen_by(car("7", turn), car("7", ~turn)))
    (track,) = found.tracks
    assert track.valid.all()
    assert np.hypot(*(track.xy - car("7", turn | ~turn).xy).T).max() < 0.3


def test_motion_in_a_long_gap_is_no_step() -> None:
    """It turned meanwhile; where it is seen again it is where it was seen."""
    seen = np.ones(80, dtype=np.bool_)
    seen[20:60] = False
    found = clean_recording(seen_by(car("7", seen)))
    (track,) = found.tracks
    assert np.hypot(*(track.xy - car("7", seen).xy)[seen].T).max() < 0.3
    assert found.report.list_changes(ChangeReason.TELEPORT) == ()
    assert found.report.list_changes(ChangeReason.LONG_GAP)


def test_without_noise_it_comes_back_exactly(busy: Recording, tmp_path: Path) -> None:
    trip = there_and_back(busy, tmp_path / "log", noise=None)
    check(trip, median_m=0.05, p95_m=0.3)
    assert trip.missing == []
    assert len(trip.tracks) == len(trip.truth)


def same_lanes(before: HdMap, after: HdMap, names: Mapping[str, str]) -> None:
    """Kinds, centre lines, links; widths where boundaries on both sides tell them. The format has no cycle lanes."""
    assert after.lanes.keys() == set(names.values())
    widths: list[float] = []
    for old, lane in before.lanes.items():
        found = after.lanes[names[old]]
        assert found.kind is (LaneKind.SHOULDER if lane.kind is LaneKind.BIKE else lane.kind)
        np.testing.assert_allclose(found.centre, lane.centre, atol=CM)
        assert set(found.exits) >= {names[other] for other in lane.exits if other in names}
        assert set(found.entries) >= {names[other] for other in lane.entries if other in names}
        widths.append(measure_boundary_width(found) - measure_boundary_width(lane))
    told = np.abs(widths)[np.isfinite(widths)]
    assert len(told) > 0.8 * np.isfinite([measure_boundary_width(lane) for lane in before.lanes.values()]).sum()
    assert not len(told) or np.percentile(told, 95) < 0.3


def same_roads(before: RoadMap, after: RoadMap) -> None:
    """Every lane lies on one of the other network, and goes the same way."""
    for lane in before.driving:
        steps = np.linspace(0.0, lane.centre.length, 9)[1:-1]
        points = np.array([lane.centre.at(s) for s in steps.tolist()])
        found = after.find_nearest_lanes(points)
        assert found.distance.max() < 0.2, lane.id
        assert np.cos(found.yaw - lane.centre.yaws_at(steps)).min() > 0.9, lane.id


def test_the_network_comes_back(busy: Recording, trip: Trip, tmp_path: Path) -> None:
    names = write_vector_map(busy.map, tmp_path / "map.pkl")
    same_lanes(busy.map, trip.read.map, names)
    report = build_network(trip.read.map, motions_of(trip.tracks), tmp_path / "net", "busy")
    roads, original = load_road_map(tmp_path / "net"), load_road_map(find_network_folder("boulevard"))
    same_roads(original, roads)
    same_roads(roads, original)
    assert (report.drop_reason_by_lane, report.links_dropped, report.links_added) == ({}, (), ())
    assert (report.left_hand, report.directions.inverted, report.directions.undecided) == (False, (), ())


@pytest.mark.full
def test_many_drives_come_back(tmp_path: Path) -> None:
    visible = found = 0
    for seed in range(1, 9):
        trip = there_and_back(busy_truth(seed, Crowd(vehicles=40, walkers=12, all=60)), tmp_path / str(seed), seed=seed)
        visible, found = visible + len(trip.visible), found + len(trip.found)
        assert trip.duplicates == []
        assert trip.ghosts == []
        assert np.percentile(trip.errors, 95) < 0.5
        assert trip.errors.max() < 2.0
    assert visible > 250
    assert found >= SHARE * visible


def real(name: str) -> Recording:
    """A real log, of the long one ten seconds."""
    found = READ[name]()
    return windowed(found, slice(1000, 1100)) if found.frame_count > 300 else found


@pytest.mark.full
@pytest.mark.parametrize("name", READ)
def test_a_real_log_comes_back(name: str, shared_data: Path, tmp_path: Path) -> None:
    truth = as_truth(real(name))
    assert truth.cavs
    names = write_vector_map(truth.map, tmp_path / "map.pkl")
    trip = there_and_back(truth, tmp_path / "log", tmp_path / "map.pkl")
    check(trip)
    same_lanes(truth.map, read_vector_map(tmp_path / "map.pkl")[0], names)


@pytest.mark.full
@pytest.mark.parametrize("name", READ)
def test_the_network_of_a_real_log_comes_back(name: str, shared_data: Path, tmp_path: Path) -> None:
    """V2XPnP knows no directions, neighbours, widths and limits: the network is the same without."""
    log = real(name)
    motions = motions_of(log.views[0].tracks)
    write_vector_map(log.map, tmp_path / "map.pkl")
    back = read_vector_map(tmp_path / "map.pkl")[0]
    told = replace(back, left_hand=log.map.left_hand)
    for one, folder in ((log.map, "before"), (told, "after")):
        build_network(one, motions, tmp_path / folder, name, log.dt_s)
    before, after = load_road_map(tmp_path / "before"), load_road_map(tmp_path / "after")
    lengths = np.array([lane.centre.length for lane in before.driving])
    middles = np.array([lane.centre.at(lane.centre.length / 2) for lane in before.driving])
    yaws = np.array([lane.centre.yaw_at(lane.centre.length / 2) for lane in before.driving])
    found = after.find_nearest_lanes(middles)
    same = (found.distance < 0.2) & (np.cos(found.yaw - yaws) > 0.9)
    assert lengths[same].sum() >= 0.95 * lengths.sum()
