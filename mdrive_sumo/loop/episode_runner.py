"""Run one episode: connect the agents of the CAVs to an `EpisodeSimulation`."""

from collections.abc import Callable, Mapping

from mdrive_sumo.contract import Observation, SensorSpec
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop.agent_driver import AgentDriver, AgentFailure
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.episode_config import EpisodeConfig
from mdrive_sumo.loop.episode_simulation import EpisodeSimulation
from mdrive_sumo.loop.frame_source import FrameSource, SimulatedFrames, SteppedWorld
from mdrive_sumo.loop.request_pace import make_pace

ObservationWatcher = Callable[[int, Mapping[str, Observation]], None]
"""Gets every tick with the observations of that tick, by CAV."""


def run_episode(
    config: EpisodeConfig,
    world: SteppedWorld,
    drivers: Mapping[str, AgentDriver],
    watch: ObservationWatcher | None = None,
    pace_s: float = 0.0,
) -> EpisodeRecord:
    """Run one scenario until every CAV has arrived, is blocked, deviated, timed out, or stands without an agent.

    `drivers` maps the id of every CAV to its agent; `watch` sees what they are given. If an agent fails, its own CAV
    brakes to a stop; others drive on. `pace_s`: time from the requests of a tick to those of the next one, see
    `RequestPace`; 0: none. It changes no result.
    Raises InputError for an invalid sensor and WorldError if the simulator fails.
    """
    simulation = start_agents(config, SimulatedFrames(config, world), drivers)
    pace = make_pace(pace_s)
    scheduler = AgentScheduler(drivers, config.options.clock, config.think_times, simulation.fail_agent, pace)
    observations = simulation.reset()
    while not simulation.is_done:
        if watch is not None:
            watch(simulation.tick, observations)
        replies = scheduler.collect_replies(simulation.tick, observations)
        observations = simulation.step(replies, busy=scheduler.find_busy(simulation.tick + 1))
    return simulation.finish(scheduler.think_times)


def start_agents(config: EpisodeConfig, frames: FrameSource, drivers: Mapping[str, AgentDriver]) -> EpisodeSimulation:
    """Ask the agents for their sensors, brief them, and return the simulation, which has not been reset yet.

    An agent that fails leaves its CAV without one. Raises InputError for an invalid sensor.
    """
    failures: dict[str, AgentFailure] = {}
    sensors = {ego.id: _declare_sensors(ego.id, drivers, failures) for ego in config.scenario.egos}
    simulation = EpisodeSimulation(config, frames, sensors)
    for ego, briefing in simulation.briefings.items():
        if ego not in failures:
            try:
                drivers[ego].start(briefing)
            except AgentFailure as error:
                failures[ego] = error
    for ego, error in failures.items():
        simulation.fail_agent(ego, error)
    return simulation


def _declare_sensors(
    ego: str, drivers: Mapping[str, AgentDriver], failures: dict[str, AgentFailure]
) -> tuple[SensorSpec, ...]:
    """Return the sensors that the agent of a CAV declares; none if it fails, with an entry in `failures`."""
    try:
        return drivers[ego].sensors()
    except AgentFailure as error:
        failures[ego] = error
        return ()
