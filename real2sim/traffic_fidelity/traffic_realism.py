"""Realism of traffic on the logs of a converted suite: of the log itself, of our traffic, of SUMO's defaults.

The CAVs and all scripted actors repeat the log; what is judged are the vehicles that SUMO drives, while the log has
them. Samples are 0.1 s apart, as in the challenge.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, CarFollowing
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import LOG_FILE, Suite
from real2sim.traffic_fidelity.drawn_traffic import sample_drawn
from real2sim.traffic_fidelity.log_simulation import TimedPath, run_beside_log
from real2sim.traffic_fidelity.realism_features import RoadUserStates, compute_features, find_collisions
from real2sim.traffic_fidelity.realism_score import (
    MEASURES,
    RealismSamples,
    compute_likelihoods,
    compute_pooled_likelihoods,
    compute_realism,
)

STRIDE = 2
"""Ticks from one sample to the next: 0.1 s."""
LEAST_SAMPLES = 11
"""A vehicle that the log has for less than a second says little; the challenge judges 8 s."""
LOG, SCHEDULED, FREE, DEFAULTS = "log replay", "scheduled", "free", "SUMO's defaults"
TITLES: Mapping[str, str] = {
    LOG: "the log itself, under its own histograms: the largest that a simulation can reach on average",
    SCHEDULED: "our traffic as converted: fitted drivers that aim at the log's progress",
    FREE: "our traffic without schedules: fitted drivers that only start as in the log",
    DEFAULTS: "SUMO's default passenger car and reaction time, started as in the log",
}
"""What drives the vehicles that are judged."""


@dataclass(frozen=True)
class LoggedScenario:
    """A converted scenario with its log: states at all samples, columns as in the recording."""

    scenario: Scenario
    roads: RoadMap
    log: EpisodeRecord

    @property
    def judged(self) -> tuple[str, ...]:
        """Ids of the vehicles that SUMO drives and the log has long enough."""
        driven = {vehicle.id for vehicle in self.scenario.background.vehicles}
        there = self.log.valid[::STRIDE].sum(axis=0)
        return tuple(
            id_
            for id_, count in zip(self.log.ids, there.tolist(), strict=True)
            if id_ in driven and count >= LEAST_SAMPLES
        )


def load_logged_scenarios(suite: Suite) -> list[LoggedScenario]:
    """Return the scenarios of a suite with their logs. Raises InputError for a suite that was not converted from
    logs."""
    loaded: list[LoggedScenario] = []
    for scenario in suite:
        path = suite.find_scenario_file(scenario.id).parent / LOG_FILE
        if not path.is_file():
            raise InputError(
                f"{path}: expected the log of a converted scenario, found none (mdrive-sumo convert SOURCE writes it)"
            )
        roads = load_road_map(_find_network(suite, scenario))
        one = LoggedScenario(scenario, roads, load_episode(path))
        if one.judged:
            loaded.append(one)
    if not loaded:
        raise InputError(f"{suite.folder}: expected vehicles that SUMO drives for a second or more, found none")
    return loaded


def _find_network(suite: Suite, scenario: Scenario) -> Path:
    return find_network_folder(scenario.network, suite.find_folder(scenario.id))


def build_variant(scenario: Scenario, name: str) -> Scenario:
    """Return the scenario with other drivers, by a name of `TITLES`."""
    before = scenario.background
    if name == SCHEDULED:
        background = before.model_copy(update={"mode": "reactive"})
    else:
        fields: dict[str, object] = {"schedule": None, "log": ()}
        if name == DEFAULTS:
            fields["driving"] = CarFollowing()
        vehicles = tuple(vehicle.model_copy(update=fields) for vehicle in before.vehicles)
        # SUMO's own action step is the length of its step
        background = Background(vehicles=vehicles, action_step_s=DT if name == DEFAULTS else before.action_step_s)
    return scenario.model_copy(update={"background": background})


def sample_log(logged: LoggedScenario) -> RealismSamples:
    """Return the samples of the judged vehicles in the log."""
    return _sample(logged, lambda _: None)


def sample_rollout(logged: LoggedScenario, name: str, seed: int) -> RealismSamples:
    """Return the samples of one simulation. Needs the process's only SUMO simulation."""
    log, scenario = logged.log, build_variant(logged.scenario, name)
    cavs = {log.ids[k]: _build_path(log, k) for k in range(log.egos)}
    sizes = {log.ids[k]: (float(log.length[k]), float(log.width[k])) for k in range(log.egos)}
    poses = np.full((3, log.ticks, len(log.ids)), np.nan)
    column = {id_: k for k, id_ in enumerate(log.ids)}
    for tick, actors in enumerate(run_beside_log(scenario, logged.roads, cavs, sizes, log.ticks, seed)):
        columns = [column[id_] for id_ in actors.ids]
        poses[:, tick, columns] = actors.x, actors.y, actors.yaw
    driven = {vehicle.id for vehicle in scenario.background.vehicles}
    return _sample(logged, lambda id_: poses[:, :, column[id_]] if id_ in driven else None)


def _build_path(log: EpisodeRecord, k: int) -> TimedPath:
    there = np.flatnonzero(log.valid[:, k])
    states = np.column_stack((log.x[there, k], log.y[there, k], np.unwrap(log.yaw[there, k]), log.speed[there, k]))
    return TimedPath(np.asarray(there * DT, dtype=np.float64), states)


def _sample(logged: LoggedScenario, find_poses: Callable[[str], Float | None]) -> RealismSamples:
    """Return the samples with the poses x, y, yaw (3, ticks) of some road users in the place of the log's."""
    log = logged.log
    x, y, yaw = (np.where(log.valid, values, np.nan) for values in (log.x, log.y, log.yaw))
    for k, id_ in enumerate(log.ids):
        poses = find_poses(id_)
        if poses is not None:
            x[:, k], y[:, k], yaw[:, k] = np.where(log.valid[:, k], poses, np.nan)
    rows = slice(None, None, STRIDE)
    states = RoadUserStates(x[rows], y[rows], yaw[rows], log.length, log.width, STRIDE * DT)
    judged = np.array([log.ids.index(id_) for id_ in logged.judged])
    features = compute_features(states, judged, logged.roads)
    return RealismSamples(features, find_collisions(features))


@dataclass(frozen=True)
class RealismRow:
    """Realism of one kind of traffic: the score, and the likelihood of every measure."""

    traffic: str
    realism: float
    likelihoods: Mapping[str, float]


@dataclass(frozen=True)
class RealismTable:
    """What was judged, and a row for each kind of traffic."""

    scenarios: int
    vehicles: int
    seconds: float
    """Vehicle seconds of the logs."""
    rollouts: int
    rows: tuple[RealismRow, ...]
    """Every vehicle under histograms of its own rollouts; means over the scenarios."""
    pooled: tuple[RealismRow, ...]
    """All logs under one histogram of all vehicles of a kind of traffic."""


def measure_realism(
    logs: Sequence[LoggedScenario],
    rollouts: int,
    drawn: Sequence[str] = (),
    report: Callable[[str], None] = lambda _: None,
) -> RealismTable:
    """Simulate all logs in all ways and compare. Needs the process's only SUMO simulation.

    drawn: demands of `DRAWN` whose traffic on drawn places is compared as well. `report` is called with the id of each
    scenario and demand before it is simulated.
    """
    logged: list[RealismSamples] = []
    samples: dict[str, list[list[RealismSamples]]] = {name: [] for name in (SCHEDULED, FREE, DEFAULTS)}
    for one in logs:
        report(one.scenario.id)
        logged.append(sample_log(one))
        for name, kept in samples.items():
            kept.append([sample_rollout(one, name, seed) for seed in range(rollouts)])
    populations = {name: _flatten(drives) for name, drives in samples.items()}
    for demand in drawn:
        report(demand)
        populations[f"drawn: {demand}"] = sample_drawn(demand, STRIDE)
    own = {LOG: [[sample] for sample in logged], **samples}
    there = sum(int(np.isfinite(sample.features["nearest"]).sum()) for sample in logged)
    return RealismTable(
        scenarios=len(logs),
        vehicles=sum(len(one.judged) for one in logs),
        seconds=there * STRIDE * DT,
        rollouts=rollouts,
        rows=tuple(_average(name, _score_each(logged, drives)) for name, drives in own.items()),
        pooled=(
            _average(LOG, [compute_pooled_likelihoods(sample, logged) for sample in logged]),
            *_score_held_out(logged),
            *(
                _average(name, [compute_pooled_likelihoods(sample, population) for sample in logged])
                for name, population in populations.items()
            ),
        ),
    )


HELD_OUT = "other logs"


def _score_held_out(logged: Sequence[RealismSamples]) -> Iterator[RealismRow]:
    """Return the row of logs under the histograms of all other logs, if there are others."""
    if len(logged) > 1:
        yield _average(
            HELD_OUT,
            [
                compute_pooled_likelihoods(sample, [other for j, other in enumerate(logged) if j != k])
                for k, sample in enumerate(logged)
            ],
        )


def _score_each(logged: Sequence[RealismSamples], drives: Sequence[Sequence[RealismSamples]]) -> list[dict[str, float]]:
    return [compute_likelihoods(sample, rollouts) for sample, rollouts in zip(logged, drives, strict=True)]


def _flatten(drives: Sequence[Sequence[RealismSamples]]) -> list[RealismSamples]:
    return [sample for rollouts in drives for sample in rollouts]


def _average(name: str, likelihoods: Sequence[Mapping[str, float]]) -> RealismRow:
    """Return the means over the scenarios, the realism score being the mean of the scenarios' scores."""
    means = {
        measure: float(np.mean(values))
        for measure in MEASURES
        if (values := [one[measure] for one in likelihoods if measure in one])
    }
    return RealismRow(name, float(np.mean([compute_realism(one) for one in likelihoods])), means)
