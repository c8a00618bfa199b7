"""A scenario family for tests of the adversarial search: one CAV, a few metres. No tests in here."""

from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures, CandidateTask
from mdrive_sumo.generate.hard.candidate_probes import PROBES, TALKING_NAMES
from mdrive_sumo.generate.hard.candidate_rejection import RejectionStage
from mdrive_sumo.generate.hard.elite_check import EliteCheck
from mdrive_sumo.generate.hard.family import (
    BUCKET,
    FamilyCandidate,
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
)
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.study.need_certificate import NeedCertificate

ROUTE_M = 12
"""As few metres as `omniscient` drives in three seconds."""
TOY = "toy"
REFUSED_START_M = 8.0


class _ToyFamily(ScenarioFamily):
    """Builds its scenarios without a scene."""

    def build(self, candidate: FamilyCandidate) -> Scenario:
        return build_toy_scenario(candidate)


def _stage_nothing(values: Values, seed: str) -> FamilyScene:
    raise AssertionError(f"expected a scenario without a scene, found {values} and {seed}")


def build_toy_scenario(candidate: FamilyCandidate) -> Scenario:
    """Return a CAV that starts `start` metres along a route of InterDrive, with so many pedestrians far away."""
    start, walkers = candidate.values
    if start > REFUSED_START_M:
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"start: expected at most 8 m, found {start:g}")
    like = next(one for one in load_toy_source() if one.id == "i07_ins_ss_town")
    first = round(start)
    ego = like.egos[0]
    x, y, yaw = ego.route[first]
    moved = ego.model_copy(update={"start": Pose(x=x, y=y, yaw=yaw), "route": ego.route[first : first + ROUTE_M + 1]})
    return Scenario(
        id=candidate.scenario_id,
        bucket=BUCKET,
        category=TOY,
        network=like.network,
        egos=(moved,),
        actors=tuple(_build_walker(i, x, y) for i in range(round(walkers))),
    )


def load_toy_source() -> tuple[Scenario, ...]:
    """Return the scenarios of InterDrive; they are read once."""
    if not _SOURCE:
        _SOURCE.extend(load_suite("interdrive@0").scenarios)
    return tuple(_SOURCE)


_SOURCE: list[Scenario] = []


def _build_walker(number: int, x: float, y: float) -> Actor:
    place = Pose(x=round(x + 60.0, 3), y=round(y + 60.0 + 2.0 * number, 3), yaw=0.0)
    return Actor(id=f"walker{number}", kind="pedestrian", length=0.5, width=0.5, start=place)


TOY_FAMILY = _ToyFamily(
    category=TOY,
    description="A CAV drives a few metres.",
    parameters=(
        FamilyParameter("start", 0.0, 10.0, "m", "where the CAV starts"),
        FamilyParameter("walkers", 0.0, 30.0, "", "pedestrians far away"),
    ),
    stage=_stage_nothing,
)


def evaluate_by_formula(task: CandidateTask) -> CandidateEvaluation:
    """Return figures that follow from the values, without any drive: for tests of the search itself."""
    candidate = task.candidate
    a, b = candidate.values
    blank = CandidateEvaluation(
        id=candidate.scenario_id, family=task.family.category, values=candidate.values, seed=candidate.seed
    )
    if a > REFUSED_START_M:
        return blank.model_copy(update={"stage": RejectionStage.BUILD, "reason": "start"})
    figures = CandidateFigures(
        reference_ticks={"0": 40},
        scores=make_scores(90.0 - 10.0 * a + b / 10.0),
        network="town_crossing",
        road_users=1 + round(b * 4),
        mean_speed=a * 2.0,
        message_gain_s=b % 6.0,
        is_certified=b > 10.0,
    )
    return blank.model_copy(update={"figures": figures})


def make_scores(score: float, unaided: float = 20.0, **scores: float) -> dict[str, float]:
    """Return figures of all agents: of those that talk, of those without messages, and others by name."""
    found = {probe.name: score if probe.name in TALKING_NAMES else unaided for probe in PROBES}
    return {**found, "omniscient": 98.0, **scores}


def make_check(name: str, *scores: float) -> EliteCheck:
    """Return the check of an elite with these scores, and a certificate without conflicts."""
    return EliteCheck(
        id=name, seeds=max(len(scores), 2), scores=scores, need=NeedCertificate(scenario=name, conflicts=())
    )
