"""`take-turns`: drives when its id says so, without perception or messages."""

import hashlib
import re

from mdrive_sumo.agents.constant_speed import ConstantSpeedAgent
from mdrive_sumo.contract import STANDSTILL, Briefing, Cause, Control, Observation, Reason, Reply
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.planning.driving_options import MAX_SPEED

OPTIONS = {
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
        options = read_options("take-turns", config, OPTIONS)
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
