"""The packaged suite `hard@0`, and what every season of the hard tier has. `validate hard` drives it."""

from functools import lru_cache

import pytest
from click.testing import CliRunner

from mdrive_sumo.cli import main
from mdrive_sumo.generate.duplicates import find_rivals
from mdrive_sumo.generate.validation.hard_suite_validation import find_hard_problems
from mdrive_sumo.scenario.reference_times import find_reference_times
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.study.need_certificate import NeedCertificateFile

MOST_CAVS, MOST_VEHICLES = 12, 150


@lru_cache(maxsize=1)
def load_hard() -> Suite:
    return load_suite("hard@0")


def test_the_first_edition_is_older_than_what_seasons_promise() -> None:
    assert list(find_hard_problems(load_hard(), (), "", must_be_complete=True)) == []


@pytest.mark.slow
def test_its_scenarios_are_distinct_and_on_networks_of_their_own() -> None:
    scenarios = load_hard().scenarios
    assert all(not rivals for rivals in find_rivals(scenarios).values())
    others = {scenario.network for scenario in load_suite("mdrive@0").scenarios}
    assert not others & {scenario.network for scenario in scenarios}
    assert all(2 <= len(one.egos) <= MOST_CAVS for one in scenarios)
    assert all(len(one.background.vehicles) <= MOST_VEHICLES for one in scenarios)


def test_the_time_counts_and_follows_from_reference_times() -> None:
    suite = load_hard()
    assert suite.score_mode == "hard"
    for scenario in suite.scenarios:
        limits = {ego.id: ego.time_limit_s for ego in scenario.egos}
        ticks = find_reference_times(scenario, suite.folder)
        assert limits == pytest.approx({name: 1.5 * count / 20 + 2.0 for name, count in ticks.items()})


def test_the_table_of_scenarios_says_what_certificates_prove() -> None:
    shown = CliRunner().invoke(main, ["list", "scenarios", "--suite", "hard@0"])
    table, legend = shown.output.split("\n\n")
    assert table.splitlines()[0].split()[-5:] == ["proves", "over", "roofs", "gain", "[s]"]
    proofs = [line.split()[-3] for line in table.splitlines()[2:]]
    assert set(proofs) == {"conflict", "-"}
    assert legend.splitlines()[-1] == f"conflict in {proofs.count('conflict')}, all in 0 of {len(proofs)} scenarios"


def test_every_certificate_that_holds_names_a_station_that_sees_the_road_user_in_time() -> None:
    for certificate in NeedCertificateFile.load(load_hard()).values():
        for conflict in certificate.conflicts:
            assert conflict.stations and conflict.told_s is not None and conflict.stopping_s is not None
            assert conflict.told_s <= conflict.stopping_s
