"""ScenarioNet: real nuScenes descriptions, small ones in the manner of Waymo and nuPlan, and damaged files."""

import math
import pickle
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.scenarionet_samples import FRAMES, Description, describe_track, description, read, state, straight

from mdrive_sumo.core.state import Kind
from real2sim.hd_map import LaneKind
from real2sim.readers.safe_pickle import NUMPY_GLOBALS
from real2sim.readers.scenarionet import AXLE_TO_CENTRE_M, read_scenarionet
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

SCENES = ("sd_nuscenes_scene-0757", "sd_nuscenes_v1.0-mini_scene-0103", "sd_nuscenes_v1.0-mini_scene-1100")


# --- real scenes ---
class _Numpy(pickle.Unpickler):
    """The test's own way into the files, with nothing but numpy."""

    def find_class(self, module: str, name: str) -> Any:
        assert module in ("numpy", "numpy.core.multiarray"), f"{module}.{name}"
        return NUMPY_GLOBALS[module, name]


@pytest.fixture(scope="module", params=SCENES)
def scene(request: pytest.FixtureRequest, shared_data: Path) -> tuple[Recording, Description]:
    path = shared_data / "real_logs" / "scenarionet_nuscenes" / f"{request.param}.pkl"
    with path.open("rb") as file:
        return read_scenarionet(path), _Numpy(file).load()


Scene = tuple[Recording, Description]


def _moving(recording: Recording) -> list[RecordedTrack]:
    vehicles = [track for track in recording.views[0].tracks if track.category.kind is Kind.VEHICLE]
    return [track for track in vehicles if np.hypot(*np.ptp(track.xy[track.valid_frames], axis=0)) > 5]


@pytest.mark.slow
def test_everything_of_a_real_scene_is_there(scene: Scene) -> None:
    recording, raw = scene
    assert recording.id == raw["id"]
    assert recording.frame_count == raw["length"] == len(raw["metadata"]["ts"])
    assert recording.dt_s == 0.1
    assert recording.cavs == ("ego",)
    assert recording.map.left_hand is None
    (view,) = recording.views
    assert {track.id for track in view.tracks} == set(raw["tracks"])
    lanes = {id_ for id_, feature in raw["map_features"].items() if "LANE" in feature["type"]}
    assert set(recording.map.lanes) == lanes
    for track in view.tracks:
        assert track.valid.sum() == raw["tracks"][track.id]["state"]["valid"].sum()
        assert len(track.x) == recording.frame_count


def test_real_vehicles_drive_on_lanes_and_forwards(scene: Scene) -> None:
    recording, _ = scene
    centres = shapely.STRtree([shapely.LineString(lane.centre) for lane in recording.map.lanes.values()])
    moving = _moving(recording)
    xy = np.concatenate([track.xy[track.valid_frames] for track in moving])
    _, distance = centres.query_nearest(shapely.points(xy), return_distance=True, all_matches=False)
    assert len(moving) >= 10
    assert np.median(distance) < 0.6
    assert (distance < 2.0).mean() > 0.8  # in scene-1100 some leave a car park that the map has no lanes for
    assert _ahead(moving) > 0.97


def _ahead(tracks: list[RecordedTrack]) -> float:
    """How much of the way that tracks make they make along their headings."""
    steps = [np.diff(track.xy, axis=0) for track in tracks]
    along = [
        step[:, 0] * np.cos(one.yaw[1:]) + step[:, 1] * np.sin(one.yaw[1:])
        for one, step in zip(tracks, steps, strict=True)
    ]
    return sum(map(np.nansum, along)) / sum(np.nansum(np.hypot(*step.T)) for step in steps)


def test_velocity_by_differences_is_that_of_the_source(scene: Scene) -> None:
    recording, raw = scene
    for track in _moving(recording):
        if track.id == "ego":
            continue  # its box centre is not the point whose velocity the source tells
        both = track.valid[1:] & track.valid[:-1]
        velocity = (np.diff(track.xy, axis=0) / recording.dt_s)[both]
        told = raw["tracks"][track.id]["state"]["velocity"][:-1][both]
        assert np.quantile(np.hypot(*(velocity - told).T), 0.99) < 0.01


def test_lanes_that_meet_are_connected_and_have_sides(scene: Scene) -> None:
    lanes = scene[0].map.lanes
    linked = [lane for lane in lanes.values() if lane.entries and lane.exits]
    assert len(linked) > 0.7 * len(lanes)  # the others lie at the border of the map
    for lane in lanes.values():
        for exit_ in lane.exits:
            assert math.dist(lane.centre[-1], lanes[exit_].centre[0]) < 0.1
            assert lane.id in lanes[exit_].entries
    roads = [lane for lane in lanes.values() if not lane.junction]
    assert sum(len(lane.left) > 1 and len(lane.right) > 1 for lane in roads) == len(roads) > 50
    assert all(math.isnan(lane.speed_limit) for lane in lanes.values())


def test_left_hand_traffic_is_not_decided_here(shared_data: Path) -> None:
    path = shared_data / "real_logs" / "scenarionet_nuscenes" / f"{SCENES[2]}.pkl"
    assert read_scenarionet(path).map.left_hand is None


def test_a_map_of_waymo_keeps_its_topology(tmp_path: Path) -> None:
    def beside(id_: int, rows: tuple[int, int]) -> dict[str, Any]:
        return {"feature_id": id_, "self_start_index": str(rows[0]), "self_end_index": str(rows[1]), "boundaries": []}

    side = {"lane_start_index": "1", "lane_end_index": "3", "boundary_feature_id": "50"}
    lane = straight(
        entry_lanes=[3],
        exit_lanes=[8, 9],
        left_neighbor=[beside(11, (0, 1)), beside(12, (1, 4))],
        right_neighbor=[],
        left_boundaries=[side],
        width=np.array([(0.0, 1.5), (0.0, 1.5), (0.0, 1.5), (2.0, 1.5), (0.0, 0.0)]),
        speed_limit_kmh=36.0,
        interpolating=True,
    )
    line = {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": np.array([(x, 2.0, 0.0) for x in range(40, -1, -5)])}
    bike = straight(9.0, speed_limit_mph=10.0) | {"type": "LANE_BIKE_LANE"}
    crosswalk = {"type": "CROSSWALK", "polygon": np.array([(0, 0, 0), (4, 0, 0), (4, 3, 0)])}
    edge = {"type": "ROAD_EDGE_BOUNDARY", "polyline": np.zeros((3, 3))}
    features = {"7": lane, "8": bike, "50": line, "60": crosswalk, "70": edge}
    hd_map = read(tmp_path, description(map_features=features)).map
    assert set(hd_map.lanes) == {"7", "8"}
    read_lane = hd_map.lanes["7"]
    assert (read_lane.entries, read_lane.exits) == (("3",), ("8", "9"))
    assert (read_lane.left_neighbour, read_lane.right_neighbour) == ("12", "")
    assert read_lane.left.tolist() == [[10, 2], [15, 2], [20, 2], [25, 2], [30, 2]]
    assert (len(read_lane.right), read_lane.width, read_lane.junction) == (0, 3.5, True)
    assert read_lane.speed_limit == pytest.approx(10.0)
    assert (hd_map.lanes["8"].kind, hd_map.lanes["8"].junction) == (LaneKind.BIKE, False)
    assert hd_map.lanes["8"].speed_limit == pytest.approx(4.4704)
    assert [polygon.tolist() for polygon in hd_map.crosswalks] == [[[0, 0], [4, 0], [4, 3]]]


def test_waymo_stops_at_its_signs_and_lights(tmp_path: Path) -> None:
    sign = {"type": "STOP_SIGN", "position": np.array((38.0, -3.0, 1.0)), "lane": [7, 99]}
    lost = {"type": "STOP_SIGN", "position": np.array((38.0, -3.0, 1.0)), "lane": [99]}
    light = {"type": "TRAFFIC_LIGHT", "lane": 7, "stop_point": np.array((35.0, 0.5, 0.0)), "state": {}}
    gone = {"type": "TRAFFIC_LIGHT", "lane": 98, "stop_point": np.zeros(3), "state": {}}
    features = {"7": straight(width=np.full((5, 2), 2.0)), "20": sign, "21": lost}
    recording = read(tmp_path, description(map_features=features, dynamic_map_states={7: light, 98: gone}))
    stop, signal = recording.map.stop_lines
    assert (stop.sign, stop.lanes, signal.sign, signal.lanes) == ("stop", ("7",), "signal", ("7",))
    np.testing.assert_allclose(stop.line, [(38, 2), (38, -2)], atol=1e-9)
    np.testing.assert_allclose(signal.line, [(35, 2), (35, -2)], atol=1e-9)
    assert recording.map.signals == {"7": ("7",)}
    assert any("1 stop signs" in note for note in recording.notes)
    assert any("1 traffic lights" in note for note in recording.notes)


def test_a_map_of_nuplan_names_all_neighbours_and_rings_its_lanes(tmp_path: Path) -> None:
    ring = np.array([(0, -1.5), (40, -1.5), (40, 2), (20, 2.5), (0, 2), (0, -1.5)])
    lane = straight(left_neighbor=["l1", "l2"], right_neighbor=["r1", "r2"], exit_lanes=["c"], polygon=ring)
    connector = straight(start=40.0, end=60.0) | {"type": "LANE_SURFACE_UNSTRUCTURE"}
    light = {"type": "TRAFFIC_LIGHT", "lane": "c", "stop_point": [48.0, 0.0], "state": {}}
    features = {"7": lane, "c": connector}
    hd_map = read(tmp_path, description("nuplan", map_features=features, dynamic_map_states={"c": light})).map
    read_lane = hd_map.lanes["7"]
    assert (read_lane.left_neighbour, read_lane.right_neighbour) == ("l2", "r1")
    assert read_lane.left.tolist() == [[0, 2], [20, 2.5], [40, 2]]
    assert read_lane.right.tolist() == [[0, -1.5], [40, -1.5]]
    assert (read_lane.junction, hd_map.lanes["c"].junction) == (False, True)
    assert hd_map.stop_lines[0].line[:, 0].tolist() == [40.0, 40.0]


def test_lanes_are_linked_only_if_the_source_links_none(tmp_path: Path) -> None:
    ahead, back = straight(start=40.05, end=80.0), straight(start=80.0, end=40.0)
    hd_map = read(tmp_path, description(map_features={"7": straight(), "8": ahead, "9": back})).map
    assert (hd_map.lanes["7"].exits, hd_map.lanes["8"].entries) == (("8",), ("7",))
    assert hd_map.lanes["9"].entries == ()  # it begins where lane 8 ends, but leads back
    told = description(map_features={"7": straight(exit_lanes=["9"]), "8": ahead, "9": back})
    assert read(tmp_path, told).map.lanes["8"].entries == ()


@pytest.mark.parametrize(
    ("type_", "finer", "expected"),
    [
        ("VEHICLE", "vehicle.car", ObjectCategory.CAR),
        ("VEHICLE", "VEHICLE", ObjectCategory.CAR),
        ("VEHICLE", "vehicle.bus.bendy", ObjectCategory.BUS),
        ("VEHICLE", "vehicle.construction", ObjectCategory.TRUCK),
        ("VEHICLE", "vehicle.emergency.ambulance", ObjectCategory.VAN),
        ("CYCLIST", "vehicle.bicycle", ObjectCategory.BICYCLE),
        ("CYCLIST", "vehicle.motorcycle", ObjectCategory.MOTORCYCLE),
        ("PEDESTRIAN", "human.pedestrian.adult", ObjectCategory.PEDESTRIAN),
        ("TRAFFIC_CONE", "movable_object.trafficcone", ObjectCategory.STATIC),
        ("TRAFFIC_BARRIER", "", ObjectCategory.STATIC),
    ],
)
def test_types_become_categories(tmp_path: Path, type_: str, finer: str, expected: ObjectCategory) -> None:
    (only,) = read(tmp_path, description(tracks={"1": describe_track(type_, finer)})).views[0].tracks
    assert only.category is expected
    assert only.parked == (expected is ObjectCategory.STATIC)


def test_what_is_skipped_is_noted(tmp_path: Path) -> None:
    tracks = {
        "1": describe_track("VEHICLE"),
        "2": describe_track("OTHER"),
        "3": describe_track("VEHICLE", valid=np.zeros(FRAMES)),
    }
    features = {"7": straight(), "8": straight() | {"polyline": np.zeros((4, 3))}}
    metadata = {"dataset": "waymo", "sdc_id": "2", "ts": [0.0, 0.1, 0.2, 0.35, 0.4]}
    recording = read(tmp_path, description(tracks=tracks, map_features=features, metadata=metadata))
    assert [one.id for one in recording.views[0].tracks] == ["1"]
    assert recording.cavs == ()
    notes = " | ".join(recording.notes)
    for expected in ("unknown type OTHER", "without any valid frame", "off by up to 0.05", "'2'", "1 lanes without"):
        assert expected in notes


@given(valid=st.lists(st.booleans(), min_size=FRAMES, max_size=FRAMES).filter(any), x=st.floats(-1e5, 1e5))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
def test_rows_equal_the_source_where_valid_and_are_nan_elsewhere(tmp_path: Path, valid: list[bool], x: float) -> None:
    raw = describe_track("VEHICLE", **(state(x) | {"valid": np.array(valid, dtype=np.float64)}))
    (only,) = read(tmp_path, description(tracks={"1": raw})).views[0].tracks
    assert only.valid.tolist() == valid
    for column in (only.x, only.y, only.yaw, only.length, only.width):
        assert np.isfinite(column).tolist() == valid
    np.testing.assert_array_equal(only.x[only.valid], raw["state"]["position"][only.valid, 0])


def test_missing_sizes_are_nan(tmp_path: Path) -> None:
    raw = describe_track("PEDESTRIAN", length=np.zeros(FRAMES), heading=np.full(FRAMES, np.nan))
    (only,) = read(tmp_path, description(tracks={"1": raw})).views[0].tracks
    assert np.isnan(only.length).all()
    assert np.isnan(only.yaw).all()
    assert only.width.tolist() == [2.0] * FRAMES


def test_the_ego_of_nuscenes_is_moved_from_its_axle_to_its_centre(tmp_path: Path) -> None:
    turned = describe_track("VEHICLE", heading=np.full(FRAMES, math.pi / 2))
    recording = read(tmp_path, description("nuscenes", tracks={"1": turned, "2": turned}))
    ego, other = recording.views[0].tracks
    np.testing.assert_allclose(ego.y - other.y, AXLE_TO_CENTRE_M)
    np.testing.assert_allclose(ego.x, other.x, atol=1e-12)
    assert any("rear axle" in note for note in recording.notes)
    (waymo,) = read(tmp_path, description(tracks={"1": turned})).views[0].tracks
    assert waymo.y.tolist() == [0.0] * FRAMES


def test_the_ego_of_nuscenes_lies_along_its_heading(tmp_path: Path) -> None:
    sideways = describe_track("VEHICLE", length=np.full((FRAMES, 1), 1.73), width=np.full((FRAMES, 1), 4.08))
    ego, other = read(tmp_path, description("nuscenes", tracks={"1": sideways, "2": sideways})).views[0].tracks
    assert (ego.length[0], ego.width[0]) == (4.08, 1.73)
    assert (other.length[0], other.width[0]) == (1.73, 4.08)


def test_a_description_as_metadrive_writes_it_is_read(tmp_path: Path) -> None:
    """Its writer leaves a defaultdict in the metadata, records no sizes of some objects, and limits of 1000 km/h."""
    raw = description("metadrive")
    for name in ("length", "width"):
        del raw["tracks"]["1"]["state"][name]
    raw["map_features"]["7"]["speed_limit_kmh"] = 1000
    raw["metadata"]["number_summary"] = {
        "object_types": {"VEHICLE"},
        "num_moving_objects_each_type": defaultdict(int, {"VEHICLE": 1}),
    }
    recording = read(tmp_path, raw)
    assert np.isnan(recording.views[0].tracks[0].length).all()
    assert math.isnan(recording.map.lanes["7"].speed_limit)


@pytest.mark.parametrize("protocol", range(6))
def test_all_protocols_and_numpy_numbers_are_read(tmp_path: Path, protocol: int) -> None:
    raw = description() | {"length": np.int64(FRAMES)}
    assert read(tmp_path, raw, protocol).frame_count == FRAMES
