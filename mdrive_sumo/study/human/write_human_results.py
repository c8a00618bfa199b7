"""Drive the agents of a plan, and write the results of a study: page, tables, figure, CSV."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.report.comparison_report.write_comparison_report import render_report_files
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import RESULTS_FILE, evaluate, report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare_with_suite
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import Results, load_results
from mdrive_sumo.study.human.human_report import build_human_report
from mdrive_sumo.study.human.human_results import (
    HumanStudyResults,
    format_drives_csv,
    format_end_csv,
    load_agent_scores,
    load_human_drives,
)
from mdrive_sumo.study.human.human_study_folder import RESULTS_FOLDER, HumanStudyFolder
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, name_agent_folder

PAGE_FILE, MARKDOWN_FILE = "human_study.html", "human_study.md"
DRIVES_FILE, END_FILE = "drives.csv", "end_answers.csv"


@dataclass(frozen=True, slots=True)
class AgentRow:
    """A finished run of an agent over the scenarios of a study."""

    agent: str
    results: Results


@dataclass(frozen=True, slots=True)
class ComparedAgents:
    """The runs of the agents that a plan compares with; unfinished ones are continued."""

    study: HumanStudyFolder
    suite: Suite
    workers: int = 1
    command: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self.study.folder

    def episodes(self) -> int:
        """Return the number of episodes."""
        return len(self.study.plan.compare) * len(self.study.plan.scenarios)

    def rows(self, progress: StudyProgress) -> Iterator[AgentRow]:
        """Drive the unfinished runs and yield a row for each. Raises InputError and KeyboardInterrupt."""
        for name in self.study.plan.compare:
            progress.run(name)
            yield AgentRow(name, evaluate(self._prepare(name), progress))

    def _prepare(self, name: str) -> PreparedRun:
        plan, spec = self.study.plan, AgentSpec(name)
        config = RunConfig(
            suite=plan.suite_name,
            scenario=",".join(scenario.id for scenario in plan.scenarios),
            agent=spec,
            seeds=(plan.seed,),
            workers=self.workers,
            out=self.study.folder / RUNS_FOLDER / name_agent_folder(spec),
            command=self.command,
        )
        return prepare_with_suite(config, self.suite)


def load_human_results(study: HumanStudyFolder, runs: Mapping[str, Results]) -> HumanStudyResults:
    """Return all that the tables of a study need. runs: results of agents, by name. Raises InputError."""
    return HumanStudyResults(
        plan=study.plan,
        drives=load_human_drives(study),
        agents={name: load_agent_scores(study.plan, results) for name, results in runs.items()},
        end_answers={
            progress.code: progress.end_answers
            for progress in study.list_progress()
            if progress.is_person and progress.end_answers is not None
        },
        withdrawn=len(study.list_withdrawals()),
    )


def load_stored_human_results(folder: Path) -> HumanStudyResults:
    """Return the results of a study's folder, with those agents whose runs are finished. Raises InputError."""
    study = HumanStudyFolder.open_existing(folder)
    files = {
        name: folder / RUNS_FOLDER / name_agent_folder(AgentSpec(name)) / RESULTS_FILE for name in study.plan.compare
    }
    return load_human_results(study, {name: load_results(path) for name, path in files.items() if path.exists()})


def write_human_results(study: HumanStudyFolder, results: HumanStudyResults, command: str) -> tuple[Path, ...]:
    """Write all files of the results and return those to begin with. Raises InputError."""
    folder = study.folder / RESULTS_FOLDER
    contents = render_report_files(build_human_report(results, command), PAGE_FILE, MARKDOWN_FILE, folder)
    contents[DRIVES_FILE] = format_drives_csv(results).encode()
    if results.plan.questionnaires.at_end:
        contents[END_FILE] = format_end_csv(results).encode()
    for name, content in contents.items():
        with report_write_errors(folder / name):
            make_parents(folder / name)
            write_bytes(folder / name, content)
    return tuple(folder / name for name in (PAGE_FILE, MARKDOWN_FILE, DRIVES_FILE))
