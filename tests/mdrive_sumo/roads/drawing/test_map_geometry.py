"""The geometry of pictures: asphalt, stripes and markings of built-in networks and of maps like those of logs."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import DrivableArea, Lane, RoadMap, find_network_folder, load_road_map
from mdrive_sumo.roads.drawing.lane_markings import INSET_M, MIN_LINE_M
from mdrive_sumo.roads.drawing.line_joining import join_lines, smooth_line
from mdrive_sumo.roads.drawing.map_geometry import (
    MIN_SHARE,
    MapGeometry,
    build_crossing_stripes,
    build_map_geometry,
    find_walking_line,
)
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.sensing.briefing_builder import compute_route_room
from mdrive_sumo.sensing.raster_sensor import _map_edges  # pyright: ignore[reportPrivateUsage]

EVERYWHERE = shapely.box(-1e4, -1e4, 1e4, 1e4)
WIDTH_M = 3.5


def straight(name: str, y: float, x: tuple[float, float] = (0.0, 60.0), width: float = WIDTH_M, **more: object) -> Lane:
    """A lane along the x axis; towards -x if x falls."""
    centre = Polyline(np.column_stack((np.linspace(*x, 13), np.full(13, y))))
    lane = Lane(name, name.split("_")[0], 0, width, 13.9, centre, False, (), "", "", {})
    return replace(lane, **more)  # type: ignore[arg-type]


def network(*lanes: Lane, **more: object) -> RoadMap:
    roads = RoadMap("made", Path("/nowhere"), {lane.id: lane for lane in lanes}, (), (), (), (), (), "none")
    return replace(roads, **more)  # type: ignore[arg-type]


def drawn(*lanes: Lane, **more: object) -> MapGeometry:
    return build_map_geometry(network(*lanes, **more), EVERYWHERE)


def heights(lines: tuple[Float, ...]) -> list[float]:
    """Mean y of every line."""
    return sorted(round(float(line[:, 1].mean()), 2) for line in lines)


@cache
def packaged(name: str) -> tuple[RoadMap, MapGeometry]:
    roads = load_road_map(find_network_folder(name, load_suite("v2xpnp@0").folder))
    return roads, build_map_geometry(roads, EVERYWHERE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["town_crossing", "v2xpnp_crossing"])
def test_asphalt_is_valid_and_covers_the_lanes(name: str) -> None:
    roads, geometry = packaged(name)
    asphalt = shapely.union_all(geometry.asphalt)
    assert all(part.is_valid for part in (*geometry.asphalt, *geometry.aprons, *geometry.pavements, *geometry.stripes))
    for lane in roads.driving:
        strip = shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat")
        assert shapely.difference(strip, asphalt).area <= 0.02 * strip.area + 0.05


def test_markings_of_built_in_networks_lie_on_the_borders_of_lanes() -> None:
    roads, geometry = packaged("town_crossing")
    streets = [lane for lane in roads.driving if not lane.junction]
    borders = shapely.union_all([
        shapely.LineString(lane.centre.xy).offset_curve(side * lane.width / 2) for lane in streets for side in (1, -1)
    ])  # fmt: skip
    assert len(geometry.markings.dashed) == sum(bool(lane.left) for lane in streets)
    for line in (*geometry.markings.solid, *geometry.markings.dashed):
        assert shapely.distance(shapely.points(line), borders).max() < INSET_M + 0.1


def test_stripes_of_a_crossing_lie_within_it_and_on_asphalt() -> None:
    roads, geometry = packaged("town_crossing")
    crossings = shapely.union_all([shapely.LineString(xy).buffer(w / 2, cap_style="flat") for xy, w in roads.crossings])
    asphalt = shapely.union_all(geometry.asphalt)
    assert len(geometry.stripes) > 4 * len(roads.crossings)
    for stripe in geometry.stripes:
        assert crossings.buffer(0.01).contains(stripe)
        assert asphalt.buffer(0.01).contains(stripe)


def test_crosswalks_of_a_converted_log_have_stripes_instead_of_blocks_beside_the_junction() -> None:
    roads, geometry = packaged("v2xpnp_crossing")
    assert len(roads.crosswalk_pavements) == 4
    outlines = shapely.union_all([shapely.Polygon(roads.pavements[i]) for i in roads.crosswalk_pavements])
    assert len(geometry.stripes) > 20
    assert all(outlines.buffer(0.01).contains(stripe) for stripe in geometry.stripes)
    assert all(not outlines.intersects(walk) for walk in geometry.pavements)


@pytest.mark.parametrize("extent", [(4.0, 9.0), (9.0, 4.0), (5.0, 5.0)])
def test_stripes_run_along_the_traffic_whatever_side_is_longer(extent: tuple[float, float]) -> None:
    """A crosswalk of one narrow lane is wider than long; only a square without traffic has no direction of its own."""
    half = np.array(extent) / 2
    outline = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * half + (30.0, 0.0)
    found = find_walking_line(outline, [straight("r_0", 0.0)])
    assert found is not None
    line, width = found
    assert abs(line[1, 0] - line[0, 0]) < 1e-9 and width == pytest.approx(extent[0])
    stripes = build_crossing_stripes(line, width)
    assert all(shapely.Polygon(outline).buffer(1e-6).contains(stripe) for stripe in stripes)
    assert len(stripes) >= extent[1] // 1 - 1
    assert not any(one.intersects(other) for i, one in enumerate(stripes) for other in stripes[:i])


def test_stripes_beside_the_road_are_left_out() -> None:
    outline = np.array(((28.0, -9.0), (32.0, -9.0), (32.0, 9.0), (28.0, 9.0)))
    stripes = drawn(straight("r_0", 0.0), pavements=(outline,), crosswalk_pavements=(0,)).stripes
    assert stripes
    assert np.abs([shapely.bounds(stripe)[[1, 3]] for stripe in stripes]).max() < 1.81
    assert all(stripe.area >= MIN_SHARE * 0.5 * 4.0 for stripe in stripes)


@pytest.mark.parametrize("gap", [-1.0, -0.4, 0.0, 0.5, 1.2])
def test_oncoming_lanes_share_one_double_line(gap: float) -> None:
    y = WIDTH_M + gap
    geometry = drawn(straight("a_0", 0.0), straight("b_0", y, (60.0, 0.0)))
    edge = WIDTH_M / 2 - INSET_M
    middle = [y / 2 - INSET_M, y / 2 + INSET_M]
    assert heights(geometry.markings.solid) == pytest.approx([-edge, *middle, y + edge], abs=0.02)
    assert geometry.markings.dashed == ()
    assert len(geometry.asphalt) == 1 and not geometry.asphalt[0].interiors


def test_a_median_keeps_its_two_edges() -> None:
    y = WIDTH_M + 3.0
    geometry = drawn(straight("a_0", 0.0), straight("b_0", y, (60.0, 0.0)))
    assert heights(geometry.markings.solid)[1:3] == pytest.approx([WIDTH_M / 2 - INSET_M, y - WIDTH_M / 2 + INSET_M])
    assert len(geometry.asphalt) == 2


@pytest.mark.parametrize("gap", [-0.5, 0.0, 0.8])
def test_lanes_of_one_direction_share_one_dashed_line(gap: float) -> None:
    y = WIDTH_M + gap
    geometry = drawn(straight("a_0", 0.0), straight("b_0", y))
    assert heights(geometry.markings.dashed) == pytest.approx([y / 2], abs=0.01)
    assert len(geometry.markings.solid) == 2


def test_pieces_of_a_road_have_one_line_without_a_kink() -> None:
    """A log's map has another width in every piece; borders jump by half the difference."""
    pieces = [straight(f"p{i}_0", 0.3 * (i % 2), (20.0 * i, 20.0 * i + 20.0), 3.2 + 0.4 * (i % 3)) for i in range(4)]
    lines = drawn(*pieces).markings.solid
    assert len(lines) == 2
    for line in lines:
        assert shapely.LineString(line).length == pytest.approx(80.0, abs=1.0)
        step = np.diff(line, axis=0)
        turns = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
        assert np.abs(turns).max() < np.radians(10)


def test_fragments_have_no_lines() -> None:
    lanes = (straight("a_0", 0.0), straight("stub_0", 20.0, (0.0, 2.0)), straight("next_0", 24.0, (0.0, 2.0)))
    assert all(shapely.LineString(line).length >= MIN_LINE_M for line in drawn(*lanes).markings.solid)
    assert len(drawn(*lanes).markings.solid) == 2


def test_there_is_no_line_where_lanes_merge_or_cross() -> None:
    merging = Polyline(np.array(((0.0, 8.0), (20.0, 6.0), (40.0, 0.8), (60.0, 0.4))))
    geometry = drawn(straight("a_0", 0.0), replace(straight("b_0", 0.0), centre=merging))
    asphalt = shapely.union_all(geometry.asphalt)
    inner = asphalt.buffer(-1.0)
    assert not any(inner.intersects(shapely.LineString(line)) for line in geometry.markings.solid)


def test_drivable_areas_lie_beside_the_asphalt_and_hold_their_islands() -> None:
    park = DrivableArea(
        outline=((0, -10), (60, -10), (60, 4), (0, 4)), holes=(((20, -8), (30, -8), (30, -4), (20, -4)),)
    )
    geometry = drawn(straight("a_0", 0.0), drivable_areas=(park,))
    aprons, asphalt = shapely.union_all(geometry.aprons), shapely.union_all(geometry.asphalt)
    assert aprons.contains(shapely.box(2, -9, 18, -3))
    assert not aprons.intersects(shapely.box(20.2, -7.8, 29.8, -4.2))
    assert shapely.intersection(aprons, asphalt).area < 0.2 * 60
    assert shapely.difference(park.polygon, shapely.union(aprons, asphalt)).area < 1.0


def test_a_stop_sign_stands_only_beside_the_outermost_lane() -> None:
    lanes = (straight("a_0", 0.0, left="a_1"), straight("a_1", WIDTH_M, right="a_0"))
    signs = tuple(StopSignBox(id=lane.id, lane=lane.id, line_pos_m=50.0, length_m=3.0) for lane in lanes)
    marks = drawn(*lanes, stop_signs=signs).stop_signs
    assert [mark.sign is not None for mark in marks] == [True, False]
    assert marks[0].sign is not None and marks[0].sign[1] < -WIDTH_M / 2 - 1.0
    assert all(np.ptp(mark.line[:, 0]) < 1e-9 for mark in marks)


@pytest.mark.slow
def test_what_is_for_pictures_changes_no_sensor() -> None:
    roads, _ = packaged("v2xpnp_crossing")
    park = DrivableArea(outline=((-90, -90), (90, -90), (90, 90), (-90, 90)))
    richer = replace(roads, drivable_areas=(park,), crosswalk_pavements=())
    for one, other in zip(_map_edges(roads, 0.2), _map_edges(richer, 0.2), strict=True):
        assert np.array_equal(one, other)
    lane = roads.driving[0].centre.resample(5.0)
    assert np.array_equal(*(compute_route_room(each, lane.xy, lane.yaws_at(lane.s)) for each in (roads, richer)))


def test_rings_and_single_pieces_are_joined_once() -> None:
    square = [np.array(((x0, y0), (x1, y1))) for (x0, y0), (x1, y1) in (((0, 0), (9, 0)), ((9.5, 0.2), (20, 0)))]
    (line,) = join_lines(square)
    assert len(line) == 4
    assert join_lines([]) == []
    assert smooth_line(line)[[0, -1]] == pytest.approx(np.array(((0.0, 0.0), (20.0, 0.0))))
    angles = np.linspace(0, 2 * np.pi, 41)
    ring = np.column_stack((np.cos(angles), np.sin(angles))) * 10
    assert len(join_lines([ring[:21], ring[20:]])) == 1
