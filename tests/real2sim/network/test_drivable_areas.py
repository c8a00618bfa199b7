"""Drivable areas: what readers find, and that every parked car of a log stands on asphalt."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from shapely.geometry.base import BaseGeometry
from testing.argoverse2_samples import archive, draw_line, write_map
from testing.map_faults import lane, lanes_map
from testing.network_samples import EAST, moved
from testing.real_logs import READ
from testing.scenarionet_samples import description, read, straight

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import NetworkFile, list_packaged_networks
from mdrive_sumo.roads.network_file import NETWORK_FILE, DrivableArea, read_network_file
from real2sim.hd_map import HdMap, LaneKind, MapArea, MapLane
from real2sim.network.drivable_areas import add_observed_areas, collect_drivable_areas
from real2sim.readers.argoverse2_map import read_argoverse2_map
from real2sim.readers.map_geometry import build_nested_areas, is_ring
from real2sim.recording import ObjectCategory, RecordedTrack

BOX: Float = np.array(((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))


def to_shape(areas: tuple[DrivableArea, ...]) -> BaseGeometry:
    return shapely.union_all([area.polygon for area in areas])


def standing(x: float, y: float, yaw: float = 0.0, category: ObjectCategory = ObjectCategory.CAR) -> RecordedTrack:
    column = np.ones(5)
    return RecordedTrack("7", category, column > 0, x * column, y * column, yaw * column, 4.6 * column, 1.9 * column)


def lanes_shape(hd_map: HdMap) -> BaseGeometry:
    """The lanes at 3.5 m, independent of the code under test."""
    return shapely.union_all([
        shapely.LineString(one.centre).buffer((one.width if one.width > 0 else 3.5) / 2, cap_style="flat")
        for one in hd_map.lanes.values() if len(one.centre) > 1
    ])  # fmt: skip


# --- readers ---
def test_rings_within_rings_are_holes_and_islands() -> None:
    inner, island = BOX * 0.8 + 1.0, BOX * 0.2 + 4.0
    areas = build_nested_areas([BOX, inner, island])
    assert sorted(len(area.holes) for area in areas) == [0, 1]
    shape = shapely.union_all([shapely.Polygon(area.outline, area.holes) for area in areas])
    assert shape.area == pytest.approx(100.0 - 64.0 + 4.0)


@pytest.mark.parametrize(("line", "ring"), [(BOX, False), (np.vstack((BOX, BOX[:1])), True), (BOX[:2], False)])
def test_only_closed_lines_are_rings(line: Float, ring: bool) -> None:
    assert is_ring(line) is ring


def test_an_outline_that_crosses_itself_is_split() -> None:
    areas = build_nested_areas([BOX[[0, 2, 1, 3]]])
    assert all(shapely.Polygon(area.outline).is_valid for area in areas)
    assert sum(shapely.Polygon(area.outline).area for area in areas) == pytest.approx(50.0)


def test_argoverse_areas_are_read(tmp_path: Path) -> None:
    outline = [*draw_line(2000.0), *draw_line(2010.0)[::-1]]
    write_map(tmp_path, archive(drivable_areas={"9": {"area_boundary": outline, "id": 9}}))
    (area,) = read_argoverse2_map(tmp_path)[0].drivable_areas
    assert shapely.Polygon(area.outline).area == pytest.approx(400.0)


def test_scenarionet_boundaries_and_driveways_are_read(tmp_path: Path) -> None:
    features = {
        "7": straight(),
        "boundary_0": {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": np.vstack((BOX * 4, BOX[:1] * 4))},
        "boundary_1": {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": np.vstack((BOX + 5, BOX[:1] + 5))},
        "boundary_2": {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": BOX + 80},
        "12": {"type": "DRIVEWAY", "polygon": BOX + 60},
    }
    areas = read(tmp_path, description(map_features=features)).map.drivable_areas
    shape = shapely.union_all([shapely.Polygon(area.outline, area.holes) for area in areas])
    assert shape.area == pytest.approx(1600.0 - 100.0 + 100.0)


# --- for network.json ---
def test_lanes_beside_the_road_are_asphalt_and_far_areas_are_left_out() -> None:
    park = MapLane("park", LaneKind.PARKING, moved(EAST, y=-4.0), width=2.5)
    walk = MapLane("walk", LaneKind.SIDEWALK, moved(EAST, y=9.0), width=2.0)
    hd_map = replace(lanes_map(lane("a", EAST), park, walk), drivable_areas=(MapArea(BOX + 500), MapArea(BOX)))
    shape = to_shape(collect_drivable_areas(hd_map))
    assert shape.area == pytest.approx(250.0 + 100.0, rel=0.01)


@given(x=st.floats(10, 90), y=st.floats(-30, 30), yaw=st.floats(-3.1, 3.1))
def test_a_parked_car_stands_on_asphalt_wherever_it_is(x: float, y: float, yaw: float) -> None:
    hd_map = lanes_map(lane("a", EAST, width=3.5))
    shape = to_shape(collect_drivable_areas(add_observed_areas(hd_map, [standing(x, y, yaw)])))
    car = shapely.Polygon(box_corners(x, y, yaw, 4.6, 1.9))
    ground = shapely.union(shape, lanes_shape(hd_map))
    assert shapely.difference(car, ground).area <= 1.7
    assert shape.area <= 35.0
    if abs(y) > 6:
        assert ground.buffer(0.02).contains(car)


def test_pedestrians_and_props_need_no_asphalt() -> None:
    tracks = [standing(50, 20, category=category) for category in (ObjectCategory.PEDESTRIAN, ObjectCategory.STATIC)]
    assert add_observed_areas(lanes_map(lane("a", EAST)), tracks).observed_areas == ()


def test_cars_far_from_the_map_stand_on_asphalt_too() -> None:
    hd_map = add_observed_areas(lanes_map(lane("a", EAST)), [standing(300.0, 200.0, 0.5)])
    car = shapely.Polygon(box_corners(300.0, 200.0, 0.5, 4.6, 1.9))
    assert to_shape(collect_drivable_areas(hd_map)).contains(car)


@pytest.mark.parametrize("name", ["av2-forecasting", pytest.param("scene-0103", marks=pytest.mark.full)])
def test_parked_cars_of_a_real_log_stand_on_asphalt(name: str, shared_data: Path) -> None:
    recording = READ[name]()
    tracks = [track for view in recording.views for track in view.tracks if track.category.kind is Kind.VEHICLE]
    still = [one for one in tracks if np.ptp(one.x[one.valid]) + np.ptp(one.y[one.valid]) < 1.0]
    areas = collect_drivable_areas(add_observed_areas(recording.map, tracks))
    assert all(area.polygon.is_valid for area in areas)
    ground = shapely.union(to_shape(areas), lanes_shape(recording.map))
    before = shapely.union(to_shape(collect_drivable_areas(recording.map)), lanes_shape(recording.map))
    near = ground.envelope.buffer(-5.0)
    shares, shares_before = [], []
    for track in still:
        row = int(track.valid_frames[-1])
        pose = (float(track.x[row]), float(track.y[row]), float(track.yaw[row]))
        size = (float(np.nan_to_num(track.length[row], nan=4.6)), float(np.nan_to_num(track.width[row], nan=1.85)))
        car = shapely.Polygon(box_corners(*pose, *size))
        if near.contains(car):
            shares.append(shapely.intersection(car, ground).area / car.area)
            shares_before.append(shapely.intersection(car, before).area / car.area)
    assert len(shares) >= 3
    assert min(shares) > 0.85 and np.median(shares) > 0.999
    assert min(shares_before) < 0.5  # the map alone leaves some in the meadow


# --- network.json ---
def test_a_network_without_areas_has_the_bytes_of_before() -> None:
    """The fingerprint of a run has the checksum of this text."""
    about = read_network_file(list_packaged_networks()["main_street"])
    assert "drivable_areas" not in about.model_dump_json() and "drivable_areas" not in about.model_dump()


def test_areas_are_kept_by_the_file(tmp_path: Path) -> None:
    about = read_network_file(list_packaged_networks()["main_street"])
    area = DrivableArea(outline=((0, 0), (9, 0), (9, 9)), holes=(((4, 1), (5, 1), (5, 2)),))
    (tmp_path / NETWORK_FILE).write_text(about.model_copy(update={"drivable_areas": (area,)}).model_dump_json())
    assert read_network_file(tmp_path).drivable_areas == (area,)
    assert "drivable_areas" in NetworkFile.model_json_schema()["properties"]


@pytest.mark.parametrize("outline", [((0, 0), (1, 1)), ((0, 0), (1, 0), (float("nan"), 1)), ((0, 0), (1, 0), (1e9, 1))])
def test_bad_outlines_are_refused(outline: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValidationError):
        DrivableArea(outline=outline)
