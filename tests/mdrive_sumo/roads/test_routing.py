"""Lanes, routing and dense routes on the packaged networks; shapely as the second opinion."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import (
    RoadMap,
    build_lane_route,
    find_lane_path,
    find_network_folder,
    list_packaged_networks,
    load_road_map,
)

NETWORKS = sorted(list_packaged_networks())


@pytest.fixture(scope="module")
def crossing() -> RoadMap:
    return load_road_map(find_network_folder("main_street"))


@pytest.mark.parametrize("name", NETWORKS)
def test_lanes_lead_into_each_other(name: str) -> None:
    roads = load_road_map(find_network_folder(name))
    for lane in roads.driving:
        for successor in lane.successors:
            gap = np.hypot(*(roads.lanes[successor].centre.xy[0] - lane.centre.xy[-1]))
            assert gap < 0.2, (lane.id, successor)
    for lane in roads.driving:
        assert not lane.left or roads.lanes[lane.left].right == lane.id


def test_nearest_agrees_with_shapely(crossing: RoadMap) -> None:
    points = np.random.default_rng(0).uniform(-60, 60, (200, 2))
    found = crossing.find_nearest_lanes(points)
    lines = [shapely.LineString(lane.centre.xy) for lane in crossing.driving]
    for point, index, distance, yaw in zip(points, found.lane, found.distance, found.yaw, strict=True):
        gaps = [line.distance(shapely.Point(point)) for line in lines]
        assert distance == pytest.approx(min(gaps), abs=1e-9)
        assert gaps[index] == pytest.approx(min(gaps), abs=1e-9)
        centre = crossing.driving[index].centre
        s, _ = centre.project(*point)
        assert min(abs(yaw - centre.yaw_at(s + near)) for near in (-1e-6, 1e-6)) < 1e-9


def test_traffic_lights_are_found_at_the_lane_that_they_hold(crossing: RoadMap) -> None:
    held = [lane for lane in crossing.driving if lane.lights]
    assert held
    assert all(not lane.junction for lane in held)
    assert all(set(lane.lights) <= set(lane.successors) for lane in held)


def test_a_path_turns_left_through_the_junction(crossing: RoadMap) -> None:
    path = find_lane_path(crossing, "south_in_2", "west_out_2")
    assert path[0] == "south_in_2"
    assert path[-1] == "west_out_2"
    assert any(crossing.lanes[lane].junction for lane in path)
    route = build_lane_route(crossing, path, 60.0, 20.0)
    hops = np.hypot(*np.diff(route.xy, axis=0).T)
    assert np.allclose(hops[:-1], 1.0, atol=0.1)
    assert route.yaw[-1] - route.yaw[0] == pytest.approx(np.pi / 2, abs=0.8)
    ahead = np.arctan2(*np.diff(route.xy, axis=0).T[::-1])
    assert np.abs(np.angle(np.exp(1j * (ahead - route.yaw[:-1])))).max() < 0.35


def test_a_lane_change_moves_over_smoothly_and_keeps_the_lanes_direction(crossing: RoadMap) -> None:
    lane = crossing.lanes["west_in_1"]
    route = build_lane_route(crossing, ("west_in_1", "west_in_2"), 0.0, 40.0)
    offsets = [lane.centre.project(x, y)[1] for x, y in route.xy]
    assert offsets[0] == pytest.approx(0.0, abs=1e-6)
    assert offsets[-1] == pytest.approx((lane.width + crossing.lanes["west_in_2"].width) / 2, abs=0.1)
    assert np.diff(offsets).max() < 0.4
    assert np.abs(route.yaw - lane.centre.yaws[0]).max() < 0.02
    late = build_lane_route(crossing, ("west_in_1", "west_in_2"), 0.0, 40.0, {0: 20.0})
    assert [lane.centre.project(x, y)[1] for x, y in late.xy][19] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("lanes", "message"),
    [
        (("nowhere_0",), "expected a lane for cars, found 'nowhere_0'"),
        (("west_in_1", "west_out_1"), "expected lane west_out_1 to follow west_in_1"),
        (("west_in_1", "west_in_2"), "expected at least 1 m to change lanes in, found 0.0 m"),
    ],
)
def test_lanes_that_do_not_connect_are_named(crossing: RoadMap, lanes: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_lane_route(crossing, lanes, 5.0, 5.0)


def test_no_way_is_an_input_error(crossing: RoadMap) -> None:
    with pytest.raises(InputError, match="expected a way from lane west_out_1 to lane west_in_1, found none"):
        find_lane_path(crossing, "west_out_1", "west_in_1")


def test_an_unknown_network_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"network 'atlantis': expected in .*main_street.*found nowhere"):
        find_network_folder("atlantis", tmp_path)


def copied(tmp_path: Path) -> Path:
    folder = tmp_path / "net"
    shutil.copytree(find_network_folder("town_crossing"), folder)
    return folder


def test_a_changed_net_is_refused(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    xml = gzip.decompress((folder / "map.net.xml.gz").read_bytes())
    (folder / "map.net.xml.gz").write_bytes(gzip.compress(xml.replace(b"speed", b"speeD", 1)))
    with pytest.raises(InputError, match=r"expected the checksum of network\.json"):
        load_road_map(folder)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda folder: (folder / "map.net.xml.gz").write_bytes(b"no gzip"),
            "cannot be read as a gzipped SUMO network",
        ),
        (lambda folder: (folder / "map.net.xml.gz").unlink(), "cannot be read as a gzipped SUMO network"),
        (lambda folder: (folder / "network.json").unlink(), r"network\.json: cannot be read: No such file"),
        (lambda folder: (folder / "network.json").write_text("{"), r"network\.json: the file: Invalid JSON"),
        (lambda folder: rewrite(folder, colour="red"), r"network\.json: colour: Extra inputs are not permitted"),
        (lambda folder: rewrite(folder, buildings=[{"id": "b", "polygon": [[0, 0], [1, 1]]}]), "at least 3 items"),
    ],
)
def test_a_damaged_network_folder_gets_one_sentence(tmp_path: Path, damage: object, message: str) -> None:
    folder = copied(tmp_path)
    damage(folder)  # type: ignore[operator]
    with pytest.raises(InputError, match=message):
        load_road_map(folder)


def rewrite(folder: Path, **changes: object) -> None:
    path = folder / "network.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
