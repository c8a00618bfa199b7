"""Streets, roads and motorways: what was drawn stays the same bytes, is sound and drivable, and keeps to its limits."""

import hashlib
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
import shapely
from testing.place_traffic import drive_traffic, list_ways
from testing.sampling import sampled

from mdrive_sumo.core.geometry import build_polyline, wrap_angle
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.worlds.network_features import extract_features
from mdrive_sumo.worlds.places import Place, check_place, draw_place, write_place
from mdrive_sumo.worlds.places.draw_place import STREET_KINDS

GOLDEN: dict[str, str] = {
    "arterial": "086d4af1a8ee75fb",
    "corridor": "3c3101387f9d8d63",
    "country_road": "1578c9eec90cc83c",
    "lane_drop": "f93687b99f587466",
    "motorway_exit": "b64ab8298c3f0a9a",
    "motorway_merge": "542fe39e03d2ad3d",
    "motorway_weave": "b26ae8673dcee1a9",
    "residential_street": "b2b821bc0a77004b",
    "works_zone": "1bd43abf2d21a763",
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


def test_every_kind_of_street_has_a_golden_checksum() -> None:
    assert sorted(kind.name for kind in STREET_KINDS) == KINDS


def check_soundness(roads: RoadMap) -> None:
    assert check_place(roads) == []
    assert all(area.polygon.is_valid for area in roads.drivable_areas)
    assert list_ways(roads)
    assert {stop.lane for stop in roads.bus_stops} <= set(roads.lanes)
    lanes = shapely.union_all(
        [shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat") for lane in roads.driving]
    )
    for row in roads.parking:
        strip = shapely.LineString(row.xy).buffer(row.width_m / 2 - 0.1, cap_style="flat")
        assert lanes.intersection(strip).area < 0.05, row.id
        assert build_polyline(row.xy).length > 5.0


def check_traffic(roads: RoadMap, folder: Path) -> None:
    """Vehicles from every entry to every exit: no collision, no teleport, none that cannot depart for others."""
    counts = drive_traffic(roads, folder)
    assert (counts.collisions, counts.teleports, counts.emergency_stops) == (0, 0, 0)
    assert counts.inserted > 5
    assert counts.arrived >= 0.4 * counts.inserted
    assert counts.waiting <= 0.1 * counts.inserted


@pytest.mark.parametrize("kind", KINDS)
def test_places_are_sound(kind: str) -> None:
    check_soundness(draw_roads(kind, 0))


@pytest.mark.parametrize("kind", KINDS)
def test_two_minutes_of_traffic_flow(kind: str, tmp_path: Path) -> None:
    check_traffic(draw_roads(kind, 0), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled(range(1, 11), (1, 2)))
@pytest.mark.parametrize("kind", KINDS)
def test_places_of_many_seeds_are_sound_and_traffic_flows(kind: str, seed: int, tmp_path: Path) -> None:
    roads = draw_roads(kind, seed)
    check_soundness(roads)
    check_traffic(roads, tmp_path)


LAYOUTS = [
    ("works_zone", {"layout": "lane_closed", "side": "left"}),
    ("works_zone", {"layout": "contraflow"}),
    ("works_zone", {"layout": "narrowed"}),
    ("works_zone", {"layout": "alternating"}),
    ("lane_drop", {"side": "left"}),
    ("motorway_weave", {"carriageways": 2}),
    ("corridor", {"junctions": 0}),
    ("arterial", {"junctions": 0, "median": "trees"}),
    ("country_road", {"tracks": 0, "roadside": "hedges"}),
    ("residential_street", {"yards": 4, "parking": "both_sides"}),
]


@pytest.mark.parametrize(("kind", "given"), LAYOUTS)
def test_layouts_that_are_asked_for_are_sound(kind: str, given: dict[str, str | int], tmp_path: Path) -> None:
    roads = load_road_map(write(draw_place(kind, "asked", **given), tmp_path))
    check_soundness(roads)
    check_traffic(roads, tmp_path)


def test_a_shared_lane_of_works_has_one_signal_for_both_ends(tmp_path: Path) -> None:
    roads = load_road_map(write(draw_place("works_zone", 1, layout="alternating"), tmp_path))
    lights = {light.split(":")[0] for lane in roads.driving for light in lane.lights.values()}
    assert lights == {"works"}
    first, other = (roads.lanes[name].centre for name in ("forward_1_0", "backward_1_0"))
    middle = first.at(first.length / 2)
    assert abs(other.project(*middle)[1]) < 0.1  # the same lane in the middle


def test_parked_rows_end_before_the_streets_that_join() -> None:
    roads = load_road_map(write(draw_place("corridor", 3, parking="both_sides"), Path(mkdtemp())))
    arms = [lane for lane in roads.driving if lane.edge.endswith(("_in", "_out"))]
    assert arms
    assert roads.parking
    joined = shapely.union_all([shapely.LineString(lane.centre.xy).buffer(lane.width / 2) for lane in arms])
    assert all(shapely.LineString(row.xy).distance(joined) > 5.0 for row in roads.parking)


def test_turn_lanes_lead_to_the_left_only() -> None:
    roads = load_road_map(write(draw_place("arterial", 2, junctions=1, lanes=2), Path(mkdtemp())))
    inner = [lane for lane in roads.driving if not lane.junction and lane.index == 3]
    assert inner
    for lane in inner:
        ways = [roads.lanes[name] for name in lane.successors]
        turns = [wrap_angle(way.centre.yaw_at(way.centre.length) - way.centre.yaw_at(0.0)) for way in ways]
        assert len(turns) == 1
        assert turns[0] > 0.5  # a left turn has two lanes, one after the other


@pytest.mark.parametrize("kind", MOTORWAYS)
def test_a_motorway_of_one_carriageway_is_a_highway_for_generation(kind: str) -> None:
    features = extract_features(draw_roads(kind, 1))
    assert features.topology == "highway"
    assert features.on_ramp == (kind in {"motorway_merge", "motorway_weave"})
