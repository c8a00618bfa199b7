"""The tracker's compiled functions give the bits of the Python text."""

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.planning import own, things
from testing.twins import call, compare_twins, describe, get_compiled

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import PROFILES
from mdrive_sumo.core import compiled
from mdrive_sumo.perception.assignment import assign
from mdrive_sumo.perception.measurements import MEASUREMENT, OWN_SENSOR, STATIONS, Measurements, Rows
from mdrive_sumo.perception.static_object_tracker import STANDSTILL, TRACKER
from mdrive_sumo.perception.track_list import TrackOrigins
from mdrive_sumo.perception.track_states import TRACK
from mdrive_sumo.perception.tracking_parameters import TRACKING
from mdrive_sumo.v2x.messages import Cam, Cpm, ReferencePose

NAN, INF = math.nan, math.inf
TICK = 100
SEEDS = st.integers(0, 2**32 - 1)
COUNTS = st.integers(0, 12)
BAD = st.sampled_from((None, None, None, NAN, INF, -INF, 0.0, -0.0))
"""What one number of the input is replaced by."""


def draw_rows(rng: np.random.Generator, dtype: np.dtype[Any], count: int, bad: float | None = None) -> Rows:
    """Tracks or measurements within some metres, with names and places that repeat."""
    rows, names = np.zeros(count, dtype), dtype.names or ()
    for name in names:
        is_variance = name in {"position", "velocity", "bias"} or name.endswith("variance")
        rows[name] = rng.uniform(1e-4, 0.3, count) if is_variance else np.round(rng.normal(0.0, 3.0, count), 1)
    limits = {
        "count": 5,
        "has_moved": 2,
        "kind": 4,
        "source": 3,
        "number": 6,
        "confirmed": 2,
        "seen_by_sensor": 2,
        "mean_count": 16,
    }
    for name in (name for name in limits if name in names):
        rows[name] = rng.integers(name == "mean_count", limits[name], count)
    for name in (name for name in ("born_tick", "seen_tick", "mean_tick", "first_tick", "last_tick") if name in names):
        rows[name] = rng.integers(TICK - 50, TICK + 1, count)
    if "source" in names:
        rows.sort(order="source", kind="stable")
    if bad is not None and count:
        column = rng.choice([name for name in names if rows.dtype[name] == np.float64])
        rows[column][rng.integers(count)] = bad
    return rows


def draw_measurements(rng: np.random.Generator, count: int, bad: float | None = None) -> Measurements:
    rows = draw_rows(rng, MEASUREMENT, count, bad)
    sources = ("cav_1", "cav_2", "rsu")
    if rng.integers(2):
        rows["source"] = 0
        sources = (str(rng.choice((OWN_SENSOR, STATIONS))),)
    return Measurements(sources, tuple(f"t{i}" for i in rng.integers(0, 8, count)), rows)


def draw_objects(rng: np.random.Generator, count: int, bad: float | None) -> Objects:
    columns = rng.normal(0.0, 20.0, (6, count))
    columns[4:] = np.round(np.abs(columns[4:]))  # few sizes are 0
    if bad is not None and count:
        columns[rng.integers(6), rng.integers(count)] = bad
    objects = things(*columns[:4].T.tolist())
    kind = rng.integers(0, 4, count).astype(np.uint8)
    return replace(objects, kind=kind, length=columns[4], width=columns[5])


def draw_pose(rng: np.random.Generator) -> ReferencePose:
    x, y, yaw = rng.normal(0.0, 3.0, 3).tolist()
    return ReferencePose(x, y, yaw, TICK - int(rng.integers(20)), *rng.uniform(0.0, 0.3, 2).tolist())


@given(SEEDS, COUNTS, BAD, st.sampled_from(sorted(PROFILES)), st.integers(0, 20))
def test_own_detections(seed: int, count: int, bad: float | None, profile: str, elapsed: int) -> None:
    objects = draw_objects(np.random.default_rng(seed), count, bad)
    arguments = (objects, own(x=1.0, y=-2.0), PROFILES[profile], elapsed, TRACKING)
    compare_twins("perception_measurements_measure_detections", *arguments)


@given(SEEDS, st.integers(0, 5), BAD)
def test_stations(seed: int, count: int, bad: float | None) -> None:
    rng = np.random.default_rng(seed)
    stations = [(f"cav_{i}", Cam(draw_pose(rng), *rng.normal(0.0, 4.0, 6).tolist())) for i in range(count)]
    if bad is not None and stations:
        stations[0] = ("cav_0", replace(stations[0][1], yaw_rate=bad))
    compare_twins("perception_measurements_measure_stations", TICK, stations, own(), TRACKING)


@pytest.mark.slow
@given(SEEDS, st.lists(COUNTS, max_size=4), BAD, st.booleans())
def test_reports(seed: int, counts: list[int], bad: float | None, has_sigmas: bool) -> None:
    rng = np.random.default_rng(seed)
    reports: list[tuple[str, Cpm, int]] = []
    for i, count in enumerate(counts):
        ages = rng.integers(0, 9, count).astype(np.uint8)
        sigmas = rng.uniform(0.0, 0.5, (count if has_sigmas else 0, 3))
        cpm = Cpm(draw_pose(rng), 80.0, draw_objects(rng, count, bad), ages, sigmas=sigmas)
        reports.append((f"cav_{i}", cpm, int(rng.integers(0, 20))))
    compare_twins("perception_measurements_measure_reported", TICK, reports, own(), TRACKING)


@given(SEEDS, COUNTS, COUNTS, st.floats(0.0, 1.0), st.booleans())
def test_assignment(seed: int, rows: int, columns: int, share: float, has_ties: bool) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(-5.0, 20.0, (rows, columns))
    if has_ties:
        cost = np.round(cost / 8.0)
    blocks = np.sort(rng.integers(0, 3, columns))
    compare_twins("perception_assignment_assign", cost, rng.uniform(size=(rows, columns)) < share, blocks)


@pytest.mark.parametrize("bad", [NAN, INF])
def test_costs_without_an_end_are_refused(bad: float) -> None:
    arguments = np.full((2, 2), bad), np.ones((2, 2), dtype=np.bool_), np.zeros(2, dtype=np.int64)
    compare_twins("perception_assignment_assign", *arguments)
    with pytest.raises(ValueError, match="expected finite costs"):
        assign(*arguments)


@given(SEEDS, COUNTS, BAD, st.floats(0.0, 1.0))
def test_prediction_and_beginning(seed: int, count: int, bad: float | None, seconds: float) -> None:
    rng = np.random.default_rng(seed)
    tracks, new = draw_rows(rng, TRACK, count, bad), draw_measurements(rng, 3, bad)
    compare_twins("perception_track_states_predict", tracks, seconds, TRACKING)
    compare_twins("perception_track_states_start_tracks", tracks, TICK, 7, new, bool(rng.integers(2)), TRACKING)


@given(SEEDS, COUNTS, COUNTS, BAD)
def test_comparison(seed: int, count: int, more: int, bad: float | None) -> None:
    rng = np.random.default_rng(seed)
    tracks, new = draw_rows(rng, TRACK, count, bad), draw_measurements(rng, more)
    known = {(source, f"t{i}"): int(rng.integers(6)) for source in (OWN_SENSOR, "cav_1", "cav_2") for i in range(4)}
    compare_twins("perception_track_list_compare", tracks, new, known, TRACKING)


def draw_names(rng: np.random.Generator) -> TrackOrigins:
    sources = ("cav_1", STATIONS, OWN_SENSOR)
    return TrackOrigins(
        {(str(rng.choice(sources)), f"t{i}"): int(rng.integers(6)) for i in range(8)},
        {i: f"t{rng.integers(8)}" for i in range(0, 6, 2)},
        {i: str(rng.choice(sources)) for i in range(6)},
    )


def compare_naming(name: str, names: TrackOrigins, update: Callable[[Callable[..., Any], TrackOrigins], Any]) -> None:
    """Both functions of that name return the same and change the names alike."""

    def describe_update(function: Callable[..., Any]) -> Any:
        mine = copy.deepcopy(names)
        return describe((update(function, mine), mine))

    assert describe_update(get_compiled(name)) == describe_update(compiled.REFERENCES[name])


@given(SEEDS, COUNTS, st.integers(1, 12))
def test_recording_of_hits(seed: int, count: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    tracks, new = draw_rows(rng, TRACK, count), draw_measurements(rng, more)
    hits = int(rng.integers(0, more + 1)) if count else 0
    rows, columns = np.sort(rng.integers(0, max(count, 1), hits)), rng.permutation(more)[:hits]

    def record(function: Callable[..., Any], names: TrackOrigins) -> Any:
        return call(function, tracks, rows, new, columns, TICK, names, TRACKING)

    compare_naming("perception_track_list_record_hits", draw_names(rng), record)


@given(SEEDS, COUNTS, st.integers(1, 20), BAD)
def test_matching(seed: int, count: int, more: int, bad: float | None) -> None:
    """Tracks and measurements that are near one another, so that several measure one track."""
    rng = np.random.default_rng(seed)
    tracks, new = draw_rows(rng, TRACK, count, bad), draw_measurements(rng, more, bad)
    for rows in (tracks, new.rows):
        rows["kind"], rows["x"] = 0, rows["x"] / 2.0
    tracks["number"] = np.arange(count) % 6

    def match(function: Callable[..., Any], names: TrackOrigins) -> Any:
        return call(function, tracks, new, TICK, names, TRACKING)

    compare_naming("perception_track_list_match_measurements", draw_names(rng), match)


@given(SEEDS, st.integers(0, 30), BAD)
def test_end_of_an_update(seed: int, count: int, bad: float | None) -> None:
    rng = np.random.default_rng(seed)
    tracks = draw_rows(rng, TRACK, count, bad)
    for name in ("vx", "vy", "mean_vx", "mean_vy"):
        tracks[name] /= 20.0
    compare_twins("perception_track_list_end_update", tracks, TICK, TRACKING)
    compare_twins("perception_track_list_list_objects", tracks, {1: "cav_1"}, TICK, own(), TRACKING)


@pytest.mark.parametrize(
    ("rows", "columns"), [([5], [0]), ([-1], [0]), ([0], [9]), ([0], [-2]), ([0, 1], [0])]
)  # fmt: skip
def test_rows_that_do_not_exist_are_refused(rows: list[int], columns: list[int]) -> None:
    rng = np.random.default_rng(0)
    new = Measurements((OWN_SENSOR,), tuple("abcd"), draw_rows(rng, MEASUREMENT, 4))
    new.rows["source"] = 0
    tracks, pairs = draw_rows(rng, TRACK, 3), (np.array(rows), np.array(columns))
    with pytest.raises(ValueError, match="expected"):
        get_compiled("perception_track_list_record_hits")(
            tracks, pairs[0], new, pairs[1], TICK, TrackOrigins(), TRACKING
        )


def test_rows_of_another_type_are_refused() -> None:
    with pytest.raises(TypeError, match="expected rows of 208 bytes, found"):
        get_compiled("perception_track_states_predict")(np.zeros(3), 0.1, TRACKING)


@given(SEEDS, COUNTS, COUNTS, BAD)
def test_standing_objects(seed: int, count: int, more: int, bad: float | None) -> None:
    rng = np.random.default_rng(seed)
    standstills = draw_rows(rng, STANDSTILL, count)
    row_by_id = {f"t{i}": i for i in range(count)}
    objects = draw_objects(rng, more, bad)
    objects = replace(objects, ids=tuple(f"t{i}" for i in rng.integers(0, 16, more)), x=objects.x / 20.0)

    def add(function: Callable[..., Any]) -> Any:
        mine = dict(row_by_id)
        after = call(function, standstills, mine, TICK, objects, 0.5, TRACKER)
        return describe((after, mine))

    name = "perception_static_object_tracker_add_detections"
    assert add(get_compiled(name)) == add(compiled.REFERENCES[name])
