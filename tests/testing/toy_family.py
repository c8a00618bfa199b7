"""A scenario family for tests of the hard tier: two CAVs on a crossing, which nobody drives. No tests in here."""

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures, CandidateTask
from mdrive_sumo.generate.hard.candidate_probes import PROBES, TALKING_NAMES, VARIANTS
from mdrive_sumo.generate.hard.candidate_rejection import RejectionStage
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.hard_selection import ChosenCandidate
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.study.need_certificate import NeedCertificate
from mdrive_sumo.worlds.placement.cavs import build_cav

TOY = "toy"
REFUSED_START_M = 8.0
GOAL_M = 40.0
CROSSING = PlaceChoice("crossing", {"arms": 4, "control": "priority", "bend": 0.0})


def _stage_toy(values: Values, _seed: str, roads: RoadMap) -> FamilyScene:
    """Two CAVs on lanes of their own, `start` metres from their beginning."""
    start = values["start"]
    if start > REFUSED_START_M:
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"start: expected at most 8 m, found {start:g}")
    lanes = [lane for lane in roads.driving if not lane.junction and lane.centre.length > GOAL_M and lane.successors]
    names = sorted(lane.id for lane in lanes)[:2]
    cavs = (build_cav(roads, str(k), (name,), (start, GOAL_M), 5.0) for k, name in enumerate(names))
    return FamilyScene(tuple(cavs), signals=values["signals"] >= 0.5)


TOY_FAMILY = ScenarioFamily(
    category=TOY,
    description="Two CAVs drive a few metres.",
    places=(CROSSING,),
    parameters=(
        FamilyParameter("start", 0.0, 10.0, "m", "where the CAVs start"),
        FamilyParameter("signals", 0.0, 1.0, "", "whether lights run (from 0.5 on)"),
    ),
    stage=_stage_toy,
)


def evaluate_by_formula(task: CandidateTask) -> CandidateEvaluation:
    """Return figures that follow from the values, without any drive: for tests of the search and of the choice."""
    start, signals = task.candidate.values
    blank = CandidateEvaluation(
        id=task.candidate.scenario_id,
        family=task.family.category,
        place=task.candidate.place,
        values=task.candidate.values,
        seed=task.candidate.seed,
    )
    if start > REFUSED_START_M:
        return blank.model_copy(update={"stage": RejectionStage.BUILD, "reason": "start"})
    return blank.model_copy(update={"figures": make_figures(blank.id, 60.0 + start, 20.0 + 20.0 * signals)})


def certify_nothing(one: ChosenCandidate) -> NeedCertificate:
    """Return a certificate that proves nothing, without any drive."""
    return NeedCertificate(scenario=one.scenario.id, conflicts=())


def make_figures(
    scenario: str, score: float, unaided: float, factor: float = 1.5, controlled: int = 1
) -> CandidateFigures:
    """Return figures of two CAVs: a score of those that talk, and one of all without messages."""
    names = [probe.name for probe in (*PROBES, *VARIANTS)]
    scores = {name: score if name in TALKING_NAMES else unaided for name in names}
    return CandidateFigures(
        reference_ticks={"0": 80, "1": 100},
        limit_factor=factor,
        scores={**scores, "omniscient": 98.0},
        controlled_routes=controlled,
        is_proven=False,
    )
