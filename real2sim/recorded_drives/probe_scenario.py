"""Drives of agents in a converted recording: the scores by which the scenarios of a bucket are chosen."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.generate.hard.reference_drive import drive_with, score_reference
from mdrive_sumo.generate.validation import FULL_SCORE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.v2x.comm_settings import PRESETS

SEEDS, SOLVER_SEEDS = (0, 1, 2), (8, 9, 10, 11)
"""Tables of results use others: what was chosen by a seed looks better with it. `omniscient` must also solve what the
second ones draw, because a scenario that it solves with three seeds it fails with one of twenty others."""
OPTIONS = EpisodeOptions(comm=PRESETS["realistic"])
"""Realistic sensing, realistic channel."""
LATE_OPTIONS = EpisodeOptions(
    comm=replace(PRESETS["realistic"], link=replace(PRESETS["realistic"].link, latency_ticks=6))
)
"""The same with the paper's latency."""
BLIND, SINGLE, SHARING, BOTH, SOLVER = "constant-speed", "single", "sharing", "sharing+negotiation", "omniscient"
LATE = "sharing, 6 ticks late"


@dataclass(frozen=True, slots=True)
class AgentProbe:
    """An agent whose mean over the seeds must lie between two bounds."""

    agent: str
    least: float
    most: float
    most_first: float = FULL_SCORE
    """The same for the first seed alone, which spares the others."""
    options: EpisodeOptions = OPTIONS
    seeds: tuple[int, ...] = SEEDS


PROBES: Mapping[str, AgentProbe] = MappingProxyType(
    {
        BLIND: AgentProbe(BLIND, 0.0, 80.0, 90.0),
        SOLVER: AgentProbe(SOLVER, FULL_SCORE, FULL_SCORE, seeds=(*SEEDS, *SOLVER_SEEDS)),
        SINGLE: AgentProbe(SINGLE, 0.0, FULL_SCORE),
        SHARING: AgentProbe(SHARING, 0.0, FULL_SCORE),
        BOTH: AgentProbe(BOTH, 0.0, FULL_SCORE),
        LATE: AgentProbe(SHARING, 0.0, FULL_SCORE, options=LATE_OPTIONS),
    }
)
"""By name, those that exclude most first. Where blind driving has hardly a conflict, nothing is there to be told
apart."""


def probe_scenario(scenario: Scenario, roads: RoadMap) -> Mapping[str, float] | str:
    """Return the mean driving scores by probe, or why the scenario is of no use. Raises WorldError."""
    means: dict[str, float] = {}
    for name, probe in PROBES.items():
        scores: list[float] = []
        for seed in probe.seeds:
            try:
                episode = drive_with(probe.agent, scenario, roads, seed, probe.options)
            except InputError as error:
                return str(error)
            scores.append(score_reference(episode, scenario, roads, seed))
            count = len(probe.seeds)
            highest = (math.fsum(scores) + FULL_SCORE * (count - len(scores))) / count
            if highest < probe.least or math.fsum(scores) / count > probe.most or scores[0] > probe.most_first:
                return f"{name} has {', '.join(f'{score:.1f}' for score in scores)}"
        means[name] = round(math.fsum(scores) / len(scores), 3)
    return means
