"""RecordingAgent: drives a CAV as expert or learner do and keeps what a learner sees, with the expert's answer."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.instructions import compose_instruction
from mdrive_sumo.agents.learned.navigation import Navigation, RouteNavigator
from mdrive_sumo.agents.learned.network_inputs import build_lidar_histogram
from mdrive_sumo.agents.learned.system_spec import DECISION_TICKS, SystemSpec
from mdrive_sumo.contract import Agent, Briefing, Control, Observation, OwnState, Plan, Reply, SensorSpec
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import draw_first_uniform
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.learning.perturbation import PerturbationSchedule
from mdrive_sumo.learning.plan_labels import label_plan, move_plan
from mdrive_sumo.learning.recorded_rigs import build_rig_sensors, find_recorded_rig, select_rig_outputs
from mdrive_sumo.learning.sample_format import encode_image
from mdrive_sumo.sensing.localization import OwnStateEstimator
from mdrive_sumo.sensing.sensor_options import MeasuringTicks
from mdrive_sumo.vehicle.control import CONTROLLERS

SEGMENT_TICKS = 100
"""With a learner, expert and learner take turns in segments of 5 s."""
TURN_TICKS = 60
"""Decisions are kept in turns of 3 s if only a share of them is: 15 decisions, of which two have no `previous` one."""
INSTRUCTION_TICKS = 80
"""The words of an instruction change every 4 s, or with the situation."""
VARIANTS = 1000
"""Different numbers of paraphrases that are drawn."""


@dataclass(frozen=True)
class RecordingSetup:
    """What one CAV's drive is recorded with."""

    expert: Agent
    rigs: tuple[str, ...]
    seed: int
    """Seed of perturbations, segments and paraphrases."""
    estimator_seed: int
    """Seed of the errors of the own state that a learner gets; those of the episode's own estimator."""
    perturbation: float = 0.0
    learner: Agent | None = None
    system: SystemSpec | None = None
    """System of the learner."""
    mix: float = 0.0
    """Share of the segments that the expert drives if there is a learner."""
    share: float = 1.0
    """Share of the decisions that are kept."""

    @property
    def kept_ticks(self) -> MeasuringTicks:
        """Ticks whose decisions are kept: in turns, which begin at another time in each drive."""
        if self.share == 1.0:
            return MeasuringTicks(DECISION_TICKS)
        cycle = DECISION_TICKS * round(TURN_TICKS / self.share / DECISION_TICKS)
        start = DECISION_TICKS * int(cycle // DECISION_TICKS * draw_first_uniform(self.seed, "turn", 0))
        return MeasuringTicks(DECISION_TICKS, TURN_TICKS, cycle, start)


@dataclass(frozen=True)
class RecordedDecision:
    """What a learner knows at one decision of a CAV, and what the expert answers. Images are JPEG files."""

    tick: int
    labels: Mapping[str, npt.NDArray[Any]]
    images: Mapping[str, bytes]
    """JPEG files by RIG-CAMERA."""
    instruction: str


class RecordingAgent:
    """The expert is asked on every tick and keeps its own state, whatever drives the car."""

    label = "single"

    def __init__(self, setup: RecordingSetup) -> None:
        self._setup = setup
        self._schedule = PerturbationSchedule(setup.seed, 0.0 if setup.learner else setup.perturbation)
        self._kept = setup.kept_ticks
        self._is_privileged = any(spec.kind == "privileged" for spec in setup.expert.sensors())
        self._estimator = OwnStateEstimator(setup.estimator_seed)
        self.decisions: list[RecordedDecision] = []
        self.decided_ticks: list[int] = []
        """Ticks of all decisions, also of those that are not kept."""

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensors of the expert, and those of the rigs."""
        system = self._setup.system
        learner = "" if system is None else find_recorded_rig(system.rig)
        return (*self._setup.expert.sensors(), *build_rig_sensors(self._setup.rigs, self._kept, learner))

    def start(self, briefing: Briefing) -> None:
        """Brief the expert and the learner."""
        self._navigator = RouteNavigator(briefing)
        self._tracker = CONTROLLERS["tracker"](briefing.vehicle)
        self._setup.expert.start(briefing)
        if self._setup.learner is not None:
            self._setup.learner.start(briefing)

    def act(self, seen: Observation) -> Reply:
        """Return the reply of what drives; keep the decision if one is due."""
        answer = self._setup.expert.act(seen)
        assert answer.plan is not None, "experts answer with plans"
        own = self._estimate_own_state(seen)
        driven, is_expert = self._drive(seen, own, answer.plan)
        if seen.tick % DECISION_TICKS == 0 and is_decided(answer.plan, seen.own):
            self.decided_ticks.append(seen.tick)
            # Of all decisions, also of those that are not kept: both remember.
            control, navigation = self._tracker.follow(answer.plan, seen.own, 0), self._navigator.locate(own)
            if self._kept.is_due(seen.tick):
                expert = ExpertAnswer(label_plan(answer.plan, seen.own), control, is_expert)
                sight = encode_sight(seen)
                self.decisions.append(build_decision(sight, own, navigation, expert, self._setup.seed))
        return replace(driven, messages=answer.messages, notes=(), detections=None)

    def _estimate_own_state(self, seen: Observation) -> OwnState:
        """Return the own state as a learner gets it: privileged experts get the true one."""
        own = seen.own
        if not self._is_privileged:
            return own
        truth = EgoState(own.x, own.y, own.yaw, own.speed, own.acceleration, own.yaw_rate, own.steer_angle)
        return self._estimator.describe(self._estimator.estimate(seen.tick, truth))

    def _drive(self, seen: Observation, own: OwnState, plan: Plan) -> tuple[Reply, bool]:
        """Return what the car does, and whether that is what the expert wants."""
        if self._setup.learner is not None:
            return self._drive_with_learner(seen, own, plan)
        burst = self._schedule.find_burst(seen.tick)
        if burst is None:
            return Reply(plan=plan), True
        return Reply(plan=burst.apply(plan, seen.own, seen.tick)), False

    def _drive_with_learner(self, seen: Observation, own: OwnState, plan: Plan) -> tuple[Reply, bool]:
        setup = self._setup
        assert setup.learner is not None and setup.system is not None
        cameras = select_rig_outputs(setup.system, seen.cameras)
        lidar = select_rig_outputs(setup.system, seen.lidar)
        observation = Observation(
            seen.tick, own, signals=seen.signals, lidar=lidar, speedometer=own.speed, cameras=cameras
        )
        reply = setup.learner.act(observation)
        segment = seen.tick // SEGMENT_TICKS
        if setup.mix > draw_first_uniform(setup.seed, "segment", segment):
            return Reply(plan=plan), True
        if reply.plan is not None and self._is_privileged:  # the loop tracks it from the true own state
            return Reply(plan=move_plan(reply.plan, own, seen.own)), False
        return reply, False


@dataclass(frozen=True)
class EncodedSight:
    """What cameras and LiDAR show in a tick, as it is stored."""

    tick: int
    images: Mapping[str, bytes]
    """JPEG files by RIG-CAMERA."""
    lidar: Mapping[str, npt.NDArray[Any]]
    """The array `lidar`, if there is one."""


@dataclass(frozen=True)
class ExpertAnswer:
    """What the expert wants at a decision."""

    plan: Float
    """(PLAN_POINTS, 2) [m] in the ego frame."""
    control: Control
    is_driven: bool
    """Whether it is also what the car does."""


def encode_sight(seen: Observation) -> EncodedSight:
    """Return what rigs show in an observation."""
    images = {name: encode_image(image) for name, image in seen.cameras.items()}
    scans = list(seen.lidar.values())
    return EncodedSight(seen.tick, images, {"lidar": build_lidar_histogram(scans[-1])} if scans else {})


def build_decision(
    sight: EncodedSight, own: OwnState, navigation: Navigation, answer: ExpertAnswer, seed: int
) -> RecordedDecision:
    """Return a decision as it is stored. own: the own state as a learner gets it; seed: of paraphrases."""
    control = answer.control
    numbers: dict[str, npt.NDArray[Any]] = {
        "own": np.array((own.x, own.y, own.yaw, own.speed, own.acceleration, own.yaw_rate)),
        "navigation": navigation.build_vector(own.speed),
        "route": navigation.route,
        "expert_plan": answer.plan,
        "expert_control": np.array((control.throttle, control.brake, control.steer)),
    }
    arrays: dict[str, npt.NDArray[Any]] = {name: value.astype(np.float32) for name, value in numbers.items()}
    arrays |= {"perturbed": np.array(not answer.is_driven, dtype=np.uint8), **sight.lidar}
    variant = int(VARIANTS * draw_first_uniform(seed, "instruction", sight.tick // INSTRUCTION_TICKS))
    return RecordedDecision(sight.tick, arrays, sight.images, compose_instruction(navigation, variant))


def is_decided(plan: Plan, own: OwnState) -> bool:
    """Return whether a plan is more than `omniscient`'s order to stand before it has planned: one point, the car."""
    return len(plan.points) > 1 or bool((np.abs(plan.points[0] - (own.x, own.y)) > 1e-6).any())
