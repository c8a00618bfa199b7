"""Crossings, roundabouts, town blocks, car parks and driveways: same bytes everywhere, sound, and what they promise."""

import gzip
import hashlib
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.place_traffic import drive_traffic, list_ways

from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.worlds.places import PLACE_KINDS, Place, check_place, draw_place, list_ranges, write_place
from mdrive_sumo.worlds.places.surroundings import SURROUNDINGS

GOLDEN = {
    "crossing": "0c36dd07dd674c06",
    "roundabout": "a330f2425c0df8e8",
    "town_block": "ed320911d23c4258",
    "car_park": "6875b46b8ac8330d",
    "driveways": "7bf4fe8a7c1264e0",
}
"""Checksum of the network of each kind for seed 0: the same on every machine."""
KINDS = sorted(GOLDEN)
BLIND_SEED = 0
"""Of an old town whose houses stand in a sight triangle."""
DIGEST = """
import hashlib, tempfile
from pathlib import Path
from mdrive_sumo.worlds.places import PLACE_KINDS, draw_place
for kind in sorted(PLACE_KINDS):
    for seed in range(3):
        with tempfile.TemporaryDirectory() as folder:
            draw_place(kind, seed).draft.write_recipe(Path(folder))
            files = b"".join(path.read_bytes() for path in sorted(Path(folder).iterdir()))
        print(kind, hashlib.sha256(files).hexdigest())
"""
"""Prints a checksum of the recipe of each kind for three seeds."""


@lru_cache(maxsize=64)
def draw_roads(kind: str, seed: int) -> RoadMap:
    place = draw_place(kind, seed)
    return load_road_map(write_place(place, Path(mkdtemp()) / place.name))


@pytest.mark.parametrize("kind", KINDS)
def test_bytes_of_a_kind_stay_as_they_are(kind: str) -> None:
    folder = draw_roads(kind, 0).folder
    files = gzip.decompress((folder / "map.net.xml.gz").read_bytes()) + (folder / "network.json").read_bytes()
    assert hashlib.sha256(files).hexdigest()[:16] == GOLDEN[kind]


@pytest.mark.slow
def test_two_processes_draw_the_same_bytes() -> None:
    """Neither the order of sets and dictionaries nor the process decides what is drawn."""
    digests = [
        subprocess.run(
            (sys.executable, "-c", DIGEST),
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    ]
    assert digests[0] == digests[1]
    assert len(digests[0].splitlines()) == 3 * len(PLACE_KINDS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_places_are_sound(kind: str, seed: int) -> None:
    roads = draw_roads(kind, seed)
    assert check_place(roads) == []
    assert all(area.polygon.is_valid for area in roads.drivable_areas)


@pytest.mark.full  # a sample of it: test_places_are_sound
@pytest.mark.parametrize("kind", KINDS)
def test_many_places_are_sound(kind: str) -> None:
    faults = {seed: check_place(draw_roads(kind, seed)) for seed in range(50)}
    assert {seed: found for seed, found in faults.items() if found} == {}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["crossing", "roundabout", "town_block"])
@pytest.mark.parametrize("seed", range(2))
def test_a_minute_of_traffic_flows(kind: str, seed: int, tmp_path: Path) -> None:
    counts = drive_traffic(draw_roads(kind, seed), tmp_path)
    assert (counts.collisions, counts.teleports, counts.emergency_stops) == (0, 0, 0)
    assert counts.arrived >= 0.2 * counts.inserted
    assert counts.waiting <= 0.15 * counts.inserted


@pytest.mark.parametrize("kind", ["crossing", "roundabout", "town_block"])
@pytest.mark.parametrize("seed", range(3))
def test_every_arm_reaches_every_other(kind: str, seed: int) -> None:
    ways = list_ways(draw_roads(kind, seed))
    entries, exits = {begin for begin, _ in ways}, {end for _, end in ways}
    assert len(entries) == len(exits) >= 3
    own = 0 if kind == "roundabout" else 1  # only a roundabout and a block let a vehicle come back
    assert len(set(ways)) >= len(entries) * (len(exits) - own)


@pytest.mark.slow
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_drafts_keep_to_their_rules(kind: str, seed: int) -> None:
    """Nothing stands on anything else; parameters lie in their ranges; nodes and edges have unique names."""
    place = draw_place(kind, seed)
    draft = place.draft
    assert draft is not None
    for name, allowed in list_ranges(PLACE_KINDS[kind].parameters).items():
        assert allowed.check(place.parameters[name]) == place.parameters[name]
    names = [node.id for node in draft.nodes]
    assert len(set(names)) == len(names)
    edges = [name for street in draft.streets for name, n in zip(street.edge_ids, street.lanes, strict=True) if n]
    assert len(set(edges)) == len(edges)
    assert set(draft.stops) | set(draft.yields) <= set(edges)
    shapes = [shapely.Polygon(outline) for outline in (*draft.buildings, *(o for _, o in draft.obstacles))]
    assert all(shape.is_valid for shape in shapes)
    assert sum(shape.area for shape in shapes) == pytest.approx(shapely.union_all(shapes).area, abs=0.01)


@pytest.mark.slow
@given(area=st.sampled_from(sorted(SURROUNDINGS)), seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_only_old_towns_give_up_sight_triangles(area: str, seed: int) -> None:
    place = draw_place("crossing", seed, area=area)
    assert place.parameters["keeps_sight"] or area == "old_town"


@pytest.mark.slow
def test_the_stated_share_of_old_towns_gives_up_sight_triangles() -> None:
    places = [draw_place("crossing", seed, area="old_town", arms=3, control="priority") for seed in range(80)]
    share = sum(bool(place.parameters["keeps_sight"]) for place in places) / len(places)
    assert share == pytest.approx(SURROUNDINGS["old_town"].keeps_sight, abs=0.15)


def test_a_building_in_a_sight_triangle_is_found(tmp_path: Path) -> None:
    """A place that says it keeps its sight triangles, and has the buildings of one that does not, has faults."""
    blind = draw_place("crossing", BLIND_SEED, area="old_town", control="priority", keeps_sight=False, speed_kmh=50)
    claims = Place(**{**vars(blind), "parameters": {**blind.parameters, "keeps_sight": True}})
    roads = load_road_map(write_place(claims, tmp_path / claims.name))
    assert any("hides" in fault for fault in check_place(roads))


@pytest.mark.slow
def test_signs_tell_the_rule_of_the_junction(tmp_path: Path) -> None:
    for control, stops, yields in (("stop", 2, 0), ("priority", 0, 2), ("all_way_stop", 4, 0), ("signals", 0, 0)):
        place = draw_place("crossing", 1, arms=4, control=control, area="town", main_lanes=1, side_lanes=1)
        roads = load_road_map(write_place(place, tmp_path / control))
        assert (len(roads.stop_signs or ()), len(roads.yield_signs)) == (stops, yields), control
        assert any(lane.lights for lane in roads.driving) == (control == "signals")


@pytest.mark.parametrize("program", ["permitted", "protected", "split"])
def test_signal_programs_differ_in_their_left_turns(program: str, tmp_path: Path) -> None:
    """Permitted: two greens, left turns yield. Protected: their own phase. Split: one phase for each arm."""
    place = draw_place(
        "crossing", 3, arms=4, control="signals", area="town", main_lanes=2, side_lanes=1, turn_lanes=True,
        zebras=False, program=program,
    )  # fmt: skip
    folder = write_place(place, tmp_path / program)
    net = gzip.decompress((folder / "map.net.xml.gz").read_bytes()).decode()
    greens = sum(
        1 for line in net.splitlines() if "<phase " in line and "y" not in line and "G" in line.split("state=")[1]
    )
    assert greens == {"permitted": 2, "protected": 3, "split": 4}[program]


def test_a_car_park_has_the_stalls_it_promises() -> None:
    place = draw_place("car_park", 4, aisles=2, stalls=8)
    assert place.draft is not None
    assert len(place.draft.parking) == 32
    assert "32 stalls" in place.description
