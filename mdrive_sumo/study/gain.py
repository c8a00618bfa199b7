"""The gain of sharing, split into what is seen, how well, and what is meant: occlusion, noise and intent."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import ResultTable, bootstrap_results, group_by_scenario, list_results
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, make_variant, name_agent_folder

PERFECT, REALISTIC = SensingProfile.PERFECT, SensingProfile.REALISTIC
SINGLE, SHARING, NEGOTIATING = "single", "sharing", "sharing+negotiation"
AGENTS = (SINGLE, SHARING, NEGOTIATING)
METRICS = ("ds", "sr")
ALL = "all"
"""Name of the group of all scenarios."""
Cell = tuple[SensingProfile, str]
"""A sensing profile and an agent."""


@dataclass(frozen=True, slots=True)
class GainPart:
    """A part of the gain: a signed sum of the scores of cells."""

    name: str
    meaning: str
    terms: Mapping[Cell, int]


PARTS = (
    GainPart(
        "occlusion",
        "objects that only others see: sharing - single, sensing perfect",
        {(PERFECT, SHARING): 1, (PERFECT, SINGLE): -1},
    ),
    GainPart(
        "noise",
        "errors of the own sensors that data of others make up for, less those that these bring:"
        " what sharing gains under realistic sensing beyond occlusion",
        {(REALISTIC, SHARING): 1, (REALISTIC, SINGLE): -1, (PERFECT, SHARING): -1, (PERFECT, SINGLE): 1},
    ),
    GainPart(
        "intent",
        "plans of others: sharing+negotiation - sharing, sensing realistic",
        {(REALISTIC, NEGOTIATING): 1, (REALISTIC, SHARING): -1},
    ),
    GainPart(
        "total",
        "the sum of the three: sharing+negotiation - single, sensing realistic",
        {(REALISTIC, NEGOTIATING): 1, (REALISTIC, SINGLE): -1},
    ),
)
CELLS: frozenset[Cell] = frozenset(cell for part in PARTS for cell in part.terms)
"""What has to be driven."""


@dataclass(frozen=True, slots=True)
class GainRow:
    """An agent under a sensing profile, with the results of every seed."""

    sensing: SensingProfile
    agent: str
    results: tuple[Results, ...]

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)


@dataclass(frozen=True, slots=True)
class GainStudy:
    """The runs of the study; agents: prepared runs by name."""

    agents: Mapping[str, PreparedRun]
    seeds: tuple[int, ...]
    folder: Path

    def episodes(self) -> int:
        """Return the number of episodes."""
        return len(self.seeds) * sum(len(self.agents[name].scenarios) for _, name in CELLS)

    def rows(self, progress: StudyProgress) -> Iterator[GainRow]:
        """Drive the unfinished runs and yield the rows. Raises InputError and KeyboardInterrupt."""
        for sensing, name in product(SensingProfile, self.agents):
            if (sensing, name) in CELLS:
                yield GainRow(sensing, name, tuple(self._drive(sensing, name, self.agents[name], progress)))

    def _drive(
        self, sensing: SensingProfile, name: str, prepared: PreparedRun, progress: StudyProgress
    ) -> Iterator[Results]:
        options = replace(prepared.config.options, sensing=sensing)
        folder = self.folder / RUNS_FOLDER / name_agent_folder(prepared.config.agent) / sensing
        for seed in self.seeds:
            progress.run(f"{name}, sensing {sensing}, seed {seed}")
            yield evaluate(make_variant(prepared, options, (seed,), folder / f"seed{seed}"), progress)


@dataclass(frozen=True, slots=True)
class GainLine:
    """A part of the gain, in points of DS or SR, over a group of scenarios."""

    group: str
    """Name of a bucket, or `ALL`."""
    scenarios: int
    part: GainPart
    gain: Mapping[str, ConfidenceInterval]
    """The gain [points] by metric."""


@dataclass(frozen=True, slots=True)
class ScoreLine:
    """The scores of a cell over a group of scenarios [%]."""

    group: str
    scenarios: int
    sensing: SensingProfile
    agent: str
    score: Mapping[str, ConfidenceInterval]


@dataclass(frozen=True, slots=True)
class GainSummary:
    """The numbers of the study."""

    scores: tuple[ScoreLine, ...]
    gains: tuple[GainLine, ...]
    void: int
    """Scenarios that are left out because an episode of theirs is void in some run."""


def summarise_gain(rows: Sequence[GainRow]) -> GainSummary:
    """Return scores and gains for every bucket and for all scenarios; the same scenarios and seeds count everywhere.

    Raises InputError if every scenario is void somewhere.
    """
    tables = {(row.sensing, row.agent): group_by_scenario(row.scenarios) for row in rows}
    bucket_by_id = {scenario.id: scenario.bucket for row in rows for scenario in row.scenarios}
    common = [name for name in bucket_by_id if all(name in table for table in tables.values())]
    if not common:
        raise InputError("study gain: expected scenarios that are void in no run, found none")
    buckets = {
        bucket: [scenario for scenario in common if bucket_by_id[scenario] == bucket]
        for bucket in bucket_by_id.values()
    }
    groups = {bucket: names for bucket, names in buckets.items() if names}
    if len(groups) != 1:
        groups[ALL] = common
    scores = [
        ScoreLine(group, len(names), *cell, _bootstrap({cell: 1}, tables, names))
        for group, names in groups.items()
        for cell in tables
    ]
    gains = [
        GainLine(group, len(names), part, _bootstrap(part.terms, tables, names))
        for group, names in groups.items()
        for part in PARTS
    ]
    return GainSummary(tuple(scores), tuple(gains), len(bucket_by_id) - len(common))


def _bootstrap(
    terms: Mapping[Cell, int], tables: Mapping[Cell, ResultTable], names: Sequence[str]
) -> dict[str, ConfidenceInterval]:
    """Return the interval of a signed sum of scores, paired by scenario and seed, by metric."""
    results = {cell: list_results(tables[cell], names) for cell in terms}
    return {
        metric: bootstrap_results(
            np.sum([[sign * getattr(one, metric) for one in results[cell]] for cell, sign in terms.items()], axis=0),
            results[next(iter(terms))],
        )
        for metric in METRICS
    }
