"""Scores of episodes, scenarios, buckets and runs (protocol 8)."""

from mdrive_sumo.scoring.category_groups import (
    compute_category_group_means,
    compute_interdrive_means,
    compute_level_means,
)
from mdrive_sumo.scoring.efficiency import EFFICIENT_RATIO, apply_reference_times, check_reference, find_arrival_ticks
from mdrive_sumo.scoring.intervals import MeanIntervals, compute_mean_intervals
from mdrive_sumo.scoring.results import (
    BucketResult,
    EgoResult,
    EpisodeKey,
    Infraction,
    Means,
    Overall,
    Results,
    RunInfo,
    ScenarioResult,
)
from mdrive_sumo.scoring.results_check import find_result_faults, find_scenario_faults
from mdrive_sumo.scoring.results_file import (
    build_results_schema,
    load_results,
    load_unchecked_results,
    save_results,
)
from mdrive_sumo.scoring.scenario_score import make_void_result, score_episode
from mdrive_sumo.scoring.score_mode import ScoreMode, compute_scenario_means
from mdrive_sumo.scoring.summary import (
    compute_bucket_means,
    compute_category_means,
    compute_harmonic_mean,
    compute_overall,
    summarize_run,
)

__all__ = [
    "ScoreMode",
    "score_episode",
    "make_void_result",
    "apply_reference_times",
    "check_reference",
    "EFFICIENT_RATIO",
    "find_arrival_ticks",
    "compute_scenario_means",
    "summarize_run",
    "compute_overall",
    "compute_bucket_means",
    "compute_category_means",
    "compute_harmonic_mean",
    "compute_category_group_means",
    "compute_level_means",
    "compute_interdrive_means",
    "MeanIntervals",
    "compute_mean_intervals",
    "Results",
    "RunInfo",
    "Overall",
    "Means",
    "BucketResult",
    "ScenarioResult",
    "EgoResult",
    "EpisodeKey",
    "Infraction",
    "find_result_faults",
    "find_scenario_faults",
    "load_results",
    "load_unchecked_results",
    "save_results",
    "build_results_schema",
]
