"""How close traffic stays to its log: figures with known answers, and all real logs."""

from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, FRAMES, Made, crossing, made, seconds, track
from testing.real_fits import NAMES, fitted_log

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from real2sim.fidelity_targets import build_traffic_targets
from real2sim.traffic_fidelity.passing_order import find_conflict_points, is_order_kept
from real2sim.traffic_fidelity.traffic_fidelity import GONE_M, TrafficFidelity, measure_traffic_fidelity


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def measured(scene: Made) -> TrafficFidelity:
    return measure_traffic_fidelity(scene.scenario, scene.roads, scene.tracks, scene.fitted.names, DT_S)


def changed(scene: Made, **fields: object) -> Made:
    """The same with another first background vehicle: it does not do what the log says."""
    first, *others = scene.scenario.background.vehicles
    vehicle = BackgroundVehicle.model_validate(first.model_dump() | fields)
    background = scene.scenario.background.model_copy(update={"vehicles": (vehicle, *others)})
    return Made(scene.fitted, scene.scenario.model_copy(update={"background": background}), scene.roads, scene.tracks)


# --- position -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_traffic_alone_on_the_road_is_where_the_log_has_it(roads: RoadMap) -> None:
    found = measured(made(roads, track("a", 20.0 + 10.0 * seconds(), 0.0)))
    assert [(one.after_s, one.vehicles) for one in found.errors] == [(t, 1) for t in (1.0, 2.0, 3.0, 5.0, 8.0)]
    assert max(one.worst for one in found.errors if one.worst is not None) < 0.5
    assert (found.not_departed, found.left_early, found.contacts) == ((), (), ())


def test_the_error_is_the_distance_that_a_slower_vehicle_falls_behind(roads: RoadMap) -> None:
    scene = made(roads, track("a", 20.0 + 10.0 * seconds(), 0.0))
    slow = {"progress": [(0.0, 0.0), (10.0, 80.0)], "lanes": [], "leaves": False}
    found = measured(changed(scene, schedule=slow, depart_speed=8.0))
    assert found.median_at_5s == pytest.approx(10.0, abs=0.5)
    assert [target.met for target in build_traffic_targets(found)] == [False, None]


def test_a_vehicle_that_is_gone_counts_as_far_away(roads: RoadMap) -> None:
    scene = made(roads, track("a", 150.0 + 10.0 * seconds(), 0.0))
    found = measured(changed(scene, edges=scene.scenario.background.vehicles[0].edges[:1]))  # it arrives at x = 200
    assert found.left_early == ("a",)
    assert [one.worst == GONE_M for one in found.errors] == [False, False, False, True, True]


def test_a_vehicle_for_which_there_is_no_room_has_not_departed(roads: RoadMap) -> None:
    scene = made(roads, track("a", 20.0 + 10.0 * seconds(), 0.0), track("b", 20.0, 0.2, parked=True))
    in_the_way = scene.scenario.actors[0].model_copy(update={"mirrored": True})
    blocked = scene.scenario.model_copy(update={"actors": (in_the_way,)})
    found = measured(Made(scene.fitted, blocked, roads, scene.tracks))
    assert found.not_departed == ("a",)
    assert found.median_at_5s == GONE_M


# --- order --------------------------------------------------------------------------------------------------------


def test_paths_that_cross_have_a_conflict_point_and_an_order() -> None:
    east, north = track("east", 10.0 * seconds(), 0.0), track("north", 50.0, -80.0 + 10.0 * seconds())
    (one,) = find_conflict_points({"east": east.xy, "north": north.xy})
    assert (one.first, one.second) == ("east", "north")
    assert one.first_at == pytest.approx((50.0, 0.0), abs=2.1)
    log = {"east": east.xy, "north": north.xy}
    assert is_order_kept(one, log, log)
    late = {"east": east.xy - (40.0, 0.0), "north": north.xy}
    assert not is_order_kept(one, log, late)
    absent = {"east": np.full((FRAMES, 2), np.nan), "north": np.full((FRAMES, 2), np.nan)}
    assert not is_order_kept(one, log, absent)


def test_paths_that_merge_have_a_conflict_point() -> None:
    x = 10.0 * seconds()
    one, other = track("a", x, 0.0), track("b", x - 15.0, np.maximum(30.0 - 0.5 * x, 0.0))
    (found,) = find_conflict_points({"a": one.xy, "b": other.xy})
    assert (found.first, found.second) == ("a", "b")


@pytest.mark.parametrize("aside", [0.0, 3.5])
def test_vehicles_that_follow_or_drive_beside_have_no_conflict_point(aside: float) -> None:
    one, other = track("a", 20.0 + 10.0 * seconds(), 0.0), track("b", 10.0 * seconds(), aside)
    assert find_conflict_points({"a": one.xy, "b": other.xy}) == ()


@pytest.mark.slow
def test_crossing_traffic_keeps_the_order_of_the_log(roads: RoadMap) -> None:
    """The vehicle from the side goes first in the log: with SUMO's own right of way it might not."""
    for east in (130.0, 145.0, 172.0, 190.0):
        scene = made(roads, track("a", east + 10.0 * seconds(), 0.0), track("b", 215.0, -55.0 + 10.0 * seconds()))
        found = measured(scene)
        assert (found.order_pairs, found.order_kept, found.order_changed) == (1, 1, ())
        assert found.median_at_5s is not None
        assert found.median_at_5s < 3.0


def test_a_changed_order_is_told_by_name(roads: RoadMap) -> None:
    scene = made(roads, track("a", 160.0 + 10.0 * seconds(), 0.0), track("b", 215.0, -85.0 + 10.0 * seconds()))
    slow = {"progress": [(0.0, 0.0), (10.0, 20.0)], "lanes": [], "leaves": False}
    found = measured(changed(scene, schedule=slow, depart_speed=2.0))
    assert found.order_changed == (("a", "b"),)
    assert found.order_share == 0.0
    assert build_traffic_targets(found)[1].met is False


def test_contacts_that_the_log_has_not_are_told(roads: RoadMap) -> None:
    scene = made(
        roads, track("a", 20.0 + 10.0 * seconds(), 0.0), track("b", 60.0 + 10.0 * seconds(), 0.0), mode="replay"
    )
    there = [(round(t, 2), 21.0 + 10.0 * t, 0.0, 0.0) for t in np.arange(0.0, 10.01, 0.1).tolist()]
    assert measured(scene).contacts == ()
    first = scene.scenario.background.vehicles[0]
    log = [(t, x + 38.0, y, yaw) for t, x, y, yaw in there]
    found = measured(changed(scene, log=log))
    assert first.id == "a"
    assert [set(pair[:2]) for pair in found.contacts] == [{"a", "b"}]


# --- real logs ----------------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
def test_reactive_traffic_stays_with_every_real_log(name: str, shared_data: Path, tmp_path: Path) -> None:
    log = fitted_log(name, tmp_path)
    found = measure_traffic_fidelity(log.scenario, log.roads, log.tracks, log.fitted.names, log.dt_s)
    assert all(target.met is not False for target in build_traffic_targets(found))
    assert found.not_departed == ()
    assert found.vehicles >= 5


@pytest.mark.full
@pytest.mark.parametrize("mode", ["replay", "hybrid"])
def test_other_modes_repeat_a_real_log_while_the_cavs_do(mode: str, shared_data: Path, tmp_path: Path) -> None:
    log = fitted_log("peach", tmp_path, mode)
    found = measure_traffic_fidelity(log.scenario, log.roads, log.tracks, log.fitted.names, log.dt_s)
    assert max(one.worst for one in found.errors if one.worst is not None) < 0.02
