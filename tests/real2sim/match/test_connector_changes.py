"""Tracks that do what networks do not know: change connectors, turn around, leave the road between two lanes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S
from testing.map_faults import drive, lane, lanes_map
from testing.network_samples import built
from testing.shared_material import SHARED_DATA

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.clean import clean_recording
from real2sim.fit.background_vehicle import route_track
from real2sim.fit.cavs import build_ego
from real2sim.hd_map import MapLane
from real2sim.match import LaneMatch, match_track
from real2sim.match.lane_candidates import load_candidate_index
from real2sim.network import build_network
from real2sim.readers.scenarionet import read_scenarionet
from real2sim.recording import ObjectCategory, RecordedTrack, vehicle_trajectories
from real2sim.tracks.reconstruct import reconstruct_tracks

SCENE_0757 = SHARED_DATA / "real_logs/scenarionet_nuscenes/sd_nuscenes_scene-0757.pkl"
IN = lane("in", [(-60, 0), (0, 0)], ("ahead", "pocket"))
AHEAD = lane("ahead", [(0, 0), (40, 0)], ("ahead2",), junction=True)
POCKET = lane("pocket", [(0, 0), (15, 1.2), (30, 3.2), (40, 4)], ("pocket2",), junction=True)
ENTRY = (IN, AHEAD, POCKET, lane("ahead2", [(40, 0), (100, 0)]), lane("pocket2", [(40, 4), (60, 9), (90, 30)]))
"""Lanes part at the entry of a junction: the one continues, the other becomes a turning pocket on the left."""


def mirrored(*lanes: MapLane) -> tuple[MapLane, ...]:
    """The same lanes driven the other way: what parts joins."""
    entries = {exit_: [one.id for one in lanes if exit_ in one.exits] for one in lanes for exit_ in one.exits}
    return tuple(
        lane(one.id, np.array(one.centre)[::-1], tuple(entries.get(one.id, ())), junction=one.junction) for one in lanes
    )


def track_of(poses: Float) -> RecordedTrack:
    full = np.ones(len(poses))
    return RecordedTrack("a", ObjectCategory.CAR, full > 0, *poses.T, length=4.5 * full, width=1.8 * full, parked=False)


@dataclass(frozen=True)
class Junction:
    roads: RoadMap

    def edges(self, found: LaneMatch) -> list[str]:
        return [self.roads.lanes[id_].edge for id_ in found.route if not self.roads.lanes[id_].junction]


@pytest.fixture(scope="module")
def entry(tmp_path_factory: pytest.TempPathFactory) -> Junction:
    return Junction(built(tmp_path_factory.mktemp("entry"), lanes_map(*ENTRY))[1])


@pytest.fixture(scope="module")
def exit_(tmp_path_factory: pytest.TempPathFactory) -> Junction:
    return Junction(built(tmp_path_factory.mktemp("exit"), lanes_map(*mirrored(*ENTRY)))[1])


LATE = np.array([(-5.0, 0.0), (24.0, -0.2), (36.0, 3.8), (40.0, 4.0), (50.0, 6.5)])
"""Ahead until the pocket is 2.5 m aside, then into it and to its stop line."""


def test_connectors_part_at_their_beginnings_and_join_at_their_ends(entry: Junction, exit_: Junction) -> None:
    """So a change between them adds nothing where they part, and the difference of their lengths where they join."""
    for junction, joins in ((entry, False), (exit_, True)):
        index = load_candidate_index(junction.roads, changes_connectors=True)
        pairs = index.connectors_to_same_lane if joins else index.connectors_from_same_lane
        changes = [(here, there) for here, others in pairs.items() for there in others]
        assert len(changes) == 2
        for here, there in changes:
            lengths = [junction.roads.lanes[id_].centre.length for id_ in (here, there)]
            path = index.find_paths(here, 60.0, 5.0)[there]
            assert path.lane_changes == 1
            assert path.length == pytest.approx(lengths[0] - lengths[1] if joins else 0.0)


def test_a_late_change_into_the_pocket_leads_to_the_pocket(entry: Junction) -> None:
    found = match_track(drive(LATE, 5.0), entry.roads)
    assert (found.reason, found.break_frames) == ("", ())
    assert entry.edges(found) == ["ein", "epocket2"]
    assert set(found.lanes) <= set(found.route)
    assert abs(found.offset[-1]) < 0.3
    beside = drive(LATE, 5.0)[list(found.aside_frames), 0]
    assert 10.0 < beside.max() < 36.0  # it is still on the other connector there


@pytest.mark.parametrize("way", [AHEAD, POCKET])
def test_a_track_on_one_connector_is_beside_none(way: MapLane, entry: Junction) -> None:
    found = match_track(drive(np.array([(-30.0, 0.0), *way.centre, way.centre[-1] + (6.0, 0.8)])), entry.roads)
    assert entry.edges(found) == ["ein", f"e{way.id}2"]
    assert found.aside_frames == ()


def test_a_change_before_lanes_join_keeps_the_lane_it_came_from(exit_: Junction) -> None:
    found = match_track(drive(LATE[::-1], 5.0), exit_.roads)
    assert (found.reason, exit_.edges(found)) == ("", ["epocket2", "ein"])
    assert abs(found.offset[0]) < 0.3


def test_the_route_of_a_cav_runs_where_it_drove_before_the_change(entry: Junction) -> None:
    """So it begins at its start and passes what the driver passed, not through it."""
    poses = drive(np.array([(12.0, -0.1), *LATE[1:]]), 5.0)
    match = match_track(poses, entry.roads)
    ego, _ = build_ego(track_of(poses), match, entry.roads, "cav", DT_S)
    assert np.hypot(ego.xy[0, 0] - poses[0, 0], ego.xy[0, 1] - poses[0, 1]) < 0.5
    gap = np.array([np.hypot(*(poses[:, :2] - point).T).min() for point in ego.xy])
    assert gap.max() < 1.3
    assert np.hypot(*np.diff(ego.xy, axis=0).T)[:-1] == pytest.approx(1.0, abs=0.05)
    Scenario(id="s", bucket="t", category="t", network="n", egos=(ego,))


@pytest.mark.parametrize(("aside_m", "is_route"), [(2.0, True), (24.0, False)])
def test_a_route_covers_nine_tenths_of_the_drive_near_lanes_or_there_is_none(
    aside_m: float, is_route: bool, tmp_path: Path
) -> None:
    """Late into the pocket, on its connector or through a gap 24 m beyond the last point where the pocket is in reach.

    What is left out would be driven by nobody: a route without it is another drive.
    """
    ahead = lane("ahead", [(0, 0), (60, 0)], ("ahead2",), junction=True)
    pocket = lane("pocket", [(0, 0), (12, 3), (20, 9), (60, 9)], ("pocket2",), junction=True)
    roads = built(
        tmp_path,
        lanes_map(IN, ahead, pocket, lane("ahead2", [(60, 0), (100, 0)]), lane("pocket2", [(60, 9), (100, 9)])),
    )[1]
    leaves = 13.0 + aside_m
    track = drive(np.array([(-30.0, 0.0), (leaves, 0.0), (leaves + 9.0, 9.0), (80.0, 9.0)]), 5.0)
    found = match_track(track, roads)
    assert (found.reason == "") is is_route, found.reason


# --- U-turns, gateways --------------------------------------------------------------------------------------------
RING = [(60.0 + 5.0 * np.sin(a), 4.0 - 4.0 * np.cos(a)) for a in np.linspace(0, np.pi, 9)]
STREET = (
    lane("east", [(0, 0), (60, 0)], ("ring",)),
    lane("ring", RING, ("west",)),
    lane("west", [(60, 8), (0, 8)]),
)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return built(tmp_path_factory.mktemp("street"), lanes_map(*STREET))[1]


def u_turn(x: float) -> Float:
    """East until x, around, and back west: x = 60 is the ring at the end of the street."""
    around = [(x + 5.0 * np.sin(a), 4.0 - 4.0 * np.cos(a)) for a in np.linspace(0, np.pi, 9)]
    return drive(np.array([(5.0, 0.0), *around, (5.0, 8.0)]), 5.0)


def test_a_u_turn_on_the_ring_is_a_route(street: RoadMap) -> None:
    found = match_track(u_turn(60.0), street)
    assert found.reason == ""
    assert [street.lanes[id_].edge for id_ in found.route if not street.lanes[id_].junction] == [
        "eeast", "ering", "ewest"
    ]  # fmt: skip


@pytest.mark.parametrize("before_m", [15.0, 18.0])
def test_a_u_turn_before_the_ring_is_no_route_over_the_ring(before_m: float, street: RoadMap) -> None:
    """The network is up to 40 m longer than what was driven: a vehicle of SUMO would come late, and out of order."""
    found = match_track(u_turn(60.0 - before_m), street)
    assert found.reason.startswith("no way from lane")
    assert isinstance(route_track(track_of(u_turn(60.0 - before_m)), found, street), str)


def test_a_way_through_a_car_park_between_two_lanes_is_no_traffic_on_the_road(street: RoadMap) -> None:
    parked = drive(np.array([(2.0, 0.0), (15.0, 0.0), (20.0, -7.0), (38.0, -7.0), (43.0, 0.0), (58.0, 0.0)]), 5.0)
    why = route_track(track_of(parked), match_track(parked, street), street)
    assert isinstance(why, str)
    assert why.endswith("off the road between two of its lanes")
    swerve = drive(np.array([(2.0, 0.0), (20.0, 0.0), (26.0, -3.0), (32.0, 0.0), (58.0, 0.0)]), 5.0)
    assert not isinstance(route_track(track_of(swerve), match_track(swerve, street), street), str)


@pytest.mark.full
@pytest.mark.skipif(not SCENE_0757.is_file(), reason="needs ../shared/data")
def test_a_real_car_that_drives_around_barriers_into_a_pocket(tmp_path: Path) -> None:
    recording = read_scenarionet(SCENE_0757)
    cleaned = clean_recording(recording)
    seen = list(vehicle_trajectories(cleaned.tracks).values())
    report = build_network(recording.map, seen, tmp_path / "net", "net", recording.dt_s)
    assert report.drop_reason_by_lane == {}
    roads = built(tmp_path / "again", recording.map, *seen)[1]
    poses = vehicle_trajectories(reconstruct_tracks(cleaned.tracks, recording.dt_s))
    found = match_track(poses["ego"], roads)
    assert (found.reason, abs(found.offset[-1]) < 2.0, len(found.aside_frames) > 20) == ("", True, True)
