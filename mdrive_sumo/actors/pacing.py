"""Speed of an actor before its trigger: it adapts to the CAV so that both meet (protocol 3.4)."""


def compute_paced_speed(ego_speed: float, distance: float, trigger_m: float, target: float) -> float:
    """Return the desired speed [m/s] of an actor; its trigger fires at `trigger_m` from a CAV `distance` [m] away.

    `target`: cruising speed [m/s]. The constants are those of the original code.
    """
    if ego_speed < 0.1:
        return 0.0
    gap = max(distance - trigger_m, 0.0)
    least = 1.0 + 2.0 * (1.0 - min(1.0, gap / 25.0))
    return min(max(ego_speed - gap / 10.0, least), target, 0.98 * ego_speed)


def compute_initial_speed(distance: float, trigger_m: float, target: float) -> float:
    """Return the initial speed [m/s]: `target` near the CAV, 2 m/s far from it, linear in between."""
    near_m = max(12.0, trigger_m + 4.0)
    far_m = max(60.0, near_m + 30.0)
    share = min(max((distance - near_m) / (far_m - near_m), 0.0), 1.0)
    return target + share * (min(2.0, target) - target)
