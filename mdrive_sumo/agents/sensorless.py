"""`stationary`, `constant-speed` and `take-turns`: agents without sensors and messages, the lower bounds of scores."""

import hashlib
import re
from dataclasses import dataclass

from mdrive_sumo.contract import STANDSTILL, Briefing, Cause, Control, Observation, Reason, ReasonLog, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.planning.driving_options import MAX_SPEED
from mdrive_sumo.planning.path_follower import PathFollower
from mdrive_sumo.planning.planning_scale import find_cruise_speed, find_planning_scale
from mdrive_sumo.planning.reference_path import RouteSpeeds, build_path, compute_legal_speeds

CONSTANT_SPEED_OPTIONS = {"speed": Option(PROTOCOL_SPEED, 1.0, MAX_SPEED)}


class StationaryAgent:
    """Stands at its start with the brake on: the lower bound of every score."""

    label = "single"

    def __init__(self, config: Config) -> None:
        read_options("stationary", config, {})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return no sensor."""
        return ()

    def start(self, briefing: Briefing) -> None:  # noqa: ARG002 - the protocol's signature
        """Begin a new episode."""
        self._reasons = ReasonLog()

    def act(self, seen: Observation) -> Reply:  # noqa: ARG002 - the protocol's signature
        """Return full braking."""
        return Reply(control=STANDSTILL, notes=self._reasons.record(Reason(Cause.STATIONARY)))


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
        speed = read_options("constant-speed", config, CONSTANT_SPEED_OPTIONS)["speed"]
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
        return build_frozen(Reply, None, plan, (), notes, None)


TAKE_TURNS_OPTIONS = {
    "slots": Option(8.0, 1.0, 64.0),
    "turn": Option(0.115, 0.0, 1.0),
    "speed": Option(PROTOCOL_SPEED, 1.0, MAX_SPEED),
}
"""Number of turns: scenarios have at most eight CAVs. Length of a turn as a share of the time limit: with 0.115 the
eighth CAV starts after 80 % of it (issue G). Speed [m/s] as of `constant-speed`."""
NUMBERED_ID = re.compile(r"\D*(\d+)")
"""Ids that name a number, such as "3" and "cav_2"; all others are hashed."""
NUDGE_EVERY_S = 25.0
"""A waiting CAV moves this often: after 30 s at a standstill it would count as blocked (protocol 7.5)."""
NUDGE_SPEED = 0.6
"""[m/s] Faster than the 0.5 m/s of a blocked CAV; a nudge takes about 0.3 m."""
NUDGE = Control(throttle=0.3, brake=0.0, steer=0.0)


class TakeTurnsAgent(ConstantSpeedAgent):
    """Waits until the number in its own id is due, then drives blindly at a constant speed: what a schedule scores.

    A lower bound for cooperative systems: it neither sees nor negotiates, and needs ids that differ by more than luck.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        """Read the options `slots`, `turn` and `speed`. Raises InputError."""
        options = read_options("take-turns", config, TAKE_TURNS_OPTIONS)
        if not options["slots"].is_integer():
            raise InputError(f"agent take-turns: option slots: expected a whole number, found {options['slots']:g}")
        super().__init__({"speed": options["speed"]} if "speed" in config else {})
        self._slots, self._turn = int(options["slots"]), options["turn"]

    def start(self, briefing: Briefing) -> None:
        """Compute the tick of departure."""
        super().start(briefing)
        wait_s = find_slot(briefing.ego_id, self._slots) * self._turn * briefing.time_limit_s
        self._departure_tick = round(wait_s / briefing.tick_s)
        self._nudge_ticks = round(NUDGE_EVERY_S / briefing.tick_s)
        self._is_nudging = False

    def act(self, seen: Observation) -> Reply:
        """Return standstill until the departure, then the plan of `constant-speed`."""
        if seen.tick >= self._departure_tick:
            return super().act(seen)
        self.skip(seen)  # otherwise the first plan would advance by the whole wait
        due = seen.tick > 0 and seen.tick % self._nudge_ticks == 0
        self._is_nudging = (due or self._is_nudging) and seen.own.speed < NUDGE_SPEED
        wait_s = (self._departure_tick - seen.tick) * self._tick_s
        notes = self._reasons.record(Reason(Cause.TURN, seconds=wait_s))
        return Reply(control=NUDGE if self._is_nudging else STANDSTILL, notes=notes)


def find_slot(ego_id: str, slots: int) -> int:
    """Return the turn of a CAV in [0, slots): the number in its id, else a hash of the id, both modulo `slots`."""
    numbered = NUMBERED_ID.fullmatch(ego_id)
    number = int(numbered[1]) if numbered else int.from_bytes(hashlib.sha256(ego_id.encode()).digest()[:8], "big")
    return number % slots
