"""What crosses the border between the benchmark and an agent: plain scalars, strings and arrays.

An agent is one object for one CAV. It is asked once for its `SensorSpec`s, is given one `Briefing`, and then answers
every `Observation` (20 Hz) with one `Reply`. Nothing here needs more than numpy, because it also crosses process and
machine borders; `schema()` publishes the same facts as data (`mdrive-sumo schema contract`).

Frames: world frame of the network, metres, seconds, radians counter-clockwise from +x; a pose is the box centre.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from types import MappingProxyType
from typing import Any, Protocol, cast, get_type_hints

import numpy as np
import numpy.typing as npt

from mdrive_sumo.geometry import Float

CONTRACT = "mdrive-sumo/contract/1"

LABELS = ("single", "sharing", "negotiation", "joint", "privileged")
"""What an agent may call itself; `privileged` is added by the benchmark to whoever declares that sensor."""

MAX_PLAN_POINTS = 200
CONTROL_STEP = 1e-4
"""Controls are rounded to this step when they arrive, so that the recorded action log re-executes exactly."""

NO_OPTIONS: Mapping[str, float | str | bool] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """A sensor that an agent asks for. Only what is declared is computed.

    kind "objects": road users and obstacles within `range_m` of the box centre, boxes with position and speed.
    kind "privileged": every state, every route and every CAV's latest plan; labels the agent `privileged`.
    """

    kind: str
    id: str = ""
    range_m: float = 100.0
    options: Mapping[str, float | str | bool] = field(default_factory=lambda: NO_OPTIONS)


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """The car that the agent drives: sizes [m], mass [kg], steering [rad], limits [m/s, m/s2]."""

    length: float
    width: float
    wheelbase: float
    rear_to_centre: float
    """Distance [m] from the rear axle forward to the box centre."""
    mass: float
    max_steer_angle: float
    max_speed: float
    max_acceleration: float
    max_deceleration: float


@dataclass(frozen=True, slots=True)
class StopSign:
    """A stop sign on the route: arc length [m] along the route of its line."""

    s: float


@dataclass(frozen=True, slots=True)
class TrafficLight:
    """A traffic light on the route: id of the light and arc length [m] along the route of its stop line."""

    id: str
    s: float


@dataclass(frozen=True, slots=True)
class Briefing:
    """All that an agent is told before the first tick."""

    ego_id: str
    seed: int
    """The agent's own seed: use no other source of randomness and re-runs are exact."""
    tick_s: float
    """Length of a tick [s]."""
    time_limit_s: float
    """The route time-out of the scenario [s] (protocol 7.6)."""
    vehicle: VehicleFacts
    route_xy: Float
    """(N, 2) points every metre [m]; the first is the start, the last is the goal."""
    route_yaw: Float
    """(N,) direction of the assigned lane at each point [rad]."""
    route_s: Float
    """(N,) arc length at each point [m]."""
    route_lane_width: Float
    """(N,) width of the assigned lane at each point [m]."""
    route_speed_limit: Float
    """(N,) speed limit at each point [m/s]."""
    stop_signs: tuple[StopSign, ...] = ()
    traffic_lights: tuple[TrafficLight, ...] = ()


@dataclass(frozen=True, slots=True)
class OwnState:
    """The ego's own instruments, without noise."""

    x: float
    y: float
    yaw: float
    speed: float
    acceleration: float
    yaw_rate: float
    steer_angle: float


@dataclass(frozen=True, slots=True)
class Objects:
    """Boxes of other road users and obstacles. Struct of arrays, all (N,); nearest first."""

    ids: tuple[str, ...]
    kind: npt.NDArray[np.uint8]
    """Values of `mdrive_sumo.state.Kind`: 0 vehicle, 1 pedestrian, 2 cyclist, 3 static."""
    x: Float
    y: Float
    yaw: Float
    speed: Float
    """Along yaw [m/s]."""
    length: Float
    width: Float


@dataclass(frozen=True, slots=True)
class Plan:
    """Where the box centre shall be: points (N, 2) [m] in the world frame, the first one lies `interval_s` ahead."""

    points: Float
    interval_s: float
    controller: str = "tracker"
    """Which controller follows the plan: a name in `mdrive_sumo.control.CONTROLLERS`."""


@dataclass(frozen=True, slots=True)
class Control:
    """Pedals and wheel: throttle and brake in [0, 1], steer in [-1, 1], left positive (full lock = max_steer_angle)."""

    throttle: float
    brake: float
    steer: float


STANDSTILL = Control(throttle=0.0, brake=1.0, steer=0.0)


@dataclass(frozen=True, slots=True)
class Message:
    """Something said to the other CAVs over the V2X channel (delivered from issue B on)."""

    type: str
    payload: bytes
    sender: str = ""
    tick: int = 0


@dataclass(frozen=True, slots=True)
class Privileged:
    """What only the `privileged` sensor tells: all other CAVs' states, routes and plans of the previous tick."""

    ego_ids: tuple[str, ...]
    """Every living CAV, oneself included, sorted."""
    states: tuple[OwnState, ...]
    routes: tuple[Float, ...]
    """(N, 2) route points of each CAV [m]."""
    plans: tuple[Plan | None, ...]
    objects: Objects
    """Every actor that is no CAV, wherever it is."""


@dataclass(frozen=True, slots=True)
class Observation:
    """What one CAV sees of one frame."""

    tick: int
    own: OwnState
    objects: Objects | None = None
    signals: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """State letter ("r", "y", "g", "G") by id of the traffic lights of the briefing."""
    messages: tuple[Message, ...] = ()
    privileged: Privileged | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """An agent's answer: a control or a plan (exactly one), and what it says to others."""

    control: Control | None = None
    plan: Plan | None = None
    messages: tuple[Message, ...] = ()


class Agent(Protocol):
    """One CAV's driver. An agent class takes its configuration (a mapping) as only argument."""

    label: str
    """One of `LABELS`: how results name this kind of agent."""

    def sensors(self) -> tuple[SensorSpec, ...]:
        """The sensors that the agent needs; asked once."""
        ...

    def start(self, briefing: Briefing) -> None:
        """Told once, before the first observation."""
        ...

    def act(self, seen: Observation) -> Reply:
        """Asked on every tick while the CAV lives."""
        ...


class ReplyError(ValueError):
    """An agent's answer is not a valid Reply."""


def check_reply(reply: object, controllers: frozenset[str]) -> Reply:
    """The reply, with its control rounded to `CONTROL_STEP`; raises ReplyError naming what is wrong."""
    if not isinstance(reply, Reply):
        raise ReplyError(f"expected a Reply, found {type(reply).__name__}")
    if (reply.control is None) == (reply.plan is None):
        raise ReplyError("expected either a control or a plan, found " + ("neither" if reply.plan is None else "both"))
    messages = tuple(_checked_message(message) for message in reply.messages)
    if reply.control is not None:
        return Reply(control=_checked_control(reply.control), messages=messages)
    return Reply(plan=_checked_plan(reply.plan, controllers), messages=messages)


def _checked_message(message: object) -> Message:
    if not isinstance(message, Message) or not isinstance(cast(object, message.payload), bytes):
        raise ReplyError(f"expected messages of type Message with a bytes payload, found {type(message).__name__}")
    return message


def _checked_control(control: object) -> Control:
    if not isinstance(control, Control):
        raise ReplyError(f"expected a Control, found {type(control).__name__}")
    return Control(
        throttle=_in_range("throttle", control.throttle, 0.0),
        brake=_in_range("brake", control.brake, 0.0),
        steer=_in_range("steer", control.steer, -1.0),
    )


def _in_range(name: str, value: Any, low: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ReplyError(f"{name}: expected a number, found {type(value).__name__}") from None
    if not low <= number <= 1.0:  # NaN fails too
        raise ReplyError(f"{name}: expected a number in [{low:g}, 1], found {number}")
    return round(round(number / CONTROL_STEP) * CONTROL_STEP, 4)


def _checked_plan(plan: object, controllers: frozenset[str]) -> Plan:
    if not isinstance(plan, Plan):
        raise ReplyError(f"expected a Plan, found {type(plan).__name__}")
    try:
        points = np.array(plan.points, dtype=np.float64)
        interval_s = float(plan.interval_s)
    except (TypeError, ValueError):
        raise ReplyError("plan: expected numbers for points and interval_s") from None
    if points.ndim != 2 or points.shape[1] != 2 or not 1 <= len(points) <= MAX_PLAN_POINTS:
        raise ReplyError(f"plan: expected points of shape (1..{MAX_PLAN_POINTS}, 2), found {points.shape}")
    if not np.isfinite(points).all() or np.abs(points).max() > 1e6:
        raise ReplyError("plan: expected finite points within 1000 km of the origin")
    if not (math.isfinite(interval_s) and 0.01 <= interval_s <= 10.0):
        raise ReplyError(f"plan: expected interval_s in [0.01, 10] s, found {interval_s}")
    if plan.controller not in controllers:
        raise ReplyError(f"plan: unknown controller {plan.controller!r}, expected one of {sorted(controllers)}")
    return Plan(points, interval_s, plan.controller)


MESSAGE_TYPES: tuple[type, ...] = (SensorSpec, Briefing, Observation, Reply)


def schema() -> dict[str, Any]:
    """The contract as data: every dataclass that crosses the border with its fields and their types."""
    described: dict[str, Any] = {}
    queue: list[type] = list(MESSAGE_TYPES)
    while queue:
        cls = queue.pop(0)
        if cls.__name__ in described:
            continue
        hints = get_type_hints(cls)
        described[cls.__name__] = {
            "description": (cls.__doc__ or "").strip(),
            "fields": {f.name: _type_name(hints[f.name], queue) for f in fields(cls)},
        }
    return {"format": CONTRACT, "control_step": CONTROL_STEP, "types": described}


def _type_name(hint: Any, queue: list[type]) -> str:
    if isinstance(hint, type) and is_dataclass(hint):
        queue.append(hint)
        return hint.__name__
    arguments: tuple[Any, ...] = getattr(hint, "__args__", ())
    if getattr(hint, "__origin__", None) is np.ndarray:
        return f"array[{arguments[1].__args__[0].__name__}]"
    if arguments:
        names = [_type_name(a, queue) for a in arguments if a is not Ellipsis]
        origin = getattr(hint, "__origin__", None)
        return " | ".join(names) if origin is None else f"{origin.__name__}[{', '.join(names)}]"
    return "null" if hint is type(None) else getattr(hint, "__name__", str(hint))
