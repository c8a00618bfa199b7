"""What goes back and forth in every tick: an Observation, and a Reply with a Control or a Plan and messages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Protocol, cast

from mdrive_sumo.contract.briefing import Briefing
from mdrive_sumo.contract.deferred_field import DeferredField
from mdrive_sumo.contract.sensors import CameraImage, Detections, Gnss, Imu, Objects, PointCloud, Raster, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float

LABELS = ("single", "sharing", "negotiation", "joint", "privileged")
"""Labels that an agent can declare. Results derive theirs from what it did (docs/agents.md)."""


@dataclass(frozen=True, slots=True)
class OwnState:
    """The ego's own state as its instruments estimate it, and how uncertain that is.

    Exact under the sensing profile `perfect`, and for agents that declare the privileged sensor. Detections are placed
    in the world by this state, so they fit to it; messages carry it to others.
    """

    x: float
    """Of the box centre in the world frame [m]."""
    y: float
    """Of the box centre in the world frame [m]."""
    yaw: float
    """Heading [rad], counter-clockwise from +x."""
    speed: float
    """Along the heading [m/s]."""
    acceleration: float
    """Along the heading [m/s2]."""
    yaw_rate: float
    """[rad/s], positive to the left."""
    steer_angle: float
    """Of the front wheels [rad], positive to the left."""
    position_sigma: float = 0.0
    """Standard deviation of the errors of x and of y [m]; 0: exact."""
    yaw_sigma: float = 0.0
    """Standard deviation of the error of yaw [rad]."""
    speed_sigma: float = 0.0
    """Standard deviation of the error of speed [m/s]."""


OUR_CONTROLLER = "tracker"
"""The controller that follows plans which name none."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Where the box centre shall be: points (N, 2) [m] in the world frame, the first one lies `interval_s` ahead."""

    points: Float
    """(N, 2) positions of the box centre [m] in the world frame, N from 1 to `MAX_PLAN_POINTS`."""
    interval_s: float
    """Time between two points, and from now to the first one [s]."""
    controller: str = OUR_CONTROLLER
    """Which controller follows the plan: a name in `mdrive_sumo.vehicle.control.CONTROLLERS`."""


@dataclass(frozen=True, slots=True)
class Control:
    """Pedals and wheel: throttle and brake in [0, 1], steer in [-1, 1], left positive (full lock = max_steer_angle)."""

    throttle: float
    """In [0, 1]."""
    brake: float
    """In [0, 1]."""
    steer: float
    """In [-1, 1], positive to the left; 1 is `VehicleFacts.max_steer_angle`."""


STANDSTILL = Control(throttle=0.0, brake=1.0, steer=0.0)
"""Full brake, wheels straight."""


@dataclass(frozen=True, slots=True)
class Message:
    """Something said to all others over the V2X channel; `mdrive_sumo.v2x.messages` makes and reads the usual types.

    An agent gives `type` and `payload`; the channel fills in `sender` (an agent cannot pose as another) and `tick`.
    """

    type: str
    """"cam", "cpm", "mcm", "denm", "feature", "text", or a name of the agent's own, at most 16 characters."""
    payload: bytes
    """Encoded content; its length is what the channel counts."""
    sender: str = ""
    """Pseudonym of the CAV or RSU that sent the message."""
    tick: int = 0
    """Tick of sending."""


@dataclass(frozen=True, slots=True)
class Note:
    """An entry for the recording, for people and replays; other agents do not receive it."""

    kind: str
    """A short name, e.g. "llm-exchange"; results count the notes of every kind but `REASON`."""
    text: str
    """What the replay shows."""


EXCHANGE = "llm-exchange"
"""Kind of the notes that hold a request to a language model and its answer: runs keep them as transcripts."""
DRIVER = "driver"
"""Kind of the notes of a take with the driver from their tick on: a person, or an agent (`loop.human_actions`)."""
REMARK = "remark"
"""Kind of the notes that a person leaves, or an observer of a study: nothing follows from them."""


@dataclass(frozen=True, slots=True)
class Privileged:
    """What only the `privileged` sensor tells: all other CAVs' states, routes and plans of the previous tick."""

    ego_ids: tuple[str, ...]
    """Pseudonym of every active CAV, the receiver included, sorted."""
    states: tuple[OwnState, ...]
    """Exact state of each CAV, in the order of `ego_ids`."""
    routes: tuple[Float, ...]
    """(N, 2) route points of each CAV [m]."""
    plans: tuple[Plan | None, ...]
    """What each CAV planned in the previous tick; None for one that gave a control."""
    objects: Objects
    """Every actor that is not a CAV, at any distance."""
    rooms: tuple[Float, ...] = ()
    """(N, 2) free width beside the route points of each CAV [m], as `Briefing.route_room`."""
    speed_limits: tuple[Float, ...] = ()
    """(N,) speed limit [m/s] at the route points of each CAV, as `Briefing.route_speed_limit`."""


NOTHING: Mapping[str, Any] = MappingProxyType({})
"""What sensors tell that were not declared."""


@dataclass(frozen=True, slots=True)
class Observation(DeferredField):
    """What one CAV sees of one frame. Fields of sensors that were not declared are None or empty."""

    DEFERRED: ClassVar[str] = "objects"
    """Agents decide every 2 to 4 ticks. A detection's errors depend on its tick only, not on what else is read."""

    tick: int
    """Number of the tick, 0 at the start; a tick lasts `Briefing.tick_s`."""
    own: OwnState
    """The CAV's own state as its instruments estimate it."""
    objects: Objects | None = None
    """Detections of the `objects` sensor, nearest first; computed when first read."""
    signals: Mapping[str, str] = field(default_factory=lambda: NOTHING)
    """State letter ("r", "y", "g", "G") by id of the traffic lights of the briefing."""
    messages: tuple[Message, ...] = ()
    """Messages that arrived since the last observation of this agent, in order of arrival."""
    privileged: Privileged | None = None
    """Every state and plan; only for agents that declare the `privileged` sensor, which labels the run."""
    lidar: Mapping[str, PointCloud] = field(default_factory=lambda: NOTHING)
    """Scans by sensor id; a slower sensor is missing in ticks without a scan."""
    bev: Mapping[str, Raster] = field(default_factory=lambda: NOTHING)
    """Bird's-eye rasters by sensor id."""
    gnss: Gnss | None = None
    """Position by satellite, with errors."""
    imu: Imu | None = None
    """Acceleration, angular rate and compass, with errors."""
    speedometer: float | None = None
    """Measured speed [m/s]."""
    cameras: Mapping[str, CameraImage] = field(default_factory=lambda: NOTHING)
    """Images by sensor id; a slower camera is missing in ticks without an image."""


@dataclass(frozen=True, slots=True)
class Reply:
    """An agent's answer: a control or a plan (exactly one), what it says to others, and what it has detected."""

    control: Control | None = None
    """Pedals and wheel for this tick."""
    plan: Plan | None = None
    """Where to drive; the controller that the plan names follows it."""
    messages: tuple[Message, ...] = ()
    """What the channel carries to others, at most `MAX_MESSAGES`."""
    notes: tuple[Note, ...] = ()
    """Entries for the recording, at most `MAX_NOTES`."""
    detections: Detections | None = None
    """Scored in open loop, without effect otherwise; None unless the agent has looked in this tick."""


class Agent(Protocol):
    """One CAV's driver. An agent class takes its configuration (a mapping) as only argument."""

    label: str
    """One of `LABELS`: what the agent says of itself. Results derive their labels from what it does."""

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensors that the agent needs; called once."""
        ...

    def start(self, briefing: Briefing) -> None:
        """Receive the briefing; called once before the first observation."""
        ...

    def act(self, seen: Observation) -> Reply:
        """Return the reply to one observation; called on every tick until the CAV ends."""
        ...


def read_sensors(agent: Agent) -> tuple[SensorSpec, ...]:
    """Return the sensors that an agent declares. Raises InputError unless they are a sequence of SensorSpec."""
    return check_sensors(agent.sensors())


def check_sensors(sensors: object) -> tuple[SensorSpec, ...]:
    """Return declared sensors as a tuple. Raises InputError unless they are a sequence of SensorSpec."""
    if not isinstance(sensors, list | tuple):
        raise InputError(f"sensors(): expected a tuple of SensorSpec, found {type(sensors).__name__}")
    for sensor in cast("Sequence[object]", sensors):
        if not isinstance(sensor, SensorSpec):
            raise InputError(f"sensors(): expected a tuple of SensorSpec, found {sensor!r:.60} in it")
    return tuple(cast("Sequence[SensorSpec]", sensors))


def read_label(agent: object) -> str:
    """Return the label that an agent declares, as text. Raises InputError for an agent without one."""
    label: object = getattr(agent, "label", None)
    if label is None:
        raise InputError(
            f"agent {type(agent).__name__}: expected an attribute `label`, one of {', '.join(LABELS)}, found none;"
            ' add `label = "single"` to the class'
        )
    return str(label)
