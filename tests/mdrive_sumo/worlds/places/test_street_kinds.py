"""Streets, roads and motorways: what was drawn stays the same bytes, is sound and drivable, and keeps to its limits."""

import hashlib
import math
import random
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.place_traffic import drive_traffic, list_ways

from mdrive_sumo.core.geometry import build_polyline, wrap_angles
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.worlds.network_features import extract_features
from mdrive_sumo.worlds.places import Place, check_place, draw_place, write_place
from mdrive_sumo.worlds.places.alignment import compute_least_radius, draw_bends, trace_axis

GOLDEN = {
    "corridor": "9af4e0dc998cc9d1",
    "lane_drop": "f93687b99f587466",
    "motorway_exit": "b64ab8298c3f0a9a",
    "motorway_merge": "542fe39e03d2ad3d",
    "motorway_weave": "b26ae8673dcee1a9",
}
"""Checksum of both files of the network of each kind for seed 0: the same on every machine."""
KINDS = sorted(GOLDEN)
MOTORWAYS = ("lane_drop", "motorway_exit", "motorway_merge", "motorway_weave")


def write(place: Place, folder: Path) -> Path:
    return write_place(place, folder / place.name)


@lru_cache(maxsize=64)
def draw_roads(kind: str, seed: int) -> RoadMap:
    return load_road_map(write(draw_place(kind, seed), Path(mkdtemp())))


@pytest.mark.parametrize("kind", KINDS)
def test_bytes_of_a_kind_stay_as_they_are(kind: str) -> None:
    folder = draw_roads(kind, 0).folder
    files = b"".join((folder / name).read_bytes() for name in ("map.net.xml.gz", "network.json"))
    assert hashlib.sha256(files).hexdigest()[:16] == GOLDEN[kind]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_places_are_sound(kind: str, seed: int) -> None:
    roads = draw_roads(kind, seed)
    assert check_place(roads) == []
    assert all(area.polygon.is_valid for area in roads.drivable_areas)
    assert list_ways(roads)
    assert {stop.lane for stop in roads.bus_stops} <= set(roads.lanes)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_a_minute_of_traffic_flows(kind: str, seed: int, tmp_path: Path) -> None:
    """Vehicles from every entry to every exit: no collision, no teleport, none that cannot depart for others."""
    counts = drive_traffic(draw_roads(kind, seed), tmp_path)
    assert (counts.collisions, counts.teleports, counts.emergency_stops) == (0, 0, 0)
    assert counts.inserted > 5
    assert counts.arrived >= 0.2 * counts.inserted
    assert counts.waiting <= 0.15 * counts.inserted


@pytest.mark.parametrize("kind", KINDS)
def test_parked_rows_lie_beside_the_lanes_and_clear_of_junctions(kind: str) -> None:
    for seed in range(4):
        roads = draw_roads(kind, seed)
        lanes = shapely.union_all(
            [shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat") for lane in roads.driving]
        )
        for row in roads.parking:
            strip = shapely.LineString(row.xy).buffer(row.width_m / 2 - 0.1, cap_style="flat")
            assert lanes.intersection(strip).area < 0.05, row.id
            assert build_polyline(row.xy).length > 5.0


@pytest.mark.parametrize("kind", MOTORWAYS)
def test_a_motorway_of_one_carriageway_is_a_highway_for_generation(kind: str) -> None:
    features = extract_features(draw_roads(kind, 1))
    assert features.topology == "highway"
    assert features.on_ramp == (kind in {"motorway_merge", "motorway_weave"})


@given(seed=st.integers(0, 10_000), limit=st.sampled_from([30, 50, 70, 100, 130]), share=st.floats(0.1, 1.0))
@settings(max_examples=30)
def test_bends_are_no_tighter_than_the_limit_allows(seed: int, limit: int, share: float) -> None:
    pieces = draw_bends(random.Random(seed), 500.0, limit, share)
    assert all(radius == 0.0 or abs(radius) >= compute_least_radius(limit) for _, radius in pieces)
    assert 400.0 < math.fsum(length for length, _ in pieces) < 520.0
    line = trace_axis((3.0, 4.0), 0.5, pieces)
    assert line.length == pytest.approx(math.fsum(length for length, _ in pieces), rel=1e-3)
    assert np.abs(wrap_angles(np.diff(line.yaws))).max(initial=0.0) < 0.25


@pytest.mark.parametrize(
    ("limit", "radius"), [(30, 27.3), (50, 115.8), (60, 123.2), (80, 252.0), (100, 437.4), (120, 755.9)]
)
def test_least_radii_are_those_of_the_guideline(limit: float, radius: float) -> None:
    assert compute_least_radius(limit) == pytest.approx(radius, abs=0.5)
