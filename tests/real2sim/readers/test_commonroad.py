"""CommonRoad: recorded NGSIM traffic compared with a plain reading of the XML, and small scenarios."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from testing.commonroad_samples import (
    BOX,
    CAR,
    LANE,
    MOVES,
    SQUARE,
    Write,
    format_lanelet,
    format_obstacle,
    format_parked,
    make_sign,
)

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import LaneKind
from real2sim.readers.commonroad import read_commonroad
from real2sim.readers.time_grid import crop_recording
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

SCENARIOS = {"USA_US101-3_3_T-1": "2018b", "USA_Peach-4_8_T-1": "2020a"}


Real = tuple[Recording, ElementTree.Element]
AREAS = {
    "rectangle": "<rectangle><length>2</length><width>1</width><orientation>1</orientation>"
    "<center><x>13</x><y>2</y></center></rectangle>",
    "circle": "<circle><radius>1</radius><center><x>13</x><y>2</y></center></circle>",
    "two": "<circle><radius>1</radius><center><x>12</x><y>2</y></center></circle>"
    "<circle><radius>1</radius><center><x>14</x><y>2</y></center></circle>",
    "polygon": "<polygon>"
    + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in ((12, 1), (14, 1), (14, 3), (12, 3)))
    + "</polygon>",
}


def _tracks(recording: Recording) -> dict[str, RecordedTrack]:
    return {track.id: track for track in recording.views[0].tracks}


# --- recorded traffic ---
@pytest.fixture(scope="module", params=SCENARIOS)
def real(request: pytest.FixtureRequest, shared_data: Path) -> Real:
    path = shared_data / "real_logs" / "commonroad" / f"{request.param}.xml"
    root = ElementTree.parse(path).getroot()
    assert root.get("commonRoadVersion") == SCENARIOS[request.param]
    return read_commonroad(path), root


def _float(element: ElementTree.Element, path: str) -> float:
    return float(element.findtext(path, "nan"))


def _xy(points: list[ElementTree.Element]) -> np.ndarray:
    """(N, 2), each point once: some of US-101 are there twice."""
    return np.array(list(dict.fromkeys((_float(point, "x"), _float(point, "y")) for point in points)))


@pytest.mark.slow
def test_every_recorded_state_is_there(real: Real) -> None:
    recording, root = real
    obstacles = [one for one in root if one.tag in ("obstacle", "dynamicObstacle")]
    tracks = _tracks(recording)
    assert set(tracks) == {one.get("id") for one in obstacles}
    assert recording.dt_s == float(root.get("timeStepSize", "nan"))
    assert recording.frame_count == 1 + max(int(_float(one, "time/exact")) for one in root.iter("state"))
    for one in obstacles:
        track = tracks[one.get("id", "")]
        states = [*one.iter("initialState"), *one.iter("state")]
        rows = [int(_float(state, "time/exact")) for state in states]
        assert track.valid_frames.tolist() == rows
        expected = [_float(state, name) for state in states for name in ("position/point/x", "position/point/y")]
        np.testing.assert_allclose(track.xy[rows].ravel(), expected, atol=1e-9)
        np.testing.assert_allclose(track.yaw[rows], [_float(state, "orientation/exact") for state in states])
        np.testing.assert_allclose(track.length[rows], _float(one, "shape/rectangle/length"))
        np.testing.assert_allclose(track.width[rows], _float(one, "shape/rectangle/width"))
        assert (track.category, track.parked) == (ObjectCategory.CAR, False)


def test_every_lanelet_is_there(real: Real) -> None:
    recording, root = real
    elements = {one.get("id", ""): one for one in root.findall("lanelet")}
    assert set(recording.map.lanes) == set(elements)
    for id_, lane in recording.map.lanes.items():
        element = elements[id_]
        left, right = (_xy(element.findall(f"{side}/point")) for side in ("leftBound", "rightBound"))
        np.testing.assert_allclose(lane.left, left)
        np.testing.assert_allclose(lane.right, right)
        if len(left) == len(right):
            np.testing.assert_allclose(lane.centre, (left + right) / 2)
        assert lane.entries == tuple(one.get("ref") for one in element.findall("predecessor"))
        assert lane.exits == tuple(one.get("ref") for one in element.findall("successor"))
        for side, found in (("Left", lane.left_neighbour), ("Right", lane.right_neighbour)):
            beside = element.find(f"adjacent{side}[@drivingDir='same']")
            assert found == ("" if beside is None else beside.get("ref"))
        assert (lane.kind, lane.directed) == (LaneKind.DRIVING, True)


def test_speed_limits_stop_lines_and_signals(real: Real) -> None:
    recording, root = real
    limits = {one.get("id"): _float(one, "trafficSignElement/additionalValue") for one in root.findall("trafficSign")}
    lights: dict[str, set[str]] = {}
    for element in root.findall("lanelet"):
        id_ = element.get("id", "")
        signs = [limits[ref.get("ref")] for ref in element.findall("trafficSignRef")]
        np.testing.assert_equal(recording.map.lanes[id_].speed_limit, min(signs, default=math.nan))
        lines = [line for line in recording.map.stop_lines if id_ in line.lanes]
        assert len(lines) == len(element.findall("stopLine"))
        for line in lines:
            assert line.sign == "signal"
            ends = [_xy(element.findall(f"{side}/point"))[-1] for side in ("leftBound", "rightBound")]
            np.testing.assert_allclose(line.line, ends)
        for ref in element.findall("trafficLightRef"):
            lights.setdefault(ref.get("ref", ""), set()).add(id_)
    assert {light: set(lanes) for light, lanes in recording.map.signals.items()} == lights


def test_recorded_vehicles_drive_along_lanes(real: Real) -> None:
    recording, _ = real
    lanes = list(recording.map.lanes.values())
    tree = shapely.STRtree([shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))) for lane in lanes])
    lines = [Polyline(lane.centre) for lane in lanes]
    poses = np.concatenate(
        [np.column_stack((one.xy, one.yaw))[one.valid_frames] for one in _tracks(recording).values()]
    )
    on_lane = along = 0
    for x, y, yaw in poses:
        hits = tree.query(shapely.Point(x, y), predicate="within")
        on_lane += len(hits) > 0
        along += any(math.cos(yaw - lines[hit].yaw_at(lines[hit].project(x, y)[0])) > 0.5 for hit in hits)
    assert on_lane / len(poses) >= 0.99
    assert along / len(poses) >= 0.95


@pytest.mark.slow
def test_lanes_within_an_intersection(shared_data: Path) -> None:
    """Of the intersection at Peachtree Street: the ways through it, whole, and none of the arms."""
    lanes = read_commonroad(shared_data / "real_logs/commonroad/USA_Peach-4_8_T-1.xml").map.lanes
    inside = {id_ for id_, lane in lanes.items() if lane.junction}
    assert {"43652", "43630", "43620", "43622"} <= inside  # turning left and going straight, from two arms
    ends = np.concatenate([lanes[id_].centre[[0, -1]] for id_ in inside])
    assert (np.ptp(ends, axis=0) < 50).all()
    arms = {id_ for id_, lane in lanes.items() if not (lane.entries and lane.exits)} - {"43634", "43620"}  # dead ends
    assert len(arms) >= 16
    assert not arms & inside


@pytest.mark.slow
def test_a_window_of_a_recording(shared_data: Path) -> None:
    path = shared_data / "real_logs/commonroad/USA_Peach-4_8_T-1.xml"
    whole = read_commonroad(path)
    part = crop_recording(str(path), whole, (2.5, 4.0))
    assert part.frame_count == 16
    there = {id_ for id_, track in _tracks(whole).items() if track.valid[25:41].any()}
    assert set(_tracks(part)) == there < set(_tracks(whole))


def test_gaps_and_the_first_frame(write: Write) -> None:
    recording = read_commonroad(write(format_lanelet(1, 0), format_obstacle(7)))
    track = _tracks(recording)["7"]
    assert (recording.frame_count, recording.id) == (4, "USA_Test-1_1_T-1")
    np.testing.assert_array_equal(track.x, [10, 11, np.nan, 13])
    np.testing.assert_array_equal(track.valid, [True, True, False, True])
    np.testing.assert_array_equal(track.width, [1.8, 1.8, np.nan, 1.8])


@pytest.mark.parametrize(
    ("type_", "category"),
    [
        ("truck", "truck"),
        ("taxi", "car"),
        ("motorcycle", "motorcycle"),
        ("pedestrian", "pedestrian"),
        ("unknown", "car"),
    ],
)
def test_what_moves(write: Write, type_: str, category: str) -> None:
    track = _tracks(read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, type_=type_))))["7"]
    assert (track.category, track.parked) == (ObjectCategory(category), False)


@pytest.mark.parametrize(
    ("type_", "category"), [("parkedVehicle", "car"), ("constructionZone", "static"), ("unknown", "static")]
)
def test_what_stands_is_there_all_the_time(write: Write, type_: str, category: str) -> None:
    track = _tracks(read_commonroad(write(format_lanelet(1, 0), format_obstacle(7), format_parked(8, type_))))["8"]
    assert (track.category, track.parked, track.valid.all()) == (ObjectCategory(category), True, True)
    np.testing.assert_array_equal(track.x, [30] * 4)


SHAPES = {
    "circle": ("<circle><radius>0.4</radius></circle>", (0.0, 0.0), (0.8, 0.8)),
    "polygon": (f"<polygon>{SQUARE}</polygon>", (2.0, 1.0), (4.0, 2.0)),
    "shifted": (f"{BOX[:-12]}<originXShift>-1.5</originXShift></rectangle>", (1.5, 0.0), (4.5, 1.8)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_boxes_about_their_centre(write: Write, name: str) -> None:
    shape, (ahead, left), size = SHAPES[name]
    track = _tracks(read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, shape=shape))))["7"]
    c, s = math.cos(0.5), math.sin(0.5)
    np.testing.assert_allclose(track.xy[0], (10 + ahead * c - left * s, ahead * s + left * c), atol=1e-9)
    np.testing.assert_allclose((track.length[0], track.width[0]), size)


def test_unreadable_obstacles_are_noted(write: Write) -> None:
    vague = MOVES.replace("<exact>6</exact>", "<intervalStart>6</intervalStart><intervalEnd>8</intervalEnd>")
    path = write(
        format_lanelet(1, 0),
        format_obstacle(7),
        format_obstacle(8, vague),
        format_parked(9, shape=BOX * 2),
        format_obstacle(10, type_="train"),
    )
    recording = read_commonroad(path)
    assert set(_tracks(recording)) == {"7"}
    assert recording.notes == (
        "1 obstacles of more than one shape skipped",
        "1 obstacles without exact times skipped",
        "1 obstacles of the type train skipped",
    )


def test_links_out_of_a_cut_map_are_taken_out(write: Write) -> None:
    links = (
        "<predecessor ref='5'/><successor ref='2'/><adjacentLeft ref='6' drivingDir='same'/><trafficSignRef ref='93'/>"
    )
    path = write(
        format_lanelet(1, 0, links), format_lanelet(2, 50), make_sign(93, "274", "8.5"), CAR, place="DEU_Test-1_1_T-1"
    )
    recording = read_commonroad(path)
    lane = recording.map.lanes["1"]
    assert (lane.entries, lane.exits, lane.left_neighbour) == ((), ("2",), "")
    assert recording.notes == ("2 links to lanelets that are not in the file skipped",)


def test_kinds_of_lanes_and_signs(write: Write) -> None:
    """German signs: 206 is stop, 205 yield, 274 a speed limit."""
    path = write(
        format_lanelet(1, 0, "<laneletType>urban</laneletType><trafficSignRef ref='91'/><trafficSignRef ref='93'/>"),
        format_lanelet(2, 4, "<stopLine><lineMarking>solid</lineMarking></stopLine><laneletType>busLane</laneletType>"),
        format_lanelet(3, 8, "<laneletType>bicycleLane</laneletType><trafficSignRef ref='92'/>"),
        format_lanelet(4, 12, "<laneletType>sidewalk</laneletType>"),
        format_lanelet(5, 16, "<laneletType>crosswalk</laneletType>"),
        *(make_sign(91, "206"), make_sign(92, "205"), make_sign(93, "274", "8.5")),
        format_obstacle(7),
        place="DEU_Test-1_1_T-1",
    )
    hd_map = read_commonroad(path).map
    kinds = {id_: lane.kind for id_, lane in hd_map.lanes.items()}
    assert kinds == {"1": LaneKind.DRIVING, "2": LaneKind.DRIVING, "3": LaneKind.BIKE, "4": LaneKind.SIDEWALK}
    assert hd_map.lanes["1"].speed_limit == 8.5
    assert [shapely.Polygon(walk).area for walk in hd_map.crosswalks] == [pytest.approx(350)]
    assert [(line.lanes, line.sign) for line in hd_map.stop_lines] == [
        (("1",), "stop"),
        (("2",), ""),
        (("3",), "yield"),
    ]
    np.testing.assert_array_equal(hd_map.stop_lines[0].line, [(100, 1.75), (100, -1.75)])


def test_2018b_speed_limits_stay_in_their_file(write: Write) -> None:
    """commonroad-io keeps them in a class attribute while it reads."""
    old = {"version": "2018b", "place": "USA_Test-1_1_T-1"}
    obstacle = format_obstacle(7, tag="obstacle").replace("<type>", "<role>dynamic</role><type>")
    limited = read_commonroad(write(format_lanelet(1, 0, "<speedLimit>12.5</speedLimit>"), obstacle, **old))
    free = read_commonroad(write(format_lanelet(1, 0), obstacle, **old))
    assert limited.map.lanes["1"].speed_limit == 12.5
    assert math.isnan(free.map.lanes["1"].speed_limit)


def test_a_moving_obstacle_of_unknown_type_is_a_vehicle(write: Write) -> None:
    assert _tracks(read_commonroad(write(LANE, CAR)))["7"].category.kind is Kind.VEHICLE


@pytest.mark.parametrize("area", AREAS)
def test_the_centre_of_a_position_that_is_an_area_is_taken(write: Write, area: str) -> None:
    vague = MOVES.replace("<point><x>13</x><y>0</y></point>", AREAS[area])
    recording = read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, vague)))
    (track,) = recording.views[0].tracks
    np.testing.assert_allclose(track.xy, [(10, 0), (11, 0), (np.nan, np.nan), (13, 2)])
    assert recording.notes == ("1 obstacles whose positions are areas: their centres taken",)


@pytest.mark.parametrize(("start", "end", "yaw"), [(0.4, 0.6, 0.5), (3.0, 3.4, 3.2), (-3.1, 3.1, math.nan)])
def test_the_middle_of_a_narrow_interval_of_headings_is_taken(
    write: Write, start: float, end: float, yaw: float
) -> None:
    interval = f"<intervalStart>{start}</intervalStart><intervalEnd>{end}</intervalEnd>"
    vague = MOVES.replace("<exact>0.5</exact>", interval)
    recording = read_commonroad(write(format_lanelet(1, 0), format_obstacle(7, vague)))
    (track,) = recording.views[0].tracks
    np.testing.assert_allclose(np.exp(1j * track.yaw[track.valid]), np.exp(1j * np.full(3, yaw)))
    np.testing.assert_array_equal(track.x, [10, 11, np.nan, 13])
    assert recording.notes == (
        "1 obstacles whose orientations are intervals: their middles taken, none of intervals over 90 degrees",
    )
