"""InterDrive's original routes (if available): statistics, routes, starts, signs and report."""

import json
import math
from dataclasses import asdict
from itertools import combinations, pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from testing.interdrive_samples import start_boxes
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.geometry import boxes_overlap
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.statistics import compute_suite_statistics
from mdrive_sumo.scenario.suite import Suite, load_suite
from real2sim.cli import convert
from real2sim.readers.interdrive import read_interdrive

pytestmark = [pytest.mark.full, pytest.mark.costly_fixture]  # in `make test`: test_interdrive, on made-up routes

ROUTES = SHARED_DATA / "mdrive" / "interdrive"


TOWNS = {"xodr": SHARED_DATA / "carla_towns", "ready": SHARED_DATA / "carla_towns" / "sumo_net_scenic"}


@pytest.fixture(scope="session", params=["xodr", pytest.param("ready", marks=pytest.mark.full)])
def original(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Suite:
    """All 46 scenarios, converted once with each kind of town map."""
    out = tmp_path_factory.mktemp(request.param) / "suite"
    arguments = ["interdrive", str(ROUTES), "--towns", str(TOWNS[request.param]), "--out", str(out)]
    result = CliRunner().invoke(convert, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "46 scenarios, 175 CAVs" in result.output
    assert "drives 163 of the 175 files" in result.output
    assert str(out / "conversion.md") in result.output
    return load_suite(str(out))


def towns_of(suite: Suite) -> dict[str, RoadMap]:
    return {name: load_road_map(find_network_folder(name, suite.folder)) for name in ("Town05", "Town06", "Town07")}


@needs_data
def test_the_originals_statistics_are_the_papers(original: Suite) -> None:
    found = compute_suite_statistics(original.scenarios)
    assert (found.scenarios, found.cavs, found.mean_actors) == (46, 175, 0.0)
    assert found.mean_cavs == pytest.approx(3.80, rel=0.05)
    assert found.mean_route_m == pytest.approx(51.83, rel=0.05)
    assert found.mean_heading_change_deg == pytest.approx(65.85, rel=0.05)
    reported = json.loads((original.folder / "conversion.json").read_text())["statistics"]
    assert reported == pytest.approx(asdict(found)), "the report tells of the suite as written"


@needs_data
def test_every_waypoint_is_on_its_route_in_order_unless_listed(original: Suite) -> None:
    report = json.loads((original.folder / "conversion.json").read_text())
    key = lambda point: (point["scenario"], point["ego"], point["waypoint"])  # noqa: E731
    left_out = {key(out["point"]) for out in report["left_out"]}
    off_lane = {key(off["point"]): off["distance_m"] for off in report["off_lane"]}
    assert len(left_out) == 1
    egos = {(scenario.id, ego.id): ego for scenario in original.scenarios for ego in scenario.egos}
    networks = {scenario.id: scenario.network for scenario in original.scenarios}
    for scene in read_interdrive(ROUTES, TOWNS["xodr"]):
        offset = np.array(read_network_file(original.folder / "networks" / networks[scene.id]).offset)
        for route in scene.routes:
            ego = egos[scene.id, route.id]
            last = 0
            for i, xy in enumerate(route.waypoints + offset):
                where = (scene.id, ego.id, i)
                if where in left_out:
                    continue
                distance = np.hypot(*(ego.xy[last:] - xy).T)
                last += int(np.argmin(distance))
                assert distance.min() <= max(off_lane.get(where, 0.5), 0.5) + 0.6, where
            end, where = route.waypoints[-1] + offset, (scene.id, ego.id, len(route.waypoints) - 1)
            assert np.hypot(*(ego.xy[-1] - end)) <= max(off_lane.get(where, 0.5), 0.5) + 0.01, where


@needs_data
def test_lanes_connect_and_routes_lie_on_them(original: Suite) -> None:
    towns = towns_of(original)
    for scenario in original.scenarios:
        lanes = towns[scenario.network].lanes
        for ego in scenario.egos:
            for before, after in pairwise(ego.lanes):
                here = lanes[before]
                assert after in (*here.successors, here.left, here.right), (scenario.id, ego.id)
            assert np.hypot(*np.diff(ego.xy, axis=0).T).max() <= 1.5
            start = lanes[ego.lanes[0]].centre
            s, d = start.project(ego.start.x, ego.start.y)
            assert abs(d) < 0.01
            assert ego.start.yaw == pytest.approx(start.yaw_at(s), abs=0.2)
            gaps = [min(abs(lanes[i].centre.project(x, y)[1]) for i in ego.lanes) for x, y in ego.xy]
            assert max(gaps) < 2.0, "half a lane, in the middle of a lane change"


@needs_data
def test_start_boxes_do_not_overlap_and_r25_stands_where_the_file_says(original: Suite) -> None:
    for scenario in original.scenarios:
        for a, b in combinations(start_boxes(scenario), 2):
            assert not boxes_overlap(a, b), scenario.id
    offset = np.array(read_network_file(original.folder / "networks" / "Town05").offset)
    by_id = {scenario.id: scenario for scenario in original.scenarios}
    for name in ("r25_town05_ins_crosschange", "r43_town05_ins_crosschange"):
        start = by_id[name].egos[0].start
        assert math.dist((start.x, start.y), (27.91 + offset[0], 14.97 + offset[1])) < 0.1


@needs_data
def test_signs_come_from_the_xodr_and_are_unknown_with_ready_nets(original: Suite) -> None:
    signs = towns_of(original)["Town07"].stop_signs
    text = (original.folder / "conversion.md").read_text()
    if "Town07.xodr" in text:
        assert signs is not None
        assert len(signs) == 19
        assert "signs unknown for Town05." in text
    else:
        assert signs is None
        assert "signs unknown for Town05, Town06, Town07." in text


@needs_data
def test_the_report_lists_the_originals_outliers(original: Suite) -> None:
    report = json.loads((original.folder / "conversion.json").read_text())
    far = {(o["point"]["scenario"], o["point"]["ego"], o["point"]["waypoint"]) for o in report["off_lane"]}
    for outlier in (
        ("r11_town05_ins_sl", "0", 2),
        ("r45_town06_hw_merge", "3", 0),
        ("r30_town06_hw_merge", "3", 0),
    ):
        assert outlier in far
    assert report["waypoints"] == 467
    assert report["shifts"] == []
