"""Scores: episode -> scenario -> bucket -> overall (protocol 8)."""

from mdrive_sumo.score.groups import category_groups, interaction_levels, interdrive_groups
from mdrive_sumo.score.mode import ScoreMode, scenario_means
from mdrive_sumo.score.results import (
    BucketResult,
    EgoResult,
    Infraction,
    Means,
    Overall,
    Results,
    RunInfo,
    ScenarioResult,
)
from mdrive_sumo.score.scenario import score_episode, void_result
from mdrive_sumo.score.storage import load_results, results_schema, save_results
from mdrive_sumo.score.summary import buckets, categories, harmonic, overall, summarise

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
