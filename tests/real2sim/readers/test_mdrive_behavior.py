"""Behaviours of MDrive's actors: triggers, actions and their vehicles."""

import pytest
from testing.mdrive_directory import TIMED, WALK, Directory, xml

from mdrive_sumo.scenario.scripted_actor import (
    DistanceTrigger,
    HardBrake,
    LaneChange,
    PathMotion,
    StartMotion,
)


def test_start_motion_is_the_default_action(directory: Directory) -> None:
    directory.add("pedestrian", "a.xml", WALK, name="a")
    directory.behave("a", None, vehicle="Vehicle 2")
    actor = directory.actor()
    assert actor.trigger == DistanceTrigger(vehicle="1", distance_m=8.0)
    assert actor.action == StartMotion()


def test_a_hard_brake_has_the_fields_of_the_real_file(directory: Directory) -> None:
    directory.add("npc", "a.xml", xml([(60, 1.75, 0), (90, 1.75, 0)]), name="a")
    directory.add("npc", "b.xml", xml([(60, 5.25, 0), (90, 5.25, 0)]), name="b")
    said = {"brake_hold_s": 1.5, "resume_speed_mps": 5, "pacing": False, "min_drive_distance_m": 3, "direction": None}
    directory.behave("a", {"type": "hard_brake", **said}, distance_m=6)
    directory.behave("b", {"type": "hard_brake"})
    a, b = directory.read().actors
    assert a.trigger == DistanceTrigger(vehicle="0", distance_m=6)
    assert a.action == HardBrake(hold_s=1.5, resume_speed=5, pacing=False, least_driven_m=3)
    assert b.action == HardBrake()


def test_a_lane_change_names_its_side_and_its_target(directory: Directory) -> None:
    directory.add("npc", "a.xml", xml(TIMED), name="a")
    directory.behave("a", {"type": "lane_change", "direction": "right", "target_vehicle": "Vehicle 2"})
    scene = directory.read()
    assert scene.actors[0].action == LaneChange(direction="right", target_vehicle="1")
    assert isinstance(scene.actors[0].motion, PathMotion), "no log can change lanes"
    assert scene.notes == ("a: has times, but is driven along its points",)


@pytest.mark.parametrize(("said", "used"), [(0.2, 1.0), (80, 50.0), (12, 12.0)])
def test_distances_are_clamped_with_a_note(directory: Directory, said: float, used: float) -> None:
    directory.add("pedestrian", "a.xml", WALK, name="a")
    directory.behave("a", None, distance_m=said)
    scene = directory.read()
    assert scene.actors[0].trigger == DistanceTrigger(vehicle="0", distance_m=used)
    assert ["clamped" in note for note in scene.notes] == [True] * (said != used)


def test_cavs_may_be_named_as_in_the_manifest(directory: Directory) -> None:
    directory.manifest["ego"][1]["name"] = "the second"
    directory.add("pedestrian", "a.xml", WALK, name="a")
    directory.behave("a", None, vehicle="the second")
    assert directory.actor().referenced_cav_ids == ("1",)


def test_behaviours_that_do_nothing_are_noted(directory: Directory) -> None:
    directory.add("static", "a.xml", xml([(60, 1.75, 0)]), name="a")
    directory.add("npc", "b.xml", WALK, name="b")
    directory.behave("a", None)
    directory.behave("b", None)
    directory.behave("b", {"type": "hard_brake"})
    directory.behaviors.append({"actor_name": "b", "trigger": None, "action": None})
    directory.behaviors.append({**directory.behaviors[1], "route_id": "other"})
    scene = directory.read()
    by_id = {actor.id: actor for actor in scene.actors}
    assert by_id["a"].trigger is None
    assert by_id["b"].action == StartMotion()
    assert scene.notes == (
        "behaviour 2 of b: a second one, skipped",
        "behaviour 3 of b: without a trigger, skipped",
        "behaviour 4 of b is of route other: skipped",
        "a: its behaviour does nothing, as it stands",
    )
