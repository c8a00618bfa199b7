"""Networks built from maps: shapes, links, junctions, signs, widths and bytes."""

import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from testing.map_faults import as_map, drive, lane, lanes_map, plant
from testing.network_samples import EAST, built, moved, on_lane, undirected
from testing.sampling import sampled

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import list_packaged_networks, load_road_map, netconvert
from mdrive_sumo.roads.network_file import read_network_file
from real2sim.hd_map import HdMap, LaneKind, MapLane, StopLine
from real2sim.network import build_network
from real2sim.network.map_measurements import measure_line_distances

pytestmark = pytest.mark.slow


# --- geometry of the result ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", sampled(sorted(list_packaged_networks()), ("boulevard", "old_town", "roundabout")))
def test_a_network_made_a_map_and_built_again_is_the_same(name: str, tmp_path: Path) -> None:
    source = load_road_map(list_packaged_networks()[name])
    report, roads = built(tmp_path, as_map(source))
    tiny = {one.id for one in source.driving if one.centre.length < 0.5}
    assert set(report.drop_reason_by_lane) == tiny  # what they joined is linked instead
    assert (report.links_dropped, report.directions.inverted) == ((), ())
    assert bool(report.links_added) == bool(tiny)
    ours = shapely.MultiLineString([one.centre.xy for one in roads.driving])
    points = np.concatenate([one.centre.resample(1.0).xy for one in source.driving])
    assert shapely.distance(shapely.points(points), ours).max() < 0.02
    assert max(report.deviation.max, report.deviation.back_max) < (0.1 if tiny else 0.05)
    assert report.left_hand is False


@pytest.mark.parametrize("name", ["boulevard", "ramp_merge"])
def test_lanes_of_a_road_stay_neighbours(name: str, tmp_path: Path) -> None:
    source = load_road_map(list_packaged_networks()[name])
    _, roads = built(tmp_path, as_map(source))
    for one in (one for one in source.driving if one.left):
        here, beside = (roads.lanes[on_lane(roads, *source.lanes[id_].centre.at(5.0))] for id_ in (one.id, one.left))
        assert here.left == beside.id


def test_lanes_start_and_end_exactly_where_the_map_says(tmp_path: Path) -> None:
    """netconvert alone cuts lanes at the outlines of junctions."""
    short = lane("short", [(100.0, 0.0), (102.0, 0.0)], ("left", "right"))
    left = lane("left", [(102.0, 0.0), (110.0, 2.0), (115.0, 10.0)], junction=True)
    right = lane("right", [(102.0, 0.0), (110.0, -2.0), (115.0, -10.0)], junction=True)
    report, roads = built(tmp_path, lanes_map(lane("in", EAST, ("short",)), short, left, right))
    assert roads.lanes["eshort_0"].centre.xy == pytest.approx(short.centre)
    assert report.deviation.max < 0.01
    assert report.deviation.back_max < 0.01


def test_fit_is_the_distance_to_lines_of_the_same_direction() -> None:
    line = Polyline(EAST)
    assert measure_line_distances([line], [Polyline(moved(EAST, y=0.3))]) == pytest.approx(0.3)
    assert measure_line_distances([line], [Polyline(EAST[::-1])]) == pytest.approx(20.0)
    assert measure_line_distances([line], [Polyline(EAST[::-1]), Polyline(moved(EAST, y=7.0))]) == pytest.approx(7.0)


def test_repairs_are_reported(tmp_path: Path) -> None:
    clean = undirected(as_map(load_road_map(list_packaged_networks()["town_crossing"])))
    faulty = plant(clean, np.random.default_rng(1), 0.2, 0.2)
    assert faulty.reversed and faulty.removed
    report, _ = built(tmp_path, faulty.map)
    assert set(report.directions.inverted) == faulty.reversed
    assert set(report.links_added) == faulty.removed
    assert report.connections == 12


def test_links_that_geometry_refutes_are_dropped_and_reported(tmp_path: Path) -> None:
    lanes = lanes_map(
        lane("a", EAST, ("b", "far", "back", "nowhere")),
        lane("b", moved(EAST, x=101.0)),
        lane("far", moved(EAST, x=300.0)),
        lane("back", moved(EAST, y=2.5)[::-1]),
    )
    report, roads = built(tmp_path, lanes)
    assert report.links_dropped == (("a", "back"), ("a", "far"))
    assert report.connections == 1
    assert any("eb_0" in roads.lanes[id_].successors for id_ in roads.lanes["ea_0"].successors)


# --- edges and junctions ------------------------------------------------------------------------------------------
def test_an_adjacent_lane_is_a_neighbour_only_along_its_length(tmp_path: Path) -> None:
    pocket = moved(EAST, y=3.5)[10:]
    report, roads = built(tmp_path, lanes_map(lane("through", EAST), lane("pocket", pocket)))
    before, beside, in_pocket = (on_lane(roads, x, y) for x, y in ((20.0, 0.0), (80.0, 0.0), (80.0, 3.5)))
    assert before != beside
    assert roads.lanes[before].left == ""
    assert roads.lanes[beside].left == in_pocket
    assert report.source_by_lane[before] == report.source_by_lane[beside] == "through"


def test_oncoming_lanes_are_no_neighbours(tmp_path: Path) -> None:
    _, roads = built(tmp_path, lanes_map(lane("east", EAST), lane("west", moved(EAST, y=3.5)[::-1])))
    assert {one.left for one in roads.driving} == {""}


def test_lanes_drawn_through_a_crossing_get_a_junction(tmp_path: Path) -> None:
    north = np.column_stack((np.full(21, 50.0), np.arange(-50.0, 51.0, 5.0)))
    report, roads = built(tmp_path, lanes_map(lane("east", EAST), lane("north", north)))
    middle = [roads.driving[i] for i in roads.find_nearest_lanes(np.array([(45.0, 0.0), (50.0, 5.0)])).lane]
    assert [one.junction for one in middle] == [True, True]
    assert report.connections == 2
    assert report.deviation.max < 0.01
    assert (report.edges, report.nodes) == (4, 5)


def test_paths_through_several_connectors_become_one_connection(tmp_path: Path) -> None:
    half = moved(EAST[:11], x=100.0)
    lanes = lanes_map(
        lane("in", EAST, ("c1",)),
        lane("c1", half, ("c2",), junction=True),
        lane("c2", moved(half, x=50.0), ("out",), junction=True),
        lane("out", moved(EAST, x=200.0)),
        lane("south", np.column_stack((np.full(11, 120.0), np.linspace(40.0, -40.0, 11))), junction=True),
    )
    report, roads = built(tmp_path, lanes)
    way = roads.lanes["ein_0"].successors
    assert len(way) == 1
    assert report.deviation.max < 0.01
    assert report.drop_reason_by_lane == {}


def test_a_stop_sign_gives_way_and_is_in_the_network_file(tmp_path: Path) -> None:
    source = load_road_map(list_packaged_networks()["town_crossing"])
    clean = as_map(source)
    minor = source.lanes["south_in_1"] if "south_in_1" in source.lanes else source.driving[-1]
    end = np.array(minor.centre.xy[-1])
    across = np.array((-np.sin(minor.centre.yaws[-1]), np.cos(minor.centre.yaws[-1]))) * 1.7
    line = StopLine(np.stack((end - across, end + across)), (minor.id,), "stop")
    _, roads = built(tmp_path, replace(clean, stop_lines=(line,)))
    assert roads.stop_signs is not None
    (box,) = roads.stop_signs
    assert box.line_pos_m == pytest.approx(roads.lanes[box.lane].centre.length, abs=0.01)
    assert roads.lanes[box.lane].centre.xy == pytest.approx(minor.centre.xy)
    plain = ElementTree.parse(tmp_path / "net" / "plain.nod.xml")
    assert sum(node.get("type") == "priority_stop" for node in plain.iter("node")) == 1


def test_without_stop_lines_the_signs_are_unknown(tmp_path: Path) -> None:
    assert built(tmp_path, lanes_map(lane("a", EAST)))[1].stop_signs is None


# --- widths, speeds, what is not for cars -------------------------------------------------------------------------
def test_widths_come_from_the_map_then_boundaries_then_neighbours_then_the_default(tmp_path: Path) -> None:
    lanes = lanes_map(
        lane("told", EAST, width=3.1),
        lane("bounded", moved(EAST, y=100.0), left=moved(EAST, y=101.6), right=moved(EAST, y=98.4)),
        lane("beside", moved(EAST, y=200.0)),
        lane("and", moved(EAST, y=203.0)),
        lane("alone", moved(EAST, y=300.0)),
    )
    report, roads = built(tmp_path, lanes)
    assert [roads.lanes[on_lane(roads, 50.0, y)].width for y in (0.0, 100.0, 200.0, 300.0)] == [3.1, 3.2, 3.0, 3.5]
    assert report.default_widths == 3


def test_speed_limits_come_from_the_map_then_from_what_was_driven(tmp_path: Path) -> None:
    lanes = lanes_map(
        lane("told", EAST, speed_limit=8.0), lane("fast", moved(EAST, y=50.0)), lane("slow", moved(EAST, y=100.0))
    )
    motions = [drive(moved(EAST, y=y), speed) for y, speed in ((0.0, 20.0), (50.0, 20.0), (100.0, 5.0))]
    report, roads = built(tmp_path, lanes, *motions)
    limits = [roads.lanes[f"e{id_}_0"].speed_limit for id_ in ("told", "fast", "slow")]
    assert limits == pytest.approx([8.0, 20.0, 13.89], abs=0.01)
    assert report.default_speeds == 2


def test_pavements_and_crosswalks_are_for_walkers_and_other_lanes_are_lost_with_a_reason(tmp_path: Path) -> None:
    walk = MapLane("walk", LaneKind.SIDEWALK, moved(EAST, y=-5.0), width=2.0)
    park = MapLane("park", LaneKind.PARKING, moved(EAST, y=5.0))
    zebra = np.array([(50.0, -4.0), (54.0, -4.0), (54.0, 4.0), (50.0, 4.0)])
    dot = lane("dot", [(0.0, 0.0), (0.1, 0.0)])
    hd_map = replace(lanes_map(lane("a", EAST), walk, park, dot), crosswalks=(zebra,))
    report, roads = built(tmp_path, hd_map)
    assert set(roads.lanes) == {"ea_0"}
    areas = sorted(shapely.Polygon(outline).area for outline in roads.pavements)
    assert areas == pytest.approx([32.0, 200.0], rel=0.01)
    assert report.drop_reason_by_lane == {"park": "a parking lane, not for driving", "dot": "shorter than 0.5 m"}


# --- files --------------------------------------------------------------------------------------------------------
def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    hd_map = as_map(load_road_map(list_packaged_networks()["staggered"]))
    build_network(hd_map, [], tmp_path / "a", "same")
    build_network(hd_map, [], tmp_path / "b", "same")
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == ["map.net.xml.gz", "network.json", "plain.con.xml", "plain.edg.xml", "plain.nod.xml"]
    assert all((tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in names)
    assert "--no-turnarounds" in read_network_file(tmp_path / "a").build


def test_a_folder_may_be_built_again(tmp_path: Path) -> None:
    built(tmp_path, lanes_map(lane("a", EAST)))
    assert set(built(tmp_path, lanes_map(lane("b", EAST)))[1].lanes) == {"eb_0"}


def test_sumo_drives_on_it(tmp_path: Path) -> None:
    _, roads = built(tmp_path, as_map(load_road_map(list_packaged_networks()["town_crossing"])))
    into = next(one for one in roads.driving if any(roads.lanes[id_].junction for id_ in one.successors))
    goal = roads.lanes[roads.lanes[into.successors[0]].successors[0]]
    trip = f'<routes><vehicle id="v" depart="0"><route edges="{into.edge} {goal.edge}"/></vehicle></routes>'
    (tmp_path / "routes.xml").write_text(trip)
    sumo = netconvert.find_netconvert().with_name("sumo")
    call = [str(sumo), "-n", str(roads.net_file), "-r", "routes.xml", "--tripinfo-output", "trips.xml", "--no-step-log"]
    call += ["--xml-validation", "never"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    (trip_info,) = ElementTree.parse(tmp_path / "trips.xml").iter("tripinfo")
    way = into.centre.length + roads.lanes[into.successors[0]].centre.length + goal.centre.length
    assert float(trip_info.get("routeLength", "0")) == pytest.approx(way, abs=8.0)


# --- bad input ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("hd_map", "message"),
    [
        (HdMap(), "map of test: expected at least one driving lane, found none in 0 lanes"),
        (lanes_map(lane("a", [(0.0, 0.0), (0.2, 0.0)])), "expected at least one driving lane, found none in 1 lanes"),
        (
            lanes_map(lane("a", [(0.0, 0.0), (np.nan, 0.0)])),
            r"map of test: lane a: expected finite points \(N, 2\), found",
        ),
        (lanes_map(lane("a", np.zeros((3, 3)))), r"lane a: expected finite points \(N, 2\), found"),
    ],
)
def test_unusable_maps_are_refused(hd_map: HdMap, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        build_network(hd_map, [], tmp_path, "test")


def nothing_found(_: str) -> None:
    return None


def test_a_missing_netconvert_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", nothing_found)
    monkeypatch.setattr("shutil.which", nothing_found)
    with pytest.raises(InputError, match=r"netconvert: expected SUMO's programs, found none \(pip install"):
        build_network(lanes_map(lane("a", EAST)), [], tmp_path, "test")
