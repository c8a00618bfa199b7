"""Kalman filters of many tracks at once.

Each track has two filters with two states each, and so closed forms without matrices: position and velocity, the same
variances for x and y (constant velocity, turned by the yaw rate; white acceleration), and yaw and yaw rate.
"""

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int, wrap_angles
from mdrive_sumo.perception.measurements import OWN_SENSOR, Measurements, Rows
from mdrive_sumo.perception.tracking_parameters import TrackingParameters

MAX_YAW_STEP = 0.5
"""[rad] A larger innovation of the yaw is no turn: the filter starts anew (a pedestrian turns round)."""
TRACK = np.dtype(
    [
        ("x", "f8"),  # [m]
        ("y", "f8"),
        ("vx", "f8"),  # [m/s]
        ("vy", "f8"),
        ("position", "f8"),  # [m2] variance of x and of y,
        ("coupling", "f8"),  # [m2/s] their covariance with the velocity of the same axis,
        ("velocity", "f8"),  # [m2/s2] and the variance of that
        ("yaw", "f8"),  # [rad]
        ("turn_rate", "f8"),  # [rad/s]
        ("yaw_variance", "f8"),
        ("yaw_coupling", "f8"),
        ("turn_variance", "f8"),
        ("length", "f8"),  # [m]
        ("width", "f8"),
        ("number", "i8"),  # names the track
        ("kind", "i8"),  # value of `Kind`
        ("born_tick", "i8"),
        ("seen_tick", "i8"),
        ("confirmed", "i8"),  # 1: it is no false positive
        ("seen_by_sensor", "i8"),  # 1: the own sensor detected it in this update
        ("mean_x", "f8"),  # [m] mean position since the track has been at one place,
        ("mean_y", "f8"),
        ("mean_vx", "f8"),  # [m/s] mean velocity since then,
        ("mean_vy", "f8"),
        ("mean_count", "i8"),  # the number of positions in it,
        ("mean_tick", "i8"),  # and since when
    ]
)


@twin
def start_tracks(
    tracks: Rows, tick: int, first_number: int, new: Measurements, is_confirmed: bool, parameters: TrackingParameters, /
) -> Rows:
    """Return the tracks, followed by one for every measurement."""
    rows = new.rows
    started = np.zeros(len(tracks) + len(rows), TRACK)
    started[: len(tracks)] = tracks
    more = started[len(tracks) :]
    for name in ("x", "y", "vx", "vy", "yaw", "length", "width", "kind", "yaw_variance"):
        more[name] = rows[name]
    for name in ("x", "y", "vx", "vy"):
        more[f"mean_{name}"] = rows[name]
    for name in ("born_tick", "seen_tick", "mean_tick"):
        more[name] = tick
    more["position"] = rows["position"] + rows["bias"]
    more["velocity"] = rows["speed_variance"]
    more["turn_variance"] = portable.square(parameters.max_turn_rate / 2)
    more["number"] = first_number + np.arange(len(rows))
    more["confirmed"] = is_confirmed
    more["seen_by_sensor"] = new.sources[0] == OWN_SENSOR
    more["mean_count"] = 1
    return started


@twin
def predict(tracks: Rows, seconds: float, parameters: TrackingParameters, /) -> Rows:
    """Return the tracks `seconds` later, where the own sensor has not detected them yet."""
    new = tracks.copy()
    moves = portable.hypot(tracks["vx"], tracks["vy"]) > parameters.moving_speed
    turn = np.where(moves, tracks["turn_rate"], 0.0) * seconds
    cos, sin = portable.cos_sin(turn / 2)
    vx, vy = cos * tracks["vx"] - sin * tracks["vy"], sin * tracks["vx"] + cos * tracks["vy"]  # along the arc's chord
    new["x"] = tracks["x"] + vx * seconds
    new["y"] = tracks["y"] + vy * seconds
    new["vx"] = cos * vx - sin * vy
    new["vy"] = sin * vx + cos * vy
    new["yaw"] = wrap_angles(tracks["yaw"] + turn)
    _grow(new, ("position", "coupling", "velocity"), seconds, parameters.acceleration_sigma)
    _grow(new, ("yaw_variance", "yaw_coupling", "turn_variance"), seconds, parameters.turn_acceleration_sigma)
    new["seen_by_sensor"] = 0
    return new


def _grow(tracks: Rows, names: tuple[str, str, str], seconds: float, sigma: float) -> None:
    """Let variance, covariance and variance of a value and its rate grow by a time of white acceleration."""
    first, both, second = (tracks[name].copy() for name in names)
    noise, square = sigma * sigma, seconds * seconds
    tracks[names[0]] = first + seconds * (2 * both + seconds * second) + noise * square * square / 4
    tracks[names[1]] = both + seconds * second + noise * square * seconds / 2
    tracks[names[2]] = second + noise * square


def correct(tracks: Rows, rows: Int, new: Rows, columns: Int, parameters: TrackingParameters) -> Rows:
    """Return the tracks; those of `rows` (K,), ascending, are corrected by the measurements `columns` (K,) of `new`.

    A track that is in several rows is corrected by the mean of its measurements.
    """
    rows, means = _average(rows, new[columns])
    corrected, part = tracks.copy(), tracks[rows]
    _correct_position(part, means)
    _correct_velocity(part, means)
    _correct_yaw(part, means, parameters)
    for name in ("length", "width"):
        part[name] += (means[name] - part[name]) / parameters.size_weight
    corrected[rows] = part
    return corrected


def _average(rows: Int, new: Rows) -> tuple[Int, Rows]:
    """Return the rows, each once, and the means of the measurements of each, weighted by accuracy.

    Random errors average out. The mean of the biases is a bound: they have the own car's estimate in common.
    """
    if (rows[1:] != rows[:-1]).all():
        return rows, new
    tracks, first, index = np.unique(rows, return_index=True, return_inverse=True)

    def average(values: Float, weights: Float) -> Float:
        return np.bincount(index, values * weights) / np.bincount(index, weights)

    means = new[first]
    places, speeds, yaws = 1 / (new["position"] + new["bias"]), 1 / new["speed_variance"], 1 / new["yaw_variance"]
    for name in ("x", "y", "bias", "length", "width"):
        means[name] = average(new[name], places)
    for name in ("vx", "vy"):
        means[name] = average(new[name], speeds)
    means["yaw"] += average(wrap_angles(new["yaw"] - means["yaw"][index]), yaws)
    means["position"] = 1 / np.bincount(index, 1 / new["position"])
    means["yaw_variance"] = 1 / np.bincount(index, yaws)
    means["speed_variance"] = 1 / np.bincount(index, speeds)
    return tracks, means


def _correct_position(track: Rows, new: Rows) -> None:
    """Correct by positions whose bias cannot be averaged away: only variance beyond it is reducible.

    A track that is known better than the bias (from own detections) is not moved by it.
    """
    excess = np.maximum(track["position"] - new["bias"], 0.0)
    coupling = track["coupling"] * np.sqrt(excess / track["position"])
    total = excess + new["position"]
    gain, velocity_gain = excess / total, coupling / total
    dx, dy = new["x"] - track["x"], new["y"] - track["y"]
    track["x"] += gain * dx
    track["y"] += gain * dy
    track["vx"] += velocity_gain * dx
    track["vy"] += velocity_gain * dy
    track["position"] -= gain * excess
    track["coupling"] *= 1.0 - gain
    track["velocity"] -= velocity_gain * coupling


def _correct_velocity(track: Rows, new: Rows) -> None:
    total = track["velocity"] + new["speed_variance"]
    gain, position_gain = track["velocity"] / total, track["coupling"] / total
    dvx, dvy = new["vx"] - track["vx"], new["vy"] - track["vy"]
    track["x"] += position_gain * dvx
    track["y"] += position_gain * dvy
    track["vx"] += gain * dvx
    track["vy"] += gain * dvy
    track["position"] -= position_gain * track["coupling"]
    track["coupling"] *= 1.0 - gain
    track["velocity"] *= 1.0 - gain


def _correct_yaw(track: Rows, new: Rows, parameters: TrackingParameters) -> None:
    step = wrap_angles(new["yaw"] - track["yaw"])
    anew = np.abs(step) > MAX_YAW_STEP
    coupling, total = track["yaw_coupling"], track["yaw_variance"] + new["yaw_variance"]
    gain = np.where(anew, 1.0, track["yaw_variance"] / total)
    turn_gain = np.where(anew, 0.0, coupling / total)
    track["yaw"] = wrap_angles(track["yaw"] + gain * step)
    turn = np.where(anew, 0.0, track["turn_rate"] + turn_gain * step)
    track["turn_rate"] = np.clip(turn, -parameters.max_turn_rate, parameters.max_turn_rate)
    track["turn_variance"] -= turn_gain * coupling
    track["yaw_variance"] = np.where(anew, new["yaw_variance"], track["yaw_variance"] * (1.0 - gain))
    track["yaw_coupling"] = np.where(anew, 0.0, coupling * (1.0 - gain))


def compute_speeds(tracks: Rows) -> Float:
    """Return the speeds (N,) [m/s] along the yaw."""
    cos, sin = portable.cos_sin(tracks["yaw"])
    return tracks["vx"] * cos + tracks["vy"] * sin
