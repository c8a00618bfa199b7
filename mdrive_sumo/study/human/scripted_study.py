"""A whole study without a person: scripted drivers drive every drive of the plan, in the order of the plan."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast

from mdrive_sumo.agents.human import HumanAgent
from mdrive_sumo.agents.registry import HUMAN_AGENTS
from mdrive_sumo.contract import REMARK, Briefing, Note
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop import run_episode
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import build_episode_config, load_job_scenario
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.takes import (
    HUMAN,
    Action,
    DriverChoice,
    HumanDriver,
    make_human_spec,
    prepare_take,
    write_take,
)
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import load_results
from mdrive_sumo.scoring.score_mode import SUCCESS_DS
from mdrive_sumo.study.human.drive_order import PlannedDrive
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder
from mdrive_sumo.study.human.human_study_plan import PERSON, HumanStudyPlan
from mdrive_sumo.study.human.participant_progress import (
    SCRIPTED_PREFIX,
    DriveEntry,
    ParticipantProgress,
    StepKind,
    find_step,
)
from mdrive_sumo.study.human.scripted_driver import ScriptedDriver, find_traits

TAKE_FOLDER = "takes/1"
"""Run folder of the take within the folder of its drive, as in drives of persons."""
DEFAULT_PARTNER = "sharing"
"""Agent of the CAVs that are left when two participants drive together."""
Report = Callable[[str], None]


class AgentActions:
    """An `ActionSource`: a built-in agent drives from the first tick to the last."""

    def __init__(self, agent: str) -> None:
        self._agent = agent

    def read(self, tick: int) -> Action:
        """See ActionSource."""
        return Action(DriverChoice(self._agent) if tick == 0 else None)


class ScriptedSeat(HumanDriver):
    """The seat of a CAV with a scripted driver in it, who acts as a person does: by pedals and wheel, tick by tick."""

    def __init__(self, ego: str, driver: ScriptedDriver, spec: AgentSpec) -> None:
        super().__init__(ego, self, cast(HumanAgent, HUMAN_AGENTS[str(spec.agent)](spec.config)))
        self._scripted = driver

    def start(self, briefing: Briefing) -> None:
        """See AgentDriver."""
        super().start(briefing)
        self._scripted.start(briefing)

    def read(self, tick: int) -> Action:
        """See ActionSource."""
        assert self.seen is not None, "the driver is asked after it has seen the tick"
        control = self._scripted.act(self.seen)
        if tick > 0:
            return Action(control=control)
        note = Note(REMARK, f"{SCRIPTED_PREFIX}{self._scripted.kind}: a program, not a person")
        return Action(DriverChoice(HUMAN, {"device": "script"}), control, notes=(note,))


def drive_take(
    plan: HumanStudyPlan, suite: Suite, drive: PlannedDrive, driver_by_cav: Mapping[int, ScriptedDriver], folder: Path
) -> None:
    """Drive a scenario with scripted drivers in some CAVs and write the take. driver_by_cav: by number of the CAV.

    Raises InputError and WorldError.
    """
    partner = drive.condition.partner if drive.condition.partner != PERSON else DEFAULT_PARTNER
    spec = make_human_spec(substitutes=(partner,), device="script")
    config = RunConfig(suite=plan.suite_name, scenario=drive.scenario.id, agent=spec, seeds=(plan.seed,), out=folder)
    run = prepare_take(config, suite)
    job = run.make_job(run.scenarios[0])
    scenario, roads = load_job_scenario(job)
    episode_config = build_episode_config(job, scenario, roads)
    drivers: dict[str, HumanDriver] = {}
    for number, ego in enumerate(scenario.egos):
        scripted = driver_by_cav.get(number)
        if scripted is None:
            agent = cast(HumanAgent, HUMAN_AGENTS[HUMAN](spec.config))
            drivers[ego.id] = HumanDriver(ego.id, AgentActions(partner), agent)
        else:
            drivers[ego.id] = ScriptedSeat(ego.id, scripted, spec)
    with open_world(episode_config) as world:
        record = run_episode(episode_config, world, drivers)
    write_take(run, record)


def assign_kinds(plan: HumanStudyPlan, kinds: Sequence[str]) -> dict[str, str]:
    """Return the kind of scripted driver by code, in turn. Raises InputError for unknown kinds, or too many."""
    for kind in kinds:
        find_traits(kind)
    if not 1 <= len(kinds) <= len(plan.codes) or len(set(kinds)) < len(kinds):
        most = len(plan.codes)
        expected = "one kind" if most == 1 else f"1 to {most} different kinds"
        raise InputError(
            f"--scripted: expected {expected}, no more than the plan has participants, found"
            f" {', '.join(kinds) or 'none'}"
        )
    return {code: kinds[place % len(kinds)] for place, code in enumerate(plan.codes)}


def run_scripted_study(study: HumanStudyFolder, suite: Suite, kinds: Sequence[str], report: Report) -> None:
    """Drive everything that is left of the plan with scripted drivers; progress is kept after every drive.

    They practise, as the plan says, but need no pauses, consent to nothing and answer no questions. Raises InputError
    and WorldError.
    """
    kind_by_code = assign_kinds(study.plan, kinds)
    for code, kind in kind_by_code.items():
        before = study.load_progress(code)
        driver = f"{SCRIPTED_PREFIX}{kind}"
        if before.drives and before.driver != driver:
            raise InputError(
                f"{study.folder}: expected {before.driver} for {code}, as the study began, found {driver};"
                " --out names another folder"
            )
        progress = before.model_copy(update={"driver": driver})
        while True:
            step = find_step(study.plan, progress, 0)
            if step.kind in (StepKind.QUESTIONS, StepKind.END_QUESTIONS):
                progress = progress.answer_drive({}) if step.kind is StepKind.QUESTIONS else progress.answer_end({})
            elif step.drive is not None:
                counts = step.kind is StepKind.DRIVE
                entry = study.make_entry(code, "counted" if counts else "practice", step.drive)
                _drive_entry(study, suite, step.drive, entry, (code, kind_by_code))
                progress = _end(study, progress, entry)
                last = progress.drives[-1]
                report(f"{code} {driver}: {entry.folder}: {'success' if last.is_success else 'no success'}")
            else:
                break
            study.save_progress(progress)


def _drive_entry(
    study: HumanStudyFolder,
    suite: Suite,
    drive: PlannedDrive,
    entry: DriveEntry,
    who: tuple[str, Mapping[str, str]],
) -> None:
    """Drive a take unless it is there: a drive of a pair is driven once. who: the code, and the kinds by code."""
    code, kind_by_code = who
    folder = study.folder / entry.folder / TAKE_FOLDER
    if (folder / RESULTS_FILE).exists():
        return
    codes = {drive.cav: code}
    if drive.condition.has_person:
        codes[drive.partner_cav] = study.plan.find_partner(code)
    has_view = drive.condition.v2x_view
    drivers = {cav: ScriptedDriver(kind_by_code[code], has_view, code) for cav, code in codes.items()}
    drive_take(study.plan, suite, drive, drivers, folder)


def _end(study: HumanStudyFolder, progress: ParticipantProgress, entry: DriveEntry) -> ParticipantProgress:
    take = f"{entry.folder}/{TAKE_FOLDER}"
    opened = progress.open_drive(entry, study.plan.breaks, 0)
    return opened.end_drive(take, is_success(study.folder / take, entry.cav), 0)


def is_success(take: Path, cav: int) -> bool:
    """Return whether the CAV of a participant succeeded in a take: its driving score is above the threshold of SR.

    Raises InputError for a folder that holds no take.
    """
    (result,) = load_results(take / RESULTS_FILE).scenarios
    return result.status == "ok" and result.egos[cav].ds > SUCCESS_DS
