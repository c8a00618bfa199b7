"""Lanelet2: small maps with known answers, and damaged ones."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.interaction_samples import build_street, format_tags
from testing.sampling import examples

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import LaneKind
from real2sim.readers.interaction import read_interaction
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.readers.osm_file import read_osm


def test_lanelets_run_the_way_their_sides_say(tmp_path: Path) -> None:
    lanes = read_lanelet2(build_street().write(tmp_path / "map.osm"))[0].lanes
    for id_, east in (("1", True), ("2", True), ("3", True), ("4", False)):
        for line in (lanes[id_].centre, lanes[id_].left, lanes[id_].right):
            assert bool(line[-1, 0] > line[0, 0]) is east
    np.testing.assert_allclose(lanes["1"].centre[[0, -1]], [(0, 2), (50, 2)], atol=0.01)
    assert lanes["4"].left[0, 1] == pytest.approx(8, abs=0.01)


def test_links_come_from_shared_points_and_ways(tmp_path: Path) -> None:
    lanes = read_lanelet2(build_street().write(tmp_path / "map.osm"))[0].lanes
    assert (lanes["1"].exits, lanes["3"].entries, lanes["2"].exits) == (("3",), ("1",), ())
    assert (lanes["1"].left_neighbour, lanes["2"].right_neighbour) == ("2", "1")
    assert (lanes["2"].left_neighbour, lanes["4"].left_neighbour) == ("", "")  # of the other direction


def test_projection_is_utm_31_north_from_its_origin(tmp_path: Path) -> None:
    """The zone's central meridian is at 500 km east, the origin at 166021.443 m (Snyder, Map Projections, 1987)."""
    path = tmp_path / "map.osm"
    path.write_text("<osm><node id='1' lat='0' lon='0'/><node id='2' lat='0' lon='3'/></osm>")
    nodes = read_osm(path).nodes
    np.testing.assert_allclose(nodes["1"], (0, 0), atol=1e-6)
    np.testing.assert_allclose(nodes["2"], (500_000 - 166_021.443, 0), atol=1e-2)


@pytest.mark.parametrize(
    ("text", "limit"), [("15mph", 6.7056), ("50 km/h", 13.8889), ("36", 10.0), ("10 m/s", 10.0), ("36.0kmh", 10.0)]
)
def test_speed_limits(tmp_path: Path, text: str, limit: float) -> None:
    road = build_street()
    road.rule(100, "speed_limit", sign_type=text)
    road.lanelet(5, left=16, right=15, rules=(100,))
    lanes = read_lanelet2(road.write(tmp_path / "map.osm"))[0].lanes
    assert lanes["5"].speed_limit == pytest.approx(limit, abs=1e-4)
    assert math.isnan(lanes["1"].speed_limit)


def test_an_unreadable_speed_limit_is_noted(tmp_path: Path) -> None:
    road = build_street()
    road.rule(100, "speed_limit", sign_type="walking pace")
    road.lanelet(5, left=16, right=15, rules=(100,))
    hd_map, notes = read_lanelet2(road.write(tmp_path / "map.osm"))
    assert math.isnan(hd_map.lanes["5"].speed_limit)
    assert notes == ("speed limit 100 skipped: expected sign_type such as 50 km/h, found 'walking pace'",)


@pytest.mark.parametrize(
    ("subtype", "sign", "meaning"),
    [
        ("right_of_way", "usR1-1", "stop"),
        ("right_of_way", "de205", "yield"),
        ("all_way_stop", "", "stop"),
        ("traffic_light", "", "signal"),
        ("traffic_sign", "", ""),
    ],
)
def test_stop_lines_mean_what_their_sign_says(tmp_path: Path, subtype: str, sign: str, meaning: str) -> None:
    road = build_street()
    road.way(20, (89, 0.2), (89, 2), (89, 3.8), type="stop_line")
    road.way(21, (91, -2), (91, -1), type="traffic_sign", subtype=sign)
    road.rule(100, subtype, lines=(20,), signs=(21,))
    road.lanelet(5, left=16, right=15, rules=(100,))
    hd_map = read_lanelet2(road.write(tmp_path / "map.osm"))[0]
    (line,) = hd_map.stop_lines
    assert (line.sign, line.lanes) == (meaning, ("5",))
    np.testing.assert_allclose(line.line, [(89, 0.2), (89, 3.8)], atol=0.01)
    assert hd_map.signals == ({"100": ("5",)} if meaning == "signal" else {})


def test_a_stop_line_without_rule_holds_for_the_lanes_it_crosses(tmp_path: Path) -> None:
    road = build_street()
    road.way(20, (45, 0.2), (45, 7.8), type="stop_line")
    (line,) = read_lanelet2(road.write(tmp_path / "map.osm"))[0].stop_lines
    assert (line.sign, line.lanes) == ("", ("1", "2"))


def test_subtypes(tmp_path: Path) -> None:
    """Crosswalks are polygons, walkways lanes, the unknown is said; a two-way lane's direction is to be found out."""
    road = build_street()
    for id_, subtype in ((21, "walkway"), (22, "bicycle_lane"), (23, "crosswalk"), (24, "rail")):
        road.lanelet(id_, left=16, right=15, subtype=subtype, one_way="no")
    hd_map, notes = read_lanelet2(road.write(tmp_path / "map.osm"))
    assert {id_: lane.kind for id_, lane in hd_map.lanes.items() if len(id_) == 2} == {
        "21": LaneKind.SIDEWALK,
        "22": LaneKind.BIKE,
    }
    assert (hd_map.lanes["1"].directed, hd_map.lanes["21"].directed) == (True, False)
    assert [shapely.Polygon(walk).area for walk in hd_map.crosswalks] == [pytest.approx(160, rel=0.01)]
    assert notes == ("1 lanelets of the subtype 'rail' skipped",)


def test_pairs_of_markings_are_crosswalks(tmp_path: Path) -> None:
    """One line is drawn in two pieces, one against the other; the line far away has no partner."""
    road = build_street()
    road.way(30, (20, 0), (20, 4), type="pedestrian_marking")
    road.way(31, (20, 8), (20, 4), type="pedestrian_marking")
    road.way(32, (23, 8), (23, 0), type="pedestrian_marking")
    road.way(33, (60, 0), (60, 8), type="pedestrian_marking")
    road.way(34, (40, 0), (40, 8), type="pedestrian_marking")
    road.way(35, (43, 0), (43, 8), type="pedestrian_marking")
    hd_map = read_lanelet2(road.write(tmp_path / "map.osm"))[0]
    assert [shapely.Polygon(walk).area for walk in hd_map.crosswalks] == [pytest.approx(24, rel=0.01)] * 2


@pytest.mark.parametrize(
    "element",
    [
        "<node id='9901' action='delete' lat='999' lon='0'/>",
        "<node id='9902' visible='false'/>",
        "<way id='9903' action='delete'/>",
        f"<relation id='9904' action='delete'>{format_tags({'type': 'lanelet', 'subtype': 'road'})}</relation>",
    ],
)
def test_deleted_elements_are_not_there(tmp_path: Path, element: str) -> None:
    """The editor JOSM keeps them in the file until it is uploaded."""
    path = build_street().write(tmp_path / "map.osm")
    lanes, notes = read_lanelet2(path)[0].lanes, read_lanelet2(path)[1]
    path.write_text(path.read_text().replace("</osm>", element + "</osm>"))
    again, more_notes = read_lanelet2(path)
    assert again.lanes.keys() == lanes.keys()
    assert more_notes == notes


@pytest.mark.parametrize(
    ("way", "reason"),
    [
        ("<way id='99'><nd ref='1'/><nd ref='404'/>TAGS</way>", "expected nodes of this file, found node 404"),
        ("<way id='99'><nd ref='1'/><nd ref='1'/>TAGS</way>", "expected at least two distinct points, found 1"),
        ("<way id='99'>TAGS</way>", "expected at least two distinct points, found 0"),
    ],
)
@pytest.mark.parametrize("type_", ["stop_line", "pedestrian_marking", "curbstone"])
def test_a_way_that_no_lanelet_needs_is_skipped_with_a_note(tmp_path: Path, way: str, reason: str, type_: str) -> None:
    path = build_street().write(tmp_path / "map.osm")
    path.write_text(path.read_text().replace("</osm>", way.replace("TAGS", format_tags({"type": type_})) + "</osm>"))
    hd_map, notes = read_lanelet2(path)
    assert len(hd_map.lanes) == 4
    assert hd_map.stop_lines == ()
    assert notes == (f"1 ways of the map skipped, the first: way 99: {reason}",)


@pytest.mark.parametrize(
    ("members", "reason"),
    [
        ("<member role='left' ref='11'/>", "lanelet 77: expected one way as right, found 0"),
        (
            "<member role='left' ref='11'/><member role='left' ref='12'/><member role='right' ref='13'/>",
            "lanelet 77: expected one way as left, found 2",
        ),
        (
            "<member role='left' ref='11'/><member role='right' ref='404'/>",
            "lanelet 77: expected one way as right, found 0",
        ),
    ],
)
def test_a_lanelet_that_is_none_is_skipped_with_a_note(tmp_path: Path, members: str, reason: str) -> None:
    """A faulty one does not cost the whole map."""
    road = build_street()
    road.relation(77, members, type="lanelet", subtype="road")
    hd_map, notes = read_lanelet2(road.write(tmp_path / "map.osm"))
    assert set(hd_map.lanes) == {"1", "2", "3", "4"}
    assert notes == (f"1 lanelets skipped, the first: {reason}",)


@pytest.mark.slow
@settings(max_examples=examples(37, 150), suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_a_map_without_some_element(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever is missing: a map or one sentence."""
    road = build_street()
    road.way(20, (89, 0.2), (89, 3.8), type="stop_line")
    road.rule(100, "traffic_light", lines=(20,), signs=(21,))
    road.lanelet(5, left=16, right=15, rules=(100,))
    path = road.write(tmp_path / "map.osm")
    root = ElementTree.fromstring(path.read_text())
    parent = data.draw(st.sampled_from([one for one in root.iter() if len(one)]))
    parent.remove(data.draw(st.sampled_from(list(parent))))
    path.write_bytes(ElementTree.tostring(root))
    try:
        hd_map, _ = read_lanelet2(path)
    except InputError as error:
        assert str(error).startswith(str(path))
    else:
        assert hd_map.lanes


BOMB = '<!DOCTYPE osm [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><osm>&b;</osm>'


NODES = "<node id='1' lat='0' lon='0'/><node id='2' lat='0' lon='0.001'/>"


LINES = f"{NODES}<way id='8'><nd ref='1'/><nd ref='2'/></way>"


DELETED_WAY = "<way action='delete'"


LANELET = "<tag k='type' v='lanelet'/><tag k='subtype' v='road'/>"


MAPS: dict[str, tuple[str, str]] = {
    "not XML": ("track_id,frame_id", "expected well-formed XML"),
    "truncated": ("<osm><node id='1' lat='0'", "expected well-formed XML"),
    "document type": (BOMB, "expected XML without a document type, found <!DOCTYPE osm>"),
    "root": ("<commonRoad/>", "expected the root <osm>, found <commonRoad>"),
    "no nodes": ("<osm/>", "expected nodes, found none"),
    "NaN": ("<osm><node id='1' lat='nan' lon='0'/></osm>", "node: lat: expected a finite number, found 'nan'"),
    "no latitude": ("<osm><node id='1' lon='0'/></osm>", "node: lat: expected a finite number, found None"),
    "no degrees": ("<osm><node id='1' lat='991' lon='0'/></osm>", "expected latitudes within 90"),
    "no id": ("<osm><node lat='1' lon='0'/></osm>", "node: expected the attribute id, found none"),
    "no lanelets": (f"<osm>{LINES}</osm>", "expected at least one lanelet with the subtype road, found none"),
    "lost node": (
        f"<osm>{NODES}<way id='8'><nd ref='9'/></way>"
        f"<relation id='5'><member role='left' ref='8'/><member role='right' ref='8'/>{LANELET}</relation></osm>",
        "lanelet 5: left: way 8: expected nodes of this file, found node 9",
    ),
    "deleted nodes": ("<osm><node id='1' lat='0' lon='0' action='delete'/></osm>", "expected nodes, found none"),
    "deleted way": (
        f"<osm>{LINES.replace('<way', DELETED_WAY)}<relation id='5'><member role='left' ref='8'/>"
        f"<member role='right' ref='8'/>{LANELET}</relation></osm>",
        "lanelet 5: expected one way as left, found 0",
    ),
    "lost way": (
        f"<osm>{LINES}<relation id='5'>{LANELET}</relation></osm>",
        "lanelet 5: expected one way as left, found 0",
    ),
    "short way": (
        f"<osm>{NODES}<way id='8'><nd ref='1'/><nd ref='1'/></way>"
        f"<relation id='5'><member role='left' ref='8'/><member role='right' ref='8'/>{LANELET}</relation></osm>",
        "way 8: expected at least two distinct points, found 1",
    ),
}


@pytest.mark.parametrize("name", MAPS)
def test_damaged_maps(folder: Path, name: str) -> None:
    text, words = MAPS[name]
    (folder / "map.osm").write_text(text)
    with pytest.raises(InputError) as error:
        read_interaction(folder, folder / "map.osm")
    assert words in str(error.value)
    assert str(folder / "map.osm") in str(error.value)
    assert "\n" not in str(error.value)
