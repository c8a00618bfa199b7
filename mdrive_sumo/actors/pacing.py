"""Pacing: before its trigger, an actor adapts its speed so that the CAV meets it (protocol 3.4)."""


def paced_speed(ego_speed: float, distance: float, trigger_m: float, target: float) -> float:
    """Desired speed [m/s] of an actor at `target` speed whose trigger fires `trigger_m` from a CAV `distance` away."""
    if ego_speed < 0.1:
        return 0.0
    gap = max(distance - trigger_m, 0.0)
    least = 1.0 + 2.0 * (1.0 - min(1.0, gap / 25.0))
    return min(max(ego_speed - gap / 10.0, least), target, 0.98 * ego_speed)


def initial_speed(distance: float, trigger_m: float, target: float) -> float:
    """Speed [m/s] at the start: `target` near the CAV, 2 m/s far from it, linear in between."""
    near = max(12.0, trigger_m + 4.0)
    far = max(60.0, near + 30.0)
    share = min(max((distance - near) / (far - near), 0.0), 1.0)
    return target + share * (min(2.0, target) - target)
