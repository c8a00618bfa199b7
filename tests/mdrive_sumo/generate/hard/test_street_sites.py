"""Finders of sites along streets against what the place's file says, measured another way."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.generate.hard.sites.street_ways import (
    compute_rise_s,
    find_kerbs,
    find_obstacles_beside,
    find_right_lanes,
    find_street_ways,
    find_zebras,
    select_ways,
)
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.worlds.placement.lane_chains import compute_pose
from mdrive_sumo.worlds.places import draw_place, write_place


def draw(folder: Path, kind: str, **parameters: str | int | float | bool) -> RoadMap:
    place = draw_place(kind, "sites", **parameters)
    return load_road_map(write_place(place, folder / place.name))


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return draw(tmp_path_factory.mktemp("street"), "corridor", parking="both_sides", lanes=1, zebras=1, junctions=2)


def test_the_other_direction_runs_along_a_way(street: RoadMap) -> None:
    way = find_street_ways(street)[0]
    here, there = (shapely.LineString(np.concatenate([street.lanes[one].centre.xy for one in lanes]))
                   for lanes in (way.lanes, way.oncoming))  # fmt: skip
    assert way.length == max(one.length for one in find_street_ways(street))
    assert here.hausdorff_distance(there) < 25.0
    ends = [shapely.Point(line.coords[k]) for line, k in ((here, 0), (there, -1))]
    assert ends[0].distance(ends[1]) < 25.0


def test_kerbs_are_the_parked_rows_at_the_right(street: RoadMap) -> None:
    way = find_street_ways(street)[0]
    kerbs = find_kerbs(street, way.lanes)
    rows = shapely.MultiLineString([row.line for row in street.parking])
    assert kerbs
    for kerb in kerbs:
        pose = compute_pose(street, way.lanes, (kerb.begin + kerb.end) / 2, kerb.offset)
        assert rows.distance(shapely.Point(pose.x, pose.y)) < 0.6
    both = sum(len(find_kerbs(street, lanes)) for lanes in (way.lanes, way.oncoming))
    assert both == len(street.parking)


def test_zebras_lie_on_pedestrian_crossings(street: RoadMap) -> None:
    way = find_street_ways(street)[0]
    crossings = [shapely.LineString(line) for line, _ in street.crossings]
    own = shapely.LineString(np.concatenate([street.lanes[one].centre.xy for one in way.lanes]))
    stations = find_zebras(street, way.lanes)
    assert len(stations) == sum(own.intersects(one) for one in crossings)
    for station in stations:
        pose = compute_pose(street, way.lanes, station)
        assert min(one.distance(shapely.Point(pose.x, pose.y)) for one in crossings) < 0.6


def test_right_lanes_and_obstacles(tmp_path: Path) -> None:
    works = draw(tmp_path, "works_zone", layout="lane_closed", side="right", length_m=110.0)
    ways = find_street_ways(works)
    beside = {way.lanes: find_obstacles_beside(works, way.lanes, ("container", "heap")) for way in ways}
    named = [one for one in works.buildings if one.id.startswith(("container", "heap"))]
    assert max(map(len, beside.values())) == len(named) > 0
    for lanes, found in beside.items():
        for station, offset in found:
            pose = compute_pose(works, lanes, station - 1.0, offset)
            assert any(shapely.Polygon(one.outline).distance(shapely.Point(pose.x, pose.y)) < 0.5 for one in named)
        for stretch in find_right_lanes(works, lanes):
            pose = compute_pose(works, lanes, (stretch.begin + stretch.end) / 2, stretch.offset)
            near = works.find_nearest_lanes(np.array([[pose.x, pose.y]]))
            assert near.distance[0] < 0.3
            assert works.driving[int(near.lane[0])].id not in lanes


def test_a_place_without_the_street_is_refused(street: RoadMap) -> None:
    with pytest.raises(ProposalRejected, match="expected a street as the family needs it, found none"):
        select_ways(street, lambda _: False)


@pytest.mark.parametrize(("distance", "speed", "acceleration"), [(1.0, 3.0, 1.5), (6.0, 3.0, 1.5), (12.0, 5.0, 1.2)])
def test_the_time_to_cover_a_distance_is_that_of_small_steps(
    distance: float, speed: float, acceleration: float
) -> None:
    covered, reached, step, time = 0.0, 0.0, 0.0005, 0.0
    while covered < distance:
        reached = min(reached + acceleration * step, speed)
        covered, time = covered + reached * step, time + step
    assert math.isclose(compute_rise_s(distance, speed, acceleration), time, abs_tol=0.01)
