"""`constant-speed`: drives without any perception."""

from dataclasses import dataclass

from mdrive_sumo.contract import Briefing, Observation, ReasonLog, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.planning.driving_options import MAX_SPEED
from mdrive_sumo.planning.path_follower import PathFollower
from mdrive_sumo.planning.planning_scale import find_cruise_speed, find_planning_scale
from mdrive_sumo.planning.reference_path import RouteSpeeds, build_path, compute_legal_speeds

OPTIONS = {"speed": Option(PROTOCOL_SPEED, 1.0, MAX_SPEED)}


@dataclass(frozen=True, slots=True)
class ConstantSpeedParameters:
    """Parameters of `ConstantSpeedAgent` [m/s2]. All values are design choices of this agent."""

    acceleration: float = 2.5
    lateral_acceleration: float = 5.0
    """High, but limited: at 8 m/s in a 6 m bend (10.7 m/s2) a car would leave the road."""
    braking: float = 4.0


CONSTANT_SPEED = ConstantSpeedParameters()


class ConstantSpeedAgent:
    """Follows its route at a constant speed (that of the scenario, slower only in sharp bends) and reacts to nothing.

    The driver of the paper's difficulty screening (protocol 14.2): a scenario that endangers it contains a conflict.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        speed = read_options("constant-speed", config, OPTIONS)["speed"]
        self._speed = speed if "speed" in config else None

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return no sensor."""
        return ()

    def start(self, briefing: Briefing) -> None:
        """Build the path and its speed limits."""
        cruise_speed = find_cruise_speed(briefing, self._speed, PROTOCOL_SPEED)
        scale = find_planning_scale(briefing, cruise_speed)
        path = build_path(briefing.route_xy, briefing.vehicle.rear_to_centre, parameters=scale.path)
        lateral, braking = CONSTANT_SPEED.lateral_acceleration, CONSTANT_SPEED.braking
        self._follower = PathFollower(path)
        self._starts_at_speed = briefing.desired_speed is None
        follows_limits = self._speed is None and briefing.desired_speed is None
        legal = compute_legal_speeds(path, briefing) if follows_limits else None
        self._speeds = RouteSpeeds.compute(path, cruise_speed, lateral, braking, legal)
        self._tick_s, self._tick = briefing.tick_s, -1
        self._reasons = ReasonLog()

    def skip(self, seen: Observation) -> None:
        """Note a tick in which something else than a plan of this agent drives: its reference does not move on."""
        self._tick = seen.tick

    def act(self, seen: Observation) -> Reply:
        """Return a plan that accelerates until the speed is reached."""
        if self._tick < 0 and self._starts_at_speed:
            self._follower.start_at(seen.own.speed)
        self._follower.update(seen.own.x, seen.own.y, seen.own.speed)
        elapsed_s = (seen.tick - self._tick) * self._tick_s  # of several ticks in open loop, or if replies are late
        self._tick = seen.tick
        notes = self._reasons.record(self._speeds.find_reason(self._follower.s))
        plan = self._follower.advance(CONSTANT_SPEED.acceleration, self._speeds.limits, elapsed_s)
        return Reply(plan=plan, notes=notes)
