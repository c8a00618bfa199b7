"""Speed of an actor before its trigger: it adapts to the CAV so that both meet (protocol 3.4)."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PacingParams:
    """The numbers of the original code (protocol 3.4)."""

    ego_standstill_speed: float = 0.1
    """[m/s] The actor stands while the CAV is slower than this."""
    min_speed: float = 1.0
    """[m/s] Least speed far from the trigger distance; it grows by `near_speed_gain` towards it."""
    near_speed_gain: float = 2.0
    near_gap_m: float = 25.0
    """The gain acts within this distance of the trigger distance."""
    gap_time_s: float = 10.0
    """A gap is closed within about this time."""
    ego_speed_share: float = 0.98
    """Greatest speed as a share of the CAV's speed."""
    initial_near_m: float = 12.0
    """Up to this distance (or `trigger_margin_m` beyond the trigger distance) the initial speed is the target speed."""
    trigger_margin_m: float = 4.0
    initial_far_m: float = 60.0
    """From this distance on (or `ramp_m` beyond the near distance) the initial speed is `initial_far_speed`."""
    ramp_m: float = 30.0
    initial_far_speed: float = 2.0
    """[m/s]"""


PARAMS = PacingParams()


def compute_paced_speed(ego_speed: float, distance: float, trigger_m: float, target: float) -> float:
    """Return the desired speed [m/s] of an actor whose trigger fires at `trigger_m` from a CAV `distance` [m] away.

    `target`: cruising speed [m/s] of the actor.
    """
    if ego_speed < PARAMS.ego_standstill_speed:
        return 0.0
    gap = max(distance - trigger_m, 0.0)
    least = PARAMS.min_speed + PARAMS.near_speed_gain * (1.0 - min(1.0, gap / PARAMS.near_gap_m))
    return min(max(ego_speed - gap / PARAMS.gap_time_s, least), target, PARAMS.ego_speed_share * ego_speed)


def compute_initial_speed(distance: float, trigger_m: float, target: float) -> float:
    """Return the initial speed [m/s]: `target` near the CAV, 2 m/s far from it, linear in between."""
    near_m = max(PARAMS.initial_near_m, trigger_m + PARAMS.trigger_margin_m)
    far_m = max(PARAMS.initial_far_m, near_m + PARAMS.ramp_m)
    share = min(max((distance - near_m) / (far_m - near_m), 0.0), 1.0)
    return target + share * (min(PARAMS.initial_far_speed, target) - target)
