"""The bucket of synthetic recordings: its numbers, made small, and the same from the same seed."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.generate.seasons.season_bucket import BucketRequest, find_bucket_drawer
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.generate.selection import SelectionItem, compute_means
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle, Schedule
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.scenario.statistics import PAPER
from mdrive_sumo.scenario.suite import SuiteFile, load_suite
from real2sim.network import NetworkReport
from real2sim.recorded_drives.choose_recordings import (
    GAIN,
    GAIN_PLACES,
    LEAST_GAIN,
    LEAST_LOSS,
    LEAST_PLACES,
    MEAN_SHARE,
    MOST_BLIND,
    SINGLE_RANGE,
    choose_recordings,
)
from real2sim.recorded_drives.convert_recording import RecordingOutcome, RecordingTask
from real2sim.recorded_drives.draw_bucket import _add_networks, draw_bucket
from real2sim.recorded_drives.pose_thinning import AWAY_M, thin_scenario
from real2sim.recorded_drives.recording_site import RecordingSite


def outcome(number: int, rng: random.Random) -> RecordingOutcome:
    """A sound scenario with figures around those of the paper."""
    cavs = 1 if rng.random() < 0.2 else 2
    single = rng.choice((60.0, 80.0, 100.0))
    scores = {
        "constant-speed": rng.uniform(20.0, 80.0),
        "single": single,
        "sharing": min(single + rng.choice((0.0, 30.0)), 100.0),
        "sharing+negotiation": min(single + rng.choice((0.0, 30.0)), 100.0),
        "omniscient": 100.0,
    }
    scores["sharing, 6 ticks late"] = max(scores["sharing"] - rng.choice((0.0, 0.0, 25.0)), 0.0)
    item = SelectionItem(
        f"s{number}",
        "signalled",
        cavs,
        rng.uniform(35.0, 60.0) * cavs,
        rng.uniform(0.0, 110.0) * cavs,
        rng.randint(60, 105),
        f"place{number % 30}",
        "",
    )
    return RecordingOutcome(item.id, (), (), scores, item)


def test_the_choice_meets_means_and_scores_on_many_places() -> None:
    rng = random.Random(1)
    chosen = choose_recordings([outcome(n, rng) for n in range(240)], 67)
    assert len(chosen) == 67
    means, paper = compute_means([one.item for one in chosen]), PAPER["v2xpnp"]
    aims = (paper.mean_cavs, paper.mean_route_m, paper.mean_heading_change_deg, paper.mean_actors)
    for mean, aim in zip(means, aims, strict=True):
        assert mean == pytest.approx(aim, rel=MEAN_SHARE + 0.005)
    score = {agent: np.mean([one.scores[agent] for one in chosen]) for agent in chosen[0].scores}
    assert score["constant-speed"] < MOST_BLIND + 0.5
    assert SINGLE_RANGE[0] - 0.5 < score["single"] < SINGLE_RANGE[1] + 0.5
    assert score["sharing"] - score["single"] > LEAST_GAIN - 0.5
    assert score["sharing+negotiation"] - score["single"] > LEAST_GAIN - 0.5
    assert score["sharing"] - score["sharing, 6 ticks late"] > LEAST_LOSS - 0.5
    places = [one.item.network for one in chosen]
    assert len(set(places)) >= LEAST_PLACES
    assert max(map(places.count, places)) <= 5
    gains = [one.item.network for one in chosen if one.scores["sharing"] - one.scores["single"] >= GAIN]
    assert len(set(gains)) >= GAIN_PLACES


def test_what_the_pool_cannot_give_is_missed_and_the_number_kept() -> None:
    assert len(choose_recordings([outcome(n, random.Random(n)) for n in range(5)], 4)) == 4


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


class NoPool:
    """In the place of a pool of processes."""

    def __class_getitem__(cls, _: object) -> type:
        return cls

    def __init__(self, *_: object) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...


def make_request(folder: Path, note: Callable[[str], None] = lambda _: None) -> BucketRequest:
    """A request of one scenario."""
    out = folder / "v2xpnp"
    out.mkdir(parents=True)
    about = SuiteFile(name="v2xpnp", title="test", season=7)
    return BucketRequest(SeasonSeed(7), SeasonSeed(7).describe(), about, out, folder / "work", 1, 2, note)


def test_a_place_without_a_network_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[str] = []
    sites = [RecordingSite(tmp_path / name, "campus", "town-busy") for name in ("good", "bad")]
    tasks = [RecordingTask(site, n, 1, 0, tmp_path) for n, site in enumerate(sites)]
    report = NetworkReport.__new__(NetworkReport)

    class Pool(NoPool):
        def run(self, groups: list[list[RecordingTask]]) -> Iterator[tuple[list[RecordingTask], NetworkReport | str]]:
            for group in groups:
                yield group, report if group[0].site is sites[0] else "no lane"

    monkeypatch.setattr("real2sim.recorded_drives.draw_bucket.ProcessPool", Pool)
    ready = _add_networks(tasks, make_request(tmp_path / "r", notes.append))
    assert [task.name for task in ready] == ["good_000"]
    assert notes == ["v2xpnp: place bad is left out, it has no network: no lane"]


def drawn(folder: Path) -> Path:
    """A bucket of one scenario."""
    request = make_request(folder)
    draw_bucket(request)
    return request.folder


@pytest.mark.full
def test_the_same_season_makes_the_same_files(tmp_path: Path) -> None:
    first, again = drawn(tmp_path / "a"), drawn(tmp_path / "b")
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    for name in files:
        assert (first / name).read_bytes() == (again / name).read_bytes(), name
    (scenario,) = load_suite(str(first)).scenarios
    assert scenario.network.startswith("v2xpnp_")
    assert Path("networks", scenario.network, "map.net.xml.gz") in files
    assert load_road_map(first / "networks" / scenario.network).buildings
    assert len(scenario.rsus) == 2
    assert len(scenario.background.vehicles) + len(scenario.actors) > 50
