"""Briefing: the static information that an agent gets before the first tick."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from mdrive_sumo.contract.deferred_field import DeferredField
from mdrive_sumo.contract.detector_profiles import IDEAL
from mdrive_sumo.core.geometry import Float

PROTOCOL_SPEED = 8.0
"""[m/s] Speed of the CAVs in the original benchmark (paper, table of controllers)."""


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """The car that the agent drives: sizes [m], mass [kg], steering [rad], limits [m/s, m/s2]."""

    length: float
    """Of the box [m]."""
    width: float
    """Of the box [m]."""
    wheelbase: float
    """Distance between the axles [m]."""
    rear_to_centre: float
    """Distance [m] from the rear axle forward to the box centre."""
    mass: float
    """[kg]"""
    max_steer_angle: float
    """Of the front wheels [rad]: `Control.steer` = 1."""
    max_speed: float
    """[m/s]"""
    max_acceleration: float
    """[m/s2]"""
    max_deceleration: float
    """[m/s2], positive."""


@dataclass(frozen=True, slots=True)
class StopSign:
    """A stop sign on the route: arc length [m] along the route of its line."""

    s: float
    """Arc length of its line along the route [m]."""


@dataclass(frozen=True, slots=True)
class TrafficLight:
    """A traffic light on the route: id of the light and arc length [m] along the route of its stop line."""

    id: str
    """Its key in `Observation.signals`."""
    s: float
    """Arc length of its stop line along the route [m]."""


JunctionKind = Literal[
    "traffic-light",
    "priority-road",
    "yield",
    "stop",
    "all-way-stop",
    "right-before-left",
    "left-before-right",
    "roundabout",
    "zipper",
    "uncontrolled",
]
"""What tells a driver who gives way at a junction."""


@dataclass(frozen=True, slots=True)
class JunctionControl:
    """A junction on the route, and who gives way there, as its signs, lights and rules tell a driver on this approach.

    On a `priority-road` the others give way, but who turns left still gives way to oncoming traffic. At a `yield` or
    `stop` sign the CAV gives way; at an `all-way-stop` all stop and drive on in the order of their arrival. Vehicles
    from the right go first by `right-before-left`, those in the ring at a `roundabout`. At a `zipper` two lanes become
    one, and their vehicles merge in turn. Nothing tells anything at an `uncontrolled` junction.
    """

    kind: JunctionKind
    """Of the approach on which the route enters."""
    entry_s: float
    """Arc length [m] along the route at which it enters the junction; of a roundabout: the ring."""
    exit_s: float
    """Arc length [m] along the route at which it leaves the junction or ring; its end, if that lies in there."""


V2xRate = Literal["fixed", "etsi"]
"""When stations of built-in agents send: every 100 ms, or by the rules of ETSI's services (docs/v2x.md)."""


@dataclass(frozen=True, slots=True)
class Briefing(DeferredField):
    """All that an agent is told before the first tick."""

    DEFERRED: ClassVar[str] = "route_room"
    """Measuring it takes more time than a hundred ticks, and most agents never leave their lanes."""

    ego_id: str
    """Pseudonym of the CAV, as in `Message.sender`: new in every episode, not the id of the scenario."""
    seed: int
    """The agent's own seed: use no other source of randomness and re-runs are exact."""
    tick_s: float
    """Length of a tick [s]."""
    time_limit_s: float
    """Time [s] after which the CAV is timed out: its own limit in the scenario, or that of protocol 7.6."""
    vehicle: VehicleFacts
    """The car that the agent drives."""
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
    """On the route, in its order."""
    traffic_lights: tuple[TrafficLight, ...] = ()
    """On the route, in its order."""
    junctions: tuple[JunctionControl, ...] = ()
    """At which ways of cars cross or merge, in the order of the route. A route that begins in one has entry_s 0."""
    route_room: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) free width [m] to the left and to the right of each route point across the assigned lane: up to the edge
    of all lanes and junctions together, oncoming lanes included, at most 10 m. No rows if it was not measured."""
    standard_detector: str = IDEAL
    """The detector profile that the profile `standard` of the objects sensor stands for in this episode."""
    desired_speed: float | None = PROTOCOL_SPEED
    """Speed [m/s] that the scenario asks CAVs to drive where the road allows it; None: the limits of the road
    (`route_speed_limit`). Nothing enforces it; score mode `hard` counts speed above the limits of the road."""
    v2x_rate: V2xRate = "fixed"
    """How often the run asks stations to send (`eval --v2x-rate`). Built-in agents and road-side units do; nothing
    enforces it."""
