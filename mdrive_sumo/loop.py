"""The tick: judge, sense, ask, move, step, record. See `run_episode`."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from mdrive_sumo import contact, control, criteria, dynamics
from mdrive_sumo.agents.driver import AgentFailure, Driver
from mdrive_sumo.contract import Briefing, Control, Observation, Plan, Reply, SensorSpec
from mdrive_sumo.episode import Ending, Episode, Recorder, quantised_frame
from mdrive_sumo.observation import Senses, briefing
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.seeding import derived_seed
from mdrive_sumo.state import TICKS_PER_SECOND, Actors, EgoState, End, Frame, Kind

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

    def start(self, egos: Mapping[str, EgoState]) -> Surroundings:
        """Places the egos; what surrounds them in frame 0."""
        ...

    def advance(self, egos: Mapping[str, EgoState], struck: Collection[str]) -> Surroundings:
        """Moves the egos to their new places (whoever is not named leaves) and everything else by one tick."""
        ...


@dataclass(frozen=True)
class Setting:
    """What stays the same during an episode."""

    scenario: Scenario
    roads: RoadMap
    seed: int
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Written into the recording: what identifies the run."""
    replayed: tuple[Ending, ...] = ()
    """Failures of a recorded run: they happen again in the same tick, for a time-out cannot be computed anew."""
    pass_through: bool = False
    """Boxes pass through each other; contacts are recorded all the same."""


def run_episode(setting: Setting, world: World, drivers: Mapping[str, Driver]) -> Episode:
    """Drives one scenario to its end: every CAV arrived, blocked, deviated, timed out, or its agent failed.

    Raises WorldError where the simulator fails; what an agent does wrong ends its CAV and nothing else.
    """
    scenario = setting.scenario
    run = _Run(setting, drivers)
    frame = quantised_frame(run.first_frame(world))
    while True:
        run.judge(frame)
        replies = run.replies(frame)
        run.recorder.add(frame, run.controls(frame, replies), run.plans)
        if not run.living:
            return run.recorder.finish([run.endings[ego.id] for ego in scenario.egos])
        frame = quantised_frame(run.next_frame(frame, world))


class _Run:
    """The state of one episode between two ticks."""

    def __init__(self, setting: Setting, drivers: Mapping[str, Driver]) -> None:
        scenario = setting.scenario
        self._setting, self._drivers = setting, drivers
        self._limit = criteria.time_limit_ticks(scenario)
        self._courses = {ego.id: criteria.course_of(ego) for ego in scenario.egos}
        self._trials = {ego.id: criteria.Trial() for ego in scenario.egos}
        self._bodies = {e.id: dynamics.at_rest(e.start.x, e.start.y, e.start.yaw) for e in scenario.egos}
        self._vehicles = dict.fromkeys(self._bodies, VEHICLE)
        self._walls = contact.walls(building.outline for building in setting.roads.buildings)
        self._followers: dict[tuple[str, str], control.Controller] = {}
        self._controls: dict[str, Control] = {}
        self.plans: dict[str, Plan] = {}
        self.endings: dict[str, Ending] = {}
        self.recorder = Recorder(
            scenario.id, setting.about, dict.fromkeys(self._bodies, (VEHICLE.length, VEHICLE.width))
        )
        self._senses = self._brief()

    @property
    def living(self) -> tuple[str, ...]:
        """CAVs that have not ended."""
        return tuple(ego for ego in self._bodies if ego not in self.endings)

    def _brief(self) -> Senses:
        setting, facts = self._setting, dynamics.facts(VEHICLE)
        limit_s = self._limit / TICKS_PER_SECOND
        briefings: dict[str, Briefing] = {}
        sensors: dict[str, tuple[SensorSpec, ...]] = {}
        for ego in setting.scenario.egos:
            seed = derived_seed(setting.seed, setting.scenario.id, "agent", ego.id)
            briefings[ego.id] = briefing(ego, setting.roads, facts, seed, limit_s)
            sensors[ego.id] = ()
            try:
                sensors[ego.id] = self._drivers[ego.id].sensors()
                self._drivers[ego.id].start(briefings[ego.id])
            except AgentFailure as error:
                self._fail(ego.id, 0, error)
        return Senses(sensors, briefings)

    def _fail(self, ego: str, tick: int, error: AgentFailure) -> None:
        self.endings[ego] = Ending(ego, tick, End.AGENT_FAILED, error.failure, error.text)

    def first_frame(self, world: World) -> Frame:
        """Every CAV at rest on its start."""
        states = {ego: dynamics.ego_state(body) for ego, body in self._bodies.items()}
        around = world.start(states)
        return Frame(0, states, around.actors, around.signals)

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

    def replies(self, frame: Frame) -> dict[str, Reply]:
        """Every living CAV's answer to the same frame."""
        living = self.living
        seen = self._senses.observe(frame, self.plans, living)
        asked = [ego for ego in living if self._asked(ego, frame.tick, seen[ego])]
        answers = {ego: self._answer(ego, frame.tick) for ego in asked}
        return {ego: reply for ego, reply in answers.items() if reply is not None}

    def _asked(self, ego: str, tick: int, seen: Observation) -> bool:
        try:
            self._drivers[ego].ask(seen)
        except AgentFailure as error:
            self._fail(ego, tick, error)
            return False
        return True

    def _answer(self, ego: str, tick: int) -> Reply | None:
        try:
            return self._drivers[ego].answer()
        except AgentFailure as error:
            self._fail(ego, tick, error)
            return None

    def controls(self, frame: Frame, replies: Mapping[str, Reply]) -> Mapping[str, Control]:
        """Pedals and wheel of every CAV that answered: its own, or those of the controller that follows its plan."""
        self.plans = {ego: reply.plan for ego, reply in replies.items() if reply.plan is not None}
        self._controls = {
            ego: reply.control if reply.control is not None else self._followed(ego, frame.egos[ego])
            for ego, reply in replies.items()
        }
        return self._controls

    def _followed(self, ego: str, state: EgoState) -> Control:
        plan = self.plans[ego]
        key = (ego, plan.controller)
        if key not in self._followers:
            self._followers[key] = control.CONTROLLERS[plan.controller](dynamics.facts(VEHICLE))
        return self._followers[key].follow(plan, state, 0)

    def next_frame(self, frame: Frame, world: World) -> Frame:
        """Moves the CAVs, lets the world move everything else, and lets nothing pass through anything."""
        before = {ego: self._bodies[ego] for ego in self.living}
        after = {ego: dynamics.step(body, self._controls[ego], VEHICLE) for ego, body in before.items()}
        around = world.advance(_states(after), self._struck(frame))
        obstacles = contact.obstacles(frame.actors, around.actors)
        settled, contacts = contact.settle(before, after, self._vehicles, obstacles, self._walls)
        self._bodies |= after if self._setting.pass_through else settled
        return Frame(
            frame.tick + 1,
            _states({e: self._bodies[e] for e in after}),
            around.actors,
            around.signals,
            contacts,
        )

    @staticmethod
    def _struck(frame: Frame) -> set[str]:
        return {c.other for c in frame.contacts if c.kind == Kind.VEHICLE and c.other not in frame.egos}


def _states(bodies: Mapping[str, dynamics.Body]) -> dict[str, EgoState]:
    return {ego: dynamics.ego_state(body) for ego, body in bodies.items()}
