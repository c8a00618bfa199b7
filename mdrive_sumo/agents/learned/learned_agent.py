"""LearnedAgent: what the learned systems have in common: sensors, decisions at 5 Hz, plans."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.creep_rule import CREEP, CreepRule
from mdrive_sumo.agents.learned.ego_frame import convert_to_world
from mdrive_sumo.agents.learned.instructions import RouteInstructor
from mdrive_sumo.agents.learned.model_weights import load_network
from mdrive_sumo.agents.learned.navigation import Navigation, RouteNavigator
from mdrive_sumo.agents.learned.network_inputs import (
    Inputs,
    black_out_images,
    build_inputs,
    compute_motion,
    has_sensor_data,
)
from mdrive_sumo.agents.learned.system_spec import DECISION_TICKS, PLAN_INTERVAL_S, SYSTEMS
from mdrive_sumo.contract import (
    STANDSTILL,
    Briefing,
    Cause,
    Note,
    Observation,
    OwnState,
    Plan,
    Reason,
    ReasonLog,
    Reply,
    SensorSpec,
)
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float

OPTIONS: Mapping[str, Option] = MappingProxyType(
    {"blackout": Option(0, 0, 1, is_switch=True), "creep": Option(1, 0, 1, is_switch=True)}
)
PROVIDERS = Choice("auto", ("auto", "cpu"))
WEIGHTS = "weights"
BRAKING_SPEED = 1.0
"""[m/s] A plan that is slower than the car by more, on the mean of its 3 s, brakes: a slower change is no decision."""


@dataclass(frozen=True, slots=True)
class DecidedPlan:
    """What a network decided: a plan in the world frame, and the control of its control branch if it has one."""

    tick: int
    points: Float
    """(1 + N, 2) [m]: where the car was, and where it shall be every `PLAN_INTERVAL_S`."""
    control: Float | None = None
    """(3,) throttle, brake, steer."""
    is_creeping: bool = False
    """Whether the plan is that of `CreepRule` instead of the network's."""

    def sample(self, elapsed_s: float) -> Float:
        """Return the points (N, 2) [m, world frame] every `PLAN_INTERVAL_S` from `elapsed_s` after the decision on.

        Points between the plan's lie on straight lines; the last ones go on with the plan's last velocity. The first
        point of a `Plan` lies one interval after the present, so a plan that is repeated unchanged would stand still.
        """
        planned = PLAN_INTERVAL_S * np.arange(len(self.points))
        wanted = planned[1:] + elapsed_s
        over_s = np.maximum(wanted - planned[-1], 0.0)
        velocity = (self.points[-1] - self.points[-2]) / PLAN_INTERVAL_S
        columns = [np.interp(wanted, planned, self.points[:, axis]) + over_s * velocity[axis] for axis in (0, 1)]
        return np.column_stack(columns)


@dataclass(frozen=True, slots=True)
class NetworkMemory:
    """What a system with memory keeps of its last decision: the output `bev` and where the car was."""

    bev: npt.NDArray[np.float32]
    pose: Float


class LearnedAgent:
    """Drives by a network: at 5 Hz it sees, answers a plan for 3 s, and follows it in between.

    Options: `weights` (path to NAME.onnx or NAME.json of a training of your own; else the packaged ones), `provider`
    (`auto`: a GPU if ONNX Runtime can use one; `cpu`), `blackout` (1: its images are black, for ablations), `creep`
    (0: without `CreepRule`).
    """

    label = "single"
    system: ClassVar[str]
    """Key in `SYSTEMS`."""
    options: ClassVar[Mapping[str, Option]] = OPTIONS

    def __init__(self, config: Config) -> None:
        """Read the options and load the network. Raises InputError."""
        self._spec = SYSTEMS[self.system]
        choices = {"provider": PROVIDERS, WEIGHTS: Choice("", ())}
        self._numbers = read_options(self.system, config, self.options, choices)
        use_gpu = read_choice(self.system, config, "provider", PROVIDERS) == "auto"
        self._network = load_network(self._spec, _read_weights_path(self.system, config), use_gpu)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the cameras of the system, the speedometer, and the LiDAR if it uses one."""
        return self._spec.build_sensors()

    def start(self, briefing: Briefing) -> None:
        """Prepare the navigation; nothing is left of an earlier episode."""
        self._briefing = briefing
        self._navigator = RouteNavigator(briefing)
        self._creep_rule = CreepRule(briefing)
        self._instructor = RouteInstructor(briefing.seed)
        self._memory: NetworkMemory | None = None
        self._decided: DecidedPlan | None = None
        self._reasons = ReasonLog()

    def act(self, seen: Observation) -> Reply:
        """Decide if a decision is due, and return what follows from the last one; before the first one stand."""
        is_due = self._decided is None or seen.tick - self._decided.tick >= DECISION_TICKS
        notes: tuple[Note, ...] = ()
        if is_due and has_sensor_data(self._spec, seen):
            self._decided = self._decide(seen)
            notes = self._reasons.record(find_reason(self._decided, seen.own))
        if self._decided is None:
            return Reply(control=STANDSTILL)
        return replace(self._build_reply(seen, self._decided), notes=notes)

    def _decide(self, seen: Observation) -> DecidedPlan:
        navigation = self._navigator.locate(seen.own)
        outputs = self._network.run(self._build_inputs(seen, navigation))
        plan = outputs["plan"].astype(np.float64)
        creeping = self._creep_rule.find_creep_plan(plan, seen, navigation) if self._numbers["creep"] else None
        if self._spec.uses_memory:
            self._memory = NetworkMemory(outputs["bev"], _get_pose(seen.own))
        has_control = self._spec.answers_control and creeping is None
        control = outputs["control"].astype(np.float64) if has_control else None
        points = np.concatenate((np.zeros((1, 2)), plan if creeping is None else creeping))
        return DecidedPlan(seen.tick, convert_to_world(points, seen.own), control, is_creeping=creeping is not None)

    def _build_inputs(self, seen: Observation, navigation: Navigation) -> Inputs:
        instruction = self._instructor.instruct(navigation) if self._spec.uses_instruction else ""
        has_limits = self._network.manifest.has_limits
        inputs = build_inputs(self._spec, seen, navigation, instruction, has_limits=has_limits)
        if self._numbers["blackout"]:
            inputs = black_out_images(self._spec, inputs)
        if self._spec.uses_memory:
            inputs |= self._build_memory_inputs(seen.own)
        return inputs

    def _build_memory_inputs(self, own: OwnState) -> Inputs:
        """Return `memory` and `motion`; zeros at the first decision."""
        if self._memory is None:
            shape = self._network.manifest.memory_shape
            return {"memory": np.zeros(shape, np.float32), "motion": np.zeros(3, np.float32)}
        return {"memory": self._memory.bev, "motion": compute_motion(self._memory.pose, _get_pose(own))}

    def _build_reply(self, seen: Observation, decided: DecidedPlan) -> Reply:
        """Return the reply of this tick."""
        return Reply(plan=Plan(self._sample_plan(seen, decided), PLAN_INTERVAL_S, self._spec.controller))

    def _sample_plan(self, seen: Observation, decided: DecidedPlan) -> Float:
        """Return the points (PLAN_POINTS, 2) [m, world frame] of the plan from now on."""
        return decided.sample((seen.tick - decided.tick) * self._briefing.tick_s)


def find_reason(decided: DecidedPlan, own: OwnState) -> Reason:
    """Return what the plan does: why a network wants it cannot be told."""
    lengths_m = portable.hypot(*np.diff(decided.points, axis=0).T)
    speed = float(lengths_m.sum()) / (len(lengths_m) * PLAN_INTERVAL_S)
    if decided.is_creeping:
        cause = Cause.CREEP
    elif float(portable.hypot(*(decided.points[-1] - decided.points[0]))) < CREEP.still_plan_m:
        cause = Cause.NETWORK_STANDS
    else:
        cause = Cause.NETWORK_BRAKES if speed < own.speed - BRAKING_SPEED else Cause.NETWORK_DRIVES
    return Reason(cause, speed=speed)


def _get_pose(own: OwnState) -> Float:
    return np.array((own.x, own.y, own.yaw))


def _read_weights_path(agent: str, config: Config) -> Path | None:
    """Return the path of the option `weights`, None if it is not given. Raises InputError."""
    value = config.get(WEIGHTS, "")
    if not isinstance(value, str) or (value and not value.endswith((".onnx", ".json"))):
        raise InputError(
            f"agent {agent}: option {WEIGHTS}: expected the path of a .onnx or .json file, found {value!r}"
        )
    return Path(value) if value else None


class VadAgent(LearnedAgent):
    """Counterpart of VAD, trained on mdrive-sumo data: six cameras and the lanes of its route, answers a plan."""

    system = "vad"


class UniadAgent(LearnedAgent):
    """Counterpart of UniAD, trained on mdrive-sumo data: six cameras, answers a plan."""

    system = "uniad"


class LmdriveAgent(LearnedAgent):
    """Counterpart of LMDrive, trained on mdrive-sumo data: cameras, LiDAR and instructions in English, answers a plan.

    Its navigator composes the instructions (`RouteInstructor`), as people do in the data of LMDrive.
    """

    system = "lmdrive"
