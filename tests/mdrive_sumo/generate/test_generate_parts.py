"""Parts of the generator that need no simulation: crops, assignment, duplicates, selection, suites of parts."""

import random
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.duplicates import DUPLICATE_DISTANCE, find_duplicate, scenario_distance
from mdrive_sumo.generate.generation_search import propose_from_template
from mdrive_sumo.generate.network_choice import find_networks
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.route_assignment import RELATIONS, assign_routes
from mdrive_sumo.generate.selection import build_item, select_items
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite


def made(category: Category, seed: str) -> Scenario:
    return build_scenario(Recipe(id=f"s{seed}", seed=seed, proposal=propose_from_template(category, seed)))


def test_assignments_keep_every_relation() -> None:
    for category in (Category.DEADLOCK, Category.ROUNDABOUT, Category.UNPROTECTED_LEFT):
        proposal = propose(category, random.Random(3))
        ways = next(
            w
            for roads in find_networks(proposal)
            if (w := assign_routes(proposal, roads, random.Random(1))) is not None
        )
        for constraint in proposal.vehicle_constraints:
            assert RELATIONS[constraint.type](ways[constraint.a], ways[constraint.b])


def test_a_crop_without_the_topology_is_refused() -> None:
    proposal = propose(Category.ROUNDABOUT, random.Random(0))
    with pytest.raises(InputError, match="networks: expected one with the topology roundabout, found none among 1"):
        find_networks(proposal, ["avenue"])


def test_a_scenario_is_its_own_duplicate_and_others_are_not() -> None:
    one, other = made(Category.DEADLOCK, "a"), made(Category.CROSSWALK, "b")
    assert scenario_distance(one, one.model_copy(update={"id": "twin"})) == 0.0
    assert find_duplicate(one, [other, one]) is one
    assert scenario_distance(one, other) > DUPLICATE_DISTANCE
    assert scenario_distance(one, other) == scenario_distance(other, one)
    assert find_duplicate(one, [other]) is None


def test_the_same_recipe_makes_the_same_bytes() -> None:
    assert made(Category.CONSTRUCTION, "x").model_dump_json() == made(Category.CONSTRUCTION, "x").model_dump_json()
    assert made(Category.CONSTRUCTION, "x").model_dump_json() != made(Category.CONSTRUCTION, "y").model_dump_json()


@pytest.mark.slow
def test_the_selection_comes_nearer_to_the_paper_than_the_pool() -> None:
    pool = [made(Category.DEADLOCK, str(seed)) for seed in range(14)]
    figures = CATEGORIES[Category.DEADLOCK].paper
    assert figures is not None

    def off(scenarios: list[Scenario]) -> float:
        egos = [ego for scenario in scenarios for ego in scenario.egos]
        route = sum(map(compute_route_length, egos)) / len(egos)
        heading = sum(map(compute_heading_change_deg, egos)) / len(egos)
        return abs(route / figures.route_m - 1) + abs(heading / figures.heading_change_deg - 1)

    items = [build_item(scenario, "a") for scenario in pool]
    kept = {item.id for item in select_items(items, {"a": 5}, figures.means, random.Random(0))}
    assert len(kept) == 5
    assert off([scenario for scenario in pool if scenario.id in kept]) < off(pool)


def test_a_suite_of_parts_has_their_scenarios(tmp_path: Path) -> None:
    first, second = made(Category.DEADLOCK, "1"), made(Category.DEADLOCK, "2")
    for name, scenario in (("one", first), ("two", second)):
        save_suite(Suite(SuiteFile(name=name, title=name), tmp_path / name, (scenario,)))
    (tmp_path / "both").mkdir()
    about = SuiteFile(name="both", title="both", parts=("one", "two"))
    (tmp_path / "both" / "suite.json").write_text(about.model_dump_json())
    assert [scenario.id for scenario in load_suite(str(tmp_path / "both")).scenarios] == ["s1", "s2"]
    twice = about.model_copy(update={"parts": ("one", "one")})
    (tmp_path / "both" / "suite.json").write_text(twice.model_dump_json())
    with pytest.raises(InputError, match="expected every scenario id once in its parts, found 's1' twice"):
        load_suite(str(tmp_path / "both"))
