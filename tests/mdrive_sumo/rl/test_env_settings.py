"""Settings of environments, and which episodes they draw."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.rl.env_arguments import EnvArguments, read_settings
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.scenario.suite import load_suite

IDS = ("i01_ins_c_main_street_right", "i25_ins_oppo_boulevard", "i37_ins_chaos_boulevard")
SETTINGS = EnvSettings(scenarios=IDS)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"view": "all"}, "environment: view: expected one of own, privileged, found 'all'"),
        (
            {"control": "pedal"},
            "control: expected one of pedals, speed-offset, targets, anchors, found 'pedal'; did you mean",
        ),
        ({"nearest": 65}, "nearest: expected an integer from 0 to 64, found 65"),
        ({"nearest": True}, "nearest: expected an integer from 0 to 64, found True"),
        ({"message_bytes": 15}, "message_bytes: expected an integer from 16 to 256, found 15"),
        ({"ticks_per_decision": 0}, "ticks_per_decision: expected an integer from 1 to 20, found 0"),
        ({"others": "idn"}, "others: expected one of"),
        ({"others": "idm", "learner": 2}, "learner: expected a CAV 2 in each scenario, found none in i01"),
        ({"scenarios": "i01"}, "scenarios: expected a list of ids, found the text 'i01'"),
        ({"scenarios": ["i01"]}, "scenario 'i01': expected the id of a scenario in suite"),
        ({"suite": "interdrve"}, "interdrve"),
        ({"density": (3, 1)}, "environment: density: expected two integers, the least first, found (3, 1)"),
        ({"density": (900, 999)}, "expected scenarios with 900 to 999 other road users in interdrive@0, found none"),
        ({"curriculum": "easy"}, "environment: curriculum: expected a list of stages, found 'easy'"),
        ({"curriculum": [{"season": 1}]}, "curriculum: stage 0: expected one of suite, scenarios, density, episodes"),
        ({"curriculum": [{}, {}]}, "stage 0: episodes: expected at least 1, for another stage follows, found 0"),
        ({"curriculum": [{"scenarios": IDS, "episodes": "x"}]}, "episodes: expected an integer, found 'x'"),
        ({"curriculum": [{"scenarios": IDS[:1]}], "others": "idm", "learner": 5}, "expected a CAV 5 in each"),
        ({"views": "own"}, "environment: argument: expected one of"),
        ({"comm": "telepathy"}, "telepathy"),
    ],
)
def test_bad_settings_are_one_sentence(arguments: dict[str, Any], sentence: str) -> None:
    filled: Any = {"scenarios": IDS, **arguments}
    with pytest.raises(InputError) as error:
        read_settings(filled)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_slots_are_those_of_the_scenario_with_the_most_cavs() -> None:
    assert SETTINGS.slots == 8
    assert [len(SETTINGS.stages[0].cav_ids[name]) for name in IDS] == [2, 4, 8]
    assert read_settings(EnvArguments(scenarios=IDS, others="idm")).slots == 1


@given(seed=st.integers(0, 2**31 - 1), number=st.integers(0, 10**6))
def test_an_episode_depends_on_seed_and_number_only(seed: int, number: int) -> None:
    first = SETTINGS.choose_episode(seed, number, {})
    SETTINGS.choose_episode(seed + 1, 3, {})
    assert SETTINGS.choose_episode(seed, number, {"options": 1}) == first
    assert first.scenario in IDS


def test_episodes_differ_and_cover_all_scenarios() -> None:
    drawn = [SETTINGS.choose_episode(0, number, {}) for number in range(60)]
    assert {one.scenario for one in drawn} == set(IDS)
    assert len({one.seed for one in drawn}) == 60
    assert EnvSettings(scenarios=IDS, vary=False).choose_episode(0, 5, {}).seed == 0


def test_a_curriculum_changes_the_scenarios_at_its_episodes() -> None:
    stages = [
        {"scenarios": IDS[:1], "episodes": 2},
        {"scenarios": IDS[1:], "episodes": 3},
        {"suite": "mdrive@1", "density": (80, 999)},
    ]
    settings = EnvSettings(curriculum=stages)
    drawn = [settings.choose_episode(1, number, {}) for number in range(9)]
    assert {one.scenario for one in drawn[:2]} == {IDS[0]}
    assert {one.scenario for one in drawn[2:5]} <= set(IDS[1:])
    assert {one.suite for one in drawn[5:]} == {"mdrive@1"}
    crowded = settings.stages[2].cav_ids
    assert all(one.scenario in crowded for one in drawn[5:])
    assert 0 < len(crowded) < len(load_suite("mdrive@1"))
    assert settings.find_cavs(drawn[0]) == settings.stages[0].cav_ids[IDS[0]]
    assert settings.choose_episode(1, 0, {"scenario": drawn[6].scenario}).suite == "mdrive@1"


def test_a_reset_may_name_its_episode() -> None:
    chosen = SETTINGS.choose_episode(0, 0, {"scenario": IDS[2], "scenario_seed": 7})
    assert (chosen.scenario, chosen.seed) == (IDS[2], 7)
    with pytest.raises(InputError, match="reset: scenario: expected one of"):
        SETTINGS.choose_episode(0, 0, {"scenario": "i99"})
