"""The file with `omniscient`'s times: entries belong to one state of a scenario, others are kept, bad files refused."""

import json
from pathlib import Path

import pytest
from testing import suite_fakes

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.reference_times import (
    REFERENCE_TIMES_FILE,
    compute_scenario_checksum,
    find_reference_times,
    list_unmeasured,
    save_reference_times,
)
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.suite import Suite, load_suite, save_suite


@pytest.fixture
def suite(tmp_path: Path) -> Suite:
    return suite_fakes.make_suite(tmp_path / "suite", "answer", "answer", "answer")


def ticks(suite: Suite) -> list[dict[str, int]]:
    return [dict(find_reference_times(scenario, suite.folder)) for scenario in suite]


def change(suite: Suite, number: int, **changes: object) -> Suite:
    scenarios = list(suite.scenarios)
    scenarios[number] = scenarios[number].model_copy(update=changes)
    save_suite(Suite(suite.about, suite.folder, tuple(scenarios)))
    return load_suite(str(suite.folder))


def test_times_come_back_as_they_were_written(suite: Suite) -> None:
    assert ticks(suite) == [{}, {}, {}]
    assert save_reference_times(suite, {"s0": {"0": 50}, "s2": {"0": 70}}) == 2
    assert ticks(suite) == [{"0": 50}, {}, {"0": 70}]
    assert list_unmeasured(suite) == ("s1",)


def test_measuring_one_scenario_keeps_the_others_byte_for_byte(suite: Suite) -> None:
    save_reference_times(suite, {f"s{i}": {"0": 50 + i} for i in range(3)})
    before = (suite.folder / REFERENCE_TIMES_FILE).read_text().splitlines()
    save_reference_times(suite, {"s1": {"0": 99}})
    after = (suite.folder / REFERENCE_TIMES_FILE).read_text().splitlines()
    assert [old == new for old, new in zip(before, after, strict=True)] == [True, True, False, True, True]
    assert ticks(suite) == [{"0": 50}, {"0": 99}, {"0": 52}]


def test_a_changed_scenario_loses_only_its_own_times(suite: Suite) -> None:
    save_reference_times(suite, {f"s{i}": {"0": 50} for i in range(3)})
    changed = change(suite, 1, weather="rain")
    assert ticks(changed) == [{"0": 50}, {}, {"0": 50}]
    assert list_unmeasured(changed) == ("s1",)


def test_a_changed_network_of_the_suites_own_makes_the_times_stale(suite: Suite) -> None:
    save_reference_times(suite, {f"s{i}": {"0": 50} for i in range(3)})
    (suite.folder / "networks" / "flat" / "note.txt").write_text("wider lanes")
    assert ticks(suite) == [{}, {}, {}]


def test_the_formatting_of_a_scenario_file_does_not_matter(suite: Suite) -> None:
    path = suite.folder / "s0" / "scenario.json"
    before = compute_scenario_checksum(suite[0], suite.folder)
    path.write_text(json.dumps(json.loads(path.read_text()), indent=8))
    assert compute_scenario_checksum(load_suite(str(suite.folder))[0], suite.folder) == before


def test_a_scenario_in_which_a_cav_did_not_arrive_has_no_reference_but_is_measured(suite: Suite) -> None:
    second = suite[0].egos[0].model_copy(update={"id": "1"})
    assert isinstance(second, Ego)
    pair = change(suite, 0, egos=(suite[0].egos[0], second))
    save_reference_times(pair, {f"s{i}": {"0": 50} for i in range(3)})
    assert ticks(pair)[0] == {}
    assert list_unmeasured(pair) == ()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "Invalid JSON"),
        ("{}", "scenarios: Field required"),
        ('{"format": "mdrive-sumo/reference-times/9", "scenarios": []}', "format: "),
        ('{"agent": "idm", "scenarios": []}', "agent: "),
        ('{"seed": 1, "scenarios": []}', "seed: "),
        ('{"scenarios": [{"scenario": "s0", "checksum": "", "ticks": {"0": 0}}]}', "greater than or equal to 1"),
        ('{"scenarios": [{"scenario": "s0", "checksum": "", "ticks": {"0": 1.5}}]}', "integer"),
        ('{"scenarios": [], "more": 1}', "more: "),
    ],
)
def test_an_unusable_file_is_refused_in_one_sentence(suite: Suite, text: str, says: str) -> None:
    (suite.folder / REFERENCE_TIMES_FILE).write_text(text)
    with pytest.raises(InputError) as caught:
        find_reference_times(suite[0], suite.folder)
    assert REFERENCE_TIMES_FILE in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
