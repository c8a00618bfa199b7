"""The packaged networks: reproducible, drivable, and free of buildings on the road."""

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from testing.sampling import sampled

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap, find_network_folder, list_packaged_networks, load_road_map
from mdrive_sumo.roads.netconvert import find_netconvert, strip_xml_comments
from mdrive_sumo.roads.network_file import NET_FILE, compute_net_checksum, read_network_file
from mdrive_sumo.worlds.places.recipe import build_network, compile_recipe

NAMES = sorted(list_packaged_networks())
LEAST_RADIUS_M = 5.5
"""A car with a wheelbase of 2.85 m turns it with 27 deg of steering; at 5 m/s it feels 4.5 m/s2."""


@pytest.fixture(params=NAMES, scope="module")
def roads(request: pytest.FixtureRequest) -> RoadMap:
    return load_road_map(find_network_folder(request.param))


@pytest.fixture
def compiler() -> None:
    try:
        find_netconvert()
    except InputError:
        pytest.skip("needs netconvert")


def surface(roads: RoadMap) -> shapely.Geometry:
    return shapely.union_all(
        [shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat") for lane in roads.driving]
    )


@pytest.mark.slow
@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("name", sampled(NAMES, ("freeway", "market_crossing", "minor_road", "old_town")))
def test_the_recipe_makes_the_packaged_net(name: str) -> None:
    folder = find_network_folder(name)
    assert compute_net_checksum(compile_recipe(folder)) == read_network_file(folder).checksum


@pytest.mark.usefixtures("compiler")
def test_building_keeps_what_is_beside_the_road(tmp_path: Path) -> None:
    folder = shutil.copytree(find_network_folder("minor_road"), tmp_path / "minor_road")
    before = read_network_file(folder)
    (folder / NET_FILE).unlink()
    assert build_network(folder) == before == read_network_file(folder)
    assert (folder / NET_FILE).read_bytes() == (find_network_folder("minor_road") / NET_FILE).read_bytes()


@pytest.mark.usefixtures("compiler")
def test_a_broken_recipe_is_named(tmp_path: Path) -> None:
    folder = shutil.copytree(find_network_folder("minor_road"), tmp_path / "minor_road")
    (folder / "plain.nod.xml").write_text("<nodes><node")
    with pytest.raises(InputError, match="expected a recipe that netconvert accepts"):
        compile_recipe(folder)


@pytest.mark.parametrize("name", NAMES)
def test_the_net_file_holds_no_date(name: str) -> None:
    packed = (find_network_folder(name) / NET_FILE).read_bytes()
    assert packed[4:8] == bytes(4)  # gzip's time stamp
    assert b"<!--" not in gzip.decompress(packed)


def test_comments_go_and_nothing_else() -> None:
    assert strip_xml_comments(b"<a>\n<!-- x\n y -->\n<b/></a>") == b"<a>\n<b/></a>"


@pytest.mark.slow
def test_turns_are_drivable(roads: RoadMap) -> None:
    for lane in (lane for lane in roads.driving if lane.junction and lane.centre.length > 4):
        yaws = np.unwrap(lane.centre.resample(1.0).yaws)
        bend = np.abs(yaws[3:] - yaws[:-3]).max() / 3
        assert bend < 1 / LEAST_RADIUS_M, lane.id


def test_buildings_are_simple_and_beside_the_road(roads: RoadMap) -> None:
    road = surface(roads)
    assert bool(roads.buildings) == (roads.name not in {"expressway", "freeway", "lane_drop"})
    for building, shape in zip(roads.buildings, roads.building_shapes, strict=True):
        assert shape.is_valid, building.id
        assert shape.distance(road) > 0.2, building.id
    overlap = sum(shape.area for shape in roads.building_shapes) - shapely.union_all(roads.building_shapes).area
    assert overlap < 1.0


def test_stop_signs_stand_on_lanes(roads: RoadMap) -> None:
    for sign in roads.stop_signs or ():
        assert sign.length_m < sign.line_pos_m <= roads.lanes[sign.lane].centre.length
    with_signs = {"minor_road", "side_street", "factory_gate"}
    assert (roads.name in with_signs) == bool(roads.stop_signs)
