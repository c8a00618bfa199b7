"""The logged drive of a CAV before the scorer: known infractions on a drawn crossing, and what a person confirms."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, Made, crossing, made, seconds, track

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scoring.metrics import ScoredEpisode, build_ego_records
from real2sim.fidelity_targets import build_logged_drive_target
from real2sim.logged_drive import (
    ConfirmedInfraction,
    LoggedDrive,
    LoggedInfraction,
    load_confirmed_infractions,
    score_logged_drive,
)
from real2sim.logged_drive.logged_episode import LOG_ENDED, record_logged_drive
from real2sim.recording import ObjectCategory, RecordedTrack


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def scored(
    scene: Made, tracks: Sequence[RecordedTrack] = (), confirmed: Sequence[ConfirmedInfraction] = ()
) -> LoggedDrive:
    return score_logged_drive(
        scene.scenario, scene.roads, tracks or scene.tracks, scene.fitted.names, DT_S, confirmed=confirmed
    )


def found_in(drive: LoggedDrive) -> list[LoggedInfraction]:
    (cav,) = drive.cavs
    return list(cav.infractions)


def moved(scene: Made, x: object, y: object) -> tuple[RecordedTrack, ...]:
    """The tracks of a scene, with the CAV's replaced after the fit: what an error of the conversion does."""
    return (track("cav", x, y), *scene.tracks[1:])


CAV_X = 300.0 + 8.0 * seconds()


def test_a_drive_along_its_lane_is_clean_and_complete(roads: RoadMap) -> None:
    drive = scored(made(roads, track("ahead", 330.0 + 8.0 * seconds(), 0.0)))
    (cav,) = drive.cavs
    assert (cav.id, cav.infractions, cav.ip, cav.duration_s) == ("cav", (), 1.0, 10.0)
    assert cav.rc > 98
    assert build_logged_drive_target(drive).met


def test_the_first_state_is_the_start_of_the_scenario(roads: RoadMap) -> None:
    scene = made(roads)
    record = record_logged_drive(scene.scenario, roads, {"cav": scene.tracks[0]}, DT_S).record
    start = scene.scenario.egos[0].start
    assert (record.x[0, 0], record.y[0, 0]) == pytest.approx((start.x, start.y), abs=1e-3)
    assert record.speed[0, 0] == pytest.approx(8.0, abs=0.01)
    assert (record.length[0], record.width[0]) == (4.5, 1.8)  # its size in the log, not that of the benchmark's car


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        (track("b", 340.0, 0.4, parked=True), "collision-vehicle"),
        (track("b", 340.0, 0.0, ObjectCategory.STATIC, parked=True), "collision-static"),
        (track("b", 340.0 + 2.0 * seconds(), 0.0), "collision-vehicle"),
        (track("b", 340.0 + 0.1 * seconds(), 1.0, ObjectCategory.PEDESTRIAN), "collision-pedestrian"),
    ],
)
def test_what_the_cav_drives_through_is_a_collision(other: RecordedTrack, kind: str, roads: RoadMap) -> None:
    (hit,) = found_in(scored(made(roads, other)))
    assert (hit.kind, hit.other, hit.is_confirmed) == (kind, "b", False)
    reach = 340.0 - 300.0 - 4.5 / 2 - float(other.length[0]) / 2
    closing = 8.0 - float(np.diff(other.x[:2])[0]) / DT_S
    assert hit.time_s == pytest.approx(reach / closing, abs=0.1)
    assert hit.x == pytest.approx(300.0 + 8.0 * hit.time_s, abs=0.1)


def test_an_offset_of_the_log_is_outside_lanes_and_says_since_when(roads: RoadMap) -> None:
    scene = made(roads)
    y = np.where(seconds() < 4.0, 0.0, np.minimum(2.5 * (seconds() - 4.0), 9.0))
    (off,) = found_in(scored(scene, moved(scene, CAV_X, -y)))
    assert off.kind == "outside-lanes"
    edge = roads.lanes["ee0_0"].width / 2 + 1.3
    assert off.from_s == pytest.approx(4.0 + edge / 2.5, abs=0.11)
    assert off.to_s == off.time_s == 10.0
    assert off.factor == pytest.approx(off.from_s / 10.0, abs=0.03)  # the share of the way before


def test_a_log_that_ends_before_its_extended_route_is_no_infraction(roads: RoadMap) -> None:
    (cav,) = scored(made(roads, track("slow", 20.0 + 0.4 * seconds(), 0.0), cavs=("slow",))).cavs
    assert (cav.end, cav.infractions) == (LOG_ENDED, ())
    assert cav.rc < 50


def test_an_arrived_drive_gets_the_infractions_that_the_score_of_an_episode_has(roads: RoadMap) -> None:
    """The record goes through the function that scores live episodes, its checks of endings included."""
    scene = made(roads, track("b", 340.0, 0.4, parked=True))
    x = 300.0 + 9.0 * seconds()
    tracks = moved(scene, x, 0.0)
    drive = scored(scene, tracks)
    record = record_logged_drive(scene.scenario, roads, {one.id: one for one in tracks}, DT_S).record
    (live,) = build_ego_records(ScoredEpisode(record, scene.scenario, roads))
    assert drive.cavs[0].end == "arrived"
    assert [(one.kind, round(one.time_s * 20), one.factor) for one in found_in(drive)] == [
        (one.kind, one.tick, one.factor) for one in live.infractions
    ]
    assert drive.cavs[0].rc == live.rc == 100.0


# --- confirmed by a person ----------------------------------------------------------------------------------------


def confirmation(**changes: object) -> ConfirmedInfraction:
    entry = {"scenario": "crossing", "cav": "cav", "kind": "collision-vehicle", "time_s": 4.5, "factor": 0.6}
    return ConfirmedInfraction.model_validate(entry | {"reason": "it touches the van", "by": "M. Muster"} | changes)


@pytest.fixture(scope="module")
def crash(roads: RoadMap) -> Made:
    return made(roads, track("b", 340.0, 0.4, parked=True))


def test_a_confirmed_infraction_meets_the_target_and_keeps_reason_and_person(crash: Made) -> None:
    missed = build_logged_drive_target(scored(crash))
    assert (missed.met, missed.value) == (False, 1)
    assert "CAV cav: collision-vehicle at 4.45 s, factor 0.6, at (335.6, 0.0)" in missed.format_sentence()
    drive = scored(crash, confirmed=[confirmation()])
    (one,) = found_in(drive)
    assert (one.reason, one.confirmed_by, drive.notes) == ("it touches the van", "M. Muster", ())
    assert (build_logged_drive_target(drive).met, drive.confirmed_count) == (True, 1)
    assert drive.cavs[0].ip == 0.6  # the penalty stays what it is


@pytest.mark.parametrize(
    "changes",
    [{"cav": "b"}, {"kind": "collision-static"}, {"time_s": 5.0}, {"time_s": 3.9}, {"factor": 0.65}],
)
def test_a_confirmation_of_another_or_a_milder_infraction_does_not_hold_and_is_noted(
    changes: dict[str, object], crash: Made
) -> None:
    drive = scored(crash, confirmed=[confirmation(**changes)])
    assert build_logged_drive_target(drive).met is False
    (note,) = drive.notes
    assert note.startswith("confirmed infraction not found")


def test_confirmations_of_other_scenarios_are_ignored_and_each_holds_once(crash: Made, roads: RoadMap) -> None:
    assert scored(crash, confirmed=[confirmation(scenario="elsewhere")]).notes == ()
    twice = scored(crash, confirmed=[confirmation(), confirmation()])
    assert (twice.confirmed_count, len(twice.notes)) == (1, 1)


ENTRY = 'scenario = "s"\ncav = "c"\nkind = "stop-sign"\ntime_s = 1.5\nfactor = 0.8\nreason = "rolls"\nby = "me"\n'


def test_the_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "confirmed.toml"
    path.write_text(f"\ufeff[[confirmed]]\n{ENTRY}\n[[confirmed]]\n{ENTRY.replace('1.5', '7')}")  # a byte order mark
    assert [one.time_s for one in load_confirmed_infractions(path)] == [1.5, 7.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        ("confirmed = 3", "confirmed"),
        ("[[confirmed]\n", "expected TOML"),
        ("[[confirmed]]\n" + ENTRY.replace("rolls", " "), "reason"),
        ("[[confirmed]]\n" + ENTRY.replace('by = "me"\n', ""), "by"),
        ("[[confirmed]]\n" + ENTRY.replace("0.8", "1.2"), "factor"),
        ("[[confirmed]]\n" + ENTRY + "silent = true\n", "silent"),
        ("[[infraction]]\n" + ENTRY, "confirmed"),
    ],
)
def test_a_bad_file_gets_one_sentence_with_its_name(text: str | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "confirmed.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        load_confirmed_infractions(path)
    assert "confirmed.toml" in str(error.value)
    assert "\n" not in str(error.value)
