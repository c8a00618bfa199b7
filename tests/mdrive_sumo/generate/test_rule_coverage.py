"""Rules that scenarios exercise: what the static test says, and proof by driving one scenario a rule."""

import math

import pytest

import mdrive_sumo as md
from mdrive_sumo.agents.sensorless import ConstantSpeedAgent
from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.contract import Briefing, Control, Observation, Reply
from mdrive_sumo.generate.validation.rule_coverage import RULES, count_rules, describe_rules, find_exercised_rules
from mdrive_sumo.generate.validation.suite_validation import find_suite_problems
from mdrive_sumo.scenario.start_variation import shift_start
from mdrive_sumo.scenario.suite import load_suite


class StraightOn(ConstantSpeedAgent):
    """Drives straight on, wherever the route leads."""

    def act(self, seen: Observation) -> Reply:
        """Return full throttle and no steering."""
        return Reply(control=Control(0.6, 0.0, 0.0))


class LateAtTheLight(ConstantSpeedAgent):
    """CAV 0 drives near the light, waits until it has been red for a moment, and drives on; the others stay."""

    def start(self, briefing: Briefing) -> None:
        """Remember whether this is CAV 0, by where it starts: pseudonyms say nothing."""
        super().start(briefing)
        first = find_scenario(PROOFS["red-light"][0])[0].egos[0].start
        self._is_first = math.dist(briefing.route_xy[0], (first.x, first.y)) < 1.0

    def act(self, seen: Observation) -> Reply:
        """Return the brake, but drive from 20 s to 23.5 s, lest it counts as blocked, and from 45.3 s on."""
        drives = self._is_first and (400 <= seen.tick < 470 or seen.tick >= 906)
        return super().act(seen) if drives else Reply(control=Control(0.0, 1.0, 0.0))


PROOFS = {
    "collision-vehicle": ("i42_hw_merge_slip_road", ConstantSpeedAgent),
    "collision-pedestrian": ("crosswalk_09", ConstantSpeedAgent),
    "collision-static": ("i07_ins_ss_town", StraightOn),
    "red-light": ("i31_ins_crosschange_main_street", LateAtTheLight),
    "stop-sign": ("i13_ins_sl_minor_road", ConstantSpeedAgent),
    "outside-lanes": ("roundabout_01", StraightOn),
    "route-deviation": ("roundabout_01", StraightOn),
}


def test_every_rule_is_exercised_somewhere() -> None:
    assert PROOFS.keys() == RULES.keys()
    for rule, (name, _) in PROOFS.items():
        scenario, roads, _ = find_scenario(name)
        assert rule in find_exercised_rules(scenario, roads), rule


def test_a_rest_near_the_line_counts_as_its_stop() -> None:
    """Until 0.1.0 both CAVs before a stop sign started 12 m and 10 m before its line, so no driver could miss it."""
    scenario, roads, _ = find_scenario("i13_ins_sl_minor_road")
    near = shift_start(scenario.egos[1], 24.0, roads)
    rolling = near.model_copy(update={"start_speed": 5.0})
    for ego, expected in ((near, False), (rolling, True), (scenario.egos[1], True)):
        changed = scenario.model_copy(update={"egos": (scenario.egos[0], ego)})
        assert ("stop-sign" in find_exercised_rules(changed, roads)) is expected


def test_frozen_lights_exercise_no_red_light() -> None:
    scenario, roads, _ = find_scenario("i31_ins_crosschange_main_street")
    frozen = scenario.model_copy(update={"signals": "frozen-green"})
    assert "red-light" not in find_exercised_rules(frozen, roads)


def test_a_pedestrian_off_the_routes_is_none() -> None:
    scenario, roads, _ = find_scenario("crosswalk_09")
    away = tuple(actor for actor in scenario.actors if actor.kind != "pedestrian")
    assert "collision-pedestrian" not in find_exercised_rules(scenario.model_copy(update={"actors": away}), roads)


def test_validate_lists_what_no_scenario_exercises() -> None:
    whole = load_suite("interdrive@0")
    part = whole[:2]
    assert "no scenario exercises collision-pedestrian" in "\n".join(describe_rules(part))
    assert count_rules(part)["collision-vehicle"] == 2


@pytest.mark.full
def test_the_whole_suite_exercises_every_rule() -> None:
    whole = load_suite("mdrive@0")
    assert all(count_rules(whole).values())
    assert not [problem for problem in find_suite_problems(whole, []) if "exercises" in problem]


@pytest.mark.slow
@pytest.mark.parametrize(
    "rule", ["stop-sign", *(pytest.param(rule, marks=pytest.mark.full) for rule in PROOFS if rule != "stop-sign")]
)
def test_a_bad_driver_breaks_the_rule(rule: str) -> None:
    name, agent = PROOFS[rule]
    found = [one for ego in md.simulate(name, agent).result.egos for one in ego.infractions]
    assert rule in {one.kind for one in found}
    if rule == "stop-sign":
        assert {one.factor for one in found if one.kind == rule} == {0.8}
