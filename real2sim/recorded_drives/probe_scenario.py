"""Drives of agents in a converted recording: the scores by which the scenarios of a bucket are chosen."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.generate.hard.reference_drive import drive_with, score_reference
from mdrive_sumo.generate.validation import FULL_SCORE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.v2x.comm_settings import PRESETS

SEEDS = (0, 1, 2)
"""Tables of results use others: what was chosen by a seed looks better with it."""
OPTIONS = EpisodeOptions(comm=PRESETS["realistic"])
"""Realistic sensing, realistic channel."""
BLIND, SINGLE, SHARING, BOTH, SOLVER = "constant-speed", "single", "sharing", "sharing+negotiation", "omniscient"


@dataclass(frozen=True, slots=True)
class AgentProbe:
    """An agent whose mean over `SEEDS` must lie between two bounds."""

    agent: str
    least: float
    most: float
    most_first: float = FULL_SCORE
    """The same for the first seed alone, which spares the others."""


PROBES = (
    AgentProbe(BLIND, 0.0, 80.0, 90.0),
    AgentProbe(SOLVER, FULL_SCORE, FULL_SCORE),
    AgentProbe(SINGLE, 0.0, FULL_SCORE),
    AgentProbe(SHARING, 0.0, FULL_SCORE),
    AgentProbe(BOTH, 0.0, FULL_SCORE),
)
"""The cheapest first. Where blind driving has hardly a conflict, nothing is there to be told apart."""


def probe_scenario(scenario: Scenario, roads: RoadMap) -> Mapping[str, float] | str:
    """Return the mean driving scores of the agents, or why the scenario is of no use. Raises WorldError."""
    means: dict[str, float] = {}
    for probe in PROBES:
        scores: list[float] = []
        for seed in SEEDS:
            try:
                episode = drive_with(probe.agent, scenario, roads, seed, OPTIONS)
            except InputError as error:
                return str(error)
            scores.append(score_reference(episode, scenario, roads, seed))
            highest = (math.fsum(scores) + FULL_SCORE * (len(SEEDS) - len(scores))) / len(SEEDS)
            if highest < probe.least or math.fsum(scores) / len(SEEDS) > probe.most or scores[0] > probe.most_first:
                return f"{probe.agent} has {', '.join(f'{score:.1f}' for score in scores)}"
        means[probe.agent] = round(math.fsum(scores) / len(scores), 3)
    return means
