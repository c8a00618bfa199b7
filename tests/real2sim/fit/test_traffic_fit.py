"""Tracks become traffic: which track becomes what, on a drawn crossing; and all real logs."""

from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, FRAMES, crossing, made, matches_of, seconds, track
from testing.real_fits import fitted_log

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scripted_actor import ReplayMotion, StandingMotion
from real2sim.fit import (
    Disposition,
    choose_cavs,
    explain_unusable,
    explain_unused_cavs,
    fit_traffic,
    make_scenario_names,
)
from real2sim.fit.route_path import build_route_path, compute_progress
from real2sim.recording import ObjectCategory, RecordedTrack


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def vehicle(roads: RoadMap, *tracks: RecordedTrack, which: int = 0) -> BackgroundVehicle:
    return made(roads, *tracks).fitted.background.vehicles[which]


# --- moving vehicles ----------------------------------------------------------------------------------------------


def test_a_vehicle_departs_with_its_front_bumper_where_the_log_has_it_and_follows_it(roads: RoadMap) -> None:
    one = vehicle(roads, track("a", 20.0 + 10.0 * seconds(), 0.0))
    assert (one.depart_s, one.depart_pos_m, one.depart_speed) == (0.0, 22.25, 10.0)
    assert one.schedule is not None
    for time, place in one.schedule.progress:
        assert place == pytest.approx(10.0 * time, abs=0.02)
    assert one.schedule.progress[-1][0] == 10.0
    assert not one.schedule.leaves
    assert np.diff([time for time, _ in one.schedule.progress]).min() >= 0.19
    assert len(one.edges) == 2
    assert one.log == ()


def test_a_vehicle_that_vanishes_leaves_and_one_that_appears_departs_then(roads: RoadMap) -> None:
    there = (seconds() > 1.95) & (seconds() < 6.05)
    one = vehicle(roads, track("a", np.where(there, 20.0 + 10.0 * seconds(), np.nan), 0.0))
    assert one.depart_s == 2.0
    assert one.schedule is not None
    assert one.schedule.leaves
    assert one.schedule.progress[-1] == (6.0, pytest.approx(40.0, abs=0.02))


def test_a_vehicle_that_begins_in_the_junction_begins_ahead_of_the_edge_before(roads: RoadMap) -> None:
    one = vehicle(roads, track("a", 210.0 + 10.0 * seconds(), 0.0))
    assert one.schedule is not None
    assert one.edges[0] == vehicle(roads, track("a", 20.0 + 10.0 * seconds(), 0.0)).edges[0]
    assert one.depart_pos_m + one.schedule.progress[0][1] == pytest.approx(212.25, abs=0.3)
    assert one.depart_pos_m < 200.0


def test_a_lane_change_stands_in_the_schedule_where_the_marking_is_crossed(roads: RoadMap) -> None:
    across = 3.5 * np.clip((seconds() - 3.0) / 4.0, 0.0, 1.0)
    one = vehicle(roads, track("a", 20.0 + 10.0 * seconds(), across))
    assert one.schedule is not None
    ((at, index),) = one.schedule.lanes
    assert (one.depart_lane, index) == (0, 1)
    assert at == pytest.approx(50.0, abs=2.5)


def test_modes_replay_and_hybrid_keep_the_poses_of_the_log(roads: RoadMap) -> None:
    for mode in ("replay", "hybrid"):
        fitted = made(roads, track("a", 20.0 + 10.0 * seconds(), 0.3), mode=mode).fitted
        assert fitted.background.mode == mode
        assert len(fitted.background.vehicles[0].log) == FRAMES
        assert fitted.background.vehicles[0].log[50] == (5.0, 70.0, 0.3, 0.0)


def test_following_is_fitted_so_that_the_driver_may_be_as_close_as_it_was(roads: RoadMap) -> None:
    close = made(roads, track("b", 34.5 + 10.0 * seconds(), 0.0), track("a", 20.0 + 10.0 * seconds(), 0.0)).fitted
    leader, follower = close.background.vehicles
    assert (leader.driving.tau_s, leader.driving.min_gap_m) == (1.0, 2.5)
    assert follower.driving.min_gap_m + 10.0 * follower.driving.tau_s == pytest.approx(10.0, abs=0.1)
    assert follower.driving.sigma == 0.0


def test_a_vehicle_that_comes_onto_the_map_late_departs_there(roads: RoadMap) -> None:
    fitted = made(roads, track("a", -30.0 + 10.0 * seconds(), 0.0)).fitted
    (one,) = fitted.background.vehicles
    assert one.depart_s == pytest.approx(2.8, abs=0.11)
    assert one.depart_pos_m < 1.1
    assert fitted.roles["a"].reason.startswith("comes onto the map at frame 2")


def test_a_vehicle_off_the_road_is_an_actor_with_its_reason(roads: RoadMap) -> None:
    fitted = made(roads, track("a", 20.0 + 10.0 * seconds(), -12.0)).fitted
    (actor,) = fitted.actors
    assert fitted.background.vehicles == ()
    assert isinstance(actor.motion, ReplayMotion)
    assert actor.avoid_collision
    assert fitted.roles["a"].disposition is Disposition.ACTOR
    assert "off the road" in fitted.roles["a"].reason


def test_of_two_vehicles_abreast_in_one_lane_only_one_is_sumos(roads: RoadMap) -> None:
    fitted = made(roads, track("a", 20.0 + 8.0 * seconds(), 0.2), track("b", 20.5 + 8.0 * seconds(), -2.2)).fitted
    assert [one.id for one in fitted.background.vehicles] == ["a"]
    assert fitted.roles["b"].reason.startswith("beside a in one lane, 2.2 m")
    assert fitted.actors[0].mirrored  # it is outside the strip that a sweeps


# --- what stands, who walks ---------------------------------------------------------------------------------------


def test_what_never_moves_stands_and_pedestrians_repeat_the_log(roads: RoadMap) -> None:
    fitted = made(
        roads,
        track("parked", 50.0, -2.6, parked=True),
        track("cone", 60.0, -2.6, ObjectCategory.STATIC, parked=True),
        track("walker", 100.0, -13.0 + seconds(), ObjectCategory.PEDESTRIAN),
        track("rider", 20.0 + 4.0 * seconds(), -5.0, ObjectCategory.BICYCLE),
    ).fitted
    kinds = {actor.id: actor.kind for actor in fitted.actors}
    assert kinds == {"parked": "vehicle", "cone": "static", "walker": "pedestrian", "rider": "cyclist"}
    by_id = {actor.id: actor for actor in fitted.actors}
    assert isinstance(by_id["parked"].motion, StandingMotion)
    assert isinstance(by_id["walker"].motion, ReplayMotion)
    assert by_id["walker"].motion.stays
    assert all(actor.mirrored and actor.avoid_collision for actor in fitted.actors)


def test_what_was_driven_around_is_not_mirrored(roads: RoadMap) -> None:
    parked = track("parked", 80.0, -1.7, parked=True)
    passing = track("a", 20.0 + 10.0 * seconds(), 0.9)
    fitted = made(roads, parked, passing).fitted
    assert [actor.mirrored for actor in fitted.actors] == [False]
    assert "passed by a" in fitted.roles["parked"].reason
    assert made(roads, parked).fitted.actors[0].mirrored


def test_a_track_that_leaves_before_a_vehicle_drives_through_its_place_is_there_only_that_long(roads: RoadMap) -> None:
    parked = track("parked", np.where(seconds() < 2.95, 80.0, np.nan), 0.0, parked=True)
    fitted = made(roads, parked, track("a", 20.0 + 10.0 * seconds(), 0.0)).fitted
    motion = fitted.actors[0].motion
    assert isinstance(motion, ReplayMotion)
    assert [pose[0] for pose in motion.poses] == [0.0, 3.0]
    assert not motion.stays


# --- CAVs ---------------------------------------------------------------------------------------------------------


def test_a_cav_starts_as_in_the_log_and_drives_to_where_it_ends(roads: RoadMap) -> None:
    scene = made(roads, track("a", 20.0 + 10.0 * seconds(), 0.4), cavs=("a",))
    check_scenario(scene.scenario, roads)
    (ego,) = scene.fitted.egos
    assert (ego.start.x, ego.start.y, ego.start_speed) == (20.0, 0.4, 10.0)
    assert ego.route[0][:2] == (20.0, 0.0)
    assert ego.route[-1][0] == pytest.approx(120.0, abs=0.1)
    assert "a" not in [one.id for one in scene.fitted.background.vehicles]


def test_the_route_of_a_cav_changes_lanes_where_the_log_does(roads: RoadMap) -> None:
    across = 3.5 * np.clip((seconds() - 3.0) / 4.0, 0.0, 1.0)
    scene = made(roads, track("a", 20.0 + 10.0 * seconds(), across), cavs=("a",))
    check_scenario(scene.scenario, roads)
    xy = scene.fitted.egos[0].xy
    assert xy[np.argmin(np.abs(xy[:, 1] - 1.75)), 0] == pytest.approx(70.0, abs=5.0)


def test_the_route_of_a_cav_that_hardly_moves_goes_on_along_its_lane(roads: RoadMap) -> None:
    scene = made(roads, track("a", 190.0 + 0.3 * seconds(), 0.0), cavs=("a",))
    check_scenario(scene.scenario, roads)
    assert np.hypot(*np.diff(scene.fitted.egos[0].xy, axis=0).T).sum() == pytest.approx(20.0, abs=0.2)
    assert "3.0 m in the log" in scene.fitted.roles["a"].reason


@pytest.mark.parametrize(
    ("one", "sentence"),
    [
        (track("a", np.where(seconds() > 1.0, 20.0 + 10.0 * seconds(), np.nan), 0.0), "appears only in frame 11"),
        (track("a", 20.0 + 10.0 * seconds(), -12.0), "off the road"),
        (track("a", 20.0 + 10.0 * seconds(), -2.6), "starts 2.6 m beside its lane"),
        (track("a", 20.0, seconds(), ObjectCategory.PEDESTRIAN), "expected a vehicle, found a pedestrian"),
    ],
)
def test_a_track_that_cannot_be_a_cav_is_refused_in_one_sentence(
    roads: RoadMap, one: RecordedTrack, sentence: str
) -> None:
    with pytest.raises(InputError, match=f"CAV a: .*{sentence}"):
        made(roads, one, cavs=("a",))


def test_an_unknown_cav_is_refused_by_name(roads: RoadMap) -> None:
    with pytest.raises(InputError, match="CAV nobody: expected one of the tracks cav"):
        made(roads, cavs=("nobody",))


def test_the_cavs_of_the_source_are_taken_if_suitable_else_the_longest_tracks(roads: RoadMap) -> None:
    short = track("short", np.where(seconds() < 4.0, 20.0 + 10.0 * seconds(), np.nan), 0.0)
    long, off = track("long", 100.0 + 9.0 * seconds(), 0.0), track("off", 20.0 + 10.0 * seconds(), -12.0)
    tracks = (short, long, off)
    matches = matches_of(tracks, roads)
    assert choose_cavs(("short",), tracks, matches) == ("short",)
    assert choose_cavs(("off",), tracks, matches) == ("long",)
    assert choose_cavs((), tracks, matches) == ("long",)
    assert explain_unused_cavs(("off", "short", "lost"), ("short",), tracks, matches) == {
        "off": explain_unusable(off, matches["off"]),
        "lost": "it is not in the cleaned log",
    }
    assert "off the road" in explain_unusable(off, matches["off"])
    with pytest.raises(InputError, match="expected a moving vehicle"):
        choose_cavs((), (off,), matches)


# --- ids, paths ---------------------------------------------------------------------------------------------------


def test_ids_of_logs_become_ids_of_scenarios() -> None:
    names = make_scenario_names([track(id_, 0.0, 0.0) for id_ in ("a:1", "a-1", "_x", "<script>", "7")])
    assert names == {"a:1": "a-1", "a-1": "a-1.2", "_x": "t_x", "<script>": "t-script-", "7": "7"}


def test_long_ids_are_cut_to_what_tells_them_apart() -> None:
    ids = ("0bfc7d407d09490cbca7", "0bfc7d40aaaaaaaaaaaa", "36209f00d7442a19485f", "36209f", "ego")
    names = make_scenario_names([track(id_, 0.0, 0.0) for id_ in ids])
    assert [names[id_] for id_ in ids] == ["0bfc7d407", "0bfc7d40a", "36209f0", "36209f", "ego"]


def test_progress_grows_through_junction_and_gaps(roads: RoadMap) -> None:
    hidden = (seconds() > 4.0) & (seconds() < 6.0)
    one = track("a", np.where(hidden, np.nan, 150.0 + 10.0 * seconds()), 0.0)
    matched = matches_of([one], roads)["a"]
    progress = compute_progress(build_route_path(roads, matched.route), one, matched)
    assert progress == pytest.approx(150.0 + 10.0 * seconds(), abs=0.35)
    assert (np.diff(progress) >= 0.0).all()


def test_fitting_nothing_but_a_cav_gives_an_empty_road(roads: RoadMap) -> None:
    cav = track("cav", 20.0 + 10.0 * seconds(), 0.0)
    fitted = fit_traffic([cav], matches_of([cav], roads), roads, ("cav",), "reactive", DT_S)
    assert (fitted.background.vehicles, fitted.actors) == ((), ())
    assert fitted.roles["cav"].disposition is Disposition.CAV


# --- real logs ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_everything_in_a_real_log_becomes_something_with_a_reason_where_it_is_not_plain(
    shared_data: Path, tmp_path: Path
) -> None:
    log = fitted_log("peach", tmp_path)
    assert {role.disposition for role in log.fitted.roles.values()} <= {Disposition.CAV, Disposition.BACKGROUND}
    assert set(log.fitted.roles) == {one.id for one in log.tracks}
    check_scenario(log.scenario, log.roads)
