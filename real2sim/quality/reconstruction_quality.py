"""Quality of a conversion: MDrive's fidelity checks on every actor, and the figures of quality.json.

The checks follow MDrive's list (spec data_formats.md section 3.1). The source of a threshold is "MDrive", "asked" or,
where both name none, "ours" with the reason.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.geometry import Float
from real2sim.quality.actor_quality import (
    TOWN_MPS,
    ActorQuality,
    compute_actor_quality,
    find_plausible_speeds,
    position_errors,
)
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.recording import ObjectCategory, RecordedTrack
from real2sim.tracks import kinematics
from real2sim.tracks.track_contacts import TrackContacts, find_contacts

COLLISION_SLACK_M = 0.1
"""Log boxes are annotated by hand, so each side is moved inwards by this before two boxes count as colliding."""


@dataclass(frozen=True, slots=True)
class QualityCheck:
    """A figure must not exceed its limit; a figure that was not assessed passes."""

    figure: str
    limit: float
    source: str
    applies_when_stationary: bool = True
    """False for checks of the path or the lanes, which apply to moving actors only."""
    limit_figure: str = ""
    """The figure of the actor that is its own limit; then `limit` is the lowest one."""

    def is_failed_by(self, actor: ActorQuality) -> bool:
        """Return whether the actor exceeds the limit."""
        value = getattr(actor, self.figure)
        return value is not None and not value <= self.get_limit(actor)

    def get_limit(self, actor: ActorQuality) -> float:
        """Return the limit for this actor."""
        return getattr(actor, self.limit_figure) if self.limit_figure else self.limit


CHECKS: tuple[QualityCheck, ...] = (
    QualityCheck("jumps_1m", 0, "asked: teleports over 1 m 0"),
    QualityCheck("jerk_p95", 5.0, "MDrive 5 m/s³, asked: 95th percentile"),
    QualityCheck("acceleration_max", 6.0, "MDrive 6 m/s²"),
    QualityCheck(
        "speed_max",
        TOWN_MPS,
        "MDrive 30 m/s; ours: on faster roads 1.5 times the speed limit or the median of the others' top speeds",
        limit_figure="speed_limit",
    ),
    QualityCheck("yaw_step_max_deg", 10.0, "ours: 100 deg/s is a 4 m turning circle at 25 km/h"),
    QualityCheck("yaw_second_max_deg", 75.0, "ours: a tight right turn at 5 m radius and 24 km/h"),
    QualityCheck("curvature_spread", 0.05, "ours: a whole steering wheel turn in 0.4 s"),
    QualityCheck("backward_max", 0.05, "ours: half the position noise of a log"),
    QualityCheck("error_median", 0.3, "asked"),
    QualityCheck("error_p95", 1.0, "asked"),
    QualityCheck("lateral_shift_max", 2.0, "ours: half a lane and a bit; more is another lane"),
    QualityCheck(
        "dtw_mean",
        0.3,
        "ours: a path that may be late, on average as near as positions in the median",
        applies_when_stationary=False,
    ),
    QualityCheck("turn_change_deg", 30.0, "ours: the tolerance of MDrive's lane direction vote"),
    QualityCheck(
        "lateral_mean", 1.75, "ours: half a lane, so that its centre is in the lane", applies_when_stationary=False
    ),
    QualityCheck("off_route_frames", 0, "MDrive: over 3 m from any lane", applies_when_stationary=False),
    QualityCheck("wrong_way_frames", 0, "asked; MDrive: over 90 deg", applies_when_stationary=False),
)
"""All thresholds with their sources."""
PEDESTRIAN_CHECKS = frozenset(
    ("jumps_1m", "jerk_p95", "acceleration_max", "speed_max", "error_median", "error_p95", "dtw_mean")
)
"""Checks that apply to pedestrians, who turn on the spot and step back."""


SCRIPTED_CATEGORIES = frozenset((ObjectCategory.PEDESTRIAN, ObjectCategory.BICYCLE))
"""Pedestrians and cyclists become scripted actors, which are not bound to lanes."""


class ReconstructionQuality(BaseModel):
    """Figures of one converted log for quality.json, separately for moving vehicles, static objects and pedestrians."""

    model_config = ConfigDict(frozen=True)

    log: str
    frames: int
    actors: tuple[ActorQuality, ...]
    moving_vehicles: int
    moving_passed: int
    moving_passed_share: float
    failures: dict[str, int]
    """Number of moving vehicles that fail each check."""
    static_things: int
    static_passed: int
    walkers: int
    """Number of pedestrians and cyclists."""
    walkers_passed: int
    error_median: float | None
    """Raw against reconstructed positions over all frames of all moving vehicles."""
    error_p95: float | None
    jerk_p95: float
    """95th percentile over all frames of all moving vehicles."""
    teleports: int
    wrong_way_frames: int
    collisions: tuple[tuple[str, str, int], ...]
    """First and second actor, and the number of frames in which their boxes overlap."""
    spawn_overlaps: tuple[tuple[str, str], ...]
    duplicates: tuple[tuple[str, str], ...]
    least_distance: float | None
    close_frames: int
    lost: dict[str, str] = {}
    """Tracks that cleaning removed, with the reason (`CleaningReport.drop_reason_by_track`)."""
    off_map: dict[str, str] = {}
    """Moving vehicles that the log itself shows off all lanes for some frames, in which lane checks do not apply."""


def find_failed_checks(actor: ActorQuality) -> tuple[str, ...]:
    """Return the names of the checks that the actor fails. Lane checks apply to moving actors only."""
    walking = actor.category == ObjectCategory.PEDESTRIAN
    bound = [check for check in CHECKS if not walking or check.figure in PEDESTRIAN_CHECKS]
    return tuple(
        check.figure for check in bound if (check.applies_when_stationary or actor.moving) and check.is_failed_by(actor)
    )


def with_failed_checks(actor: ActorQuality) -> ActorQuality:
    """Return the actor with `failed` filled in."""
    return actor.model_copy(update={"failed": find_failed_checks(actor)})


@dataclass(frozen=True, slots=True)
class ReconstructedLog:
    """Input of the assessment: reconstructed tracks and, by the same ids, the cleaned raw tracks."""

    log: str
    dt_s: float
    tracks: Sequence[RecordedTrack]
    raw: Mapping[str, RecordedTrack]
    lanes: LaneSegmentIndex | None = None
    lost: Mapping[str, str] | None = None
    limits: Mapping[str, float] | None = None
    """The highest speed limit [m/s] that the map gives on the way of a vehicle, by track id."""


def assess_reconstruction(converted: ReconstructedLog) -> ReconstructionQuality:
    """Check every actor and compute the figures of the scene."""
    dt_s, raw = converted.dt_s, converted.raw
    figures = [compute_actor_quality(track, dt_s, raw.get(track.id), converted.lanes) for track in converted.tracks]
    actors = tuple(map(with_failed_checks, _set_speed_limits(figures, converted.limits or {})))
    walkers = [actor for actor in actors if actor.category in SCRIPTED_CATEGORIES]
    others = [actor for actor in actors if actor.category not in SCRIPTED_CATEGORIES]
    moving = [actor for actor in others if actor.moving]
    static = [actor for actor in others if not actor.moving]
    ids = {actor.id for actor in moving}
    movers = [track for track in converted.tracks if track.id in ids]
    error = _concatenate([position_errors(track, raw[track.id]) for track in movers if track.id in raw])
    jerk = _concatenate(
        [
            kinematics.jerk_magnitudes(track.xy[run], dt_s)
            for track in movers
            for run in kinematics.find_runs(track.valid)
        ]
    )
    return ReconstructionQuality(
        log=converted.log,
        frames=len(converted.tracks[0].valid) if converted.tracks else 0,
        actors=actors,
        moving_vehicles=len(moving),
        moving_passed=_count_passed(moving),
        moving_passed_share=_count_passed(moving) / len(moving) if moving else 1.0,
        failures=dict(Counter(name for actor in moving for name in actor.failed)),
        static_things=len(static),
        static_passed=_count_passed(static),
        walkers=len(walkers),
        walkers_passed=_count_passed(walkers),
        error_median=_compute_percentile(error, 50),
        error_p95=_compute_percentile(error, 95),
        jerk_p95=_compute_percentile(jerk, 95) or 0.0,
        teleports=sum(actor.jumps_1m for actor in actors),
        wrong_way_frames=sum(actor.wrong_way_frames or 0 for actor in moving),
        lost=dict(converted.lost or {}),
        off_map={actor.id: _describe_off_map(actor) for actor in moving if actor.outside_frames},
        **_contacts_by_id(find_contacts(converted.tracks, COLLISION_SLACK_M), [track.id for track in converted.tracks]),
    )


def _set_speed_limits(actors: Sequence[ActorQuality], limits: Mapping[str, float]) -> list[ActorQuality]:
    """Return the actors with the highest speed that is plausible on their road."""
    moving = {
        actor.id: actor.speed_max for actor in actors if actor.moving and actor.category not in SCRIPTED_CATEGORIES
    }
    plausible = find_plausible_speeds(moving, limits)
    return [actor.model_copy(update={"speed_limit": plausible.get(actor.id, TOWN_MPS)}) for actor in actors]


def _describe_off_map(actor: ActorQuality) -> str:
    return f"{actor.outside_frames} of {actor.frames} frames off all lanes of the map in the log itself"


def _contacts_by_id(contacts: TrackContacts, ids: Sequence[str]) -> dict[str, Any]:
    return {
        "collisions": tuple((ids[i], ids[j], n) for i, j, n in contacts.collisions),
        "spawn_overlaps": tuple((ids[i], ids[j]) for i, j in contacts.spawn_overlaps),
        "duplicates": tuple((ids[i], ids[j]) for i, j in contacts.duplicates),
        "least_distance": contacts.least_distance_m if np.isfinite(contacts.least_distance_m) else None,
        "close_frames": contacts.close_frames,
    }


def _count_passed(actors: Sequence[ActorQuality]) -> int:
    return sum(not actor.failed for actor in actors)


def _concatenate(values: Sequence[Float]) -> Float:
    return np.concatenate(values) if values else np.zeros(0)


def _compute_percentile(values: Float, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None
