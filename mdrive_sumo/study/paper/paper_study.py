"""The runs of the study: closed loop, open loop and worse channels; every run has a journal and can be continued."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.open_loop import (
    REFERENCE_AGENT,
    OpenLoopExecutor,
    OpenLoopResults,
    OpenLoopScenario,
    Reference,
    evaluate_open,
    make_open_loop_executor,
    open_run_reference,
    prepare_open_loop,
)
from mdrive_sumo.runs.evaluate import EpisodeExecutor, evaluate, make_episode_executor
from mdrive_sumo.runs.fingerprint import compute_fingerprint
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scoring import Results, summarize_run
from mdrive_sumo.study.conditions import ChannelCondition, make_conditions
from mdrive_sumo.study.paper.paper_plan import PaperPlan
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, StudyRow, make_variant, name_agent_folder
from mdrive_sumo.v2x.comm_settings import PRESETS

REFERENCE = REFERENCE_AGENT
"""Agent of the recorded drives that open loop compares with."""
DETECTOR_PREFIX = "perception-swap:"
"""Agents with the paper's rule-based planner, which differ in their detector. The paper has them in RQ3 only."""
SURROGATE_SUFFIX = ":profile"
"""Detectors that are error models and no networks."""
CONDITIONS = make_conditions(PRESETS["ideal"], {"latency": ((6,),), "pose-error": ((0.6, 0.6),)}, "one-at-a-time")
"""The clean channel, then the paper's perturbations (RQ5): 6 ticks, and 0.6 m with 0.6 degrees."""


class PaperProgress(StudyProgress, Protocol):
    """Receives the progress of the study."""

    def compared(self, name: str) -> None:
        """An agent has seen a recording in open loop."""
        ...


@dataclass(frozen=True, slots=True)
class ClosedRow:
    """A finished run in closed loop."""

    agent: str
    results: Results
    folder: Path


@dataclass(frozen=True, slots=True)
class OpenRow:
    """A finished evaluation in open loop."""

    agent: str
    results: OpenLoopResults


PaperRow = ClosedRow | StudyRow | OpenRow


@dataclass(frozen=True, slots=True)
class PaperStudy:
    """The runs of the study. agents: by name, prepared with all scenarios, seeds and the clean channel."""

    plan: PaperPlan
    agents: Mapping[str, PreparedRun]
    reference: PreparedRun
    """`REFERENCE`, whether it is among the agents or not."""
    folder: Path

    def episodes(self) -> int:
        """Return the largest possible number of episodes and of recordings shown in open loop."""
        closed = sum(len(self._list_closed(name)) for name in self._list_all())
        channel = len(self.plan.channel) * (len(CONDITIONS) - 1) * sum(map(_may_perturb, self.agents))
        return (closed + channel + len(self.plan.logs) * len(self.agents)) * len(self.reference.config.seeds)

    def rows(self, progress: PaperProgress) -> Iterator[PaperRow]:
        """Drive the unfinished runs and yield a row for each. Raises InputError and KeyboardInterrupt.

        All runs share worker processes, which keep the networks that they have loaded.
        """
        limit_s = max(run.limit_s() for run in self._list_all().values())
        workers = self.reference.config.workers
        base: dict[str, Results] = {}
        with make_episode_executor(workers, limit_s) as executor:
            for name, prepared in self._list_all().items():
                folder = self._find_folder(self._name_part(name), prepared)
                run = _restrict(prepared, self._list_closed(name), folder)
                progress.run(f"{name}, closed loop")
                base[name] = evaluate(run, progress, executor)
                yield ClosedRow(name, base[name], run.folder)
            for name, prepared in self.agents.items():
                if _may_perturb(name):
                    yield from self._drive_conditions(name, prepared, base[name], (progress, executor))
        reference = self._load_reference()
        with make_open_loop_executor(workers, limit_s) as viewers:
            for name, prepared in self.agents.items():
                progress.run(f"{name}, open loop")
                yield OpenRow(name, self._show(prepared, reference, progress, viewers))

    def _load_reference(self) -> Reference:
        stored = load_stored_run(self._find_folder(self._name_part(REFERENCE), self.reference))
        return open_run_reference(stored, ",".join(self.plan.logs))

    def _list_all(self) -> dict[str, PreparedRun]:
        return {**self.agents, **({} if REFERENCE in self.agents else {REFERENCE: self.reference})}

    def _list_closed(self, agent: str) -> tuple[str, ...]:
        """Return the scenarios that an agent drives in closed loop."""
        whole = agent in self.agents and not is_surrogate(agent)
        return self.plan.closed if whole else self.plan.logs

    def _name_part(self, agent: str) -> str:
        """Return the folder of an agent's runs in closed loop: a reference that is no agent drives less."""
        return "closed" if agent in self.agents else "reference"

    def _find_folder(self, part: str, prepared: PreparedRun) -> Path:
        return self.folder / RUNS_FOLDER / part / name_agent_folder(prepared.config.agent)

    def _show(
        self, prepared: PreparedRun, reference: Reference, progress: PaperProgress, executor: OpenLoopExecutor
    ) -> OpenLoopResults:
        config = prepared.config
        folder = self._find_folder("open", prepared)
        run = prepare_open_loop(reference, config.agent, config.options, folder, config.workers)
        shown = 0

        def report(_: int, __: int, result: OpenLoopScenario) -> None:
            nonlocal shown
            shown += 1
            progress.compared(result.id)

        try:
            results = evaluate_open(run, report, fresh=config.fresh, executor=executor)
        except WorldError as error:  # a worker died twice over one recording
            raise InputError(f"{folder}: {error}") from None
        progress.spared(len(self.plan.logs) * len(config.seeds) - shown)
        return results

    def _drive_conditions(
        self, name: str, prepared: PreparedRun, whole: Results, means: tuple[PaperProgress, EpisodeExecutor]
    ) -> Iterator[StudyRow]:
        """Yield the clean row, taken from the run in closed loop, and the others unless no CAV hears another."""
        progress, executor = means
        clean, *others = CONDITIONS
        first = StudyRow(name, clean, (select_results(whole, self.plan.channel),), reused=False)
        episodes = len(self.plan.channel) * len(prepared.config.seeds)
        if not any(scenario.exchanged for scenario in first.scenarios):
            progress.spared(episodes * len(others))
            return
        yield first
        for condition in others:
            progress.run(f"{name}, {condition.name}")
            results = evaluate(self._prepare(prepared, condition), progress, executor)
            yield StudyRow(name, condition, (results,), reused=False)

    def _prepare(self, prepared: PreparedRun, condition: ChannelCondition) -> PreparedRun:
        run = _restrict(prepared, self.plan.channel, self._find_folder("channel", prepared) / condition.folder)
        return make_variant(run, replace(run.config.options, comm=condition.comm), run.config.seeds, run.folder)


def _restrict(prepared: PreparedRun, scenarios: tuple[str, ...], folder: Path) -> PreparedRun:
    """Return a prepared run with some of its scenarios, in another folder."""
    chosen = tuple(scenario for scenario in prepared.scenarios if scenario.id in {*scenarios})
    pattern = "*" if len(chosen) == len(prepared.suite) else ",".join(scenario.id for scenario in chosen)
    config = replace(prepared.config, scenario=pattern, out=folder)
    fingerprint = compute_fingerprint(config, prepared.suite, chosen)
    return replace(prepared, config=config, scenarios=chosen, folder=folder, fingerprint=fingerprint)


def select_results(whole: Results, scenarios: tuple[str, ...]) -> Results:
    """Return the results of some scenarios of a run, with their means."""
    return summarize_run(whole.run, [result for result in whole.scenarios if result.id in {*scenarios}])


def is_surrogate(agent: str) -> bool:
    """Return whether an agent has a surrogate of a detector: such agents drive the scenarios of RQ3 only."""
    return agent.startswith(DETECTOR_PREFIX) and agent.endswith(SURROGATE_SUFFIX)


def _may_perturb(agent: str) -> bool:
    """Return whether an agent can be in the tables of RQ5: detectors and the reference are not."""
    return agent != REFERENCE and not agent.startswith(DETECTOR_PREFIX)
