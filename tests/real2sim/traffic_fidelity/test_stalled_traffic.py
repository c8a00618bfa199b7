"""Background vehicles that stall: who counts, and the causes that the conversion avoids."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, FRAMES, Made, crossing, made, seconds, track
from testing.map_faults import lane, lanes_map

from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.scripted_actor import ReplayMotion
from real2sim.fidelity_targets import build_stalled_target
from real2sim.network import build_network
from real2sim.recording import ObjectCategory
from real2sim.traffic_fidelity.log_simulation import simulate_log
from real2sim.traffic_fidelity.stalled_traffic import (
    SAMPLE_S,
    StalledVehicle,
    TrafficDrive,
    compute_longest_stand,
    drive_alone,
    find_stalled,
)

SAMPLES = 80
"""40 s."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def drive(**places: tuple[float, float, float]) -> TrafficDrive:
    """Road users of 4.5 x 1.8 m that stand from 10 s on at x, y, yaw; before they drive."""
    x, y, yaw = (np.tile([place[k] for place in places.values()], (SAMPLES, 1)) for k in range(3))
    speed = np.where((np.arange(SAMPLES) * SAMPLE_S < 10.0)[:, None], 5.0, np.zeros(len(places)))
    size = np.ones(len(places))
    return TrafficDrive("alone", tuple(places), 4.5 * size, 1.8 * size, x, y, yaw, speed)


def stalled(found: TrafficDrive, log_s: float = 0.0, *others: str) -> dict[str, str]:
    """Id -> road user ahead of the vehicles that stall, all being background but "cav" and `others`."""
    logged = {id_: log_s for id_ in found.ids if id_ not in ("cav", *others)}
    return {one.id: one.behind for one in find_stalled(found, logged, {"cav"})}


EAST, WEST = 0.0, np.pi


def test_the_head_of_a_queue_stalls_and_those_behind_it_do_not() -> None:
    assert stalled(drive(a=(0, 0, EAST), b=(-7, 0, EAST), c=(-14, 0, EAST))) == {"a": ""}


def test_vehicles_that_wait_for_each_other_both_stall() -> None:
    assert stalled(drive(a=(0, 0, EAST), b=(6, 0.5, WEST))) == {"a": "b", "b": "a"}


def test_who_stands_behind_a_cav_is_in_a_queue_and_behind_a_scripted_actor_is_not() -> None:
    assert stalled(drive(a=(0, 0, EAST), cav=(7, 0, EAST))) == {}
    assert stalled(drive(a=(0, 0, EAST), walker=(5, 0, EAST)), 0.0, "walker") == {"a": "walker"}


@pytest.mark.parametrize(("log_s", "expected"), [(19.0, {"a": ""}), (20.5, {})])
def test_only_what_is_longer_than_in_the_log_by_10_s_counts(log_s: float, expected: dict[str, str]) -> None:
    assert stalled(drive(a=(0, 0, EAST)), log_s) == expected


def test_beside_is_not_ahead() -> None:
    assert stalled(drive(a=(0, 0, EAST), b=(6, 3.5, EAST))) == {"a": "", "b": ""}


def test_the_longest_stand_of_a_track() -> None:
    x = np.concatenate((np.zeros(30), 10.0 * DT_S * np.arange(FRAMES - 30)))
    assert compute_longest_stand(track("a", x, 0.0), DT_S) == pytest.approx(3.0, abs=0.11)
    assert compute_longest_stand(track("a", 10.0 * seconds(), 0.0), DT_S) == 0.0


def test_a_target_names_the_vehicle_the_place_and_the_drive() -> None:
    one = StalledVehicle(id="a", drive="alone", from_s=9.5, to_s=40.0, log_s=1.0, x=3.0, y=4.0, behind="P3")
    target = build_stalled_target((one, one.model_copy(update={"drive": "omniscient"})))
    assert (target.value, target.met) == (1, False)
    assert "a stands from 9.5 s to 40 s at (3.0, 4.0) behind P3, 1 s at most in the log (alone)" in target.detail
    assert build_stalled_target(()).met


# --- causes -------------------------------------------------------------------------------------------------------


def find_stalled_alone(scene: Made) -> dict[str, str]:
    found = drive_alone(scene.scenario, scene.roads, 10.0)
    logged = {one.id: 0.0 for one in scene.scenario.background.vehicles}
    return {one.id: one.behind for one in find_stalled(found, logged, {"cav"})}


def test_a_pedestrian_that_the_log_cuts_off_on_a_lane_does_not_block_it_for_ever(roads: RoadMap) -> None:
    """It crosses when the log ends; as long as it stood there, the vehicle behind would wait."""
    scene = made(
        roads,
        track("a", 215.0, -150.0 + 8.0 * seconds()),
        track("walker", 209.0 + 0.6 * seconds(), -40.0, ObjectCategory.PEDESTRIAN),
    )
    (walker,) = scene.fitted.actors
    assert isinstance(walker.motion, ReplayMotion)
    assert not walker.motion.stays
    assert "leaves with the end of the log" in scene.fitted.roles["walker"].reason
    assert find_stalled_alone(scene) == {}
    stays = walker.model_copy(update={"motion": walker.motion.model_copy(update={"stays": True})})
    frozen = replace(scene, scenario=scene.scenario.model_copy(update={"actors": (stays,)}))
    assert find_stalled_alone(frozen) == {"a": "walker"}


@pytest.mark.parametrize("crossed_at_m", [190.0, 200.0, 203.0])
def test_a_lane_change_at_the_end_of_a_lane_that_ends_is_due_before_it(tmp_path: Path, crossed_at_m: float) -> None:
    """The right lane ends; one whose driver leaves it at the last moment must not be left standing there."""
    build_network(
        lanes_map(
            lane("w0", [(0, 0), (200, 0)]),
            lane("w1", [(0, 3.5), (200, 3.5)], ("e1",)),
            lane("e1", [(200, 3.5), (430, 3.5)]),
        ),
        [],
        tmp_path / "net",
        "crossing",
    )
    roads = load_road_map(tmp_path / "net")
    x = 130.0 + 10.0 * seconds()
    y = 3.5 * np.clip((x - crossed_at_m) / 20.0 + 0.5, 0.0, 1.0)
    scene = made(roads, track("a", x, y), cav_y=3.5)
    vehicle = scene.scenario.background.vehicles[0]
    assert vehicle.schedule is not None
    at = vehicle.schedule.lanes[0][0]
    assert at <= 200.0 - vehicle.depart_pos_m - 0.99
    assert find_stalled_alone(scene) == {}


def test_a_vehicle_that_begins_in_a_junction_is_on_the_connector_to_its_lane(tmp_path: Path) -> None:
    """One lane leads to both lanes of the next edge."""
    build_network(
        lanes_map(
            lane("w", [(0, 0), (200, 0)], ("j0", "j1")),
            lane("j0", [(200, 0), (230, 0)], ("e0",), junction=True),
            lane("j1", [(200, 0), (210, 0.6), (220, 2.9), (230, 3.5)], ("e1",), junction=True),
            lane("e0", [(230, 0), (430, 0)]),
            lane("e1", [(230, 3.5), (430, 3.5)]),
            lane("s", [(215, -150), (215, -20)], ("jn",)),
            lane("jn", [(215, -20), (215, 20)], ("n",), junction=True),
            lane("n", [(215, 20), (215, 150)]),
        ),
        [],
        tmp_path / "net",
        "crossing",
    )
    roads = load_road_map(tmp_path / "net")
    x = 221.0 + 8.0 * seconds()
    late = track("a", np.where(seconds() < 2.0, np.nan, x - 16.0), np.interp(x - 16.0, [220, 230], [2.9, 3.5]))
    scene = made(roads, late)
    tracks = {one.id: one for one in scene.tracks}
    placed = simulate_log(scene.scenario, roads, tracks, DT_S).xy("a", FRAMES)
    off = np.hypot(*(placed - tracks["a"].xy).T)
    assert np.nanmax(off) < 1.5
