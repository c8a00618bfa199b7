"""Which CAVs a log has, by name and by its source."""

from dataclasses import replace

import pytest
from testing.small_log import FRAMES, track

from mdrive_sumo.core.errors import InputError
from real2sim.clean import CleanedRecording
from real2sim.clean.cleaning_report import CleaningReport
from real2sim.fit.cav_selection import describe_unused_cavs, select_cav_tracks
from real2sim.match import LaneMatch
from real2sim.recording import ObjectCategory, RecordedTrack, vehicle_trajectories

TRACKS = (
    track("car-1", 20.0, 0.0, 8.0),
    track("car-12", 30.0, 3.5, 9.0),
    track("van/7", 40.0, 0.0, 8.0),
    track("parked", 70.0, -4.0, 0.0),
    track("walker", 50.0, -6.0, 1.2, ObjectCategory.PEDESTRIAN, (0.6, 0.6)),
)


def in_lane(one: RecordedTrack) -> LaneMatch:
    return LaneMatch(("a_0",) * FRAMES, one.x, 0.0 * one.x, ("a_0",), False, "", first_lane_width=3.5)


MATCHES = {one.id: in_lane(one) for one in TRACKS if one.category is ObjectCategory.CAR}
CLEANED = CleanedRecording(0.1, TRACKS, {"observer": "van/7", "lost": "gone"}, CleaningReport(()))


def select(*names: str) -> tuple[str, ...]:
    return select_cav_tracks(names, CLEANED, TRACKS, MATCHES)


def test_a_cav_is_named_by_its_observer_its_track_its_actor_or_a_unique_beginning() -> None:
    assert select("observer") == ("van/7",)
    assert select("car-1") == ("car-1",)  # though car-12 begins so
    assert select("van-7") == ("van/7",)
    assert select("van") == ("van/7",)
    assert select("car-12", "observer", "van/7") == ("car-12", "van/7")


@pytest.mark.parametrize(("name", "found"), [("car", "2 whose names begin so"), ("lorry", "none of that name")])
def test_a_name_of_no_vehicle_or_of_several_is_refused_with_those_that_can_be_driven(name: str, found: str) -> None:
    with pytest.raises(InputError) as caught:
        select(name)
    assert str(caught.value) == f"CAV {name}: expected one of the vehicles car-1, car-12, van-7, found {found}"


def test_cavs_of_the_source_that_are_none_here_are_told_unless_others_were_asked_for() -> None:
    cleaned = replace(CLEANED, cavs={"observer": "van/7", "other": "parked"})
    chosen = select_cav_tracks((), cleaned, TRACKS, MATCHES)
    assert chosen == ("van/7",)
    (said,) = describe_unused_cavs((), chosen, cleaned, TRACKS, MATCHES)
    assert said == "parked, a CAV of the source, is not a CAV here: it never moves; driven instead: van-7"
    assert describe_unused_cavs(("car-1",), ("car-1",), cleaned, TRACKS, MATCHES) == ()


def test_only_vehicles_are_matched_to_lanes() -> None:
    assert sorted(vehicle_trajectories(TRACKS)) == ["car-1", "car-12", "parked", "van/7"]
    assert vehicle_trajectories(TRACKS)["car-1"][3].tolist() == pytest.approx([22.4, 0.0, 0.0])
