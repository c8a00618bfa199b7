"""Street lamps and trees that are made up: where they stand, and that LiDARs hit what cameras draw."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from testing.lidar_scans import scan, sensor
from testing.worlds import straight_road

from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.sensing.camera.static_scene import load_static_scene
from mdrive_sumo.sensing.street_furniture import (
    LANE_ROOM_M,
    STREET_MPS,
    WALL_ROOM_M,
    FurnitureKind,
    StreetFurniture,
    load_street_furniture,
)

MADE_UP = ("pole:lamp:", "lamp:", "trunk:", "crown:")


def list_stems(furniture: StreetFurniture) -> list[int]:
    return [i for i, name in enumerate(furniture.names) if name.startswith(("pole:lamp:", "trunk:"))]


@pytest.mark.parametrize("network", ["city_crossing", "old_town"])
def test_what_is_made_up_stands_beside_lanes_and_away_from_walls(network: str) -> None:
    """By shapely, which the code does not measure with."""
    roads = load_road_map(find_network_folder(network))
    furniture = load_street_furniture(roads)
    stems = list_stems(furniture)
    assert len(stems) > 10
    points = shapely.points(furniture.x[stems], furniture.y[stems])
    for lane in roads.driving:
        away = shapely.distance(shapely.LineString(lane.centre.xy), points)
        assert away.min() > lane.width / 2 + LANE_ROOM_M - 1e-6
    for shape in roads.building_shapes:
        assert shapely.distance(shape, points).min() > WALL_ROOM_M - 1e-6


def test_lamps_stand_along_streets_and_trees_farther_from_fast_roads() -> None:
    street = straight_road()
    fast = replace(street, lanes={"r_0": replace(street.lanes["r_0"], speed_limit=STREET_MPS + 1.0)})
    in_street, on_fast = load_street_furniture(street), load_street_furniture(fast)
    lamps = [i for i, kind in enumerate(in_street.kinds) if kind is FurnitureKind.LAMP]
    assert in_street.x[lamps].tolist() == pytest.approx([12.0 + 32.0 * i for i in range(9)])
    assert in_street.y[lamps] == pytest.approx(np.full(9, -(1.75 + 1.2) + 1.3))
    assert FurnitureKind.LAMP not in on_fast.kinds
    trunks = [i for i, kind in enumerate(on_fast.kinds) if kind is FurnitureKind.TRUNK]
    assert on_fast.y[trunks].max() < -(1.75 + 7.0)
    wall = Building(id="wall", polygon=((0.0, -9.0), (300.0, -9.0), (300.0, -1.8), (0.0, -1.8)))
    assert load_street_furniture(replace(street, buildings=(wall,))).names == ()


def test_a_lidar_hits_the_trunks_and_crowns_that_cameras_draw() -> None:
    roads = straight_road()
    furniture = load_street_furniture(roads)
    cloud = scan(sensor(roads, hit_ids=True), own=(Kind.VEHICLE, 40.0, 0.0, 0.0, 4.9, 2.1))
    hit = {name for name in cloud.names if name.startswith(MADE_UP)}
    assert {name.partition(":")[0] for name in hit} >= {"trunk", "crown", "pole"}
    drawn = load_static_scene(roads)
    corners = drawn.vertices["position"].astype(float) + drawn.origin
    for name in hit:
        points = cloud.points[cloud.hit == cloud.names.index(name), :3] + (40.0, 0.0, 2.5)
        row = furniture.names.index(name)
        around = np.hypot(corners[:, 0] - furniture.x[row], corners[:, 1] - furniture.y[row]) < 3.0
        assert (points.min(axis=0) > corners[around].min(axis=0) - 0.1).all()
        assert (points.max(axis=0) < corners[around].max(axis=0) + 0.1).all()
