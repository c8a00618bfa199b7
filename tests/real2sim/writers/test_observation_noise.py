"""Simulated observers: noise of the magnitudes measured on V2XPnP's frames."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.v2xpnp_writer_samples import FRAMES, HALF_MM, by_id, same_tracks, scene, track

from mdrive_sumo.core.geometry import wrap_angles
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.observation_noise import ObservationNoise, assign_numbers, simulate_observers
from real2sim.writers.v2xpnp import write_v2xpnp


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


def test_yaws_are_random_for_pedestrians_exact_for_cars_and_delayed_in_turns(
    observed: tuple[Recording, Recording],
) -> None:
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


@pytest.mark.slow
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


@pytest.mark.slow
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


def test_a_cav_must_be_there_throughout() -> None:
    one = track("a", 0, 0)
    one.valid[3] = False
    with pytest.raises(ValueError, match="CAV a must be there in every frame, it is absent in 1"):
        simulate_observers(scene(one, cavs=("a",)), None, 0)


def test_numbers_are_kept_and_names_are_counted() -> None:
    assert assign_numbers(scene(track("7", 0, 0), track("30", 0, 0))) == {"7": "7", "30": "30"}
    assert assign_numbers(scene(track("07", 0, 0), track("7", 0, 0))) == {"07": "0", "7": "1"}
