"""InterDrive's conversion: small files for each rule, and bad input."""

import json
import math
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.interdrive_samples import start_boxes
from testing.made_up_town import Points, make_town, route_xml

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import boxes_overlap
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from real2sim.authored.scenario_builder import advance_start
from real2sim.authored.suite_converter import convert_interdrive
from real2sim.match.waypoint_matcher import RouteLeg, match_waypoints
from real2sim.readers.interdrive import read_interdrive

pytestmark = pytest.mark.slow


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder with one made-up town."""
    make_town(tmp_path / "maps")
    return tmp_path


def converted(work: Path, *routes: Points) -> tuple[Scenario, dict[str, Any]]:
    folder = work / "src" / "r1_townxx_hw_c"
    folder.mkdir(parents=True)
    for i, points in enumerate(routes):
        (folder / f"r1_townxx_hw_c_{i}.xml").write_text(route_xml(points))
    convert_interdrive([work / "src"], work / "maps", work / "out")
    report = json.loads((work / "out" / "conversion.json").read_text())
    return load_suite(str(work / "out")).scenarios[0], report


def test_a_route_lies_on_its_lane_with_carlas_y_flipped(work: Path) -> None:
    scenario, report = converted(work, [(20, 1.75), (80.4, 1.75)])
    ego = scenario.egos[0]
    offset = read_network_file(work / "out" / "networks" / "TownXX").offset
    assert (scenario.bucket, scenario.category, scenario.network) == ("InterDrive", "hw_c", "TownXX")
    assert (ego.start.x, ego.start.y) == pytest.approx((20 + offset[0], -1.75 + offset[1]), abs=0.01)
    assert ego.start.yaw == pytest.approx(0.0, abs=1e-3)
    assert len(ego.route) == 62
    assert ego.route[-1][0] - ego.route[0][0] == pytest.approx(60.4, abs=0.01)
    assert report["off_lane"] == report["shifts"] == report["left_out"] == []


def test_the_lane_is_changed_at_once_as_carlas_planner_does(work: Path) -> None:
    ego = converted(work, [(20, 1.75), (80, 5.25)])[0].egos[0]
    aside = ego.xy[0, 1] - ego.xy[:, 1]
    assert len(ego.lanes) == 2
    assert aside[3] > 1.0
    assert aside[7:] == pytest.approx(np.full(len(aside) - 7, 3.5), abs=0.02)
    assert ego.yaw == pytest.approx(np.zeros(len(ego.yaw)), abs=1e-3), "the direction stays the lanes' own"


def test_lanes_are_changed_between_the_waypoints_that_lie_on_them(work: Path) -> None:
    ego = converted(work, [(20, 1.75), (60, 1.75), (100, 5.25), (140, 1.75)])[0].egos[0]
    aside = ego.xy[0, 1] - ego.xy[:, 1]
    assert len(ego.lanes) == 3
    assert aside[:40] == pytest.approx(np.zeros(40), abs=0.02)
    assert aside[60:78] == pytest.approx(np.full(18, 3.5), abs=0.02)
    assert aside[-1] == pytest.approx(0.0, abs=0.02)


def test_a_start_nearest_to_the_opposite_lane_is_placed_by_its_route(work: Path) -> None:
    scenario, report = converted(work, [(20, -0.3), (80, 1.75)])
    assert scenario.egos[0].start.yaw == pytest.approx(0.0, abs=1e-3)
    assert len(scenario.egos[0].lanes) == 1
    (off,) = report["off_lane"]
    assert off["distance_m"] == pytest.approx(2.05, abs=0.01)
    assert off["nearest_lane"] != off["lane"]
    assert off["nearest_lane_distance_m"] == pytest.approx(1.45, abs=0.01)


def test_waypoints_far_from_any_lane_or_behind_are_left_out_and_listed(work: Path) -> None:
    scenario, report = converted(work, [(20, 1.75), (40, 40), (60, 1.75), (57, 1.75), (80, 1.75)])
    assert [out["point"]["waypoint"] for out in report["left_out"]] == [1, 3]
    far, behind = report["left_out"]
    assert far["nearest_lane_distance_m"] == pytest.approx(40 - 5.25, abs=0.01)
    assert behind["nearest_lane_distance_m"] == pytest.approx(0.0, abs=0.01)
    assert len(scenario.egos[0].route) == 61


def test_overlapping_starts_are_moved_apart_by_the_least_distance(work: Path) -> None:
    scenario, report = converted(work, [(20, 1.75), (90, 1.75)], [(23, 1.75), (90, 1.75)], [(23, 5.25), (90, 5.25)])
    assert [(s["ego"], s["distance_m"]) for s in report["shifts"]] == [("1", pytest.approx(2.0))]
    assert not any(boxes_overlap(a, b) for a, b in combinations(start_boxes(scenario), 2))
    assert scenario.egos[1].start.x - scenario.egos[0].start.x == pytest.approx(5.0, abs=0.01)
    assert len(scenario.egos[1].route) == 66, "the route ends where it ended"


def test_three_overlapping_starts_are_separated(work: Path) -> None:
    scenario, report = converted(work, *([(20, 1.75), (90, 1.75)],) * 3)
    assert sorted(s["distance_m"] for s in report["shifts"]) == pytest.approx([5.0, 9.9], abs=0.11)
    assert not any(boxes_overlap(a, b) for a, b in combinations(start_boxes(scenario), 2))


def test_a_short_route_stays_where_it_is_if_the_other_can_move(work: Path) -> None:
    _, report = converted(work, [(20, 1.75), (22, 1.75)], [(18, 1.75), (90, 1.75)])
    assert [(s["ego"], s["distance_m"]) for s in report["shifts"]] == [("1", pytest.approx(7.0))]


def test_the_same_files_give_the_same_suite(work: Path) -> None:
    converted(work, [(20, 1.75), (60, 1.75), (100, 5.25)], [(22, 1.75), (90, 1.75)])
    convert_interdrive([work / "src"], work / "maps", work / "again")
    files = sorted(path.relative_to(work / "out") for path in (work / "out").rglob("*") if path.is_file())
    assert len(files) == 6
    for file in files:
        assert (work / "out" / file).read_bytes() == (work / "again" / file).read_bytes(), file


def test_a_start_is_moved_on_over_lane_changes_and_waypoints(work: Path) -> None:
    converted(work, [(20, 1.75), (60, 1.75), (100, 5.25)])
    roads = load_road_map(work / "out" / "networks" / "TownXX")
    offset = np.array(read_network_file(roads.folder).offset)
    xy = np.array([(20, -1.75), (60, -1.75), (100, -5.25)]) + offset
    legs = match_waypoints(roads, xy).legs
    assert advance_start(roads, legs, 50.0)[0] == RouteLeg(
        legs[1].lanes, pytest.approx(legs[0].start_s + 50.0), legs[1].goal_s
    )
    assert len(advance_start(roads, legs, 39.0)) == 2
    with pytest.raises(InputError, match="long enough"):
        advance_start(roads, legs, 500.0)


def test_starts_that_cannot_be_moved_apart_are_an_error(work: Path) -> None:
    with pytest.raises(InputError, match=r"r1_townxx_hw_c: expected"):
        converted(work, [(20, 1.75), (21, 1.75)], [(20, 1.75), (21, 1.75)])
    assert not (work / "out").exists(), "all or nothing"


def test_routes_in_comments_are_not_there(work: Path) -> None:
    folder = work / "src" / "r1_townxx_hw_c"
    folder.mkdir(parents=True)
    comment = f"<!-- <?xml version='1.0'?>{route_xml([(0, 0), (1, 1)])} -->"
    (folder / "r_0.xml").write_text(route_xml([(20, 1.75), (80, 1.75)]) + comment)
    (route,) = read_interdrive(work / "src", work / "maps")[0].routes
    assert route.waypoints.tolist() == [[20, -1.75], [80, -1.75]]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("<routes><route town='TownXX'>", "well-formed XML"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><routes/>", "without a document type"),
        ("<routes/>", "exactly one <route>, found 0"),
        ("<routes><route id='1'/></routes>", "attribute town"),
        (route_xml([(1, 1)]), "at least 2 waypoint(s), found 1"),
        (route_xml([(1, 1), (math.nan, 2)]), "x: expected a finite number, found 'nan'"),
        (route_xml([(1, 1), (2, 2)]).replace('y="2"', ""), "y: expected a finite number, found None"),
        (route_xml([(1, 1), (2, 2)], "Town99"), "expected Town99.xodr or Town99.net.xml"),
        (route_xml([(1, 500), (2, 500)]), "within 12 m of a lane, found 0"),
        (route_xml([(80, 12), (20, 12)]), "drivable way"),
    ],
)
def test_a_bad_route_file_is_refused_in_one_sentence(work: Path, text: str, sentence: str) -> None:
    folder = work / "src" / "r1_townxx_ins_c"
    folder.mkdir(parents=True)
    (folder / "r1_townxx_ins_c_0.xml").write_text(text)
    with pytest.raises(InputError) as caught:
        convert_interdrive([work / "src"], work / "maps", work / "out")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (work / "out").exists()


def test_sources_without_routes_are_refused(work: Path) -> None:
    with pytest.raises(InputError, match="expected a directory of scenario folders, found none"):
        read_interdrive(work / "nowhere", work / "maps")
    (work / "src").mkdir()
    with pytest.raises(InputError, match="expected scenario folders"):
        read_interdrive(work / "src", work / "maps")
    (work / "src" / "r1_townxx_ins_c").mkdir()
    with pytest.raises(InputError, match="found no XML"):
        read_interdrive(work / "src", work / "maps")
    (work / "src" / "r1_townxx_ins_c" / "ego.xml").write_text(route_xml([(1, 1), (2, 2)]))
    with pytest.raises(InputError, match="ends in _<number>"):
        read_interdrive(work / "src", work / "maps")


def test_a_folder_with_two_towns_or_one_cav_twice_is_refused(work: Path) -> None:
    folder = work / "src" / "r1_townxx_ins_c"
    folder.mkdir(parents=True)
    (folder / "a_0.xml").write_text(route_xml([(1, 1), (2, 2)]))
    (folder / "b_0.xml").write_text(route_xml([(1, 1), (2, 2)]))
    with pytest.raises(InputError, match="0 twice"):
        read_interdrive(work / "src", work / "maps")
    (folder / "b_0.xml").rename(folder / "b_1.xml")
    (folder / "b_1.xml").write_text(route_xml([(1, 1), (2, 2)], "Town01"))
    with pytest.raises(InputError, match="Town01, TownXX"):
        read_interdrive(work / "src", work / "maps")


def test_a_folder_with_something_in_it_is_not_written_to(work: Path) -> None:
    (work / "out").mkdir()
    (work / "out" / "mine").touch()
    folder = work / "src" / "r1_townxx_ins_c"
    folder.mkdir(parents=True)
    (folder / "a_0.xml").write_text(route_xml([(20, 1.75), (80, 1.75)]))
    with pytest.raises(InputError, match="new or empty folder"):
        convert_interdrive([work / "src"], work / "maps", work / "out")
