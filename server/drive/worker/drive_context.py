"""DriveContext: what all takes of a drive have in common, loaded once, before any process is forked."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from mdrive_sumo.agents.human import HumanAgent
from mdrive_sumo.agents.registry import ASKING_AGENTS, HUMAN_AGENTS
from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.contract import Briefing
from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, EpisodeSimulation, SimulatedFrames
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.report.scene_3d import find_scene_area, pack_scene
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import build_episode_config, load_job_scenario
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.stored_run import StoredRun, load_viewed_run
from mdrive_sumo.runs.takes import HUMAN, DriverChoice, make_human_spec, prepare_take
from mdrive_sumo.scenario.packaged_suites import name_packaged_suite
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from server.drive.simulation_values import DriveFacts, DriveSetup
from server.drive.worker.take_actions import EnteredRun

MAX_CHECKPOINT_S = 60.0
"""Longest time between two checkpoints [s]: an episode."""
MAX_TICK_LIMIT_S = 3600.0
"""An hour: people who wait so long for a tick have gone."""
MAX_SPEED_UP = 1000.0
"""More than any machine computes."""


@dataclass(frozen=True)
class DriveContext:
    """Scenario, network and settings of a drive, and the run that it enters."""

    setup: DriveSetup
    """With the suite, options and agents of the run that is entered, if one is."""
    config: RunConfig
    suite: Suite
    scenario: Scenario
    roads: RoadMap
    episode: EpisodeConfig
    record: EpisodeRecord | None = None
    """The recording of the run that is entered."""
    agents: Mapping[str, DriverChoice] = field(default_factory=dict[str, DriverChoice])
    """The built-in agents of that run by CAV, which drive again up to the tick in which it is entered; none: its
    replies are repeated."""

    def prepare(self, folder: Path, device: str, latency_ms: float) -> PreparedRun:
        """Return the run of a take. device, latency_ms: provenance, see `make_human_spec`. Raises InputError."""
        options = {**self.config.agent.config, "device": device, "latency_ms": latency_ms}
        agent = replace(self.config.agent, config=options)
        return prepare_take(replace(self.config, agent=agent, out=folder, fresh=True), self.suite)

    @property
    def cavs(self) -> tuple[str, ...]:
        """All CAVs, in the order of the scenario file."""
        return tuple(ego.id for ego in self.scenario.egos)

    @property
    def substitutes(self) -> tuple[str, ...]:
        """Built-in agents that may drive."""
        return tuple(str(self.config.agent.config["substitutes"]).split(","))

    @cached_property
    def origin(self) -> tuple[float, float]:
        """The point [m], in whole metres, to which positions for pages are relative: the middle of all routes."""
        points = [point for ego in self.scenario.egos for point in ego.xy.tolist()]
        return tuple(round((min(values) + max(values)) / 2) for values in zip(*points, strict=True))

    def check_driver(self, cav: str, name: str, options: Mapping[str, Any]) -> DriverChoice:
        """Return the driver that a page names. Raises InputError unless it may drive this CAV."""
        if cav not in self.cavs:
            raise InputError(f"hand-over: CAV: {describe_unknown(cav, self.cavs)}")
        choice = DriverChoice(name, dict(options))
        if name != HUMAN:
            HumanAgent(self.config.agent.config).make_substitute(name, choice.config)
        return choice

    def check_substitutes(self, agents: Sequence[str], cavs: Sequence[str]) -> None:
        """Raise InputError unless these agents may drive these CAVs in what-if branches."""
        for agent in agents:
            if agent == HUMAN:
                raise InputError("what-if: expected agents, found a person")
            for cav in cavs or self.cavs[:1]:
                self.check_driver(cav, agent, {})

    def make_entered_run(self) -> EnteredRun | None:
        """Return the actions of the run that is entered. Raises InputError for a damaged recording."""
        if self.record is None:
            return None
        return EnteredRun(self.record, self.setup.from_tick, is_driven=bool(self.agents))

    def choose_driver(self, cav: str) -> DriverChoice:
        """Return who drives a CAV from the tick on in which people begin."""
        if cav in self.setup.people:
            return DriverChoice(HUMAN, {"device": self.setup.device})
        return DriverChoice(self.setup.others)

    def describe(self) -> dict[str, Any]:
        """Return what a continued drive must not change, for `tree.json`."""
        entered = {"from_tick": self.setup.from_tick} if self.record is not None else {}
        options = {name: self.config.agent.config[name] for name in ("substitutes", "v2x")}
        about = {"scenario": self.scenario.id, "suite": self.suite.name, "seed": self.setup.seed}
        return {**about, **options, "others": self.setup.others, **self.setup.options.to_dict(), **entered}

    def make_facts(self) -> DriveFacts:
        """Return what the server tells pages."""
        x, y = self.origin
        egos, vehicle = self.scenario.egos, replace(VEHICLE, grip=self.episode.road_grip)
        briefings = self._briefings
        return DriveFacts(
            scenario=self.scenario.id,
            description=self.scenario.description,
            suite=self.suite.name,
            seed=self.setup.seed,
            cavs=self.cavs,
            people=self.setup.people,
            origin=self.origin,
            routes={ego.id: [(round(px - x, 2), round(py - y, 2)) for px, py in ego.xy.tolist()] for ego in egos},
            speed_limits={ego: one.route_speed_limit.tolist() for ego, one in briefings.items()},
            room={ego: one.route_lane_width.tolist() for ego, one in briefings.items()},
            vehicle=asdict(vehicle),
            time_limit_ticks=compute_time_limit_ticks(self.scenario),
            agents=self.substitutes,
            weather=self.weather,
            pseudonyms=self.episode.pseudonyms,
            tick_s=DT,
        )

    def pack_scene(self) -> bytes:
        """Return what stands still around all routes, for pages."""
        points = np.concatenate([ego.xy for ego in self.scenario.egos])
        return pack_scene(self.roads, find_scene_area(points), self.weather, self.origin)

    @property
    def weather(self) -> WeatherName:
        """The weather of the scene."""
        return cast(WeatherName, self.setup.weather or self.scenario.weather)

    @cached_property
    def _briefings(self) -> Mapping[str, Briefing]:
        frames = SimulatedFrames(self.episode, open_world(self.episode))
        return EpisodeSimulation(self.episode, frames, dict.fromkeys(self.cavs, ())).briefings


def load_context(setup: DriveSetup) -> DriveContext:
    """Load the scenario of a drive, and the run that it enters. Raises InputError for whatever the user has to mend."""
    _check_setup(setup)
    if setup.from_run is None:
        return _load(setup, {})
    setup, recording, agents = _follow_run(setup, load_viewed_run(setup.from_run))
    record = load_episode(recording)
    last = max(ending.tick for ending in record.endings) - 1
    if not 0 <= setup.from_tick <= last:
        raise InputError(f"{setup.from_run}: tick: expected one before its end, 0 to {last}, found {setup.from_tick}")
    try:
        return replace(_load(setup, agents), record=record)
    except InputError:
        if not agents:
            raise
    return replace(_load(setup, {}), record=record)  # agents with options or sensors that a take cannot have


def _load(setup: DriveSetup, agents: Mapping[str, DriverChoice]) -> DriveContext:
    folder = find_scenario(setup.scenario, setup.suite or None, setup.seed).suite_folder
    assert folder is not None, "a scenario found by its id is in a suite"
    suite = load_suite(_name_suite(folder))
    names = dict.fromkeys((*setup.substitutes, setup.others, *(choice.name for choice in agents.values())))
    config = RunConfig(
        suite=_name_suite(folder),
        scenario=setup.scenario,
        agent=make_human_spec(tuple(names), setup.v2x, setup.device),
        options=setup.options,
        seeds=(setup.seed,),
        out=setup.folder,
    )
    on_board = HumanAgent(config.agent.config)
    for choice in agents.values():
        on_board.make_substitute(choice.name, choice.config)
    run = prepare_take(config, suite)
    job = run.make_job(run.scenarios[0])
    scenario, roads = load_job_scenario(job)
    _check_people(setup, scenario)
    return DriveContext(
        setup, config, suite, scenario, roads, build_episode_config(job, scenario, roads), agents=agents
    )


def _check_setup(setup: DriveSetup) -> None:
    if setup.weather and setup.weather not in get_args(WeatherName):
        raise InputError(f"weather: {describe_unknown(setup.weather, get_args(WeatherName))}")
    if setup.options.clock != IDEAL:
        raise InputError(f"agent clock: expected ideal, found {setup.options.clock.text}: people take their own time")
    if not 1.0 <= setup.speed_up <= MAX_SPEED_UP:
        raise InputError(f"speed_up: expected 1 to {MAX_SPEED_UP:g}, found {setup.speed_up!r}")
    if not 0 < setup.tick_limit_s <= MAX_TICK_LIMIT_S:
        raise InputError(f"tick_limit_s: expected up to {MAX_TICK_LIMIT_S:g} s, found {setup.tick_limit_s!r}")
    if not 0 <= setup.checkpoint_s <= MAX_CHECKPOINT_S:
        raise InputError(f"checkpoint_s: expected 0 to {MAX_CHECKPOINT_S:g} s, found {setup.checkpoint_s!r}")


def _check_people(setup: DriveSetup, scenario: Scenario) -> None:
    cavs = [ego.id for ego in scenario.egos]
    for cav in setup.people:
        if cav not in cavs:
            raise InputError(f"scenario {scenario.id}: CAV: {describe_unknown(cav, cavs)}")
    if len(set(setup.people)) < len(setup.people):
        raise InputError(f"CAVs of people: expected each once, found {', '.join(setup.people)}")


def _name_suite(folder: Path) -> str:
    """Return the exact name of a packaged suite, which is the same on all machines; the path of any other."""
    return name_packaged_suite(folder) or str(folder.resolve())


def _follow_run(setup: DriveSetup, stored: StoredRun) -> tuple[DriveSetup, Path, Mapping[str, DriverChoice]]:
    """Return the setup with suite and options of a run, the recording, and the agents of its CAVs that can drive again.

    All of them can, or none does.
    """
    run, config = stored.run, stored.run.config
    scenario = next((one for one in run.scenarios if one.id == setup.scenario), None)
    if scenario is None or setup.seed not in config.seeds:
        known = ", ".join(run.name_episode(key) for key in list(run.episodes)[:8])
        raise InputError(
            f"{setup.from_run}: expected an episode of the run ({known}), found {setup.scenario} seed {setup.seed}"
        )
    path = run.find_recording((setup.scenario, setup.seed))
    if not path.is_file():
        raise InputError(f"{setup.from_run}: expected the recording {path.name}, found none")
    options = replace(config.options, clock=IDEAL)
    followed = replace(_follow_take(setup, config), suite=_name_suite(run.suite.folder), options=options)
    can_drive = all(_can_drive(agent) for agent in config.agents) and config.options.clock == IDEAL
    return followed, path, _list_agents(config, scenario, setup.seed) if can_drive else {}


def _follow_take(setup: DriveSetup, config: RunConfig) -> DriveSetup:
    """Return the setup with the agents that drive in a take, and with what its cars send; else that of any run."""
    if config.agent.agent != HUMAN:
        return setup
    on_board = HumanAgent(config.agent.config)
    substitutes = dict.fromkeys((*setup.substitutes, *on_board.substitutes))
    return replace(setup, substitutes=tuple(substitutes), v2x="sharing" if on_board.has_v2x else "off")


def _can_drive(agent: AgentSpec) -> bool:
    """Return whether an agent of a run can drive again, so that its replies need not be repeated."""
    return agent.is_builtin and agent.agent not in HUMAN_AGENTS and agent.agent not in ASKING_AGENTS


def _list_agents(config: RunConfig, scenario: Scenario, seed: int) -> dict[str, DriverChoice]:
    agents = dict.fromkeys((ego.id for ego in scenario.egos), config.agent)
    if config.others is not None:
        tested = config.others.choose_tested(scenario, seed)
        agents |= {ego: config.others.agent for ego in agents if ego not in tested}
    return {ego: DriverChoice(str(agent.agent), agent.config) for ego, agent in agents.items()}
