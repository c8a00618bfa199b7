"""Figures of one trajectory: MDrive's fidelity metrics (spec data_formats.md section 3.1)."""

from collections.abc import Callable, Mapping

import numpy as np
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Kind
from real2sim.percentile import compute_median, compute_percentile
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.recording import RecordedTrack
from real2sim.tracks import kinematics
from real2sim.tracks.stationary import has_moved

OFF_ROUTE_M = 3.0
"""[m] A position further from every lane is off the road, see the check of `off_route_frames`."""
LEEWAY_M = 0.3
"""[m] Allowed difference between reconstruction and log (issue C): lane checks apply where the log is inside by this
much.

Where the log itself is further off, it shows a car park, a driveway or a road that the map lacks, and a reconstruction
on a lane would be unfaithful; these frames are counted and listed as outside.
"""
HALF_LANE_M = 1.75
"""[m] Further from the centre line of a usual lane, a vehicle is beside the lane: parked at the kerb or in a
gateway."""
CROSSING_M = 5.0
"""[m] Ours: about a car length against a lane is crossing it, not driving in it."""
CROSSING_RAD = float(np.radians(20.0))
"""[rad] Ours: a longer path at this angle to the lane is crossing too: it leaves a 3.5 m lane within 10 m. Lane changes
take 3 s and more: 5 degrees in a street, at most 10 at walking pace."""
WRONG_WAY_RAD = float(np.radians(90.0))
"""[rad] MDrive. It counts in a lane only, at most `HALF_LANE_M` from its centre line: beside an oncoming lane a vehicle
is in a lane or gateway that the map lacks."""
TOWN_MPS = 30.0
"""[m/s] MDrive's limit for all roads."""
HIGHEST_MPS = 70.0
"""[m/s] 252 km/h, about where cars are limited by their makers (250 km/h)."""
OVER_ROAD = 1.5
"""Ours: 195 km/h where 130 km/h are allowed or usual, and 30 m/s up to 72 km/h."""
LEAST_OTHERS = 5
"""Fewer other vehicles say nothing about the traffic."""


class ActorQuality(BaseModel):
    """Figures of one trajectory. Lengths in m, times in s, angles in degrees. None: not assessed."""

    model_config = ConfigDict(frozen=True)

    id: str
    category: str
    moving: bool
    frames: int
    gaps: int
    jumps_05m: int = 0
    jumps_1m: int = 0
    jumps_2m: int = 0
    jump_mean: float = 0.0
    jump_max: float = 0.0
    jerk_mean: float = 0.0
    jerk_p95: float = 0.0
    jerk_max: float = 0.0
    frames_over_jerk: int = 0
    acceleration_mean: float = 0.0
    acceleration_max: float = 0.0
    frames_over_acceleration: int = 0
    speed_mean: float = 0.0
    speed_max: float = 0.0
    speed_limit: float = TOWN_MPS
    """The highest speed that is plausible on its road [m/s]."""
    frames_over_speed: int = 0
    yaw_step_max_deg: float = 0.0
    yaw_second_max_deg: float = 0.0
    curvature_spread: float | None = None
    backward_max: float = 0.0
    lateral_mean: float | None = None
    lateral_max: float | None = None
    share_within_1m: float | None = None
    share_within_05m: float | None = None
    outside_frames: int | None = None
    """Frames in which the log itself is off all lanes (`LEEWAY_M`); the other lane figures exclude them."""
    off_route_frames: int | None = None
    wrong_way_frames: int | None = None
    spawn_offset: float | None = None
    spawn_yaw_offset_deg: float | None = None
    error_median: float | None = None
    error_p95: float | None = None
    error_max: float | None = None
    lateral_shift_max: float | None = None
    dtw_mean: float | None = None
    turn_change_deg: float | None = None
    failed: tuple[str, ...] = ()


def compute_actor_quality(
    track: RecordedTrack, dt_s: float, raw: RecordedTrack | None = None, lanes: LaneSegmentIndex | None = None
) -> ActorQuality:
    """Return all figures of one track; errors need `raw`, lane figures need `lanes` and a vehicle."""
    figures = _compute_motion_figures(track, dt_s)
    if raw is not None:
        figures |= _compute_error_figures(track, raw)
    if lanes is not None and track.category.kind is Kind.VEHICLE:
        figures |= _compute_lane_figures(track, raw, lanes)
    return ActorQuality(
        id=track.id,
        category=track.category.value,
        moving=has_moved(track if raw is None else raw, dt_s),
        frames=int(track.valid.sum()),
        gaps=max(len(kinematics.find_runs(track.valid)) - 1, 0),
        **figures,  # pyright: ignore[reportArgumentType]  # one dictionary for fields of several types
    )


def _compute_motion_figures(track: RecordedTrack, dt_s: float) -> dict[str, float | int | None]:
    """Compute the figures over all stretches without a gap, together."""
    xy, yaw, stretches = track.xy, track.yaw, kinematics.find_runs(track.valid)

    def every(of: Callable[[slice], Float]) -> Float:
        return np.concatenate([of(run) for run in stretches] or [np.zeros(0)])

    jump = every(lambda run: kinematics.jump_distances(xy[run]))
    jerk = every(lambda run: kinematics.jerk_magnitudes(xy[run], dt_s))
    acceleration = every(lambda run: kinematics.acceleration_magnitudes(xy[run], dt_s))
    speed = every(lambda run: kinematics.step_lengths(xy[run]) / dt_s)
    turned = every(lambda run: np.degrees(kinematics.yaw_steps(yaw[run])))
    bends = every(lambda run: kinematics.curvature_changes(xy[run], dt_s))
    second = max(round(1.0 / dt_s), 1)
    return {
        "jumps_05m": int((jump > 0.5).sum()),
        "jumps_1m": int((jump > 1.0).sum()),
        "jumps_2m": int((jump > 2.0).sum()),
        "jump_mean": _mean(jump),
        "jump_max": _max(jump),
        "jerk_mean": _mean(jerk),
        "jerk_p95": compute_percentile(jerk, 95) if len(jerk) else 0.0,
        "jerk_max": _max(jerk),
        "frames_over_jerk": int((jerk > 5.0).sum()),
        "acceleration_mean": _mean(acceleration),
        "acceleration_max": _max(acceleration),
        "frames_over_acceleration": int((acceleration > 6.0).sum()),
        "speed_mean": _mean(speed),
        "speed_max": _max(speed),
        "frames_over_speed": int((speed > 30.0).sum()),
        "yaw_step_max_deg": _max(turned),
        "yaw_second_max_deg": float(
            np.degrees(max((kinematics.max_yaw_change(yaw[run], second) for run in stretches), default=0.0))
        ),
        "curvature_spread": float(bends.std()) if len(bends) else None,
        "backward_max": _max(every(lambda run: kinematics.backward_distances(xy[run], yaw[run]))),
    }


def _compute_error_figures(track: RecordedTrack, raw: RecordedTrack) -> dict[str, float | int | None]:
    both = track.valid & raw.valid
    if not both.any():
        return {}
    error = position_errors(track, raw)
    off = (track.xy - raw.xy)[both]
    yaw = track.yaw[both]
    lateral = np.abs(off[:, 1] * np.cos(yaw) - off[:, 0] * np.sin(yaw))
    turned = kinematics.compute_turn(track.xy[both]) - kinematics.compute_turn(raw.xy[both])
    moving = kinematics.step_lengths(track.xy[both]).sum() > 5.0
    return {
        "error_median": compute_median(error),
        "error_p95": compute_percentile(error, 95),
        "error_max": float(error.max()),
        "lateral_shift_max": float(lateral.max()),
        "dtw_mean": compute_dtw_distance(track.xy[both], raw.xy[both]) / int(both.sum()),
        "turn_change_deg": float(np.degrees(abs(np.remainder(turned + np.pi, 2 * np.pi) - np.pi))) if moving else None,
    }


def position_errors(track: RecordedTrack, raw: RecordedTrack) -> Float:
    """Return the distance [m] between reconstructed and raw position at every frame that both have."""
    both = track.valid & raw.valid
    return kinematics.magnitude((track.xy - raw.xy)[both])


def compute_dtw_distance(first: Float, second: Float, band: int = 5) -> float:
    """Return the dynamic-time-warping distance [m] of two paths (N, 2) of equal length, within `band` frames of the
    diagonal."""
    n = len(first)
    if not n:
        return 0.0
    columns = np.arange(n)[:, None] + np.arange(-band, band + 1)
    gap = second[np.clip(columns, 0, n - 1)] - first[:, None]
    costs = np.where((columns >= 0) & (columns < n), np.hypot(gap[..., 0], gap[..., 1]), np.inf)
    return _sum_least_costs(costs)


@twin
def _sum_least_costs(costs: Float, /) -> float:
    """Return the least sum of costs (N, W), W odd, from the middle of the first row to that of the last.

    A step leads to the next column, to the next row one column before, which is the same place of the other path, or to
    the next row.
    """
    frames, width = costs.shape
    middle = width // 2
    best = [np.inf] * middle + np.cumsum(costs[0, middle:]).tolist()
    for row in range(1, frames):
        least, left = [np.inf] * width, np.inf
        for k in range(width):
            above = min(best[k], best[k + 1]) if k + 1 < width else best[k]
            least[k] = left = min(above, left) + float(costs[row, k])
        best = least
    return float(best[middle])


def _compute_lane_figures(
    track: RecordedTrack, raw: RecordedTrack | None, lanes: LaneSegmentIndex
) -> dict[str, float | int | None]:
    """Compute lane figures over the frames in which the log is on the map; the mean offset over those in which it is in
    a lane."""
    there = track.valid
    xy, yaw = track.xy[there], track.yaw[there]
    log = xy if raw is None else np.where(raw.valid[there, None], raw.xy[there], xy)
    shown, is_outside = lanes.locate(log)
    covered = ~is_outside & ((raw is None) | (shown <= OFF_ROUTE_M - LEEWAY_M))
    beyond = int((~covered).sum())
    if not covered.any():
        return {"outside_frames": beyond}
    xy, yaw, shown = xy[covered], yaw[covered], shown[covered]
    offset = lanes.offsets(xy)
    away = lanes.heading_deviations(xy, yaw, offset)
    inside = (shown <= HALF_LANE_M) | (raw is None)
    return {
        "outside_frames": beyond,
        "lateral_mean": float(offset[inside].mean()) if inside.any() else None,
        "lateral_max": float(offset.max()),
        "share_within_1m": float((offset <= 1.0).mean()),
        "share_within_05m": float((offset <= 0.5).mean()),
        "off_route_frames": int((offset > OFF_ROUTE_M).sum()),
        "wrong_way_frames": _count_wrong_way_frames((away > WRONG_WAY_RAD) & (offset <= HALF_LANE_M), xy, away),
        "spawn_offset": float(offset[0]),
        "spawn_yaw_offset_deg": float(np.degrees(away[0])),
    }


def _mean(values: Float) -> float:
    return float(values.mean()) if len(values) else 0.0


def _max(values: Float) -> float:
    return float(values.max()) if len(values) else 0.0


def _count_wrong_way_frames(against: Bool, xy: Float, away: Float) -> int:
    """Count the frames in which the vehicle drives against the lanes, without crossings."""
    step = np.append(kinematics.step_lengths(xy), 0.0)
    back, across = -step * np.cos(away), step * np.sin(away)
    frames = 0
    for run in kinematics.find_runs(against):
        along = back[run].sum()
        crosses = along < CROSSING_M or across[run].sum() > along * np.tan(CROSSING_RAD)
        frames += 0 if crosses else run.stop - run.start
    return frames


def find_plausible_speeds(top_speeds: Mapping[str, float], limits: Mapping[str, float]) -> dict[str, float]:
    """Return the highest plausible speed [m/s] of every moving vehicle.

    `top_speeds`: the highest speed of every moving vehicle [m/s] by track id. `limits`: the highest speed limit [m/s]
    that the map gives on its way, by track id; vehicles without one are missing.
    """
    plausible: dict[str, float] = {}
    for id_ in top_speeds:
        others = [speed for other, speed in top_speeds.items() if other != id_]
        traffic = compute_median(np.array(others)) if len(others) >= LEAST_OTHERS else 0.0
        road = OVER_ROAD * max(limits.get(id_, 0.0), traffic)
        plausible[id_] = min(max(TOWN_MPS, road), HIGHEST_MPS)
    return plausible
