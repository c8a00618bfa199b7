"""Drive a take again and see what its CAVs were shown: recordings hold what happened, not what was seen."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.contract import Briefing, SensorSpec
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import run_episode
from mdrive_sumo.loop.episode_runner import ObservationWatcher
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_difference import find_first_difference
from mdrive_sumo.runs.episode_job import EpisodeJob, build_episode_config, load_job_scenario, make_reexecution
from mdrive_sumo.runs.open_agents import open_human_driver


@dataclass(frozen=True, slots=True)
class ObservedTake:
    """A take that has been driven again, as it was recorded."""

    record: EpisodeRecord
    actions: Mapping[str, RecordedActions]
    """What was done in each CAV, and who drove it."""
    briefings: Mapping[str, Briefing]
    """What the driver of each CAV was told before the first tick."""


def is_take(agent: AgentSpec) -> bool:
    """Return whether the run of an agent is a take."""
    return agent.agent == HUMAN


def observe_take(
    job: EpisodeJob, record: EpisodeRecord, watch: ObservationWatcher, sensors: tuple[SensorSpec, ...] = ()
) -> ObservedTake:
    """Drive a take again; `watch` is shown every tick. Raises InputError if it is not the recorded episode.

    job: of the take, with its suite. It writes nothing. sensors: what `watch` is shown besides what drivers are; they
    change nothing.
    """
    actions = {ego: RecordedActions(record, ego) for ego in record.ego_ids}
    again = make_reexecution(job, record)
    scenario, roads = load_job_scenario(again)
    config = build_episode_config(again, scenario, roads)
    drivers = {ego: open_human_driver(ego, source, again.agent, sensors) for ego, source in actions.items()}
    with open_world(config) as world:
        driven = run_episode(config, world, drivers, watch)
    if difference := find_first_difference(record, driven):
        raise InputError(
            f"take of {record.scenario}: expected the episode of its recording, found another one from tick"
            f" {difference.tick} on ({difference.text}); `mdrive-sumo verify` says more"
        )
    told = {ego: driver.briefing for ego, driver in drivers.items()}
    return ObservedTake(record, actions, {ego: briefing for ego, briefing in told.items() if briefing is not None})
