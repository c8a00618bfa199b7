"""Faults planted into clean logs of SUMO drives, written as V2XPnP files: read, cleaned and built, at least 98 % are
repaired, and none without being told."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from testing.busy_log import Crowd, busy_truth
from testing.log_faults import PLANTS, Fault, planted, tracks_of
from testing.log_truth import Log
from testing.map_faults import plant
from testing.round_trip import motions_of

from real2sim.clean import CleanedRecording, clean_recording
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.network import build_network
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.recording import ObserverView, RecordedTrack, Recording
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.writers.observation_noise import ObservationNoise, simulate_observers
from real2sim.writers.v2xpnp import write_views
from real2sim.writers.v2xpnp_map import write_vector_map
from tests.real2sim.clean.test_clean_faults import repaired, told

pytestmark = pytest.mark.slow

SHARE = 0.98
CLEAN = ObservationNoise(
    min_visible_share=0.0,
    gaps_per_s=0.0,
    cav_range_m=300.0,
    station_range_m=300.0,
    label_error_probability=0.0,
    attribute_error_probability=0.0,
)
"""Every observer sees everything all the time, with the usual errors of position, size and yaw."""
CROWD = Crowd(vehicles=30, walkers=12, all=54)
MAP_SHARE = 0.15
"""Of the lanes drawn backwards, and of the links taken away."""


@cache
def scene(seed: int) -> Recording:
    """A drive in which things are called 100, 101, ..., as the planting of faults wants it."""
    truth = busy_truth(seed, CROWD)
    names = {track.id: str(100 + n) for n, track in enumerate(truth.views[0].tracks)}
    tracks = tuple(replace(track, id=names[track.id]) for track in truth.views[0].tracks)
    whole = replace(truth.views[0], tracks=tracks)
    open_ground = replace(truth.map, buildings=())  # they hide things, and some of the parked cars stand inside them
    cavs = tuple(names[cav] for cav in truth.cavs)
    return replace(truth, views=(whole, *truth.views[1:]), cavs=cavs, map=open_ground)


@dataclass(frozen=True)
class Result:
    fault: Fault
    repaired: bool
    told: bool


def through_files(log: Log, faults: Sequence[Fault], folder: Path) -> Iterator[Result]:
    """What becomes of the faults when the log is written, read, cleaned and reconstructed."""
    found = chain(log.recording, folder)
    for fault in faults:
        yield Result(fault, repaired(fault, log, found), told(fault, log, found))


def chain(recording: Recording, folder: Path) -> CleanedRecording:
    write_views(recording, folder)
    found = clean_recording(read_v2xpnp(folder, ()))
    return replace(found, tracks=reconstruct_tracks(found.tracks, found.dt_s))


@cache
def clean_log(seed: int) -> Log:
    """A log without faults. Its truth is what the whole chain makes of it: SUMO's drivers change their acceleration at
    once, which reconstruction smooths by up to a metre, faults or none.
    """
    real = scene(seed).views[0].tracks
    log = Log(simulate_observers(scene(seed), CLEAN, seed), real)
    with TemporaryDirectory() as folder:
        found = chain(log.recording, Path(folder) / "log").tracks
    return replace(log, truth=tuple(expected(thing, tracks_of(found, thing)) for thing in real))


def expected(thing: RecordedTrack, found: Sequence[RecordedTrack]) -> RecordedTrack:
    (track,) = found
    there = thing.valid & track.valid
    columns = {name: np.where(there, getattr(track, name), np.nan) for name in ("x", "y", "yaw")}
    return thing.replace_columns(valid=there, **columns)


def shares(results: Sequence[Result]) -> dict[str, float]:
    total, good = Counter(r.fault.kind for r in results), Counter(r.fault.kind for r in results if r.repaired)
    return {kind: good[kind] / total[kind] for kind in total}


@pytest.mark.full
def test_a_clean_log_needs_no_repair() -> None:
    """Each thing has one track near it: what the other tests count as repaired was in order before."""
    log = clean_log(0)
    gaps = [np.nanmedian(np.hypot(*(a.xy - b.xy).T)) for a, b in zip(log.truth, scene(0).views[0].tracks, strict=True)]
    assert max(gaps) < 0.5
    assert clean_recording(log.recording).report.list_changes(ChangeReason.TELEPORT) == ()


@pytest.mark.full
@pytest.mark.parametrize("kind", sorted(PLANTS))
def test_planted_faults_do_break_the_log(kind: str) -> None:
    """The same checks on what was written, not cleaned."""
    log, faults = planted(clean_log(0), 0, [kind])
    assert faults
    for fault in faults:
        assert damaged(log, fault)


def damaged(log: Log, fault: Fault) -> bool:
    thing, frames = log.truth[fault.thing], list(fault.frames)
    views = [view for view in log.recording.views if fault.observer in (view.observer, "all")]
    named = [track for view in views for track in view.tracks if track.id == thing.id]
    if fault.kind == "gap":
        return not any(track.valid[frames].any() for track in named)
    if fault.kind in ("duplicate", "ego ghost"):
        return sum(lies(track, thing, frames) for view in views for track in view.tracks) > len(named)
    if fault.kind == "heading":
        return bool((np.cos(named[0].yaw - thing.yaw)[frames] < 0).all())
    return bool((np.hypot(*(named[0].xy - thing.xy)[frames].T) > 1.0).all())


def lies(track: RecordedTrack, thing: RecordedTrack, frames: list[int]) -> bool:
    return bool(np.nanmedian(np.hypot(*(track.xy - thing.xy)[frames].T)) < 1.0) if track.valid[frames].any() else False


def test_all_kinds_at_once_through_the_files(tmp_path: Path) -> None:
    results = list(through_files(*planted(clean_log(0), 0), tmp_path / "log"))
    assert set(shares(results)) == set(PLANTS)
    assert sum(result.repaired for result in results) >= SHARE * len(results), shares(results)
    assert all(result.told for result in results)


@pytest.mark.full
def test_many_logs_through_the_files(tmp_path: Path) -> None:
    results: list[Result] = []
    for seed in range(24):
        log, faults = planted(clean_log(seed % 6), seed)
        results += through_files(log, faults, tmp_path / str(seed))
    assert len(results) > 500
    assert min(shares(results).values()) >= SHARE, shares(results)
    assert [result.fault for result in results if not result.told] == []


# --- maps


@dataclass(frozen=True)
class MapResult:
    reversed: int
    removed: int
    straightened: int
    linked: int
    wrong: int


def map_through_files(seed: int, folder: Path) -> MapResult:
    """Lanes drawn backwards and links taken away in the vector map of a drive."""
    truth = scene(seed % 3)
    faulty = plant(truth.map, np.random.default_rng(seed), MAP_SHARE, MAP_SHARE)
    names = write_vector_map(faulty.map, folder / f"{seed}.pkl")
    found, _ = read_vector_map(folder / f"{seed}.pkl")
    views = (ObserverView("log", truth.views[0].tracks),)
    tracks = clean_recording(replace(truth, views=views, cavs=())).tracks
    report = build_network(found, motions_of(tracks), folder / "net", "busy")
    turned, added = set(report.directions.inverted), set(report.links_added)
    reversed_, removed = {names[n] for n in faulty.reversed}, {(names[a], names[b]) for a, b in faulty.removed}
    wrong = len(turned - reversed_) + len(added - removed) + len(report.links_dropped)
    return MapResult(len(reversed_), len(removed), len(turned & reversed_), len(added & removed), wrong)


def check_maps(results: Sequence[MapResult]) -> None:
    """What was repaired stands in the report: `inverted` and `links_added` are where this is counted."""
    assert sum(r.straightened for r in results) >= SHARE * sum(r.reversed for r in results)
    assert sum(r.linked for r in results) >= SHARE * sum(r.removed for r in results)
    assert sum(r.wrong for r in results) <= 0.01 * sum(r.reversed + r.removed for r in results)


def test_a_faulty_vector_map_is_repaired(tmp_path: Path) -> None:
    result = map_through_files(0, tmp_path)
    assert min(result.reversed, result.removed) > 3
    check_maps([result])


@pytest.mark.full
def test_many_faulty_vector_maps_are_repaired(tmp_path: Path) -> None:
    results = [map_through_files(seed, tmp_path) for seed in range(15)]
    assert sum(r.reversed + r.removed for r in results) > 150
    check_maps(results)
