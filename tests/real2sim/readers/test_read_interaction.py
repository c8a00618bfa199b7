"""INTERACTION and Lanelet2: the real recording, small maps with known answers, and damaged files."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap, LaneKind
from real2sim.readers.interaction import read_interaction
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.readers.osm_file import read_osm
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

MAP = "DR_USA_Intersection_EP0.osm"
VEHICLES = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
PEDESTRIANS = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"
SCALE = 0.9996 * (1 + math.radians(3) ** 2 / 2)
"""Of UTM on the equator, 3 degrees off its central meridian (Snyder, Map Projections, 1987, to second order)."""
M_PER_DEGREE = (111_319.491 * SCALE, 110_574.276 * SCALE)
"""East and north on the equator (WGS 84)."""


# --- the real recording ---


@pytest.fixture(scope="module")
def data(shared_data: Path) -> Path:
    return shared_data / "real_logs" / "interaction"


@pytest.fixture(scope="module")
def real(data: Path) -> Recording:
    return read_interaction(data, data / MAP)


def _tracks(recording: Recording) -> tuple[RecordedTrack, ...]:
    return recording.views[0].tracks


def _vehicle_points(recording: Recording) -> np.ndarray:
    """(N, 3) x, y, yaw of every tenth frame."""
    vehicles = (track for track in _tracks(recording) if track.category.kind is Kind.VEHICLE)
    return np.concatenate([np.column_stack((one.xy, one.yaw))[one.valid_frames[::10]] for one in vehicles])


def _areas(hd_map: HdMap) -> list[shapely.Geometry]:
    rings = (np.concatenate((lane.left, lane.right[::-1])) for lane in hd_map.lanes.values())
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings]


def test_real_counts_and_clock(real: Recording) -> None:
    kinds = [track.category.kind for track in _tracks(real)]
    assert (kinds.count(Kind.VEHICLE), kinds.count(Kind.PEDESTRIAN)) == (74, 23)
    assert (real.dt_s, real.frame_count, len(real.map.lanes)) == (0.1, 3007, 59)
    assert real.cavs == ()


def test_real_table_is_read_cell_by_cell(real: Recording, data: Path) -> None:
    """Against the text itself, split by hand."""
    by_id = {track.id: track for track in _tracks(real)}
    for name in ("vehicle_tracks_000.csv", "pedestrian_tracks_000.csv"):
        lines = (data / name).read_text().splitlines()[1:]
        for line in lines[:: len(lines) // 50]:
            cells = line.split(",")
            track, row = by_id[cells[0]], int(cells[1]) - 1
            assert track.valid[row]
            assert (track.x[row], track.y[row]) == (float(cells[4]), float(cells[5]))
            box = [float(cell) for cell in cells[8:]] or [math.nan] * 3
            np.testing.assert_array_equal([track.yaw[row], track.length[row], track.width[row]], box)
        assert sum(by_id[one].valid.sum() for one in {line.split(",")[0] for line in lines}) == len(lines)


def test_real_vehicles_are_on_lanelets(real: Recording) -> None:
    """As shared/spec/data_formats.md section 6 says; a wrong projection misses by metres."""
    points = _vehicle_points(real)
    road = shapely.union_all(_areas(real.map))
    assert shapely.contains_xy(road, points[:, 0], points[:, 1]).mean() >= 0.99


def test_real_vehicles_drive_along_lanes(real: Recording) -> None:
    """A lanelet read the wrong way round turns its vehicles into wrong-way drivers."""
    tree, lines = shapely.STRtree(_areas(real.map)), [Polyline(lane.centre) for lane in real.map.lanes.values()]
    points = _vehicle_points(real)
    along = 0
    for x, y, yaw in points:
        hits = tree.query(shapely.Point(x, y), predicate="within")
        along += any(math.cos(yaw - lines[hit].yaw_at(lines[hit].project(x, y)[0])) > 0.5 for hit in hits)
    assert along / len(points) >= 0.97


def test_real_lanes_are_linked(real: Recording) -> None:
    lanes = real.map.lanes
    for lane in lanes.values():
        for after in lane.exits:
            assert lane.id in lanes[after].entries
            assert np.hypot(*(lanes[after].centre[0] - lane.centre[-1])) < 1e-6
        for side, back in (("left", "right"), ("right", "left")):
            beside = getattr(lane, f"{side}_neighbour")
            assert not beside or getattr(lanes[beside], f"{back}_neighbour") == lane.id
    dead_ends = [lane for lane in lanes.values() if not lane.exits or not lane.entries]
    assert 0 < len(dead_ends) <= 16  # 5 arms, in and out, of one or two lanes
    assert _reachable(real.map) == set(lanes)


def _reachable(hd_map: HdMap) -> set[str]:
    """Lanes on some way from the rim of the map."""
    queue = [lane.id for lane in hd_map.lanes.values() if not lane.entries]
    seen = set(queue)
    while queue:
        new = set(hd_map.lanes[queue.pop()].exits) - seen
        seen |= new
        queue += new
    return seen


def test_real_rules(real: Recording) -> None:
    np.testing.assert_allclose([lane.speed_limit for lane in real.map.lanes.values()], 15 * 0.44704)
    lines = {line.lanes: line.sign for line in real.map.stop_lines}
    assert lines == dict.fromkeys([("30028",), ("30048",), ("30041", "30046"), ("30056",), ("30057",)], "stop")


def test_real_crosswalks(real: Recording) -> None:
    """Four pairs of lines; most of the pedestrians on the road are on them."""
    walks = shapely.union_all([shapely.Polygon(walk) for walk in real.map.crosswalks])
    walkers = np.concatenate([one.xy[one.valid] for one in _tracks(real) if one.category is ObjectCategory.PEDESTRIAN])
    on_road = walkers[shapely.contains_xy(shapely.union_all(_areas(real.map)), *walkers.T)]
    assert len(real.map.crosswalks) == 4
    assert walks.area < 0.12 * shapely.union_all(_areas(real.map)).area
    assert shapely.contains_xy(walks, *on_road.T).mean() > 0.5


def test_real_window(real: Recording, data: Path) -> None:
    part = read_interaction(data / "vehicle_tracks_000.csv", data / MAP, (100.0, 110.0))
    assert part.frame_count == 101
    there = {track.id: track for track in _tracks(real) if track.valid[1000:1101].any()}
    assert {track.id for track in _tracks(part)} == set(there)
    for track in _tracks(part):
        np.testing.assert_array_equal(track.x, there[track.id].x[1000:1101])


# --- small maps ---


class Map:
    """Writes `.osm` files; coordinates are metres, turned into degrees with a constant."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[float, float], int] = {}
        self.parts: list[str] = []

    def way(self, id_: int, *points: tuple[float, float], **tags: str) -> None:
        refs = "".join(f"<nd ref='{self.nodes.setdefault(point, len(self.nodes) + 1)}'/>" for point in points)
        self.parts.append(f"<way id='{id_}'>{refs}{_tags(tags)}</way>")

    def lanelet(self, id_: int, left: int, right: int, rules: tuple[int, ...] = (), **tags: str) -> None:
        members = f"<member type='way' role='left' ref='{left}'/><member type='way' role='right' ref='{right}'/>"
        members += "".join(f"<member type='relation' role='regulatory_element' ref='{rule}'/>" for rule in rules)
        self.relation(id_, members, **({"type": "lanelet", "subtype": "road"} | tags))

    def rule(
        self, id_: int, subtype: str, lines: tuple[int, ...] = (), signs: tuple[int, ...] = (), **tags: str
    ) -> None:
        members = "".join(f"<member type='way' role='ref_line' ref='{line}'/>" for line in lines)
        members += "".join(f"<member type='way' role='refers' ref='{sign}'/>" for sign in signs)
        self.relation(id_, members, type="regulatory_element", subtype=subtype, **tags)

    def relation(self, id_: int, members: str, **tags: str) -> None:
        self.parts.append(f"<relation id='{id_}'>{members}{_tags(tags)}</relation>")

    def write(self, path: Path) -> Path:
        nodes = "".join(
            f"<node id='{id_}' lat='{y / M_PER_DEGREE[1]:.10f}' lon='{x / M_PER_DEGREE[0]:.10f}'/>"
            for (x, y), id_ in self.nodes.items()
        )
        path.write_text(f"<osm>{nodes}{''.join(self.parts)}</osm>")
        return path


def _tags(tags: dict[str, str]) -> str:
    return "".join(f"<tag k='{key}' v='{value}'/>" for key, value in tags.items())


def _street() -> Map:
    """Two lanes east (1 on the right, 2 on the left), then one that follows lane 1, and one west (4) north of them."""
    road = Map()
    road.way(11, (0, 0), (50, 0))
    road.way(12, (50, 4), (0, 4))  # drawn against the direction of travel
    road.way(13, (0, 8), (50, 8))
    road.way(14, (0, 12), (50, 12))
    road.way(15, (50, 0), (90, 0))
    road.way(16, (50, 4), (90, 4))
    road.lanelet(1, left=12, right=11)
    road.lanelet(2, left=13, right=12)
    road.lanelet(3, left=16, right=15)
    road.lanelet(4, left=13, right=14)
    return road


def test_lanelets_run_the_way_their_sides_say(tmp_path: Path) -> None:
    lanes = read_lanelet2(_street().write(tmp_path / "map.osm"))[0].lanes
    for id_, east in (("1", True), ("2", True), ("3", True), ("4", False)):
        for line in (lanes[id_].centre, lanes[id_].left, lanes[id_].right):
            assert bool(line[-1, 0] > line[0, 0]) is east
    np.testing.assert_allclose(lanes["1"].centre[[0, -1]], [(0, 2), (50, 2)], atol=0.01)
    assert lanes["4"].left[0, 1] == pytest.approx(8, abs=0.01)


def test_links_come_from_shared_points_and_ways(tmp_path: Path) -> None:
    lanes = read_lanelet2(_street().write(tmp_path / "map.osm"))[0].lanes
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
    road = _street()
    road.rule(100, "speed_limit", sign_type=text)
    road.lanelet(5, left=16, right=15, rules=(100,))
    lanes = read_lanelet2(road.write(tmp_path / "map.osm"))[0].lanes
    assert lanes["5"].speed_limit == pytest.approx(limit, abs=1e-4)
    assert math.isnan(lanes["1"].speed_limit)


def test_a_speed_limit_in_no_known_words_is_said(tmp_path: Path) -> None:
    road = _street()
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
    road = _street()
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
    road = _street()
    road.way(20, (45, 0.2), (45, 7.8), type="stop_line")
    (line,) = read_lanelet2(road.write(tmp_path / "map.osm"))[0].stop_lines
    assert (line.sign, line.lanes) == ("", ("1", "2"))


def test_subtypes(tmp_path: Path) -> None:
    """Crosswalks are polygons, walkways lanes, the unknown is said; a two-way lane's direction is to be found out."""
    road = _street()
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
    road = _street()
    road.way(30, (20, 0), (20, 4), type="pedestrian_marking")
    road.way(31, (20, 8), (20, 4), type="pedestrian_marking")
    road.way(32, (23, 8), (23, 0), type="pedestrian_marking")
    road.way(33, (60, 0), (60, 8), type="pedestrian_marking")
    road.way(34, (40, 0), (40, 8), type="pedestrian_marking")
    road.way(35, (43, 0), (43, 8), type="pedestrian_marking")
    hd_map = read_lanelet2(road.write(tmp_path / "map.osm"))[0]
    assert [shapely.Polygon(walk).area for walk in hd_map.crosswalks] == [pytest.approx(24, rel=0.01)] * 2


# --- small tables ---


def _table(path: Path, *rows: str, header: str = VEHICLES) -> Path:
    path.write_text("\n".join((header, *rows)) + "\n")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _street().write(tmp_path / "map.osm")
    _table(
        tmp_path / "vehicle_tracks_007.csv",
        "1,5,500,car,1,2,10,0,0.1,4.5,1.8",
        "1,6,600,car,2,2,10,0,0.1,4.5,1.8",
        "1,8,800,car,4,2,10,0,0.1,4.5,1.8",
        "2,6,600,truck,9,2,10,0,3.1,9,2.5",
    )
    _table(
        tmp_path / "pedestrian_tracks_007.csv",
        "P1,4,400,pedestrian/bicycle,0,9,1,1",
        "P2,4,400,pedestrian/bicycle,0,9,4,3",
        header=PEDESTRIANS,
    )
    return tmp_path


def test_frames_start_with_the_first_of_both_tables(folder: Path) -> None:
    recording = read_interaction(folder, folder / "map.osm")
    first, truck, walker, cyclist = _tracks(recording)
    assert (recording.frame_count, recording.id) == (5, "map_vehicle_tracks_007")
    np.testing.assert_array_equal(first.valid, [False, True, True, False, True])
    np.testing.assert_array_equal(first.x, [np.nan, 1, 2, np.nan, 4])
    assert (truck.category, truck.length[2], truck.yaw[2]) == (ObjectCategory.TRUCK, 9, 3.1)
    assert (walker.category, cyclist.category) == (ObjectCategory.PEDESTRIAN, ObjectCategory.BICYCLE)
    assert np.isnan([walker.yaw, walker.length, walker.width]).all()
    assert recording.notes == ("1 of the pedestrian/bicycle tracks taken for bicycles by their speed",)


def test_a_window_keeps_the_frames_at_both_ends(folder: Path) -> None:
    part = read_interaction(folder, folder / "map.osm", (0.1, 0.2))
    assert part.frame_count == 2
    assert [(track.id, track.valid.tolist()) for track in _tracks(part)] == [("1", [True, True]), ("2", [False, True])]


def test_nothing_is_warned_of(folder: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_interaction(folder / "vehicle_tracks_007.csv", folder / "map.osm")


# --- damaged files ---


def _rows(*rows: str, header: str = VEHICLES) -> Callable[[Path], object]:
    return lambda folder: _table(folder / "vehicle_tracks_007.csv", *rows, header=header)


GOOD = "1,5,500,car,1,2,10,0,0.1,4.5,1.8"
TABLES: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (lambda folder: (folder / "vehicle_tracks_007.csv").write_text(""), "column track_id, found none"),
    "no rows": (_rows(), "expected at least one row, found none"),
    "no column": (
        _rows(GOOD, header=VEHICLES.replace("psi_rad", "heading")),
        "expected the column psi_rad, found track",
    ),
    "short row": (_rows(GOOD, "1,6,600,car,2"), "line 3: expected 11 columns, found 5"),
    "NaN": (_rows(GOOD.replace(",2,", ",nan,")), "line 2: y: expected a finite number, found 'nan'"),
    "a word": (_rows(GOOD.replace("0.1", "north")), "line 2: psi_rad: expected a finite number, found 'north'"),
    "no size": (_rows(GOOD.replace("1.8", "0")), "line 2: width: expected a positive number, found '0'"),
    "off the clock": (
        _rows(GOOD, "1,6,640,car,2,2,10,0,0.1,4.5,1.8"),
        "line 3: timestamp_ms: expected a multiple of 100",
    ),
    "twice": (_rows(GOOD, GOOD), "track 1: expected one row at 500 ms, found 2"),
    "type": (_rows(GOOD.replace("car", "tram")), "line 2: agent_type: expected one of car, truck"),
    "no text": (
        lambda folder: (folder / "vehicle_tracks_007.csv").write_bytes(b"\xff\xfe\x00"),
        "comma-separated values",
    ),
    "no file": (lambda folder: (folder / "vehicle_tracks_007.csv").unlink(), "expected one vehicle_tracks_*.csv"),
    "several": (lambda folder: (folder / "vehicle_tracks_008.csv").write_text(""), "(name one of several), found 2"),
}


@pytest.mark.parametrize("name", TABLES)
def test_damaged_tables(folder: Path, name: str) -> None:
    damage, words = TABLES[name]
    damage(folder)
    with pytest.raises(InputError) as error:
        read_interaction(folder, folder / "map.osm")
    assert words in str(error.value)
    assert str(folder) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((0.3, 9.0), "expected a window within 0 s to 0.4 s, found 0.3 s to 9 s"),
        ((0.2, 0.1), "found 0.2 s to 0.1 s"),
        ((-1.0, 0.1), "found -1 s to 0.1 s"),
        ((math.nan, 0.1), "found nan s to 0.1 s"),
    ],
)
def test_a_window_outside_the_log(folder: Path, window: tuple[float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_interaction(folder, folder / "map.osm", window)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_a_map_without_some_element(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever is missing: a map or one sentence."""
    road = _street()
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


def test_a_missing_table_file(folder: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_interaction(folder / "vehicle_tracks_009.csv", folder / "map.osm")


BOMB = '<!DOCTYPE osm [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><osm>&b;</osm>'
NODES = "<node id='1' lat='0' lon='0'/><node id='2' lat='0' lon='0.001'/>"
LINES = f"{NODES}<way id='8'><nd ref='1'/><nd ref='2'/></way>"
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
        f"<osm>{NODES}<way id='8'><nd ref='9'/></way></osm>",
        "way 8: expected nodes of this file, found node 9",
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
