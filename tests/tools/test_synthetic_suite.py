"""The bucket of synthetic recordings: chosen by its means, made small, and the same from the same seed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.validation import ScenarioValidation
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle, Schedule
from mdrive_sumo.scenario.scenario import save_scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.scenario.suite import SCENARIO_FILE, load_suite
from tools.synthetic_recordings.build_suite import COUNT, SHARES, build_suite, split_count, write_selection
from tools.synthetic_recordings.candidate_selection import (
    PAPER_MEANS,
    SelectionCandidate,
    build_candidate,
    compute_means,
    select_candidates,
)
from tools.synthetic_recordings.convert_recording import (
    RecordingOutcome,
    RecordingTask,
    build_site_network,
    convert_recording,
    record_log,
)
from tools.synthetic_recordings.pose_thinning import AWAY_M, thin_scenario


def one(name: str, group: str, *sums: float) -> SelectionCandidate:
    return SelectionCandidate(name, group, (sums[0], sums[1], sums[2]), 1)


def test_those_are_chosen_whose_means_are_nearest_to_the_paper() -> None:
    far = [one(f"far{n}", "a", 90.0, 20.0, 60.0 + n) for n in range(4)]
    near = [one("near0", "a", 44.0, 61.0, 84.0), one("near1", "a", 47.0, 61.0, 84.0)]
    other = one("other", "b", 45.0, 60.0, 84.0)
    chosen = select_candidates([*far, *near, other], {"a": 2, "b": 1})
    assert [kept.id for kept in chosen] == ["near0", "near1", "other"]
    assert np.abs(compute_means(chosen) / PAPER_MEANS - 1.0).max() < 0.02
    assert len(select_candidates(far, {"a": 9})) == 4


def test_means_are_over_cavs_and_actors_over_scenarios() -> None:
    two = SelectionCandidate("two", "a", (80.0, 90.0, 80.0), 2)
    assert compute_means([two, one("one", "a", 40.0, 0.0, 90.0)]).tolist() == [40.0, 30.0, 85.0]


def test_a_candidate_counts_everything_but_cavs_and_stations() -> None:
    ego = straight_ego("0")
    thing = Actor(id="thing", kind="static", length=1.0, width=1.0, start=Pose(x=0.0, y=9.0, yaw=0.0))
    found = build_candidate(straight_scenario(ego).model_copy(update={"actors": (thing,)}), "a")
    assert (found.cavs, found.sums[2]) == (1, 1.0)
    assert found.sums[0] == pytest.approx(float(np.hypot(*np.diff(ego.xy, axis=0).T).sum()))


@pytest.mark.parametrize("count", [1, 5, 10, 67])
def test_kinds_add_up_to_the_count(count: int) -> None:
    assert sum(split_count(count).values()) == count


def test_the_whole_bucket_has_the_papers_number_of_cavs() -> None:
    assert split_count(COUNT) == SHARES
    assert sum(cavs * number for (_, cavs), number in SHARES.items()) / COUNT == pytest.approx(1.80, abs=0.01)


def walk(wiggle: float) -> Actor:
    poses = tuple((round(0.1 * k, 1), 0.13 * k, wiggle * float(np.sin(k / 5)), 0.0) for k in range(101))
    start = Pose(x=0.0, y=0.0, yaw=0.0)
    return Actor(
        id="w", kind="cyclist", length=1.8, width=0.6, start=start, motion=ReplayMotion(poses=poses, stays=True)
    )


@pytest.mark.parametrize("wiggle", [0.0, 0.5])
def test_thinned_replays_go_the_same_way(wiggle: float) -> None:
    scenario = straight_scenario(straight_ego("0")).model_copy(update={"actors": (walk(wiggle),)})
    (thin,) = thin_scenario(scenario).actors
    before, after = walk(wiggle).motion, thin.motion
    assert isinstance(before, ReplayMotion)
    assert isinstance(after, ReplayMotion)
    assert after.stays
    full, few = np.array(before.poses), np.array(after.poses)
    assert (few[0] == full[0]).all()
    assert (few[-1] == full[-1]).all()
    assert len(few) == 2 if not wiggle else len(few) < 50
    for k in (1, 2):
        assert np.abs(np.interp(full[:, 0], few[:, 0], few[:, k]) - full[:, k]).max() <= AWAY_M + 1e-9


def test_thinned_schedules_go_as_fast() -> None:
    progress = tuple((0.5 * k, max(0.0, 4.0 * k - 20.0)) for k in range(21))
    vehicle = BackgroundVehicle(id="v", depart_s=0.0, edges=("e",), schedule=Schedule(progress=progress))
    scenario = straight_scenario(straight_ego("0"))
    background = Background(vehicles=(vehicle, vehicle.model_copy(update={"id": "free", "schedule": None})))
    thin = thin_scenario(scenario.model_copy(update={"background": background})).background.vehicles
    assert thin[0].schedule is not None
    assert thin[0].schedule.progress == (progress[0], progress[5], progress[20])
    assert thin[1].schedule is None


def outcome(folder: Path, number: int, problems: tuple[str, ...], ds: float) -> RecordingOutcome:
    """A scenario in the folder, and what was found in it."""
    task = RecordingTask("crossing", number, 1, 0, folder.with_name("work"), folder)
    scenario = straight_scenario(straight_ego("0")).model_copy(update={"id": task.name})
    save_scenario(scenario, folder / task.name / SCENARIO_FILE)
    return RecordingOutcome(task, (), ScenarioValidation(task.name, problems, None, ds))


def test_what_does_not_pass_is_left_out_and_what_is_solved_comes_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "suite"
    made = [
        outcome(folder, 0, ("not solvable",), 40.0),
        outcome(folder, 1, (), 60.0),
        outcome(folder, 2, (), 100.0),
        outcome(folder, 3, (), 100.0),
    ]
    write_selection(folder, made, {"crossing 1": 2})
    suite = load_suite(str(folder))
    assert [scenario.id for scenario in suite.scenarios] == ["crossing_002", "crossing_003"]
    assert suite.about.checksum == suite.checksum()
    assert '"not solvable"' in capsys.readouterr().out


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    with pytest.raises(InputError, match="s: expected a new folder, found something there"):
        build_suite(tmp_path / "s", 1, 0, 1)


def converted(folder: Path) -> tuple[Path, RecordingOutcome]:
    """One recording, made, converted and driven."""
    task = RecordingTask("crossing", 4, 2, 0, folder / "work", folder / "suite")
    assert record_log(task) == task.log
    done = convert_recording(replace(task, network=build_site_network([task])))
    assert isinstance(done, RecordingOutcome), done
    return folder / "suite", done


@pytest.mark.full
def test_the_same_seed_makes_the_same_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with capfd.disabled():
        (first, done), (again, _) = converted(tmp_path / "a"), converted(tmp_path / "b")
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    assert {"crossing_004/scenario.json", "networks/v2xpnp_crossing/map.net.xml.gz"} <= set(map(str, files))
    for name in files:
        assert (first / name).read_bytes() == (again / name).read_bytes(), name
    assert done.misses == ()
    assert done.examined.problems == ()
    (scenario,) = load_suite(str(tmp_path / "a" / "work" / "alone" / "crossing_004")).scenarios
    assert scenario.network == "v2xpnp_crossing"
    assert len(scenario.egos) == len(scenario.rsus) == 2
    assert len(scenario.background.vehicles) + len(scenario.actors) > 60
    assert load_road_map(first / "networks" / "v2xpnp_crossing").lanes
