"""Evaluate a candidate of the adversarial search: built, solved by `omniscient`, and how much the rules lose.

First comes what rejects most in a second of processor time: build -> length -> danger (blind driving must do harm) ->
feasibility (`omniscient`, seed 0) -> blind driving and `single` (seed 0, then others) -> factor of the time limits, and
whether a certificate is of level `all` -> feasibility with other seeds -> rules that talk -> speeding and cautious
drivers (a seed each). Only what the choice needs is kept.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate.hard.candidate_probes import (
    FIRST_SEED,
    PROBE_MODE,
    PROBE_OPTIONS,
    PROBE_SEEDS,
    PROBES,
    TALKING_NAMES,
    UNAIDED_NAMES,
    UNAIDED_PROBES,
    VARIANTS,
    CandidateScores,
)
from mdrive_sumo.generate.hard.candidate_rejection import CandidateRejected, RejectionStage
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import HardPlace
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR, HardRecipe, build_candidate
from mdrive_sumo.generate.hard.met_controls import count_met_controls
from mdrive_sumo.generate.hard.reference_drive import drive_with
from mdrive_sumo.generate.hard.time_limits import (
    LIMIT_EXTRA_S,
    MOST_FACTOR,
    choose_limit_factor,
    compute_time_limits,
    is_missed,
    set_time_limits,
)
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.validation import FULL_SCORE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT, ReferenceTicks
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.statistics import compute_route_length
from mdrive_sumo.scenario.variation import vary_scenario
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, find_arrival_ticks, score_episode
from mdrive_sumo.study.need_certificate import find_cautious_arrival

BLIND_AGENT = "constant-speed"
"""It is driven before anything else, and cheaply: most random candidates hold no conflict at all."""
MOST_BLIND = 75.0
"""Score without regard to the time above which the blind agent is not in danger."""
MOST_CAV_S = 200.0
"""Times of all CAVs with `omniscient` together [s]. Processor time is proportional to it; the choice bounds the mean,
so that the whole suite is driven in eight minutes on two cores."""
DELAY_FACTOR, DELAY_S = 2.0, 10.0
"""`omniscient` must arrive within so many times the time at the speed limit, and so many seconds for a start from a
standstill. Where it waits longer the time limit would allow every agent to wait, and the drive costs more processor
time."""
REFERENCE_SEEDS = (*PROBE_SEEDS, 8, 9)
"""Seeds with which `omniscient` must solve a candidate: those that choose, and two that no table has, because a
solution that fails with one start in ten would be missed by three."""
REASON_CHARACTERS = 120
"""Of the reason of a rejection in a journal."""


@dataclass(frozen=True, slots=True)
class CandidateTask:
    """A candidate to evaluate; it can be sent to a worker process."""

    family: ScenarioFamily
    candidate: FamilyCandidate
    place: HardPlace


class CandidateFigures(BaseModel):
    """What was measured of a candidate that passed every stage."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    reference_ticks: Mapping[str, Annotated[int, Field(ge=1)]]
    """Of `omniscient`, by CAV id."""
    limit_factor: float
    """What these times are multiplied by for the time limits."""
    scores: Mapping[str, float]
    """Mean scores (mode `hard`) over the seeds of each probe, by its name, and of `omniscient`."""
    controlled_routes: int = Field(ge=0)
    """CAVs that meet a priority sign, a light or a stop sign."""
    is_proven: bool
    """Whether no driver without messages can be both safe and in time, as a certificate of level `all` says."""

    @property
    def routes(self) -> int:
        """Number of CAVs."""
        return len(self.reference_ticks)

    @property
    def score(self) -> float:
        """Of the better one of the rules that see and talk."""
        return max(self.scores[name] for name in TALKING_NAMES)

    @property
    def unaided_score(self) -> float:
        """Of the best of the agents without messages, speeding and cautious variants aside."""
        return max(self.scores[name] for name in UNAIDED_NAMES)

    @property
    def variants_score(self) -> float:
        """Mean of the speeding and cautious drivers."""
        return math.fsum(self.scores[variant.name] for variant in VARIANTS) / len(VARIANTS)

    @property
    def best_variants_score(self) -> float:
        """Mean of the three best of them: two of kin and one more, because one alone may be lucky with its seed."""
        return math.fsum(sorted(self.scores[variant.name] for variant in VARIANTS)[-3:]) / 3

    @property
    def driving_s(self) -> float:
        """Times of all CAVs with `omniscient` together [s]."""
        return sum(self.reference_ticks.values()) * DT


class CandidateEvaluation(BaseModel):
    """A candidate with its figures, or the stage and the reason of its rejection."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    id: Identifier
    family: Identifier
    place: Identifier
    """Name of its network."""
    values: tuple[float, ...]
    seed: str
    figures: CandidateFigures | None = Field(default=None, exclude_if=lambda figures: figures is None)
    stage: RejectionStage | None = Field(default=None, exclude_if=lambda stage: stage is None)
    reason: str = Field(default="", exclude_if=lambda reason: not reason)
    rejected_score: float | None = Field(default=None, exclude_if=lambda score: score is None)
    """What an agent reached that must not reach so much."""

    @property
    def measured(self) -> CandidateFigures:
        """The figures of a candidate that was not rejected."""
        assert self.figures is not None, f"{self.id} was rejected"
        return self.figures

    @property
    def merit(self) -> float:
        """How much is gained by breeding from it: what the best without messages lose, most where it is certified.

        Below 2 for one that was rejected: the more, the less the agent reached that rejected it; most where agents
        without messages are lost.
        """
        if self.figures is None:
            lost = 0.0 if self.rejected_score is None else 1.0 - self.rejected_score / FULL_SCORE
            return lost + (self.stage is RejectionStage.GAP)
        found = self.figures
        best = max(found.unaided_score, found.best_variants_score)
        return FULL_SCORE - best + FULL_SCORE * found.is_proven

    def make_recipe(self, place: HardPlace) -> HardRecipe:
        """Return the recipe of the scenario of a candidate that was not rejected, with time limits."""
        return HardRecipe(
            generator=HARD_GENERATOR,
            id=self.id,
            family=self.family,
            place=place.about,
            values=self.values,
            seed=self.seed,
            limit_factor=self.measured.limit_factor,
            time_limits_s=compute_time_limits(self.measured.reference_ticks, self.measured.limit_factor),
        )


def evaluate_candidate(task: CandidateTask) -> CandidateEvaluation:
    """Return the figures of a candidate, or why it was rejected."""
    try:
        return _make_blank(task).model_copy(update={"figures": _measure_candidate(task)})
    except CandidateRejected as rejected:
        return _reject(task, rejected.stage, rejected.reason, rejected.score)


def make_failed_evaluation(task: CandidateTask, reason: str) -> CandidateEvaluation:
    """Return the evaluation of a candidate whose worker process gave no result."""
    return _reject(task, RejectionStage.FAILURE, reason)


def _make_blank(task: CandidateTask) -> CandidateEvaluation:
    candidate = task.candidate
    return CandidateEvaluation(
        id=candidate.scenario_id,
        family=task.family.category,
        place=candidate.place,
        values=candidate.values,
        seed=candidate.seed,
    )


def _reject(task: CandidateTask, stage: RejectionStage, reason: str, score: float | None = None) -> CandidateEvaluation:
    rounded = None if score is None else round(score, 2)
    return _make_blank(task).model_copy(
        update={"stage": stage, "reason": reason[:REASON_CHARACTERS], "rejected_score": rounded}
    )


def _measure_candidate(task: CandidateTask) -> CandidateFigures:
    roads = task.place.load_roads()
    try:
        scenario = build_candidate(task.family, task.candidate, roads)
    except ProposalRejected as refused:
        raise CandidateRejected(RejectionStage.BUILD, f"{refused.stage}: {refused.reason}") from None
    except InputError as error:
        raise CandidateRejected(RejectionStage.BUILD, str(error)) from None
    _check_length(math.fsum(_compute_free_flow_s(ego, roads) for ego in scenario.egos))
    try:
        return _drive_candidate(scenario, roads)
    except WorldError as error:
        raise CandidateRejected(RejectionStage.FEASIBILITY, f"expected an episode, found none: {error}") from None


def _drive_candidate(scenario: Scenario, roads: RoadMap) -> CandidateFigures:
    solved, ticks = _solve(scenario, roads)
    final = set_time_limits(scenario, compute_time_limits(ticks))
    scores = CandidateScores(final, roads, ticks)
    scores.drive(UNAIDED_PROBES, FIRST_SEED)
    scores.drive(UNAIDED_PROBES, PROBE_SEEDS)
    cautious_s = find_cautious_arrival(final, roads, solved)
    factor = choose_limit_factor(ticks, cautious_s)
    if factor < MOST_FACTOR:
        final = set_time_limits(scenario, compute_time_limits(ticks, factor))
        scores = CandidateScores(final, roads, ticks)
    reference_score = _solve_with_all_seeds(solved, final, roads, ticks)
    scores.drive(PROBES, PROBE_SEEDS)
    scores.drive_variants()
    return CandidateFigures(
        reference_ticks=ticks,
        limit_factor=factor,
        scores={name: round(score, 2) for name, score in {**scores.means, REFERENCE_AGENT: reference_score}.items()},
        controlled_routes=count_met_controls(final, roads),
        is_proven=is_missed(compute_time_limits(ticks, factor), cautious_s),
    )


def _solve(scenario: Scenario, roads: RoadMap) -> tuple[EpisodeRecord, ReferenceTicks]:
    """Return the drive of `omniscient` with seed 0 and the times of arrival [ticks]; blind driving must do harm."""
    free_flow_s = {ego.id: _compute_free_flow_s(ego, roads) for ego in scenario.egos}
    _check_danger(scenario, roads, free_flow_s)
    limited = set_time_limits(scenario, {name: DELAY_FACTOR * time + DELAY_S for name, time in free_flow_s.items()})
    solved = drive_with(REFERENCE_AGENT, limited, roads)
    result = score_episode(solved, limited, roads, ScoreMode.MDRIVE, 0)
    ticks = find_arrival_ticks(result.egos)
    _check_solved(result)
    if len(ticks) < len(scenario.egos):
        raise CandidateRejected(RejectionStage.FEASIBILITY, f"expected all CAVs of {REFERENCE_AGENT} to arrive")
    _check_length(sum(ticks.values()) * DT)
    return solved, ticks


def _check_solved(result: ScenarioResult, seed: int = 0) -> None:
    if result.ds < FULL_SCORE:
        raise CandidateRejected(
            RejectionStage.FEASIBILITY,
            f"expected {REFERENCE_AGENT} to reach 100 with seed {seed}, found {result.ds:.2f}:"
            f" {_describe_losses(result)}",
        )


def _solve_with_all_seeds(first: EpisodeRecord, scenario: Scenario, roads: RoadMap, ticks: ReferenceTicks) -> float:
    """Return the mean score of `omniscient` over the seeds of the probes; it must solve all of `REFERENCE_SEEDS`.

    first: its drive with seed 0.
    """
    scores: list[float] = []
    for seed in REFERENCE_SEEDS:
        varied = vary_scenario(scenario, roads, seed)
        episode = drive_with(REFERENCE_AGENT, scenario, roads, seed) if seed else first
        _check_solved(score_episode(episode, varied, roads, ScoreMode.MDRIVE, seed), seed)
        scores.append(score_episode(episode, varied, roads, PROBE_MODE, seed, ticks).ds)
    return math.fsum(scores) / len(scores)


def _check_danger(scenario: Scenario, roads: RoadMap, free_flow_s: Mapping[str, float]) -> None:
    """Reject a scenario in which nothing happens to an agent that drives on blindly."""
    limited = set_time_limits(scenario, {name: MOST_FACTOR * s + LIMIT_EXTRA_S for name, s in free_flow_s.items()})
    episode = drive_with(BLIND_AGENT, limited, roads, options=PROBE_OPTIONS)
    found = score_episode(episode, limited, roads, ScoreMode.MDRIVE, 0).ds
    if found > MOST_BLIND:
        raise CandidateRejected(
            RejectionStage.DANGER, f"expected {BLIND_AGENT} at {MOST_BLIND:g} at most, found {found:.2f}"
        )


def _describe_losses(result: ScenarioResult) -> str:
    """Return what each CAV that lost score did."""
    losses = [(ego.id, str(ego.outcome), *(one.kind for one in ego.infractions)) for ego in result.egos if ego.ds < 100]
    return "; ".join(f"CAV {name} {', '.join(dict.fromkeys(what))}" for name, *what in losses)


def _check_length(seconds: float) -> None:
    if seconds > MOST_CAV_S:
        expected = f"expected {MOST_CAV_S:g} s of driving at most over all CAVs"
        raise CandidateRejected(RejectionStage.LENGTH, f"{expected}, found {seconds:.0f} s")


def _compute_free_flow_s(ego: Ego, roads: RoadMap) -> float:
    """Return the time [s] that a route takes at the greatest speed limit on it."""
    return compute_route_length(ego) / max(roads.lanes[lane].speed_limit for lane in ego.lanes)
