"""`constant-speed`: the blind driver."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.planning.reference_path import PathFollower, ReferencePath, build_path, compute_curve_speeds

OPTIONS = {"speed": Option(8.0, 1.0, 30.0)}
ACCELERATION = 2.5
LATERAL = 5.0
"""[m/s2] Generous: at 8 m/s (10.7 m/s2) a car leaves the road in a 6 m bend, so even the blind slow down there."""
BRAKING = 4.0


class ConstantSpeedAgent:
    """Follows its route at a constant speed (8 m/s, slower only in sharp bends) and reacts to nobody.

    The driver of the paper's difficulty screening (protocol 14.2): what endangers it is a conflict.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        self._speed = read_options("constant-speed", config, OPTIONS)["speed"]

    def sensors(self) -> tuple[SensorSpec, ...]:
        """None."""
        return ()

    def start(self, briefing: Briefing) -> None:
        """Lays the path."""
        path: ReferencePath = build_path(briefing.route_xy, briefing.vehicle.rear_to_centre)
        self._reference = PathFollower(path)
        self._limits = compute_curve_speeds(path, self._speed, LATERAL, BRAKING)
        self._tick_s = briefing.tick_s

    def act(self, seen: Observation) -> Reply:
        """Faster until the speed is reached."""
        self._reference.update(seen.own.x, seen.own.y, seen.own.speed)
        return Reply(plan=self._reference.advance(ACCELERATION, self._limits, self._tick_s))
