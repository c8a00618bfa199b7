"""Which sensors put an episode into the object track, and how the tracks of episodes and results add up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.report_samples import BEST, make_agent_run

from mdrive_sumo.contract import SensingTrack, SensorSpec, join_sensing_tracks
from mdrive_sumo.runs.compare import compare
from mdrive_sumo.scoring import find_result_faults
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, derive_sensing_track, find_object_source

LISTING = {
    "objects": SensorSpec("objects"),
    "a detector's surrogate": SensorSpec("objects", options={"profile": "lidar-single"}),
    "drawn boxes": SensorSpec("bev", "top"),
    "everything": SensorSpec("privileged"),
    "named points": SensorSpec("lidar", "top", options={"hit_ids": True}),
    "a kind of tomorrow": SensorSpec("radar"),
}
CARRIED = (
    SensorSpec("lidar", "top"),
    SensorSpec("lidar", "top", options={"hit_ids": False, "noise_m": 0.02}),
    SensorSpec("gnss"),
    SensorSpec("imu"),
    SensorSpec("speedometer"),
)


@pytest.mark.parametrize("name", LISTING)
def test_what_lists_objects_puts_all_cavs_into_the_object_track(name: str) -> None:
    listing = LISTING[name]
    assert find_object_source((*CARRIED, listing)).startswith(repr(listing.kind))
    assert derive_sensing_track([CARRIED, (), (*CARRIED, listing)]) is SensingTrack.OBJECT


def test_what_a_car_carries_is_the_sensor_track() -> None:
    assert [find_object_source([spec]) for spec in CARRIED] == [""] * len(CARRIED)
    assert derive_sensing_track([CARRIED, ()]) is SensingTrack.SENSOR


def test_every_kind_of_sensor_has_a_track() -> None:
    """A new kind must be entered here and in docs/sensors.md, on one side or the other."""
    harmless = {kind for kind in SENSOR_KINDS if not find_object_source([SensorSpec(kind)])}
    assert harmless == {"lidar", "camera", "gnss", "imu", "speedometer"}
    assert {*SENSOR_KINDS} - harmless == {"objects", "bev", "privileged"}


@given(st.lists(st.sampled_from(("", "sensor", "object")), max_size=5))
def test_one_episode_with_objects_decides_and_one_unknown_is_never_called_sensor(tracks: list[str]) -> None:
    joined = join_sensing_tracks(tracks)
    assert joined == join_sensing_tracks(reversed(tracks)) and (joined == "object") == ("object" in tracks)
    assert (joined == "sensor") == (bool(tracks) and all(track == "sensor" for track in tracks))


def test_a_results_file_that_names_another_track_than_its_scenarios_is_refused() -> None:
    results = make_agent_run("mine", BEST, track="object")
    assert results.run.sensing_track == "object" and not list(find_result_faults(results))
    for claim in ("sensor", ""):
        forged = results.model_copy(update={"run": results.run.model_copy(update={"sensing_track": claim})})
        (fault,) = find_result_faults(forged)
        assert fault == f"run.sensing_track: expected 'object' as the scenarios say, found {claim!r}"
    old = make_agent_run("mine", BEST)
    assert old.run.sensing_track == "" and "sensing_track" not in old.model_dump_json()


def test_compare_warns_of_runs_of_different_tracks_and_says_nothing_of_unknown_ones() -> None:
    by_lidar, by_list, old = (make_agent_run("mine", BEST, track=track) for track in ("sensor", "object", ""))
    told = compare(by_lidar, by_list)
    assert "A is in the sensor track and B in the object track, which are ranked apart" in told.warnings
    assert [str(one) for one in told.settings] == ["sensing track: sensor and object"]
    assert compare(by_lidar, old).settings == () and compare(by_lidar, old).warnings == ()
