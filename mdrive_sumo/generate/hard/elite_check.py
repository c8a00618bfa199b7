"""The last, dear check of an elite before it enters the suite: `omniscient` must score 100 with every seed."""

from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.generate.hard.reference_drive import drive_with, score_reference
from mdrive_sumo.generate.validation import FULL_SCORE, HARD_SEEDS
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.study.need_certificate import NeedCertificate, certify_need

CHECK_SEEDS = HARD_SEEDS


@dataclass(frozen=True, slots=True)
class EliteTask:
    """An elite to check; it can be sent to a worker process."""

    scenario: Scenario
    seeds: int


class EliteCheck(BaseModel):
    """Driving scores of `omniscient` with seeds 0, 1, ... up to the first that is not 100."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    id: Identifier
    seeds: int
    """How many were asked for."""
    scores: tuple[float, ...] = ()
    need: NeedCertificate | None = None
    """The certificate of need, from the drive with seed 0; None if that failed."""
    reason: str = ""
    """Why there is no score with the next seed; "": all were driven, or the last score is not 100."""

    @property
    def is_solved(self) -> bool:
        """Whether `omniscient` scores 100 with every seed."""
        return len(self.scores) == self.seeds and min(self.scores) >= FULL_SCORE and self.need is not None


def check_elite(task: EliteTask) -> EliteCheck:
    """Drive an elite with `omniscient` and one seed after the other, up to the first that is not solved."""
    scenario = task.scenario
    roads = load_road_map(find_network_folder(scenario.network))
    scores: list[float] = []
    need: NeedCertificate | None = None
    reason = ""
    try:
        first = drive_with(REFERENCE_AGENT, scenario, roads, 0)
        scores.append(score_reference(first, scenario, roads, 0))
        while scores[-1] >= FULL_SCORE and len(scores) < task.seeds:
            seed = len(scores)
            scores.append(score_reference(drive_with(REFERENCE_AGENT, scenario, roads, seed), scenario, roads, seed))
        if scores[-1] >= FULL_SCORE:  # last, because it takes longest
            need = certify_need(scenario, roads, first)
    except WorldError as error:
        reason = str(error)
    return EliteCheck(id=scenario.id, seeds=task.seeds, scores=tuple(scores), need=need, reason=reason)


def describe_check(check: EliteCheck) -> str:
    """Return the result of a check in one line."""
    if check.is_solved:
        return f"omniscient 100 with {check.seeds} of {check.seeds} seeds"
    seed = len(check.scores) if check.reason else len(check.scores) - 1
    return f"replaced: seed {seed}: {check.reason or f'omniscient {check.scores[-1]:.2f}'}"
