"""One episode, tick by tick. See `run_episode`."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from mdrive_sumo.actors import ActorMode, ScriptedActors, Crowd
from mdrive_sumo.contract import STANDSTILL, Briefing, Control, Message, Plan, Reply, SensorSpec
from mdrive_sumo.core.clock import IDEAL, Clock
from mdrive_sumo.core.seeding import derived_seed
from mdrive_sumo.core.state import TICKS_PER_SECOND, Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, ReceivedMessages, Recorder, ThinkTime, quantised_frame
from mdrive_sumo.loop.agent_driver import AgentFailure, AgentDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WEATHERS, Friction
from mdrive_sumo.scoring import criteria
from mdrive_sumo.sensing.briefing_builder import briefing
from mdrive_sumo.sensing.observation_builder import Senses, Surrounds, scene_of
from mdrive_sumo.sensing.roadside_units import Roadside
from mdrive_sumo.sensing.scene import Scene
from mdrive_sumo.v2x.channel import Channel
from mdrive_sumo.v2x.comm import PRESETS, Comm
from mdrive_sumo.vehicle import contact, control, dynamics

VEHICLE = dynamics.MKZ_2017
"""Every CAV is the paper's car (protocol K6)."""


class Surroundings(Protocol):
    """What the world drives by itself."""

    @property
    def actors(self) -> Actors:
        """Everything but the CAVs."""
        ...

    @property
    def signals(self) -> Mapping[str, str]:
        """States of traffic lights."""
        ...


class World(Protocol):
    """What the loop needs of a simulator; `sumo.SumoWorld` is one, a fake in the tests another."""

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> Surroundings:
        """Places the egos and scripted road users; what else surrounds them in frame 0."""
        ...

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> Surroundings:
        """Moves both to their new places (whoever is not named leaves) and everything else by one tick."""
        ...


@dataclass(frozen=True)
class EpisodeConfig:
    """What stays the same during an episode."""

    scenario: Scenario
    roads: RoadMap
    seed: int
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Written into the recording: what identifies the run."""
    replayed: tuple[Ending, ...] = ()
    """Failures of a recorded run: they happen again in the same tick, for a time-out cannot be computed anew."""
    comm: Comm = PRESETS["ideal"]
    """What the V2X channel does to messages."""
    clock: Clock = IDEAL
    thought: tuple[ThinkTime, ...] = ()
    """How long the agents of a recorded run thought, for re-execution under a measured clock."""
    actors: ActorMode = ActorMode.DEFAULT
    """How scripted road users behave."""
    friction: Friction = Friction.DRY
    """How slippery the road is to CAVs. Nobody tells their agents: the briefing has the limits of a dry road."""
    pass_through: bool = False
    """Boxes pass through each other; contacts are recorded all the same."""


def run_episode(setting: EpisodeConfig, world: World, drivers: Mapping[str, AgentDriver]) -> EpisodeRecord:
    """Drives one scenario to its end: every CAV arrived, blocked, deviated, timed out, or its agent failed.

    Raises WorldError where the simulator fails; what an agent does wrong ends its CAV and nothing else.
    """
    scenario = setting.scenario
    run = _Run(setting, drivers)
    frame = quantised_frame(run.first_frame(world))
    while True:
        run.judge(frame)
        heard = run.channel.deliver(frame.tick, run.living)
        replies = run.replies(frame, heard)
        run.recorder.add(frame, run.controls(frame, replies), run.plans, heard)
        if not run.living:
            return run.finished([run.endings[ego.id] for ego in scenario.egos])
        frame = quantised_frame(run.next_frame(frame, world))


class _Run:
    """The state of one episode between two ticks."""

    def __init__(self, setting: EpisodeConfig, drivers: Mapping[str, AgentDriver]) -> None:
        scenario = setting.scenario
        self._setting = setting
        self._limit = criteria.time_limit_ticks(scenario)
        self._courses = {ego.id: criteria.course_of(ego) for ego in scenario.egos}
        self._trials = {ego.id: criteria.Trial() for ego in scenario.egos}
        self._bodies = {e.id: dynamics.rolling(e.start.x, e.start.y, e.start.yaw, e.start_speed) for e in scenario.egos}
        self._car = replace(VEHICLE, grip=setting.friction.grip(scenario.weather))
        self._vehicles = dict.fromkeys(self._bodies, self._car)
        self._walls = contact.walls(building.outline for building in setting.roads.buildings)
        self._cast, self._crowd = ScriptedActors(scenario, setting.roads, setting.actors), Crowd()
        self._followers: dict[tuple[str, str], control.Controller] = {}
        self._controls: dict[str, Control] = dict.fromkeys(self._bodies, STANDSTILL)
        self._mail: dict[str, tuple[Message, ...]] = dict.fromkeys(self._bodies, ())
        self.plans: dict[str, Plan] = {}
        self.endings: dict[str, Ending] = {}
        self._sizes = dict.fromkeys(self._bodies, (VEHICLE.length, VEHICLE.width))
        self.recorder = Recorder(scenario.id, setting.about, self._sizes)
        self.channel = Channel(setting.comm, derived_seed(setting.seed, scenario.id, "channel"))
        self._minds = AgentScheduler(drivers, setting.clock, setting.thought, self._fail)
        common = Surrounds(
            setting.roads, WEATHERS[scenario.weather], derived_seed(setting.seed, scenario.id, "sensing")
        )
        self._roadside = Roadside(scenario.rsus if setting.comm.on else (), common)
        self._senses = self._brief(drivers, common)

    @property
    def living(self) -> tuple[str, ...]:
        """CAVs that have not ended."""
        return tuple(ego for ego in self._bodies if ego not in self.endings)

    def _brief(self, drivers: Mapping[str, AgentDriver], common: Surrounds) -> Senses:
        setting, facts = self._setting, dynamics.facts(VEHICLE)
        limit_s = self._limit / TICKS_PER_SECOND
        briefings: dict[str, Briefing] = {}
        sensors: dict[str, tuple[SensorSpec, ...]] = {}
        for ego in setting.scenario.egos:
            seed = derived_seed(setting.seed, setting.scenario.id, "agent", ego.id)
            briefings[ego.id] = briefing(ego, setting.roads, facts, seed, limit_s)
            sensors[ego.id] = ()
            try:
                sensors[ego.id] = drivers[ego.id].sensors()
                drivers[ego.id].start(briefings[ego.id])
            except AgentFailure as error:
                self._fail(ego.id, 0, error)
        return Senses(sensors, briefings, common)

    def _fail(self, ego: str, tick: int, error: AgentFailure) -> None:
        self.endings[ego] = Ending(ego, tick, End.AGENT_FAILED, error.failure, error.text)

    def first_frame(self, world: World) -> Frame:
        """Every CAV on its start, with its start speed."""
        states = {ego: dynamics.ego_state(body) for ego, body in self._bodies.items()}
        around = world.start(states, self._cast.present)
        return Frame(0, states, self._crowd.merged(around.actors, self._cast.present), around.signals)

    def judge(self, frame: Frame) -> None:
        """Ends CAVs that arrived, deviated, were blocked or timed out by this frame (protocol 5 to 7)."""
        for ego in self.living:
            state = frame.egos[ego]
            self._trials[ego] = criteria.observe(
                self._trials[ego], self._courses[ego], frame.tick, state.x, state.y, state.speed
            )
            end = criteria.verdict(self._trials[ego], frame.tick, self._limit)
            if end is not None:
                self.endings[ego] = Ending(ego, frame.tick, end)
        for again in self._setting.replayed:
            if again.tick == frame.tick and again.ego not in self.endings:
                self.endings[again.ego] = again

    def replies(self, frame: Frame, heard: ReceivedMessages) -> dict[str, Reply]:
        """The answers that count from this frame on; what they and the road-side units say goes into the channel."""
        for ego, messages in heard.items():
            self._mail[ego] += messages
        replies = self._minds.due(frame.tick)
        free = self._minds.free(self.living)
        spoken = self._roadside.speaks(frame.tick)
        scene = scene_of(frame, self._sizes) if spoken or self._senses.needed(free) else None
        mail = {ego: self._mail[ego] for ego in free}
        self._mail |= dict.fromkeys(free, ())
        replies |= self._minds.ask(frame.tick, self._senses.observe(frame, scene, self.plans, mail))
        replies = {ego: reply for ego, reply in replies.items() if ego not in self.endings}
        self._say(frame, replies, scene if spoken else None)
        return replies

    def _say(self, frame: Frame, replies: Mapping[str, Reply], scene: Scene | None) -> None:
        said = {ego: reply.messages for ego, reply in replies.items() if reply.messages}
        for ego, reply in replies.items():
            self.recorder.note(frame.tick, ego, reply.notes)
        if scene is not None:
            said |= self._roadside.said(scene)
        if said:
            places = {ego: (frame.egos[ego].x, frame.egos[ego].y) for ego in self.living} | self._roadside.places
            self.channel.post(frame.tick, said, places, receivers=self.living)

    def controls(self, frame: Frame, replies: Mapping[str, Reply]) -> Mapping[str, Control]:
        """Pedals and wheel of every living CAV: its own, those of the controller that follows its plan, or its last."""
        for ego, reply in replies.items():
            if reply.plan is not None:
                self.plans[ego] = reply.plan
            else:
                self.plans.pop(ego, None)
        for ego, reply in replies.items():
            self._controls[ego] = reply.control if reply.control is not None else self._followed(ego, frame.egos[ego])
        self.plans = {ego: plan for ego, plan in self.plans.items() if ego not in self.endings}
        self._controls = {ego: self._controls[ego] for ego in self.living}
        return self._controls

    def finished(self, endings: list[Ending]) -> EpisodeRecord:
        """The read-only record of it all."""
        return self.recorder.finish(endings, self.channel.log(), self._minds.thought)

    def _followed(self, ego: str, state: EgoState) -> Control:
        plan = self.plans[ego]
        key = (ego, plan.controller)
        if key not in self._followers:
            self._followers[key] = control.CONTROLLERS[plan.controller](dynamics.facts(VEHICLE))
        return self._followers[key].follow(plan, state, 0)

    def next_frame(self, frame: Frame, world: World) -> Frame:
        """Moves the CAVs, lets the world move everything else, and lets nothing pass through anything."""
        before = {ego: self._bodies[ego] for ego in self.living}
        after = {ego: dynamics.step(body, self._controls[ego], self._car) for ego, body in before.items()}
        struck = self._struck(frame)
        scripted = self._cast.advance(replace(frame, egos={ego: frame.egos[ego] for ego in before}), struck)
        around = world.advance(_states(after), scripted, struck)
        actors = self._crowd.merged(around.actors, scripted)
        obstacles = contact.obstacles(frame.actors, actors)
        settled, contacts = contact.settle(before, after, self._vehicles, obstacles, self._walls)
        self._bodies |= after if self._setting.pass_through else settled
        return Frame(
            frame.tick + 1,
            _states({e: self._bodies[e] for e in after}),
            actors,
            around.signals,
            contacts,
        )

    @staticmethod
    def _struck(frame: Frame) -> set[str]:
        """Actors that a CAV met in this frame; they stand for a while (props always do)."""
        return {c.other for c in frame.contacts if c.kind != Kind.STATIC and c.other not in frame.egos}


def _states(bodies: Mapping[str, dynamics.Body]) -> dict[str, EgoState]:
    return {ego: dynamics.ego_state(body) for ego, body in bodies.items()}
