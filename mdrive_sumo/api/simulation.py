"""Drive one scenario in this process: with an agent (`simulate`), or step by step (`Simulation`)."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, Self, Unpack, cast

from mdrive_sumo.agent_process.agent_lookup import find_carla_file, load_agent_class
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.api.episode import Episode
from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec, check_sensors
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_locator
from mdrive_sumo.core.setting import check_arguments
from mdrive_sumo.core.state import FailureReason, Frame
from mdrive_sumo.episode.episode_options import EpisodeArguments, EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, EpisodeSimulation, SimulatedFrames, run_episode
from mdrive_sumo.loop.agent_driver import AgentDriver, AgentFailure, LocalDriver, validate_reply
from mdrive_sumo.loop.human_actions import ActionSource
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.agent_spec import AgentFactory, AgentSpec
from mdrive_sumo.runs.open_agents import open_agents
from mdrive_sumo.runs.prepared_run import check_agent_name
from mdrive_sumo.runs.run_config import read_seed
from mdrive_sumo.runs.take_actions import complete_replay, load_take_actions
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.sumo import SumoWorld

DEFAULT_SENSORS = (SensorSpec("objects"),)
"""What the CAVs of a `Simulation` sense unless it names sensors: the objects around them."""


def simulate(
    scenario: str | Scenario,
    agent: str | AgentFactory = "idm",
    *,
    agent_config: Mapping[str, Any] | None = None,
    seed: int = 0,
    suite: str | Suite | None = None,
    raise_agent_errors: bool = True,
    **options: Unpack[EpisodeArguments],
) -> Episode:
    """Drive one scenario in this process and return the episode: the same one, bit for bit, as `evaluate` records.

    scenario: an id, or a scenario of a suite. seed: of all randomness; 0 is the scenario as written, any other draws
    starts, triggers and drivers (docs/benchmark.md). agent: a built-in name, a class, `module:Class`, `path.py:Class`
    or `carla:path.py`; every CAV gets an instance. suite: where the scenario is, by default the packaged suites.
    raise_agent_errors: an agent that fails raises AgentFailure here, with its own exception as the cause, instead of
    ending its CAV. options: `comm`, `agent_clock`, `actors`, `friction`, `ids`, `sensing`, as for `evaluate`.

    Raises InputError, WorldError and AgentFailure.
    """
    check_arguments(simulate, options, EpisodeOptions)
    seed = read_seed(seed)
    found, roads, folder = find_scenario(scenario, suite, seed)
    spec = AgentSpec(agent, agent_config or {})
    check_agent_name(spec)
    spec = complete_replay(spec.resolve())
    config = _make_config(found, roads, seed, spec.name, options)
    actions = load_take_actions(spec, found)
    Simulation.close_open()
    with _open_local_agents(spec, config.cav_pseudonyms, actions) as drivers, open_world(config) as world:
        if raise_agent_errors:
            drivers = {ego: cast(AgentDriver, _RaisingDriver(ego, driver)) for ego, driver in drivers.items()}
        try:
            record = run_episode(config, world, drivers)
        except _AgentError as error:
            raise AgentFailure(error.failure.failure, f"CAV {error.ego}: {error.failure.text}") from (
                error.failure.__cause__
            )
    return Episode(record, found, roads, seed, folder)


def _make_config(
    scenario: Scenario, roads: RoadMap, seed: int, agent: str, arguments: EpisodeArguments
) -> EpisodeConfig:
    options = EpisodeOptions.parse(**arguments)
    about = {"agent": hide_locator(agent), "seed": seed, **options.to_dict()}
    return EpisodeConfig(scenario, roads, seed, about, options=options)


@contextmanager
def _open_local_agents(
    spec: AgentSpec, pseudonyms: Mapping[str, str], actions: Mapping[str, ActionSource]
) -> Generator[Mapping[str, AgentDriver]]:
    """Start an agent for every CAV in this process; only an agent of the CARLA leaderboard needs a child process."""
    if isinstance(spec.agent, str) and (spec.agent in AGENTS or find_carla_file(spec.agent) is not None):
        with open_agents(spec, pseudonyms, actions=actions) as drivers:
            yield drivers
        return
    factory = load_agent_class(spec.agent) if isinstance(spec.agent, str) else spec.agent
    yield {ego: LocalDriver(factory(spec.config)) for ego in pseudonyms}


class _AgentError(Exception):
    """The failure of an agent on its way past the loop, which catches AgentFailure."""

    def __init__(self, ego: str, failure: AgentFailure) -> None:
        super().__init__(failure.text)
        self.ego, self.failure = ego, failure


class _RaisingDriver:
    """An AgentDriver whose failures leave the loop instead of ending the CAV."""

    def __init__(self, ego: str, driver: AgentDriver) -> None:
        self._ego, self._driver = ego, driver

    def __getattr__(self, name: str) -> Any:
        """Pass attributes on; methods raise _AgentError instead of AgentFailure."""
        value = getattr(self._driver, name)
        if not callable(value):
            return value

        def call(*arguments: Any) -> Any:
            try:
                return value(*arguments)
            except AgentFailure as error:
                raise _AgentError(self._ego, error) from None

        return call


class Simulation:
    """One episode whose loop the caller owns: `reset`, then `step` until `is_done`, then `episode`.

        with md.Simulation("i11_ins_sl_town") as simulation:
            observations = simulation.reset()
            while not simulation.is_done:
                observations = simulation.step({ego: decide(seen) for ego, seen in observations.items()})
        simulation.episode.replay()

    It is the tick of the benchmark: with the replies of an agent it gives the episode of that agent. SUMO holds one
    simulation per process, so opening another one closes this one.
    """

    _open: ClassVar["Simulation | None"] = None

    def __init__(
        self,
        scenario: str | Scenario,
        *,
        seed: int = 0,
        suite: str | Suite | None = None,
        sensors: Sequence[SensorSpec] | Mapping[str, Sequence[SensorSpec]] = DEFAULT_SENSORS,
        **options: Unpack[EpisodeArguments],
    ) -> None:
        """sensors: those of every CAV, or those of each CAV by id. The other arguments are those of `simulate`.

        There is no agent clock here: the caller may think as long as it likes. Raises InputError.
        """
        check_arguments(Simulation, options, EpisodeOptions)
        self.seed = read_seed(seed)
        self.scenario, self.roads, self._suite_folder = find_scenario(scenario, suite, self.seed)
        egos = [ego.id for ego in self.scenario.egos]
        by_ego = sensors if isinstance(sensors, Mapping) else dict.fromkeys(egos, sensors)
        self._sensors = {ego: check_sensors(by_ego.get(ego, ())) for ego in egos}
        if "agent_clock" in options:
            raise InputError("Simulation: agent_clock: expected none, for the caller replies in the tick it was asked")
        self._config = _make_config(self.scenario, self.roads, self.seed, "external", options)
        self._world: SumoWorld | None = None
        self._prepared: SumoWorld | None = open_world(self._config)
        """The world of the first `reset`: walls and briefings are made once."""
        self._simulation = self._make_simulation(self._prepared)

    def _make_simulation(self, world: SumoWorld) -> EpisodeSimulation:
        return EpisodeSimulation(self._config, SimulatedFrames(self._config, world), self._sensors)

    @classmethod
    def close_open(cls) -> None:
        """Close the simulation of this process that is open, if any."""
        if Simulation._open is not None:
            Simulation._open.close()

    @property
    def briefings(self) -> Mapping[str, Briefing]:
        """What an agent learns before the first tick, by CAV id: route, vehicle, speed limits, time limit."""
        return self._simulation.briefings

    @property
    def tick(self) -> int:
        """The current tick; 20 ticks are one second."""
        return self._simulation.tick

    @property
    def frame(self) -> Frame:
        """The true state of everything in the current tick."""
        return self._simulation.frame

    @property
    def active_egos(self) -> tuple[str, ...]:
        """Ids of the CAVs that have not ended, also of those whose agent failed and which brake."""
        return self._simulation.active_egos

    @property
    def is_done(self) -> bool:
        """Whether every CAV has ended."""
        return self._simulation.is_done

    @property
    def episode(self) -> Episode:
        """The recorded episode. Raises RuntimeError before the episode is done."""
        return Episode(self._simulation.finish(), self.scenario, self.roads, self.seed, self._suite_folder)

    def reset(self) -> dict[str, Observation]:
        """Start the episode, or start it anew, and return the first observations by CAV id. Raises WorldError."""
        Simulation.close_open()
        world = self._prepared
        if world is None:
            world = open_world(self._config)
            self._simulation = self._make_simulation(world)
        self._prepared = None
        self._world = world
        world.__enter__()
        Simulation._open = self
        return self._simulation.reset()

    def step(self, replies: Mapping[str, Reply]) -> dict[str, Observation]:
        """Apply a reply per CAV, advance by one tick, and return the new observations by CAV id.

        A CAV without a reply repeats its last control. The result is empty when every CAV has ended. Raises InputError
        for an unusable reply or a closed simulation, and WorldError if SUMO fails.
        """
        if self._world is None:
            raise InputError("step: expected an open simulation, found a closed one; reset() starts it anew")
        observations = self._simulation.step({ego: self._check(ego, reply) for ego, reply in replies.items()})
        if self.is_done:
            self.close()
        return observations

    def _check(self, ego: str, reply: object) -> Reply:
        if ego not in self._sensors:
            raise InputError(f"step: expected replies of {', '.join(self._sensors)}, found {ego!r}")
        try:
            return validate_reply(reply)
        except AgentFailure as error:
            raise InputError(f"step: reply of CAV {ego}: {error.text}") from None

    def end(self, ego: str, reason: str = "ended by the caller") -> None:
        """Give up the agent of a CAV: the car brakes to a stop, gets no more observations and ends `agent-failed`."""
        self._simulation.fail_agent(ego, AgentFailure(FailureReason.CRASHED, reason))

    def close(self) -> None:
        """Close SUMO. `episode` stays available if the episode is done."""
        if self._world is not None:
            self._world.__exit__(None, None, None)
            self._world = None
        if Simulation._open is self:
            Simulation._open = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
