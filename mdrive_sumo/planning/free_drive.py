"""A drive on a free road, against which a plan is held: what it would meet first is why the plan is slower."""

import numpy as np

from mdrive_sumo.contract import Cause, Objects, OwnState, Privileged, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.motion_prediction import TIMES
from mdrive_sumo.planning.parameters import JOINT_PLANNING
from mdrive_sumo.planning.path_overlap import find_cells
from mdrive_sumo.planning.reference_path import SPACING_M, PathState, ReferencePath
from mdrive_sumo.planning.speed_lattice import SpeedLattice
from mdrive_sumo.planning.speed_profile import SpeedProfile

LAG_S = 4.0
"""[s] What limits a profile later is no reason for what the car does now."""
LAG_M = 2.0
"""[m] A profile that falls behind a drive on a free road by less is not limited: the lattice rounds its speeds."""
FREE_ACCELERATION, FREE_BRAKING = 2.0, 4.0
"""[m/s2] Of a drive on a free road: the largest of the moves of the finest lattice."""
MET_M = 5.0, 2.2
"""[m] A road user whose centre is closer along and across the own path is in the way: a car's length and width, and the
margins of planning. It names the reason of a plan, which itself keeps clear of boxes."""


def round_limits(limits: Float, lattice: SpeedLattice) -> Float:
    """Return the highest speeds (M,) [m/s] of the lattice that keep to limits (M,) [m/s]."""
    steps = np.maximum(np.floor(limits / lattice.speed_step + 1e-6), 1.0)
    return steps * lattice.speed_step


def predict_free_stations(limits: Float, lattice: SpeedLattice, start: PathState, times: Float) -> Float:
    """Return the arc lengths (T,) [m] at equidistant `times` (T,) [s] of a drive that no road user limits.

    limits: `round_limits` at the points of the path. It tells what limits a profile, and is no plan: it may brake late.
    """
    speed = start.speed if lattice.has_exact_start else lattice.find_index(start.speed) * lattice.speed_step
    step_s = float(times[0])
    return drive_freely(limits, start.s, speed, FREE_ACCELERATION, FREE_BRAKING, step_s, len(times))


@twin
def drive_freely(
    limits: Float, s: float, speed: float, acceleration: float, braking: float, step_s: float, steps: int, /
) -> Float:
    """Return the arc lengths (steps,) [m] of a car that keeps to limits (M,) [m/s] at the points of its path.

    It starts at s [m] and `speed` [m/s]; acceleration, braking: [m/s2] its highest.
    """
    stations = np.zeros(steps)
    for k in range(steps):
        limit = float(limits[min(max(int(s / SPACING_M), 0), len(limits) - 1)])
        after = min(speed + acceleration * step_s, max(limit, speed - braking * step_s))
        s += (speed + after) / 2 * step_s
        speed = after
        stations[k] = s
    return stations


def falls_behind(profile: SpeedProfile, age_s: float, free: Float, times: Float) -> bool:
    """Return whether a profile of that age [s] falls behind the stations (T,) [m] of a free drive within `LAG_S`.

    times: equidistant, from the first step on.
    """
    soon = slice(round(LAG_S / float(times[0])))
    return float((free[soon] - profile.get_stations(age_s + times[soon])).max()) >= LAG_M


def find_waiting_pedestrian(objects: Objects, own: OwnState) -> Reason | None:
    """Return the nearest pedestrian who stands, as a reason: its caution slows a CAV before one is in its way."""
    standing = (objects.kind == Kind.PEDESTRIAN) & (np.abs(objects.speed) < JOINT_PLANNING.standing_speed)
    if not standing.any():
        return None
    distance_m = portable.hypot(objects.x - own.x, objects.y - own.y)
    row = int(np.where(standing, distance_m, np.inf).argmin())
    position = float(objects.x[row]), float(objects.y[row])
    return Reason(Cause.PEDESTRIAN, (objects.ids[row],), position, float(distance_m[row]))


def find_first_met(known: Privileged, own_id: str, path: ReferencePath, free: Float) -> Reason | None:
    """Return the road user that the own car meets first if it is at stations `free` (K,) [m] at `TIMES`, as a reason.

    Road users are predicted straight on, CAVs by their plans. None if there is none.
    """
    cells, times = find_cells(path, free), TIMES[: len(free)]
    positions = _predict_positions(known, own_id, times)
    dx, dy = np.moveaxis(positions - path.xy[cells], -1, 0)
    cos, sin = portable.cos_sin(path.yaw[cells])
    met = (np.abs(cos * dx + sin * dy) < MET_M[0]) & (np.abs(cos * dy - sin * dx) < MET_M[1])
    if not met.any():
        return None
    row = int(np.where(met.any(1), met.argmax(1), len(times)).argmin())
    first = int(met[row].argmax())
    distance_m, seconds = float(free[first] - free[0]), float(times[first])
    objects = known.objects
    if row >= len(objects.ids):
        cavs = [name for name in known.ego_ids if name != own_id]
        return Reason(Cause.AVOID, (cavs[row - len(objects.ids)],), None, distance_m, seconds)
    stands = abs(float(objects.speed[row])) < JOINT_PLANNING.standing_speed
    at_roadside = stands and objects.kind[row] == Kind.PEDESTRIAN
    cause = Cause.PEDESTRIAN if at_roadside else Cause.BLOCKED if stands else Cause.AVOID
    position = float(objects.x[row]), float(objects.y[row])
    return Reason(cause, (objects.ids[row],), position, distance_m, seconds)


def _predict_positions(known: Privileged, own_id: str, times: Float) -> Float:
    """Return the positions (N, K, 2) [m] of all objects, then of all other CAVs, at `times` (K,) [s]."""
    objects = known.objects
    cos, sin = portable.cos_sin(objects.yaw)
    speed = np.stack((objects.speed * cos, objects.speed * sin), axis=-1)
    positions = [np.stack((objects.x, objects.y), axis=-1)[:, None] + speed[:, None] * times[:, None]]
    for name, state, plan in zip(known.ego_ids, known.states, known.plans, strict=True):
        if name == own_id:
            continue
        if plan is None:
            direction = np.array(portable.cos_sin(state.yaw))
            positions.append(((state.x, state.y) + state.speed * times[:, None] * direction)[None])
        else:
            rows = np.minimum(np.rint(times / plan.interval_s).astype(np.int64), len(plan.points)) - 1
            positions.append(plan.points[np.maximum(rows, 0)][None])
    return np.concatenate(positions)
