"""Is a suite sound, difficult and solvable, and what its name promises? What `mdrive-sumo validate` reports."""

from mdrive_sumo.generate.validation.requirements import FULL_SCORE, NEAR_MISS_TTC_S
from mdrive_sumo.generate.validation.scenario_validation import Examination, Question, examine, examine_suite, sampled
from mdrive_sumo.generate.validation.suite_validation import suite_notes, suite_problems

__all__ = [
    "FULL_SCORE",
    "NEAR_MISS_TTC_S",
    "Examination",
    "Question",
    "examine",
    "examine_suite",
    "sampled",
    "suite_notes",
    "suite_problems",
]
