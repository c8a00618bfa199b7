"""The built-in suites of the whole benchmark: what is packaged is what the README says, and can be made again."""

import gzip
from collections import Counter

import pytest

from mdrive_sumo.generate.generated_suite import find_rebuild_differences, load_recipes
from mdrive_sumo.generate.validation import find_suite_problems
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.scenario.packaged_suites import list_packaged_suites
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.study.occlusion_certificate import OcclusionCertificateFile

pytestmark = pytest.mark.slow

PACKED_LIMIT = 25 * 2**20
"""Bytes of the wheel."""


def test_the_benchmark_has_the_papers_buckets() -> None:
    suite = load_suite("mdrive@0")
    assert Counter(scenario.bucket for scenario in suite.scenarios) == {
        "InterDrive": 46,
        "Interaction": 112,
        "V2XPnP": 67,
    }
    assert [part.name for part in suite.parts] == ["interdrive", "interaction", "v2xpnp"]


def test_the_benchmark_is_as_the_papers_tables_say_and_as_it_was_sealed() -> None:
    """Means, categories, weather, certificates, checksums, recipes; the drives are `make validate`'s."""
    assert find_suite_problems(load_suite("mdrive@0"), ()) == ()


@pytest.mark.full
def test_every_recipe_makes_its_scenario_again() -> None:
    recipes = load_recipes("interaction@0")
    assert len(recipes) == 112
    assert list(find_rebuild_differences(recipes)) == []


def test_what_is_packaged_fits_into_the_wheel() -> None:
    folders = (*list_packaged_suites().values(), *list_packaged_networks().values())
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file()]
    assert sum(len(gzip.compress(path.read_bytes(), 6)) for path in files) < PACKED_LIMIT


@pytest.mark.parametrize("name", ["pre-crash", "crosswalk"])
def test_hidden_conflicts_of_a_category(name: str) -> None:
    """At least 80 % of pre-crash and all crosswalk scenarios have an occlusion certificate."""
    suite = load_suite("interaction@0")
    certificates = OcclusionCertificateFile.load(suite)
    hidden = [certificates[s.id].occluded for s in suite.scenarios if s.category == name]
    assert sum(hidden) >= (0.8 if name == "pre-crash" else 1.0) * len(hidden) > 0
