"""Scores: episode -> scenario -> bucket -> overall (protocol 8)."""

from mdrive_sumo.scoring.category_groups import category_groups, interaction_levels, interdrive_groups
from mdrive_sumo.scoring.results import (
    BucketResult,
    EgoResult,
    Infraction,
    Means,
    Overall,
    Results,
    RunInfo,
    ScenarioResult,
)
from mdrive_sumo.scoring.results_file import load_results, results_schema, save_results
from mdrive_sumo.scoring.scenario_score import score_episode, void_result
from mdrive_sumo.scoring.score_mode import ScoreMode, scenario_means
from mdrive_sumo.scoring.summary import buckets, categories, harmonic, overall, summarise

__all__ = [
    "ScoreMode",
    "score_episode",
    "void_result",
    "scenario_means",
    "summarise",
    "overall",
    "buckets",
    "categories",
    "harmonic",
    "category_groups",
    "interaction_levels",
    "interdrive_groups",
    "Results",
    "RunInfo",
    "Overall",
    "Means",
    "BucketResult",
    "ScenarioResult",
    "EgoResult",
    "Infraction",
    "load_results",
    "save_results",
    "results_schema",
]
