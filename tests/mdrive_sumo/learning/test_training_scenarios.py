"""Training scenarios: deterministic, sound, disjoint by split, and apart from every packaged suite."""

import hashlib
import os
import subprocess
import sys
from collections import Counter, defaultdict
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.generate.built_in_drive import drive_episode
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE, SPLITS
from mdrive_sumo.learning.training_places import KIND_SHARES
from mdrive_sumo.learning.training_scenarios import (
    LONGEST_STRETCH,
    TEMPLATE,
    TEMPLATE_SHARE,
    _draw_kind,
    build_training_scenario,
)
from mdrive_sumo.learning.training_situations import CROWD, SITUATIONS
from mdrive_sumo.roads import RoadMap, list_packaged_networks
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.packaged_suites import list_exact_suites
from mdrive_sumo.scenario.scenario import Ego, Scenario, load_scenario, save_scenario
from mdrive_sumo.scenario.scripted_actor import StandingMotion
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scoring import ScoreMode, score_episode

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
SEED, NUMBERS = 200, (0, 2, 5, 7, 8, 16, 19, 20, 23, 28, 33, 35)
"""Seed, and numbers of places of eight kinds; with more of them every test would take longer."""
PRINT_DIGEST = """
import hashlib, sys
from pathlib import Path
from mdrive_sumo.learning.training_scenarios import build_training_scenario
scenario, _ = build_training_scenario("test", 1, 0, Path(sys.argv[1]))
print(hashlib.sha256(scenario.model_dump_json().encode()).hexdigest())
"""
LEAST_RADIUS_M = 4.5
"""Of routes, measured over 3 m; lane changes on short lanes are the sharpest."""
Built = tuple[Scenario, RoadMap]


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of places, which tests fill."""
    return tmp_path_factory.mktemp("places")


@lru_cache
def build(split: str, seed: int, index: int, places: Path) -> Built:
    made = build_training_scenario(split, seed, index, places)
    assert made is not None
    return made


@pytest.fixture(scope="module")
def many(places: Path) -> list[Built]:
    """Scenarios of the split for training, each at a place of its own."""
    return [build("train", SEED, SCENARIOS_PER_PLACE * number, places) for number in NUMBERS]


DIGESTS = {"train": "9a8496f9d5e0d108", "val": "593946b5ec8d81cb", "test": "f96d5e0e4caad838"}
"""Of two scenarios of seed 1."""


@pytest.mark.parametrize("split", SPLITS)
def test_scenarios_are_those_of_this_version_of_the_generator(split: str, places: Path) -> None:
    """Another digest asks for another `VERSION`."""
    digest = hashlib.blake2b(digest_size=8)
    for index in (0, 1):
        digest.update(build(split, 1, index, places)[0].model_dump_json().encode())
    assert digest.hexdigest() == DIGESTS[split]


def test_another_process_makes_the_same_bytes_in_another_folder(places: Path, tmp_path: Path) -> None:
    made = build("test", 1, 0, places)[0].model_dump_json()
    shown = subprocess.run(
        [sys.executable, "-c", PRINT_DIGEST, tmp_path],
        env={**os.environ, "PYTHONHASHSEED": "7"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout.strip() == hashlib.sha256(made.encode()).hexdigest()


def test_a_scenario_survives_being_written(many: list[Built], tmp_path: Path) -> None:
    for scenario, _ in many[:5]:
        save_scenario(scenario, tmp_path / "scenario.json")
        again = load_scenario(tmp_path / "scenario.json")
        assert again.model_dump(exclude={"egos"}) == scenario.model_dump(exclude={"egos"})
        assert [ego.lanes for ego in again.egos] == [ego.lanes for ego in scenario.egos]


def test_splits_and_seeds_share_neither_places_nor_scenarios(many: list[Built], places: Path) -> None:
    assert len({scenario.id for scenario, _ in many}) == len({roads.name for _, roads in many}) == len(many)
    other = [build(split, 1, 0, places) for split in SPLITS]
    networks = {roads.checksum for _, roads in (*many, *other)}
    assert len(networks) == len(many) + len(other)
    assert [scenario.id.partition("-")[0] for scenario, _ in other] == list(SPLITS)


def test_neighbours_are_other_scenarios_at_the_same_place(many: list[Built], places: Path) -> None:
    scenario, roads = build("train", SEED, 1, places)
    assert roads == many[0][1] and scenario.network == many[0][0].network and scenario.id != many[0][0].id


def test_another_split_is_refused(places: Path) -> None:
    with pytest.raises(InputError, match="split: expected one of train, val, test, found 'trial'"):
        build_training_scenario("trial", 0, 0, places)


def test_no_suite_has_a_place_for_training(many: list[Built]) -> None:
    """By the checksum of the compiled network: all that can be driven on is in it."""
    suites = [path.parent for suite in list_exact_suites().values() for path in suite.glob("networks/*/network.json")]
    assert len(suites) > 100
    used = {read_network_file(folder).checksum for folder in (*suites, *list_packaged_networks().values())}
    assert not used & {roads.checksum for _, roads in many}
    assert not {folder.name for folder in suites} & {roads.name for _, roads in many}


def test_nothing_overlaps_and_routes_are_drivable(many: list[Built]) -> None:
    for scenario, roads in many:
        check_scenario(scenario, roads)
        assert not list(find_spawn_overlaps(scenario, roads)), scenario.id
        assert 1 <= len(scenario.egos) <= 6
        for ego in scenario.egos:
            assert least_radius(ego) > LEAST_RADIUS_M, (scenario.id, ego.id)
        for actor in scenario.actors:
            at = actor.start
            box = shapely.Polygon(box_corners(at.x, at.y, at.yaw, actor.length, actor.width))
            is_prop = isinstance(actor.motion, StandingMotion) and scenario.category in SITUATIONS
            if is_prop and scenario.category != "crowded":
                assert not any(box.intersects(house) for house in roads.building_shapes), scenario.id


def least_radius(ego: Ego) -> float:
    ahead = np.diff(ego.xy, axis=0)
    yaws = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return float(3.0 / max(np.abs(yaws[3:] - yaws[:-3]).max(), 1e-9))


def test_worlds_are_of_many_kinds(many: list[Built]) -> None:
    made = [scenario for scenario, _ in many]
    assert len({scenario.weather for scenario in made}) >= 3
    assert {scenario.speeds for scenario in made} == {"road", "protocol"}
    assert {scenario.signals for scenario in made} == {"program", "frozen-green"}
    assert len({roads.name.rpartition("_")[0] for _, roads in many}) >= 8
    assert any(not roads.buildings for _, roads in many)
    fastest = max(roads.lanes[lane].speed_limit for one, roads in many for ego in one.egos for lane in ego.lanes)
    assert 27.0 < fastest <= 33.34


def test_a_crowded_place_has_its_road_users(many: list[Built]) -> None:
    crowded = [scenario for scenario, _ in many if scenario.category == "crowded"]
    assert len(crowded) > 0.1 * len(many)
    for scenario in crowded:
        kinds = Counter(actor.kind for actor in scenario.actors)
        assert CROWD[0] <= sum(kinds.values()) <= CROWD[1]
        assert kinds["pedestrian"] >= 5 and kinds["vehicle"] >= 5


def test_cavs_at_road_speed_can_stop_before_others_in_their_lane(many: list[Built]) -> None:
    for scenario, roads in many:
        for ego in scenario.egos:
            limit = roads.lanes[ego.lanes[0]].speed_limit
            assert ego.start_speed <= (limit if scenario.speeds == "road" else 8.0)
            standing = [one for one in scenario.actors if isinstance(one.motion, StandingMotion)]
            route = shapely.LineString(ego.xy)
            ways = [route.project(shapely.Point(one.start.x, one.start.y)) for one in standing
                    if route.distance(shapely.Point(one.start.x, one.start.y)) < 0.5]  # fmt: skip
            assert ego.start_speed**2 <= 2 * 4.0 * max(min(ways, default=1e3) - 2.0, 0.0) or scenario.speeds != "road"
        assert len(scenario.egos[0].route) <= 230 * LONGEST_STRETCH


def test_shares_come_near_those_that_are_aimed_at() -> None:
    """Expected shares over the kinds of places, from the weights themselves."""
    import random

    rng, found = random.Random(1), defaultdict[str, float](float)
    for kind, share in KIND_SHARES.items():
        drawn = Counter(_draw_kind(kind, rng) for _ in range(400))
        for name, number in drawn.items():
            found[name] += share * number / 400
    aims = {TEMPLATE: TEMPLATE_SHARE, **{name: one.share for name, one in SITUATIONS.items()}}
    assert sum(aims.values()) == pytest.approx(1.0)
    assert set(found) == set(aims)
    for name, aim in aims.items():
        assert found[name] == pytest.approx(aim, abs=0.05), name
    assert 0.17 < found["crowded"] < 0.25


def test_omniscient_drives_what_is_there(many: list[Built]) -> None:
    crowded, roads = next(one for one in many if one[0].category == "crowded")
    episode = drive_episode(crowded, roads, "omniscient")
    present = {vehicle.id for vehicle in crowded.background.vehicles if vehicle.depart_s == 0.0}
    there = {id_ for id_, valid in zip(episode.ids, episode.valid[0], strict=True) if valid}
    assert len(present - there) <= 1 < len(present)
    assert score_episode(episode, crowded, roads, ScoreMode.MDRIVE, 0).ds > 60.0
