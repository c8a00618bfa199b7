"""Lines of roads: bends that the limit allows, lines beside them, parts of them; connections of their junctions."""

import itertools
import math
import random

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Polyline, build_polyline, wrap_angles
from mdrive_sumo.worlds.places.alignment import (
    compute_least_radius,
    cut_line,
    draw_bends,
    ease,
    join_lines,
    reverse_line,
    shift_line,
    trace_axis,
)
from mdrive_sumo.worlds.places.draft_edge import DraftEdge, DraftLane
from mdrive_sumo.worlds.places.frontage import Roadside, find_kerb, list_sight_triangles
from mdrive_sumo.worlds.places.junction_connections import JunctionArm, connect_junction
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_spine import HalfSection, Joint, SideArm, SpinePlan, StreetSection, build_spine

SEEDS = st.integers(0, 10_000)
LIMITS = st.sampled_from([30, 50, 70, 100, 130])


def draw_axis(seed: int, limit: int, share: float) -> Polyline:
    return trace_axis((3.0, 4.0), 0.5, draw_bends(random.Random(seed), 500.0, limit, share))


@given(seed=SEEDS, limit=LIMITS, share=st.floats(0.1, 1.0))
def test_bends_are_no_tighter_than_the_limit_allows(seed: int, limit: int, share: float) -> None:
    pieces = draw_bends(random.Random(seed), 500.0, limit, share)
    assert all(radius == 0.0 or abs(radius) >= compute_least_radius(limit) for _, radius in pieces)
    length = math.fsum(length for length, _ in pieces)
    assert 400.0 < length < 520.0
    line = trace_axis((3.0, 4.0), 0.5, pieces)
    assert line.length == pytest.approx(length, rel=2e-3)
    assert np.abs(wrap_angles(np.diff(line.yaws))).max(initial=0.0) < 0.25


@pytest.mark.parametrize(
    ("limit", "radius"), [(30, 27.3), (50, 115.8), (60, 123.2), (80, 252.0), (100, 437.4), (120, 755.9)]
)
def test_least_radii_are_those_of_the_guideline(limit: float, radius: float) -> None:
    assert compute_least_radius(limit) == pytest.approx(radius, abs=0.5)


@given(seed=SEEDS, limit=LIMITS, left_m=st.floats(-12.0, 12.0), share=st.floats(0.1, 1.0))
def test_a_shifted_line_keeps_its_distance(seed: int, limit: int, left_m: float, share: float) -> None:
    axis = draw_axis(seed, limit, share)
    shifted = shift_line(axis, left_m)
    offsets = [axis.project(*point)[1] for point in shifted.xy.tolist()]
    assert np.abs(np.array(offsets) - left_m).max() < 0.02 + 0.01 * abs(left_m)


@given(seed=SEEDS, cuts=st.lists(st.floats(20.0, 380.0), min_size=1, max_size=4, unique=True))
def test_parts_of_a_line_join_to_the_whole(seed: int, cuts: list[float]) -> None:
    axis = draw_axis(seed, 50, 0.8)
    stations = [0.0, *sorted(cut for cut in cuts if all(abs(cut - other) > 3.0 or cut == other for other in cuts))]
    stations.append(axis.length)
    parts = [cut_line(axis, begin, end) for begin, end in itertools.pairwise(stations)]
    joined = join_lines(*parts)
    assert joined.length == pytest.approx(axis.length, abs=0.2)
    assert np.abs([axis.project(*point)[1] for point in joined.xy.tolist()]).max() < 0.05
    assert reverse_line(reverse_line(joined)).xy.tolist() == joined.xy.tolist()


def test_a_smooth_step_stays_between_its_ends() -> None:
    assert [ease(share) for share in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]


def build_edge(name: str, points: list[tuple[float, float]], lanes: str) -> DraftEdge:
    uses = {"w": "walk", "c": "cycle", "d": "drive"}
    drawn = tuple(DraftLane(uses[letter], 3.0) for letter in lanes)  # pyright: ignore[reportArgumentType]
    return DraftEdge(name, "a", "b", build_polyline(points), drawn, 10.0, 3)


def test_connections_keep_lanes_and_turns_apart() -> None:
    """Two lanes and a turn lane come from the west; roads lead on to the east, the north and the south."""
    west = JunctionArm(build_edge("west_in", [(-50, 0), (0, 0)], "wcddd"), None, has_left_turn_lane=True)
    east = JunctionArm(None, build_edge("east_out", [(0, 0), (50, 0)], "wcdd"))
    north = JunctionArm(None, build_edge("north_out", [(0, 0), (0, 50)], "wd"))
    south = JunctionArm(None, build_edge("south_out", [(0, 0), (0, -50)], "wd"))
    assert sorted(connect_junction([west, east, north, south])) == [
        ("west_in", 1, "east_out", 1),  # the cycle lane goes on
        ("west_in", 1, "south_out", 1),
        ("west_in", 2, "east_out", 2),
        ("west_in", 2, "south_out", 1),
        ("west_in", 3, "east_out", 3),
        ("west_in", 4, "north_out", 1),
    ]
    assert connect_junction([east]) == []


@pytest.mark.parametrize("keeps_sight", [True, False])
def test_houses_leave_sight_triangles_free(keeps_sight: bool) -> None:
    draft = NetworkDraft("a", "b")
    half = HalfSection(1, 3.0, pavement_m=2.0)
    arm = SideArm("right_1", -math.pi / 2, ((60.0, 0.0),), half, 8.33, "yield")
    axis = build_polyline([(-100.0, 0.0), (100.0, 0.0)])
    spine = build_spine(
        draft, SpinePlan(axis, StreetSection(half, half), (Joint("x", 100.0, radius=4.0, arms=(arm,)),), 13.89)
    )
    triangles = list(list_sight_triangles(spine, 50.0))
    assert len(triangles) == 2
    roadside = Roadside(draft)
    roadside.clear += triangles if keeps_sight else []
    for edge in draft.edges:
        roadside.add_house_row(find_kerb(edge), HouseRows((0.1, 0.3), (0.5, 1.0), (6.0, 8.0)), random.Random(1))
    assert len(draft.buildings) > 20
    is_hidden = any(shapely.Polygon(house).intersects(area) for house in draft.buildings for area in triangles)
    assert is_hidden != keeps_sight
