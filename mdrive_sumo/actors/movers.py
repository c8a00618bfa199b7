"""The moving scripted actors as rows of one array, and their motion along their paths."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.actors.kinematic_limits import LIMITS_BY_KIND, compute_safe_speed
from mdrive_sumo.actors.motion_path import MotionPath
from mdrive_sumo.actors.path_tables import ROW_STRIDE, Rows, build_knots
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor, ReplayMotion

STANDSTILL_SPEED = 1e-3
"""A speed below this [m/s], the resolution of a recording, is set to 0."""
LOG_TIME_TOLERANCE_S = 1e-6
"""A replay whose own clock differs from the scenario's by less than this is at the pose of its log."""

MOVER = np.dtype(
    [
        ("is_timed", "i8"),  # 1: a replay, whose progress is its own clock [s]
        ("is_pedestrian", "i8"),
        ("avoids_collisions", "i8"),
        ("stays_at_end", "i8"),  # 0: it leaves the world there
        ("half_length", "f8"),  # [m]
        ("half_width", "f8"),
        ("accel", "f8"),  # this and the next six: see `KinematicLimits`
        ("comfort_brake", "f8"),
        ("max_brake", "f8"),
        ("gap", "f8"),
        ("look_margin", "f8"),
        ("clearance", "f8"),
        ("prediction_s", "f8"),
        ("first", "i8"),  # index of the first knot of its path,
        ("last", "i8"),  # and of the last one
        ("begin", "f8"),  # progress there
        ("end", "f8"),
        ("path_length", "f8"),  # [m]
        ("progress", "f8"),  # arc length [m]; of a replay its own clock [s]
        ("speed", "f8"),  # [m/s]
        ("clock_rate", "f8"),  # of a replay's own clock: 1 is as logged
        ("script_speed", "f8"),  # [m/s] that the script sets; infinite for a replay, which follows its log
        ("is_braking", "i8"),  # 1: as much as it can
        ("is_stopped", "i8"),  # 1: it stands at once, because it was struck or is not yet triggered
        ("is_present", "i8"),  # 1: it is in the world
        ("is_entering", "i8"),  # 1: it would be in the world and was not
        ("x", "f8"),  # [m]
        ("y", "f8"),
        ("yaw", "f8"),  # [rad], unwrapped
        ("s", "f8"),  # arc length [m] of the box centre
        ("slope", "f8"),  # arc length per unit of progress: 1, of a replay the speed [m/s]; 0 beyond the end
    ]
)


def build_movers(actors: Sequence[Actor], avoid_collisions: bool) -> Rows:
    """Return the moving actors, in their order, still without paths and states."""
    movers = np.zeros(len(actors), MOVER)
    for mover, actor in zip(movers, actors, strict=True):
        kind = KIND_BY_NAME[actor.kind]
        mover["is_timed"] = isinstance(actor.motion, ReplayMotion)
        mover["is_pedestrian"] = actor.kind == "pedestrian"
        mover["avoids_collisions"] = actor.avoid_collision and avoid_collisions
        mover["stays_at_end"] = not isinstance(actor.motion, ReplayMotion) or actor.motion.stays
        mover["half_length"], mover["half_width"] = actor.length / 2, actor.width / 2
        for name in ("accel", "comfort_brake", "max_brake", "gap", "look_margin", "clearance", "prediction_s"):
            mover[name] = getattr(LIMITS_BY_KIND[kind], name)
    return movers


def set_paths(movers: Rows, paths: Sequence[MotionPath]) -> Rows:
    """Give each mover its path; return the knots."""
    knots = build_knots(paths)
    counts = np.array([len(path.progress) for path in paths], dtype=np.int64)
    movers["last"] = np.cumsum(counts) - 1
    movers["first"] = movers["last"] - counts + 1
    movers["begin"], movers["end"] = knots["progress"][movers["first"]], knots["progress"][movers["last"]]
    movers["path_length"] = knots["s"][movers["last"]]
    return knots


@twin
def advance_movers(movers: Rows, speed_limits: Float, /) -> Rows:
    """Return the movers with progress, speed and clock one tick later, and which of them are entering.

    speed_limits: (M,) greatest speeds [m/s] with respect to obstacles.
    """
    is_timed, brake_limit = movers["is_timed"] != 0, movers["max_brake"] * DT
    room = np.where(is_timed, np.inf, np.maximum(movers["path_length"] - movers["s"], 0.0))
    limit = np.minimum(speed_limits, compute_safe_speed(room, 0.0, movers["comfort_brake"]))
    planned = np.where(is_timed, np.minimum(movers["slope"], movers["script_speed"]), movers["script_speed"])
    brake = np.where((movers["is_braking"] != 0) | is_timed, movers["max_brake"], movers["comfort_brake"])
    wanted = np.minimum(np.maximum(planned, movers["speed"] - brake * DT), limit)
    most = movers["speed"] + movers["accel"] * DT
    speed = np.minimum(np.maximum(wanted, np.maximum(movers["speed"] - brake_limit, 0.0)), most)
    speed = np.where(speed < STANDSTILL_SPEED, 0.0, speed)
    # A log may exceed the kinematic limits.
    is_unhindered = is_timed & (movers["clock_rate"] >= 1.0) & (limit >= planned)
    is_stopped = movers["is_stopped"] != 0
    speed = np.where(is_stopped, 0.0, np.where(is_unhindered, planned, speed))
    clock_rate = np.where(planned > 1e-6, np.minimum(speed / np.maximum(planned, 1e-6), 1.0), 1.0)
    clock_rate = np.where(is_stopped, 0.0, clock_rate)
    progress = movers["progress"] + np.where(is_timed, clock_rate, speed) * DT
    later = movers.copy()
    later["speed"], later["clock_rate"] = speed, clock_rate
    later["progress"] = np.where(is_timed, progress, np.minimum(progress, movers["end"]))
    later["is_entering"] = _find_present(later) & (movers["is_present"] == 0)
    return later


@twin
def place_movers(movers: Rows, knots: Rows, /) -> Rows:
    """Return the movers at the points of their progress, clamped to the ends of the paths, and which are present."""
    progress, placed = movers["progress"], movers.copy()
    keys = np.arange(len(movers)) * ROW_STRIDE + progress
    before = np.searchsorted(knots["progress_key"], keys, side="right") - 1
    before = np.clip(before, movers["first"], movers["last"] - 1)
    low, high = knots[before], knots[before + 1]
    span = high["progress"] - low["progress"]
    share = np.clip((progress - low["progress"]) / span, 0.0, 1.0)
    for name in ("x", "y", "yaw", "s"):
        placed[name] = low[name] + share * (high[name] - low[name])
    placed["slope"] = np.where(progress < movers["end"], (high["s"] - low["s"]) / span, 0.0)
    placed["is_present"] = _find_present(movers)
    return placed


def _find_present(movers: Rows) -> Bool:
    """Return an (M,) mask of the movers that are in the world."""
    is_over = (movers["progress"] > movers["end"] + LOG_TIME_TOLERANCE_S) & (movers["stays_at_end"] == 0)
    return (movers["progress"] >= movers["begin"] - LOG_TIME_TOLERANCE_S) & ~is_over
