"""Validation of suites as reported by `mdrive-sumo validate`: sound, difficult and solvable scenarios that match the
suite's name."""

from mdrive_sumo.generate.validation.hard_suite_validation import is_hard_suite
from mdrive_sumo.generate.validation.requirements import FULL_SCORE, NEAR_MISS_TTC_S
from mdrive_sumo.generate.validation.rule_coverage import describe_rules
from mdrive_sumo.generate.validation.scenario_validation import (
    HARD_SEEDS,
    ScenarioValidation,
    ValidationTask,
    sample_scenarios,
    validate_scenario,
    validate_scenarios,
)
from mdrive_sumo.generate.validation.suite_validation import describe_suite, find_suite_problems

__all__ = [
    "FULL_SCORE",
    "HARD_SEEDS",
    "NEAR_MISS_TTC_S",
    "ScenarioValidation",
    "ValidationTask",
    "validate_scenario",
    "validate_scenarios",
    "sample_scenarios",
    "describe_rules",
    "describe_suite",
    "find_suite_problems",
    "is_hard_suite",
]
