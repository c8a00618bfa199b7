"""SystemSpec: what a learned system sees and answers; training and driving read the same specification."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.contract.camera_rigs import build_camera_rig

DECISION_TICKS = 4
"""A system decides at 5 Hz, the rate of the paper's agents."""
PLAN_POINTS = 6
PLAN_INTERVAL_S = 0.5
"""Waypoints of a plan, in the ego frame at the time of the decision: the next 3 s (Bench2Drive's agents, LMDrive)."""
ROUTE_POINTS = 20
ROUTE_STEP_M = 2.5
"""Points of the route ahead that a system may be given, from the car on: 50 m."""
LIMIT_ROWS = (0, 10, 19)
"""Points of the route at which a system is told the allowed speed: here, 25 m and 47.5 m ahead."""
TARGET_POINTS_M = (10.0, 25.0)
"""[m] How far ahead along the route the two target points lie."""
COMMANDS = ("follow", "left", "right", "change-left", "change-right")
"""Navigation commands, in the order of their one-hot vector."""
NAVIGATION_SIZE = 1 + len(COMMANDS) + 2 * len(TARGET_POINTS_M) + 2
"""Length of the navigation vector: see `navigation.Navigation.build_vector`."""
LIDAR_CELLS = 64
LIDAR_CELL_M = 0.75
"""A LiDAR scan becomes a bird's-eye histogram of 64 x 64 cells, 48 m x 48 m, the car 12 m above its lower edge."""
LIDAR_BEHIND_M = 12.0
LIDAR_LAYERS = 2
"""Points near the ground (below 0.4 m above it), and points above."""
INSTRUCTION_WORDS = 16
"""Length of an instruction in words; shorter ones are padded with 0."""


@dataclass(frozen=True, slots=True)
class ImageInput:
    """Images of equal size that a network gets as one input (cameras, height, width, 3), uint8."""

    name: str
    cameras: tuple[str, ...]
    """Ids of the rig's cameras, in order."""
    height: int
    width: int


@dataclass(frozen=True, slots=True)
class SystemSpec:
    """A learned system: its sensors, the inputs of its network in order, its controller."""

    name: str
    counterpart_of: str
    rig: str
    """Name of the camera rig (`camera_rigs.RIGS`)."""
    scale: float
    """Of the sides of the rig's images."""
    images: tuple[ImageInput, ...]
    uses_route: bool = False
    """Input `route` (ROUTE_POINTS, 4) float32."""
    uses_lidar: bool = False
    """Input `lidar` (LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS) uint8."""
    uses_instruction: bool = False
    """Input `instruction` (INSTRUCTION_WORDS,) int64."""
    uses_memory: bool = False
    """Inputs `memory`, the output `bev` of the previous decision (zeros at first), and `motion` (3,) float32: how far
    the car has moved since, dx, dy [m] in the earlier ego frame and the change of yaw [rad]."""
    answers_control: bool = False
    """Output `control` (3,) float32 beside the plan: throttle, brake, steer; the reply blends both."""
    controller: str = "b2d"
    """What follows the plan (`vehicle.control.CONTROLLERS`)."""

    def build_sensors(self) -> tuple[SensorSpec, ...]:
        """Return the cameras that the network uses, the speedometer, and the LiDAR if used.

        Cameras and LiDAR measure at decisions only.
        """
        used = {camera for image in self.images for camera in image.cameras}
        rig = build_camera_rig(self.rig, self.scale, every_ticks=DECISION_TICKS)
        cameras = tuple(spec for spec in rig if spec.id in used)
        scans = {"profile": "lmdrive", "every_ticks": DECISION_TICKS}
        lidar = (SensorSpec("lidar", "top", options=scans),) if self.uses_lidar else ()
        return (*cameras, SensorSpec("speedometer"), *lidar)


_SIX = ("front", "front-left", "front-right", "back", "back-left", "back-right")
SYSTEMS: Mapping[str, SystemSpec] = MappingProxyType(
    {
        "tcp": SystemSpec(
            "tcp", "TCP", "tcp", 0.5, (ImageInput("front", ("front",), 128, 450),),
            answers_control=True, controller="tracker",
        ),
        "vad": SystemSpec(
            "vad", "VAD", "vad", 0.25, (ImageInput("surround", _SIX, 112, 200),), uses_route=True, uses_memory=True
        ),
        "uniad": SystemSpec(
            "uniad", "UniAD", "uniad", 0.125, (ImageInput("surround", _SIX, 112, 200),), uses_memory=True
        ),
        "lmdrive": SystemSpec(
            "lmdrive", "LMDrive", "lmdrive", 0.2,
            (ImageInput("front", ("front",), 180, 240), ImageInput("sides", ("left", "right", "rear"), 60, 80)),
            uses_lidar=True, uses_instruction=True, controller="dual-pid",
        ),
    }
)  # fmt: skip
"""By name of the agent. Every network also gets `navigation` (NAVIGATION_SIZE,) and, since roads are faster than 8 m/s,
`limits` (len(LIMIT_ROWS),) [m/s], both float32. It answers `plan` (PLAN_POINTS, 2) float32 [m, ego frame], or what
`plan_anchors` decides one by."""
PLAN_HEADS = ("waypoints", "anchors")
"""How a network answers a plan: its points, or scores and offsets of the anchors of `plan_anchors`."""
