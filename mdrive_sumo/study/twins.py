"""The study of twins: what each factor of a scenario costs each agent, paired with the scenario as it is."""

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file, make_folder, write_text
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE, read_network_file
from mdrive_sumo.roads.road_map import find_network_folder
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare_with_suite
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.scenario.reference_times import find_reference_times, save_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scoring import EgoResult, Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import bootstrap_results, group_by_scenario
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, compute_mean
from mdrive_sumo.study.occlusion_certificate import REFERENCE_OPTIONS
from mdrive_sumo.study.study_runs import BEST, RUNS_FOLDER, StudyProgress, make_variant, name_agent_folder
from mdrive_sumo.study.twin_scenarios import (
    NO_CONFLICTS,
    HiddenConflicts,
    Twin,
    TwinFactor,
    find_hidden_conflicts,
    list_hidden_pairs,
    make_twin,
)
from mdrive_sumo.v2x.comm_settings import PRESETS

METRICS = ("ds", "sr")
SUITES_FOLDER = "suites"
ORIGINAL = "original"
"""Folder of the runs of the scenarios as they are."""
REFERENCE_FOLDER = "reference"
"""Folder of the drive of `omniscient` in which occluders are found."""
NEEDS_DRIVE = frozenset({TwinFactor.OCCLUDER, TwinFactor.BACKGROUND})
TwinPair = tuple[ScenarioResult, ScenarioResult]
"""The result of an episode of the original with the scores that are compared, and the same with those of the twin."""


@dataclass(frozen=True, slots=True)
class TwinGap:
    """A twin that cannot be made."""

    scenario: str
    factor: TwinFactor
    reason: str


@dataclass(frozen=True, slots=True)
class TwinRow:
    """An agent in the scenarios as they are (factor None), or in their twins of a factor."""

    agent: str
    factor: TwinFactor | None
    results: tuple[Results, ...]
    """Of the run with all seeds; empty if no twin could be made."""
    twins: tuple[Twin, ...] = ()
    gaps: tuple[TwinGap, ...] = ()

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)


@dataclass(frozen=True, slots=True)
class TwinStudy:
    """The runs of the study. agents: prepared runs of the original scenarios, by name."""

    agents: Mapping[str, PreparedRun]
    factors: tuple[TwinFactor, ...]
    stranger: AgentSpec
    seeds: tuple[int, ...]
    folder: Path

    @property
    def _first(self) -> PreparedRun:
        return next(iter(self.agents.values()))

    def episodes(self) -> int:
        """Return the largest possible number of episodes."""
        scenarios = len(self._first.scenarios)
        drives = len(self.agents) * (1 + len(self.factors)) * len(self.seeds)
        return scenarios * (drives + bool(NEEDS_DRIVE & set(self.factors)))

    def rows(self, progress: StudyProgress) -> Iterator[TwinRow]:
        """Make the twins, drive the unfinished runs and yield the rows. Raises InputError and KeyboardInterrupt."""
        conflicts = self._find_conflicts(progress)
        made = {factor: self._make_twins(factor, conflicts) for factor in self.factors}
        if not any(twins for twins, _ in made.values()):
            first = next(gap for _, gaps in made.values() for gap in gaps)
            raise InputError(f"study twins: expected a twin that can be made, found none: {first.reason}")
        for _, gaps in made.values():
            progress.spared(len(gaps) * len(self.seeds) * len(self.agents))
        suites = {
            factor: _save_suite(twins, self._first.suite, self.folder / SUITES_FOLDER / factor)
            for factor, (twins, _) in made.items()
            if twins
        }
        for name, prepared in self.agents.items():
            yield TwinRow(name, None, (self._drive(name, prepared, ORIGINAL, progress),))
            for factor, (twins, gaps) in made.items():
                runs = [self._prepare(prepared, factor, suites[factor])] if twins else []
                results = tuple(self._drive(name, run, factor, progress) for run in runs)
                yield TwinRow(name, factor, results, twins, gaps)

    def _find_conflicts(self, progress: StudyProgress) -> Mapping[str, HiddenConflicts]:
        """Return the hidden conflicts by scenario; drives `omniscient` where a certificate names a pair."""
        suite, scenarios = self._first.suite, self._first.scenarios
        pairs = list_hidden_pairs(suite) if NEEDS_DRIVE & set(self.factors) else {}
        hidden = [scenario for scenario in scenarios if pairs.get(scenario.id)]
        if NEEDS_DRIVE & set(self.factors):
            progress.spared(len(scenarios) - len(hidden))
        if not hidden:
            return {}
        config = replace(
            self._first.config,
            scenario=_join_ids(hidden),
            agent=AgentSpec(BEST),
            options=REFERENCE_OPTIONS,
            seeds=(0,),
            record=True,
            out=self.folder / RUNS_FOLDER / REFERENCE_FOLDER,
        )
        run = prepare_with_suite(config, suite)
        progress.run("occluders, in the drive of omniscient")
        driven = {result.id: result for result in evaluate(run, progress).scenarios if result.status == "ok"}
        return {
            scenario.id: find_hidden_conflicts(
                pairs[scenario.id], load_recording(run, driven[scenario.id]), _load_roads(scenario, suite)
            )
            for scenario in hidden
            if scenario.id in driven
        }

    def _make_twins(
        self, factor: TwinFactor, conflicts: Mapping[str, HiddenConflicts]
    ) -> tuple[tuple[Twin, ...], tuple[TwinGap, ...]]:
        twins: list[Twin] = []
        gaps: list[TwinGap] = []
        for scenario in self._first.scenarios:
            roads = _load_roads(scenario, self._first.suite)
            try:
                twins.append(make_twin(scenario, roads, factor, conflicts.get(scenario.id, NO_CONFLICTS)))
            except InputError as error:
                gaps.append(TwinGap(scenario.id, factor, str(error)))
        return tuple(twins), tuple(gaps)

    def _prepare(self, prepared: PreparedRun, factor: TwinFactor, suite: Suite) -> PreparedRun:
        """Return the run of an agent in the twins of a factor. Raises InputError."""
        folder, mode = str(suite.folder), prepared.config.score_mode
        config = replace(prepared.config, suite=folder, scenario="*", chosen_mode=mode)
        if factor is TwinFactor.CONNECTION:
            config = replace(config, options=replace(config.options, comm=PRESETS["off"]))
        if factor is TwinFactor.STRANGER:  # "under test" is what drives exactly one CAV
            config = replace(config, agent=self.stranger, others=OtherAgents(config.agent))
        return prepare_with_suite(config, suite)

    def _drive(self, name: str, prepared: PreparedRun, part: str, progress: StudyProgress) -> Results:
        """Return the results of a run with all seeds: few long runs keep many cores busy."""
        agent = self.agents[name].config.agent
        folder = self.folder / RUNS_FOLDER / name_agent_folder(agent) / part
        progress.run(f"{name}, {part}")
        return evaluate(make_variant(prepared, prepared.config.options, self.seeds, folder), progress)


def _join_ids(scenarios: Iterable[Scenario]) -> str:
    return ",".join(scenario.id for scenario in scenarios)


def _load_roads(scenario: Scenario, suite: Suite) -> RoadMap:
    return load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))


def _save_suite(twins: Sequence[Twin], original: Suite, folder: Path) -> Suite:
    """Write the twins of a factor as a suite, with the reference times of the originals, in place of an older one.

    A scenario without some buildings has a network of its own.
    """
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder)
    with atomic_folder(folder) as draft:
        scenarios = tuple(_save_network(twin, original, draft) for twin in twins)
        about = SuiteFile(
            name=original.about.name,
            title=f"{original.about.title}: twins, {twins[0].factor}",
            score_mode=original.score_mode,
        )
        save_suite(Suite(about, draft, scenarios))
        ids = {scenario.id for scenario in scenarios}
        measured = {
            one.id: find_reference_times(one, original.find_folder(one.id))
            for one in original.scenarios
            if one.id in ids
        }
        save_reference_times(load_suite(str(draft)), {name: ticks for name, ticks in measured.items() if ticks})
    return load_suite(str(folder))


def _save_network(twin: Twin, original: Suite, draft: Path) -> Scenario:
    """Write the network of a twin unless it is a packaged one; return the twin with the name of its network."""
    home = original.find_folder(twin.scenario.id)
    source = find_network_folder(twin.scenario.network, home)
    about = read_network_file(source)
    is_changed = len(twin.roads.buildings) < len(about.buildings)
    name = f"{twin.scenario.network}.{twin.scenario.id}" if is_changed else twin.scenario.network
    target = draft / NETWORKS_FOLDER / name
    if not target.is_dir() and (is_changed or source.is_relative_to(home)):
        make_folder(draft / NETWORKS_FOLDER)
        make_folder(target)
        copy_file(twin.roads.net_file, target / twin.roads.net_file.name)
        changed = about.model_copy(update={"name": name, "buildings": twin.roads.buildings})
        write_text(target / NETWORK_FILE, changed.model_dump_json(indent=1) + "\n")
    return twin.scenario.model_copy(update={"network": name})


@dataclass(frozen=True, slots=True)
class TwinLine:
    """What a factor does to an agent, over the scenarios that have the twin and are void in neither [%]."""

    agent: str
    factor: TwinFactor
    scenarios: int
    original: Mapping[str, ConfidenceInterval]
    twin: Mapping[str, ConfidenceInterval]
    change: Mapping[str, ConfidenceInterval]
    """Twin - original, paired by scenario and seed, by metric."""
    pairs: tuple[TwinPair, ...]


@dataclass(frozen=True, slots=True)
class TwinSummary:
    """The numbers of the study."""

    lines: tuple[TwinLine, ...]
    gaps: tuple[TwinGap, ...]
    void: int
    """Pairs of an agent, a scenario and a factor that are left out because an episode is void."""


def summarise_twins(rows: Sequence[TwinRow]) -> TwinSummary:
    """Return a line for each agent and factor that has twins. Raises InputError if all of them are void."""
    lines = tuple(compare_pairs(*key, pairs) for key, pairs in pair_twins(rows).items())
    if not lines:
        raise InputError("study twins: expected twins that are not void, found none")
    first = rows[0].agent
    gaps = tuple(gap for row in rows if row.agent == first for gap in row.gaps)
    planned = sum(len(row.twins) for row in rows)
    return TwinSummary(lines, gaps, planned - sum(line.scenarios for line in lines))


def pair_twins(rows: Sequence[TwinRow]) -> dict[tuple[str, TwinFactor], tuple[TwinPair, ...]]:
    """Return the pairs of episodes that are void in neither, by agent and factor; those without any are left out."""
    originals = {row.agent: group_by_scenario(row.scenarios) for row in rows if row.factor is None}
    found: dict[tuple[str, TwinFactor], tuple[TwinPair, ...]] = {}
    for row in rows:
        twins = group_by_scenario(row.scenarios)
        pairs = tuple(
            _pair(base, twins[name][seed])
            for name, by_seed in originals[row.agent].items()
            if row.factor is not None and name in twins
            for seed, base in sorted(by_seed.items())
        )
        if row.factor is not None and pairs:
            found[row.agent, row.factor] = pairs
    return found


def compare_pairs(agent: str, factor: TwinFactor, pairs: Sequence[TwinPair]) -> TwinLine:
    """Return the line of an agent and a factor; one pair or more."""
    before, after = zip(*pairs, strict=True)
    scores = {m: [np.array([getattr(one, m) for one in results]) for results in (before, after)] for m in METRICS}
    return TwinLine(
        agent,
        factor,
        len({base.id for base in before}),
        {metric: bootstrap_results(values[0], before) for metric, values in scores.items()},
        {metric: bootstrap_results(values[1], before) for metric, values in scores.items()},
        {metric: bootstrap_results(values[1] - values[0], before) for metric, values in scores.items()},
        tuple(pairs),
    )


def _pair(base: ScenarioResult, twin: ScenarioResult) -> TwinPair:
    """Return original and twin with the scores to compare: with a stranger those of the CAVs that it does not drive."""
    own = {ego.id for ego in twin.egos if ego.is_other}
    if not own:
        return base, base.model_copy(update={metric: getattr(twin, metric) for metric in METRICS})
    before, after = (
        base.model_copy(update=_score_cavs([ego for ego in one.egos if ego.id in own])) for one in (base, twin)
    )
    return before, after


def _score_cavs(egos: Sequence[EgoResult]) -> dict[str, float]:
    """Return DS and SR [%] of some CAVs: means over them, with the time factors of mode `hard`."""
    scores = [ego.ds * (1.0 if ego.time_factor is None else ego.time_factor) for ego in egos]
    means = {"ds": compute_mean(scores), "sr": 100.0 * compute_mean(ego.ds > SUCCESS_DS for ego in egos)}
    return {metric: round(mean, 6) for metric, mean in means.items()}  # as results have them
