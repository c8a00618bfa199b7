"""The bucket of synthetic recordings: its numbers, made small, and the same from the same seed."""

from pathlib import Path

import numpy as np
import pytest
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.generate.seasons.season_bucket import BucketRequest, find_bucket_drawer
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.scenario.background import Background, BackgroundVehicle, Schedule
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.scenario.suite import SuiteFile, load_suite
from real2sim.recorded_drives.draw_bucket import COUNT, SHARES, draw_bucket, split_count
from real2sim.recorded_drives.pose_thinning import AWAY_M, thin_scenario


@pytest.mark.parametrize("count", [1, 5, 10, 67])
def test_kinds_add_up_to_the_count(count: int) -> None:
    assert sum(split_count(count).values()) == count


def test_the_whole_bucket_has_the_papers_number_of_cavs() -> None:
    assert split_count(COUNT) == SHARES
    assert sum(cavs * number for cavs, number in SHARES.items()) / COUNT == pytest.approx(1.80, abs=0.01)


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


def test_the_bucket_is_found_by_its_entry_point() -> None:
    assert find_bucket_drawer("v2xpnp") is draw_bucket


def drawn(folder: Path) -> Path:
    """A bucket of one scenario."""
    out = folder / "v2xpnp"
    out.mkdir(parents=True)
    about = SuiteFile(name="v2xpnp", title="test", season=7)
    draw_bucket(
        BucketRequest(SeasonSeed(7), SeasonSeed(7).describe(), about, out, folder / "work", 1, 2, lambda _: None)
    )
    return out


@pytest.mark.full
def test_the_same_season_makes_the_same_files(tmp_path: Path) -> None:
    first, again = drawn(tmp_path / "a"), drawn(tmp_path / "b")
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    for name in files:
        assert (first / name).read_bytes() == (again / name).read_bytes(), name
    (scenario,) = load_suite(str(first)).scenarios
    assert scenario.network.startswith("v2xpnp_")
    assert Path("networks", scenario.network, "map.net.xml.gz") in files
    assert len(scenario.rsus) == 2
    assert len(scenario.background.vehicles) + len(scenario.actors) > 50
