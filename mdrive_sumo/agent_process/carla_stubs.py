"""Names that agents of the CARLA leaderboard import, where CARLA is not installed: the few that say something here.

CARLA's frame is left-handed (x ahead or east, y right or south, z up), its angles are degrees, yaw clockwise from
above. Imported only by the process of such an agent. Written from CARLA's published Python API; none of its code.
"""

import importlib.util
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from inspect import Parameter, signature
from types import ModuleType
from typing import Any

from mdrive_sumo.agent_process.agent_file import is_vehicle_count
from mdrive_sumo.core import portable

POSITIONAL = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD, Parameter.VAR_POSITIONAL)
DEFAULT_SPACING_M = 50.0
"""Between points of the plan that the leaderboard's base class keeps."""


@dataclass
class Vector3D:
    """Three numbers."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def __add__(self, other: "Vector3D") -> Any:
        return type(self)(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: "Vector3D") -> Any:
        return type(self)(self.x - other.x, self.y - other.y, self.z - other.z)

    def __mul__(self, factor: float) -> Any:
        return type(self)(self.x * factor, self.y * factor, self.z * factor)

    __rmul__ = __mul__

    def length(self) -> float:
        """Euclidean norm."""
        return portable.distance((self.x, self.y, self.z), (0.0, 0.0, 0.0))


class Location(Vector3D):
    """A place [m]."""

    def distance(self, other: Vector3D) -> float:
        """Between two places [m]."""
        return portable.distance((self.x, self.y, self.z), (other.x, other.y, other.z))


@dataclass
class Rotation:
    """Degrees; the order of the arguments is CARLA's."""

    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0

    def get_forward_vector(self) -> Vector3D:
        """Where it points."""
        level, up = portable.cos_sin(math.radians(self.pitch))
        cos, sin = portable.cos_sin(math.radians(self.yaw))
        return Vector3D(level * cos, level * sin, up)


@dataclass
class Transform:
    """A place and a direction."""

    location: Location = field(default_factory=Location)
    rotation: Rotation = field(default_factory=Rotation)

    def get_forward_vector(self) -> Vector3D:
        """Where it points."""
        return self.rotation.get_forward_vector()


@dataclass
class VehicleControl:
    """Pedals and wheel: steer is positive to the right."""

    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0
    hand_brake: bool = False
    reverse: bool = False
    manual_gear_shift: bool = False
    gear: int = 0


class RoadOption(IntEnum):
    """What a route does at a point."""

    VOID = -1
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    LANEFOLLOW = 4
    CHANGELANELEFT = 5
    CHANGELANERIGHT = 6


class Track(Enum):
    """Tracks of the CARLA leaderboard."""

    SENSORS = "SENSORS"
    MAP = "MAP"


class AutonomousAgent:
    """Base class of the leaderboard's agents: makes itself ready, and keeps a thinned-out plan."""

    def __init__(self, path_to_conf_file: str, ego_vehicles_num: int = 1) -> None:
        self.agent_name = "auto_agent"
        self.track = Track.SENSORS
        self._global_plan: Any = None
        self._global_plan_world_coord: Any = None
        call_setup(self, path_to_conf_file, ego_vehicles_num)

    def setup(self, path_to_conf_file: str, ego_vehicles_num: int = 1) -> None:
        """The agent's own."""

    def sensors(self) -> list[dict[str, Any]]:
        """The agent's own."""
        return []

    def set_global_plan(self, global_plan_gps: Sequence[Any], global_plan_world_coord: Sequence[Any]) -> None:
        """Keeps the routes of all vehicles, whole and thinned out; of an agent for one vehicle its own route."""
        if global_plan_world_coord and isinstance(global_plan_world_coord[0], tuple):
            rows = select_kept_points(global_plan_world_coord, _compute_spacing(self))
            self._global_plan = [global_plan_gps[row] for row in rows]
            self._global_plan_world_coord = [global_plan_world_coord[row] for row in rows]
            return
        self._global_plan_all = list(global_plan_gps)
        self._global_plan_world_coord_all = list(global_plan_world_coord)
        kept = [select_kept_points(route, _compute_spacing(self)) for route in global_plan_world_coord]
        pairs = zip(kept, global_plan_gps, global_plan_world_coord, strict=True)
        self._global_plan, self._global_plan_world_coord = [], []
        for rows, gps, world in pairs:
            self._global_plan.append([gps[row] for row in rows])
            self._global_plan_world_coord.append([world[row] for row in rows])

    def destroy(self) -> None:
        """The agent's own; never called: the process ends."""


def call_setup(agent: Any, config: str, vehicles: int) -> None:
    """Calls `setup`, which in single-vehicle agents takes the configuration, and perhaps what is optional."""
    taken = [argument for argument in signature(agent.setup).parameters.values() if argument.kind in POSITIONAL]
    takes_two = len(taken) > 1 and is_vehicle_count(taken[1].name, taken[1].default is Parameter.empty)
    agent.setup(*((config, vehicles) if takes_two else (config,)))


def select_kept_points(route: Sequence[tuple[Transform, RoadOption]], spacing_m: float) -> list[int]:
    """Rows of the points to keep: changes of the option, lane changes, one every so many metres, the last."""
    kept: list[int] = []
    since, before = 0.0, None
    for row, (place, option) in enumerate(route):
        since += place.location.distance(route[row - 1][0].location) if row else 0.0
        changing = option in (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)
        if option is not before or changing or since >= spacing_m or row == len(route) - 1:
            kept.append(row)
            since = 0.0
        before = option
    return kept


def _compute_spacing(agent: Any) -> float:
    """[m] The option target_point_distance of the agent's `config`, if it is a mapping that has it."""
    config = getattr(agent, "config", None)
    if not isinstance(config, dict):
        return DEFAULT_SPACING_M
    inner = config.get("control")
    options = inner if isinstance(inner, dict) and "target_point_distance" in inner else config
    return float(options.get("target_point_distance", DEFAULT_SPACING_M))


CARLA = (Vector3D, Location, Rotation, Transform, VehicleControl)
MODULES: dict[str, tuple[type, ...]] = {
    "carla": CARLA,
    "leaderboard": (),
    "leaderboard.autoagents": (),
    "leaderboard.autoagents.autonomous_agent": (AutonomousAgent, Track),
    "agents": (),
    "agents.navigation": (),
    "agents.navigation.local_planner": (RoadOption,),
}


def install_stubs() -> None:
    """Makes these names importable in this process, unless there is a real CARLA."""
    installed = importlib.util.find_spec("carla")
    if installed is not None and installed.origin is not None:  # a mere folder of that name has none
        return
    for name, classes in MODULES.items():
        module = sys.modules[name] = ModuleType(name)
        module.__path__ = []
        for cls in classes:
            setattr(module, cls.__name__, cls)
        parent, _, last = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], last, module)
