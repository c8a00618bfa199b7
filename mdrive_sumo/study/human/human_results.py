"""What participants drove, drive by drive, and what agents reached in the same CAVs of the same scenarios."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_nested
from mdrive_sumo.core.tables import format_csv_lines
from mdrive_sumo.episode import load_episode
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.prepared_run import recording_path
from mdrive_sumo.runs.takes import RecordedActions
from mdrive_sumo.scoring import EgoResult, Results, ScenarioResult, load_results
from mdrive_sumo.scoring.score_mode import SUCCESS_DS
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.participant_progress import Answer, DriveEntry, ParticipantProgress

SCORES = ("ds", "sr", "rc", "ip", "time_s", "time_ratio")
"""Numbers of a drive that tables have means of."""


@dataclass(frozen=True, slots=True)
class CavScore:
    """What one CAV reached in one episode."""

    scenario: str
    ds: float
    """[%]"""
    sr: float
    """100 for a success, else 0."""
    rc: float
    """[%]"""
    ip: float
    time_s: float | None
    """From the start to its end; None unless it arrived."""
    time_ratio: float | None
    """Of `omniscient`'s time; None unless both arrived."""
    outcome: str
    collisions: int
    place: str = ""
    """The network, if it is known."""

    @classmethod
    def of(cls, result: ScenarioResult, cav: int) -> "CavScore":
        """Return the score of a CAV by its number. Raises InputError for a CAV that the result has not."""
        if cav >= len(result.egos):
            raise InputError(f"{result.id}: expected a CAV {cav}, found {len(result.egos)} CAVs")
        ego = result.egos[cav]
        arrived = ego.outcome == "arrived" and ego.ticks is not None
        return cls(
            result.id,
            ego.ds,
            100.0 if ego.ds > SUCCESS_DS else 0.0,
            ego.rc,
            ego.ip,
            ego.ticks * DT if arrived and ego.ticks is not None else None,
            ego.time_ratio,
            str(ego.outcome),
            _count_collisions(ego),
            result.place,
        )


def _count_collisions(ego: EgoResult) -> int:
    return sum(infraction.kind.startswith("collision") for infraction in ego.infractions)


@dataclass(frozen=True, slots=True)
class HumanDrive:
    """One drive that counts."""

    code: str
    driver: str
    """`person` or `scripted:KIND`."""
    order: int
    """Place among the participant's drives that count, from 1."""
    condition: str
    cav: str
    """Id of the CAV that the participant drove."""
    score: CavScore
    scenario_ds: float
    """Of all CAVs of the scenario, in the score mode of the suite [%]."""
    scenario_sr: float
    interventions: int
    """Changes between the participant and an agent during the drive."""
    device: str
    answers: Mapping[str, Answer]


@dataclass(frozen=True, slots=True)
class HumanStudyResults:
    """All that the tables of a study are computed from."""

    plan: HumanStudyPlan
    drives: tuple[HumanDrive, ...]
    agents: Mapping[str, tuple[CavScore, ...]]
    """What each agent reached in the CAVs that participants drive, by agent."""
    end_answers: Mapping[str, Mapping[str, Answer]]
    """Answers at the end, by code."""
    withdrawn: int
    """Number of participants who withdrew."""

    @property
    def persons(self) -> tuple[HumanDrive, ...]:
        """The drives of persons; those of programs are none."""
        return tuple(drive for drive in self.drives if drive.driver == "person")

    @property
    def scripted(self) -> tuple[HumanDrive, ...]:
        """The drives of scripted drivers."""
        return tuple(drive for drive in self.drives if drive.driver != "person")


def load_human_drives(study: HumanStudyFolder) -> tuple[HumanDrive, ...]:
    """Return the finished drives that count, of all who did not withdraw. Raises InputError for a damaged take."""
    return tuple(
        _load_drive(study.folder, progress, entry)
        for progress in study.list_progress()
        for entry in progress.list_drives("counted")
        if not entry.is_open and not entry.is_lost and _is_kept(study, progress.code, entry)
    )


def _is_kept(study: HumanStudyFolder, code: str, entry: DriveEntry) -> bool:
    """Return whether a take is still there: one of a pair goes when the partner withdraws."""
    partner = study.plan.find_partner(code)
    return not (entry.folder.startswith("pairs/") and partner in study.list_withdrawals())


def _load_drive(folder: Path, progress: ParticipantProgress, entry: DriveEntry) -> HumanDrive:
    take = folder / entry.take
    results = load_results(take / RESULTS_FILE)
    result = results.scenarios[0]
    if len(results.scenarios) != 1 or result.id != entry.scenario or result.status != "ok":
        raise InputError(f"{take}: expected a take of {entry.scenario}, found {result.id} ({result.status})")
    score = CavScore.of(result, entry.cav)
    ego = result.egos[entry.cav].id
    actions = RecordedActions(load_episode(recording_path(take, result.id)), ego)
    return HumanDrive(
        code=progress.code,
        driver=progress.driver,
        order=entry.number + 1,
        condition=entry.condition,
        cav=ego,
        score=score,
        scenario_ds=result.ds,
        scenario_sr=result.sr,
        interventions=max(len(actions.drivers) - 1, 0),
        device=str(next(iter(actions.drivers.values())).device) if actions.drivers else "",
        answers=entry.answers or {},
    )


def load_agent_scores(plan: HumanStudyPlan, results: Results) -> tuple[CavScore, ...]:
    """Return what an agent reached in the CAVs that participants drive; void episodes are left out."""
    by_id = {result.id: result for result in results.scenarios if result.status == "ok"}
    return tuple(CavScore.of(by_id[scenario.id], scenario.cav) for scenario in plan.scenarios if scenario.id in by_id)


def compute_mean_interval(scores: Sequence[CavScore], name: str) -> ConfidenceInterval | None:
    """Return mean and interval of a score; None where it is defined nowhere. Drives of a scenario are its seeds."""
    defined = [score for score in scores if getattr(score, name) is not None]
    labels = [(score.place or score.scenario, score.scenario, i) for i, score in enumerate(defined)]
    return bootstrap_nested([getattr(score, name) for score in defined], labels) if defined else None


def compute_gap(scores: Sequence[CavScore], base: Sequence[CavScore], name: str) -> ConfidenceInterval | None:
    """Return scores - base, paired by scenario, each with the mean of its drives; None without a common scenario."""
    ours, theirs = group_values(scores, name), group_values(base, name)
    place_by_scenario = {score.scenario: score.place or score.scenario for score in (*base, *scores)}
    common = [scenario for scenario in ours if scenario in theirs]
    differences = [fmean(ours[scenario]) - fmean(theirs[scenario]) for scenario in common]
    labels = [(place_by_scenario[scenario], scenario) for scenario in common]
    return bootstrap_nested(differences, labels) if common else None


def group_values(scores: Iterable[CavScore], name: str) -> dict[str, list[float]]:
    """Return the defined values of a score by scenario."""
    groups: dict[str, list[float]] = {}
    for score in scores:
        value = getattr(score, name)
        if value is not None:
            groups.setdefault(score.scenario, []).append(value)
    return groups


DRIVE_COLUMNS = (
    "code", "driver", "order", "scenario", "condition", "cav", "ds", "sr", "rc", "ip", "time_s", "time_ratio",
    "outcome", "collisions", "interventions", "scenario_ds", "scenario_sr", "device",
)  # fmt: skip


def format_drives_csv(results: HumanStudyResults) -> str:
    """Return one line of CSV for each drive that counts, with the answers of its questionnaire."""
    questions = [question.id for question in results.plan.questionnaires.after_drive]
    lines: list[list[object]] = [[*DRIVE_COLUMNS, *(f"answer_{name}" for name in questions)]]
    for drive in results.drives:
        score = drive.score
        values: list[object] = [
            drive.code, drive.driver, drive.order, score.scenario, drive.condition, drive.cav, score.ds, score.sr,
            score.rc, score.ip, score.time_s, score.time_ratio, score.outcome, score.collisions, drive.interventions,
            drive.scenario_ds, drive.scenario_sr, drive.device,
        ]  # fmt: skip
        lines.append([*map(_format_value, (*values, *(drive.answers.get(name) for name in questions)))])
    return format_csv_lines(lines)


def format_end_csv(results: HumanStudyResults) -> str:
    """Return one line of CSV for each participant with answers at the end."""
    questions = [question.id for question in results.plan.questionnaires.at_end]
    lines = [["code", *(f"answer_{name}" for name in questions)]]
    for code, answers in results.end_answers.items():
        lines.append([code, *(str(_format_value(answers.get(name))) for name in questions)])
    return format_csv_lines(lines)


def _format_value(value: object) -> object:
    if value is None:
        return ""
    return f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def build_human_json(results: HumanStudyResults) -> dict[str, Any]:
    """Return all numbers of a study for the JSON of another; without answers."""
    drives = [
        {**asdict(drive.score), **{name: getattr(drive, name) for name in DRIVE_FACTS}} for drive in results.drives
    ]
    agents = {name: [asdict(score) for score in scores] for name, scores in results.agents.items()}
    return {"title": results.plan.title, "persons": len(results.persons), "drives": drives, "agents": agents}


DRIVE_FACTS = ("code", "driver", "order", "condition", "cav", "scenario_ds", "scenario_sr", "interventions", "device")
