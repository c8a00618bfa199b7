"""EpisodeStepper: the simulation of one environment, from decision to decision, in this process.

It drives `mdrive_sumo.Simulation`, whose step is the tick of the benchmark; the episodes are those of `simulate`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.api.simulation import Simulation
from mdrive_sumo.contract import Message, Observation, Reply, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import RoadUsers
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver
from mdrive_sumo.rl import driving_actions
from mdrive_sumo.rl.driving_reward import DrivingReward
from mdrive_sumo.rl.env_settings import PRIVILEGED, EnvSettings, EpisodeChoice
from mdrive_sumo.rl.grid_view import describe_grid, list_grid_sensors, read_grid
from mdrive_sumo.rl.message_slots import LEARNED, MessageSlots
from mdrive_sumo.rl.observation_vector import ObservationVector, count_numbers
from mdrive_sumo.rl.route_cursor import RouteCursor
from mdrive_sumo.rl.slot_arrays import SlotArrays, SlotShape, SlotStatus
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.suite import Suite, load_suite_of_one
from mdrive_sumo.scoring.metrics import ScoredEpisode, build_ego_records
from mdrive_sumo.scoring.score_mode import compute_driving_score

OWN_SENSOR = SensorSpec("objects", range_m=100.0)
"""What observations of the view `own` read: detections of what is in sight. The view `privileged` reads the frame."""
SlotInfo = dict[str, Any]
"""What the infos say of one learner."""


def describe_shape(settings: EnvSettings, slots: int) -> SlotShape:
    """Return the sizes of the arrays of an environment."""
    width = count_numbers(settings.nearest, settings.senders, settings.message_bytes)
    control = driving_actions.CONTROL_WIDTH[settings.control]
    return SlotShape(slots, width, control, settings.message_bytes, describe_grid(settings.grid))


class _Learner:
    """One CAV that a policy drives."""

    def __init__(self, ego: str, simulation: Simulation, settings: EnvSettings) -> None:
        scenario_ego = next(one for one in simulation.scenario.egos if one.id == ego)
        self.ego = ego
        self.cursor = RouteCursor(simulation.briefings[ego])
        self.heard = MessageSlots(settings.senders, settings.message_bytes)
        self.vector = ObservationVector(simulation.briefings[ego], self.cursor, self.heard, settings.nearest)
        self.reward = DrivingReward(scenario_ego, simulation.scenario, simulation.roads)
        self.plan: driving_actions.PlanSource | None = None
        """Plans of the latest action, unless it was pedals."""


class EpisodeStepper:
    """Drives one episode after the other; actions and results are in `arrays`."""

    def __init__(self, settings: EnvSettings, arrays: SlotArrays) -> None:
        self._settings, self._arrays = settings, arrays
        self._simulation: Simulation | None = None
        self._learners: dict[int, _Learner] = {}
        """By slot; those that have ended are not in it."""
        self._others: dict[str, LocalDriver] = {}
        self._observations: Mapping[str, Observation] = {}
        self._egos: dict[int, str] = {}
        self._suites: dict[tuple[str, str], Suite] = {}

    def reset(self, episode: EpisodeChoice) -> dict[int, SlotInfo]:
        """Start an episode; write the first observations, and return infos by slot. Raises InputError, WorldError."""
        settings, arrays = self._settings, self._arrays
        self.close()
        ids = settings.find_cavs(episode)
        others = self._open_others(ids)
        seeing = () if settings.view == PRIVILEGED else (OWN_SENSOR,)
        seeing += list_grid_sensors(settings.grid, settings.ticks_per_decision)
        sensors = {ego: others[ego].sensors() if ego in others else seeing for ego in ids}
        simulation = Simulation(
            episode.scenario, seed=episode.seed, suite=self._load_suite(episode), sensors=sensors,
            **settings.options,
        )  # fmt: skip
        learning = [ego for ego in ids if ego not in others]
        self._egos = dict(enumerate(learning))
        self._learners = {slot: _Learner(ego, simulation, settings) for slot, ego in self._egos.items()}
        self._others = others
        for ego, driver in others.items():
            driver.start(simulation.briefings[ego])
        self._simulation = simulation
        self._observations = simulation.reset()
        arrays.observations[:] = 0.0
        arrays.grids[:] = 0
        arrays.rewards[:] = 0.0
        arrays.status[:] = SlotStatus.RESTING
        for slot, learner in self._learners.items():
            learner.reward.add(simulation.frame)
            learner.reward.take_reward()
            arrays.status[slot] = SlotStatus.ACTIVE
        self._write_observations(simulation)
        return {
            slot: {"cav": ego, "suite": episode.suite, "scenario": episode.scenario, "seed": episode.seed}
            for slot, ego in self._egos.items()
        }

    def step(self) -> dict[int, SlotInfo]:
        """Drive one decision with the actions in the arrays; return the scores by slot if the episode is done."""
        simulation = self._simulation
        if simulation is None or simulation.is_done:
            raise InputError("step: expected an episode that runs, found none; reset() starts one")
        arrays = self._arrays
        ended: set[int] = set()
        replies = self._read_actions()
        for tick in range(self._settings.ticks_per_decision):
            if tick:
                replies = {}
            self._add_plans(replies, with_message=tick == 0)
            self._ask_others(simulation, replies)
            before = simulation.active_egos
            self._observations = simulation.step(replies)
            ended |= self._take_tick(simulation, before)
            if simulation.is_done:
                break
        arrays.rewards[:] = 0.0
        arrays.status[:] = SlotStatus.RESTING
        for slot, learner in tuple(self._learners.items()):
            arrays.rewards[slot] = learner.reward.take_reward()
            arrays.status[slot] = SlotStatus.TERMINATED if slot in ended else SlotStatus.ACTIVE
            if slot in ended:
                del self._learners[slot]
        self._write_observations(simulation)
        return self._score(simulation) if simulation.is_done else {}

    def close(self) -> None:
        """Close the simulation, if one is open."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def _load_suite(self, episode: EpisodeChoice) -> Suite:
        """Return the suite with this scenario only, read once: a whole suite takes a tenth of a second."""
        key = (episode.suite, episode.scenario)
        if key not in self._suites:
            self._suites[key] = load_suite_of_one(find_suite_folder(episode.suite), episode.scenario)
        return self._suites[key]

    def _open_others(self, egos: tuple[str, ...]) -> dict[str, LocalDriver]:
        """Return a driver for every CAV that is no learner."""
        agent, learner = self._settings.others, self._settings.learner
        if not agent:
            return {}
        return {ego: LocalDriver(AGENTS[agent]({})) for place, ego in enumerate(egos) if place != learner}

    def _read_actions(self) -> dict[str, Reply]:
        """Return the pedals of the CAVs that are driven by pedals, with their messages; keep the plans of others."""
        arrays, settings = self._arrays, self._settings
        replies: dict[str, Reply] = {}
        for slot, learner in self._learners.items():
            if not arrays.asked[slot]:
                continue
            action = arrays.controls[slot]
            if settings.control == "pedals":
                pedals = driving_actions.make_pedals(action)
                replies[learner.ego] = Reply(control=pedals.control, messages=self._read_message(slot))
            else:
                seen = self._observations[learner.ego]
                learner.plan = driving_actions.make_plan_source(settings.control, action, learner.cursor, seen)
        return replies

    def _add_plans(self, replies: dict[str, Reply], *, with_message: bool) -> None:
        """Add the plan of this tick of each CAV that has one; its message goes out with the first one."""
        for slot, learner in self._learners.items():
            seen = self._observations.get(learner.ego)
            if learner.plan is not None and seen is not None:
                says = self._read_message(slot) if with_message and self._arrays.asked[slot] else ()
                replies[learner.ego] = Reply(plan=learner.plan(seen), messages=says)

    def _read_message(self, slot: int) -> tuple[Message, ...]:
        if not self._settings.message_bytes:
            return ()
        return (Message(LEARNED, self._arrays.messages[slot].tobytes()),)

    def _ask_others(self, simulation: Simulation, replies: dict[str, Reply]) -> None:
        for ego, driver in self._others.items():
            if ego not in self._observations:
                continue
            try:
                driver.ask(self._observations[ego])
                replies[ego] = driver.answer()
            except AgentFailure as error:
                simulation.end(ego, error.text)

    def _take_tick(self, simulation: Simulation, before: tuple[str, ...]) -> set[int]:
        """Give the new frame to rewards and messages; return the slots whose CAV ended in it."""
        frame, active = simulation.frame, simulation.active_egos
        ended: set[int] = set()
        for slot, learner in self._learners.items():
            if learner.ego not in before:
                continue
            learner.reward.add(frame)
            if learner.ego not in active:
                ended.add(slot)
            elif self._settings.message_bytes:
                learner.heard.add(self._observations[learner.ego].messages)
        return ended

    def _write_observations(self, simulation: Simulation) -> None:
        """Write the observation of every learner that drives."""
        rows, frame = self._arrays.observations, simulation.frame
        if self._settings.grid:
            for slot, learner in self._learners.items():
                self._arrays.grids[slot] = read_grid(self._settings.grid, self._observations[learner.ego])
        if self._settings.view != PRIVILEGED:
            for slot, learner in self._learners.items():
                seen = self._observations[learner.ego]
                assert seen.objects is not None, "the sensor is declared"
                learner.vector.write(seen, seen.own, seen.objects, rows[slot])
            return
        vehicle = next(iter(simulation.briefings.values())).vehicle
        users = RoadUsers.from_egos(frame.egos, dict.fromkeys(frame.egos, (vehicle.length, vehicle.width)))
        users = users.concat(frame.actors)
        for slot, learner in self._learners.items():
            own = frame.egos[learner.ego]
            dx, dy = users.x - own.x, users.y - own.y
            squares = dx * dx + dy * dy
            squares[users.ids.index(learner.ego)] = np.inf
            nearest = np.argsort(squares, kind="stable")[: min(self._settings.nearest, len(users) - 1)]
            learner.vector.write(self._observations[learner.ego], own, users.take(nearest), rows[slot])

    def _score(self, simulation: Simulation) -> dict[int, SlotInfo]:
        """Return the scores of the finished episode by slot, as `evaluate` would give them in mode `mdrive`."""
        episode = simulation.episode
        records = build_ego_records(ScoredEpisode(episode.record, simulation.scenario, simulation.roads))
        by_ego = {record.id: record for record in records}
        infos: dict[int, SlotInfo] = {}
        for slot, ego in self._egos.items():
            record = by_ego[ego]
            infos[slot] = {
                "ds": compute_driving_score(record),
                "rc": record.rc,
                "ip": record.ip,
                "end": str(record.ending.end),
                "infractions": [one.kind for one in record.infractions if one.factor < 1.0],
                "ticks": record.ending.tick,
                "digest": episode.digest,
            }
        return infos
