"""Evaluate a candidate of the adversarial search: built, new, solved by `omniscient`, and how much the rules lose.

The cheapest test comes first: build -> duplicates -> length -> danger (blind driving must do harm) -> feasibility
(`omniscient`, seed 0) -> how far the rules come, without and with messages (seed 0) -> feasibility (`omniscient`, other
seeds) -> the rules with two other seeds -> certificate of need.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate.duplicates import find_duplicate
from mdrive_sumo.generate.hard.candidate_probes import (
    PROBE_MODE,
    PROBE_OPTIONS,
    PROBE_SEEDS,
    TALKING_NAMES,
    UNAIDED_NAMES,
    WAITING,
    CandidateScores,
)
from mdrive_sumo.generate.hard.candidate_rejection import CandidateRejected, RejectionStage
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_recipe import (
    HARD_GENERATOR,
    HardRecipe,
    build_candidate,
)
from mdrive_sumo.generate.hard.reference_drive import drive_with
from mdrive_sumo.generate.hard.time_limits import LIMIT_EXTRA_S, LIMIT_FACTOR, compute_time_limits, set_time_limits
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.validation import FULL_SCORE, HARD_SEEDS
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT, ReferenceTicks
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.statistics import compute_route_length
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scenario.variation import vary_scenario
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, find_arrival_ticks, score_episode
from mdrive_sumo.study.need_certificate import certify_need

BLIND_AGENT = "constant-speed"
"""It is driven before anything else, and cheaply: most random candidates hold no conflict at all."""
MOST_BLIND = 75.0
"""Score without regard to the time above which the blind agent is not in danger."""
MOST_CAV_S = 240.0
"""Times of all CAVs with `omniscient` together [s]: twelve CAVs of 20 s. Processor time is proportional to it; the
choice bounds the mean, so that the whole suite is driven in eight minutes on two cores."""
DELAY_FACTOR, DELAY_S = 2.0, 10.0
"""`omniscient` must arrive within so many times the time at the speed limit, and so many seconds for a start from a
standstill. Where it waits longer the time limit would allow every agent to wait, and the drive costs more processor
time."""
KNOWN_SUITES = ("mdrive@0",)
"""Suites whose scenarios must not be repeated."""


@dataclass(frozen=True, slots=True)
class CandidateTask:
    """A candidate to evaluate; it can be sent to a worker process."""

    family: ScenarioFamily
    candidate: FamilyCandidate
    known_suites: tuple[str, ...] = KNOWN_SUITES


class CandidateFigures(BaseModel):
    """What was measured of a candidate that passed every stage."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    reference_ticks: Mapping[str, Annotated[int, Field(ge=1)]]
    """Of `omniscient`, by CAV id."""
    scores: Mapping[str, float]
    """Mean scores (mode `hard`) over the seeds of the probes, by name of the probe, and of `omniscient`."""
    network: str
    road_users: int = Field(ge=1)
    """CAVs, background vehicles and scripted road users; no props."""
    mean_speed: float
    """Of the CAVs with `omniscient` [m/s]: lengths of the routes by times."""
    message_gain_s: float
    """How much earlier a message tells of the conflict, see the certificate of need; 0 without one."""
    is_certified: bool
    """Whether the certificate of need holds."""

    @property
    def score(self) -> float:
        """Of the better one of the rules that see and talk."""
        return max(self.scores[name] for name in TALKING_NAMES)

    @property
    def unaided_score(self) -> float:
        """Of the best of the agents without messages; one that waits by its number is not among them."""
        return max(self.scores[name] for name in UNAIDED_NAMES)

    @property
    def waiting_score(self) -> float:
        """Of `take-turns`."""
        return self.scores[WAITING]

    @property
    def gap(self) -> float:
        """Points that the best rules that talk lose against `omniscient`."""
        return FULL_SCORE - self.score

    @property
    def driving_s(self) -> float:
        """Times of all CAVs with `omniscient` together [s]."""
        return sum(self.reference_ticks.values()) * DT


class CandidateEvaluation(BaseModel):
    """A candidate with its figures, or the stage and the reason of its rejection."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    id: Identifier
    family: Identifier
    values: tuple[float, ...]
    seed: str
    figures: CandidateFigures | None = None
    stage: RejectionStage | None = None
    reason: str = ""

    @property
    def measured(self) -> CandidateFigures:
        """The figures of a candidate that was not rejected."""
        assert self.figures is not None, f"{self.id} was rejected"
        return self.figures

    @property
    def recipe(self) -> HardRecipe:
        """The recipe of the scenario of a candidate that was not rejected, with time limits."""
        limits = compute_time_limits(self.measured.reference_ticks)
        return HardRecipe(
            generator=HARD_GENERATOR,
            id=self.id,
            family=self.family,
            values=self.values,
            seed=self.seed,
            time_limits_s=limits,
        )


def evaluate_candidate(task: CandidateTask) -> CandidateEvaluation:
    """Return the figures of a candidate, or why it was rejected."""
    candidate = task.candidate
    blank = CandidateEvaluation(
        id=candidate.scenario_id, family=task.family.category, values=candidate.values, seed=candidate.seed
    )
    try:
        return blank.model_copy(update={"figures": _measure_candidate(task)})
    except CandidateRejected as rejected:
        return blank.model_copy(update={"stage": rejected.stage, "reason": rejected.reason})


def make_failed_evaluation(task: CandidateTask, reason: str) -> CandidateEvaluation:
    """Return the evaluation of a candidate whose worker process gave no result."""
    candidate = task.candidate
    return CandidateEvaluation(
        id=candidate.scenario_id,
        family=task.family.category,
        values=candidate.values,
        seed=candidate.seed,
        stage=RejectionStage.FAILURE,
        reason=reason,
    )


def _measure_candidate(task: CandidateTask) -> CandidateFigures:
    try:
        scenario = build_candidate(task.family, task.candidate)
    except ProposalRejected as refused:
        raise CandidateRejected(RejectionStage.BUILD, f"{refused.stage}: {refused.reason}") from None
    except InputError as error:
        raise CandidateRejected(RejectionStage.BUILD, str(error)) from None
    if (twin := find_duplicate(scenario, _list_known(task.known_suites, scenario.network))) is not None:
        raise CandidateRejected(RejectionStage.DUPLICATES, f"expected something new, found a duplicate of {twin.id}")
    roads = load_road_map(find_network_folder(scenario.network))
    _check_length(math.fsum(_compute_free_flow_s(ego, roads) for ego in scenario.egos))
    try:
        return _drive_candidate(scenario, roads)
    except WorldError as error:
        raise CandidateRejected(RejectionStage.FEASIBILITY, f"expected an episode, found none: {error}") from None


def _drive_candidate(scenario: Scenario, roads: RoadMap) -> CandidateFigures:
    solved, ticks = _solve(scenario, roads)
    final = set_time_limits(scenario, compute_time_limits(ticks))
    scores = CandidateScores(final, roads, ticks)
    scores.drive(PROBE_SEEDS[:1])
    reference_score = _solve_with_all_seeds(solved, final, roads, ticks)
    scores.drive(PROBE_SEEDS[1:])
    need = certify_need(final, roads, solved, only_first=True)
    return CandidateFigures(
        reference_ticks=ticks,
        scores={name: round(score, 4) for name, score in {**scores.means, REFERENCE_AGENT: reference_score}.items()},
        network=scenario.network,
        road_users=_count_road_users(scenario),
        mean_speed=_compute_mean_speed(scenario, ticks),
        message_gain_s=need.lead_s,
        is_certified=need.holds,
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
    """Return the mean score of `omniscient` over the seeds of the probes; it must solve all of `HARD_SEEDS`.

    first: its drive with seed 0.
    """
    scores: list[float] = []
    for seed in range(HARD_SEEDS):
        varied = vary_scenario(scenario, roads, seed)
        episode = drive_with(REFERENCE_AGENT, scenario, roads, seed) if seed else first
        _check_solved(score_episode(episode, varied, roads, ScoreMode.MDRIVE, seed), seed)
        if seed in PROBE_SEEDS:
            scores.append(score_episode(episode, varied, roads, PROBE_MODE, seed, ticks).ds)
    return math.fsum(scores) / len(scores)


def _check_danger(scenario: Scenario, roads: RoadMap, free_flow_s: Mapping[str, float]) -> None:
    """Reject a scenario in which nothing happens to an agent that drives on blindly."""
    limited = set_time_limits(scenario, {name: LIMIT_FACTOR * s + LIMIT_EXTRA_S for name, s in free_flow_s.items()})
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


def _count_road_users(scenario: Scenario) -> int:
    scripted = sum(actor.kind != "static" for actor in scenario.actors)
    return len(scenario.egos) + len(scenario.background.vehicles) + scripted


def _compute_mean_speed(scenario: Scenario, ticks: ReferenceTicks) -> float:
    length = math.fsum(compute_route_length(ego) for ego in scenario.egos)
    return round(length / (sum(ticks.values()) * DT), 3)


@cache
def _list_known(suites: tuple[str, ...], network: str) -> tuple[Scenario, ...]:
    """Return the known scenarios that can be duplicates: those on the same network."""
    return tuple(scenario for suite in suites for scenario in _load_known(suite) if scenario.network == network)


@cache
def _load_known(suite: str) -> tuple[Scenario, ...]:
    return load_suite(suite).scenarios
