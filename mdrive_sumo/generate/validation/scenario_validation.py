"""Validation of one scenario: soundness, and the results of a blind and an omniscient drive."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate.validation.hard_validation import HARD_BUCKET, HardValidation, validate_hard_scenario
from mdrive_sumo.generate.validation.requirements import find_unmet_requirements, has_near_miss
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_cost import estimate_cost
from mdrive_sumo.runs.episode_job import EpisodeJob, load_job_scenario, reexecute
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.reference_times import ReferenceTicks
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import ScoreMode, find_arrival_ticks, score_episode
from mdrive_sumo.study.occlusion_certificate import (
    DRIVES,
    REFERENCE_OPTIONS,
    OcclusionCertificate,
    ReferenceDrive,
    find_occluded_intervals,
)

LIMIT_S = 300.0
"""Wall clock for one scenario."""
HARD_SEEDS = 3
"""Number of seeds, from 0 on, with which `omniscient` must solve a scenario of the hard tier: those that choose its
seasons. One could be luck; those of its tables choose nothing."""


@dataclass(frozen=True, slots=True)
class ValidationTask:
    """A scenario to validate; plain values, so that it can be sent to a worker process."""

    suite_folder: Path
    scenario: str
    seeds: int = HARD_SEEDS
    """With how many seeds `omniscient` drives a scenario of the hard tier."""


@dataclass(frozen=True, slots=True)
class ScenarioValidation:
    """Result for one scenario; it passes if `problems` is empty."""

    scenario: str
    problems: tuple[str, ...]
    blind_ttc_s: float | None = None
    """Least time to collision of constant-speed driving; None: never within 1.8 s, or not driven."""
    omniscient_ds: float | None = None
    certificate: OcclusionCertificate | None = None
    """Road users hidden from a CAV before a conflict; None if the scenario was not driven."""
    reference: ReferenceTicks | None = None
    """Ticks after which the CAVs of `omniscient` arrived; None if the scenario was not driven."""
    hard: HardValidation | None = None
    """What a scenario of the hard tier needs besides; None of other tiers, or if it was not driven."""

    @property
    def is_difficult(self) -> bool:
        """Whether blind driving has a near miss."""
        return has_near_miss(self.blind_ttc_s)

    @property
    def is_occluded(self) -> bool:
        """Whether a conflict is hidden until late, see `study.occlusion_certificate`."""
        return self.certificate is not None and self.certificate.occluded


def sample_scenarios(suite: Suite, size: int | None) -> tuple[Scenario, ...]:
    """Return all scenarios of a suite, or a fixed sample of `size` of them, in proportion over its parts, in the
    suite's order."""
    drawn = sorted(key for part in suite.parts or (suite,) for key in _sample_keys(part))[:size]
    kept = {scenario for _, _, scenario in drawn}
    return tuple(scenario for scenario in suite.scenarios if scenario.id in kept)


def _sample_keys(part: Suite) -> Iterator[tuple[float, int, str]]:
    """Return sort keys for sampling: the first half of one part before the second half of any other."""
    keys = sorted((derive_seed(0, scenario.id, "validate"), scenario.id) for scenario in part.scenarios)
    for rank, (seed, name) in enumerate(keys):
        yield (rank + 0.5) / len(keys), seed, name


def validate_scenarios(
    suite: Suite, scenarios: Sequence[Scenario], workers: int, seeds: int = HARD_SEEDS
) -> Iterator[ScenarioValidation]:
    """Validate scenarios of a suite in worker processes, in the order in which they finish."""
    longest_first = sorted(scenarios, key=lambda one: estimate_cost(one, suite.find_folder(one.id)), reverse=True)
    questions = [ValidationTask(suite.folder.resolve(), scenario.id, seeds) for scenario in longest_first]
    with ProcessPool[ValidationTask, ScenarioValidation](
        validate_scenario, min(workers, len(questions)), LIMIT_S
    ) as pool:
        for question, found in pool.run(questions):
            failed = isinstance(found, WorkerFailure)
            yield ScenarioValidation(question.scenario, (found.reason,)) if failed else found


def validate_scenario(question: ValidationTask) -> ScenarioValidation:
    """Drive a scenario blindly and with `omniscient`, or as the hard tier needs it, and report its problems.

    Raises WorldError.
    """
    scenario, roads = load_job_scenario(_job(question, "omniscient"))
    if unsound := tuple(_find_soundness_problems(scenario, roads)):
        return ScenarioValidation(scenario.id, unsound)
    if scenario.bucket == HARD_BUCKET:
        hard = validate_hard_scenario(scenario, roads, question.seeds)
        return ScenarioValidation(scenario.id, hard.problems, None, hard.omniscient_ds, None, hard.reference, hard)
    drives: dict[ReferenceDrive, EpisodeRecord] = {drive: reexecute(_job(question, drive)) for drive in DRIVES}
    blind, solved = (score_episode(drives[drive], scenario, roads, ScoreMode.MDRIVE, 0) for drive in DRIVES)
    problems = find_unmet_requirements(scenario.bucket, blind, solved)
    return ScenarioValidation(
        scenario.id,
        problems,
        blind.min_ttc,
        solved.ds,
        _certify(scenario, roads, drives),
        find_arrival_ticks(solved.egos),
    )


def _job(question: ValidationTask, agent: str) -> EpisodeJob:
    return EpisodeJob(question.suite_folder, question.scenario, AgentSpec(agent), options=REFERENCE_OPTIONS)


def _find_soundness_problems(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    try:
        check_scenario(scenario, roads)
    except InputError as error:
        yield str(error)
    else:
        yield from find_spawn_overlaps(scenario, roads)


def _certify(
    scenario: Scenario, roads: RoadMap, drives: Mapping[ReferenceDrive, EpisodeRecord]
) -> OcclusionCertificate:
    hidden = (
        interval
        for drive, episode in drives.items()
        for interval in find_occluded_intervals(drive, episode, scenario, roads)
    )
    return OcclusionCertificate(scenario=scenario.id, hidden=tuple(hidden))
