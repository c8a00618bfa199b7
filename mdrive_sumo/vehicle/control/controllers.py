"""Registry of the controllers that turn a plan into pedals and steering: our tracker and the paper's baselines."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from mdrive_sumo.contract import VehicleFacts
from mdrive_sumo.vehicle.control.pid import B2D, LMDRIVE, CarlaPid, DualPid, V2xController
from mdrive_sumo.vehicle.control.plan_reader import Controller
from mdrive_sumo.vehicle.control.tracker import Tracker

ControllerFactory = Callable[[VehicleFacts], Controller]

CONTROLLERS: Mapping[str, ControllerFactory] = MappingProxyType(
    {
        "tracker": Tracker,
        "v2x-5": lambda _: V2xController(max_speed=5.0),
        "v2x-8": lambda _: V2xController(max_speed=8.0),
        "v2x": lambda _: V2xController(max_speed=5.0),
        "carla-pid-6": lambda _: CarlaPid(target_kmh=21.6),
        "carla-pid-8": lambda _: CarlaPid(target_kmh=28.8),
        "b2d": lambda _: DualPid(B2D),
        "dual-pid": lambda _: DualPid(LMDRIVE),
    }
)
"""Names that a `Plan.controller` may have (paper, table of per-baseline controllers). "v2x" is "v2x-5": scale 1."""
