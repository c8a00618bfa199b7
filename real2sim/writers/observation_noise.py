"""Simulate what several observers would record of a known scene, with the noise of V2XPnP's logs (format notes, 2.2).

A surrogate: errors of sizes, yaws, ranges and offsets have the magnitudes measured on real frames; the correlation of
errors in time and the rates of gaps and wrong labels cannot be measured on single frames and are assumed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from real2sim.hd_map import HdMap
from real2sim.recording import DEFAULT_SIZE_M, ObjectCategory, ObserverView, RecordedTrack, Recording


@dataclass(frozen=True, slots=True)
class ObservationNoise:
    """Differences of the views from the truth and from each other."""

    position_m: float = 0.06
    """Standard deviation in x and in y: two agents then differ by 0.1 m in the median, as measured."""
    correlation_s: float = 1.0
    """Correlation time of position errors; assumed."""
    size: float = 0.06
    """Relative standard deviation of a vehicle's size, one draw per agent (4.04 m instead of 4.60 m was observed)."""
    pedestrian_size: float = 0.15
    """The same for pedestrians, one draw per frame."""
    yaw_deg: float = 0.5
    lag_s: float = 0.4
    """Delay of the yaw of boxes behind the motion: 10 degrees in a turn of 25 degrees/s."""
    flip_probability: float = 0.02
    """Probability per frame that a pedestrian's yaw, which is meaningless, flips; assumed."""
    mount_m: tuple[float, float] = (0.5, 0.9)
    """Range of the longitudinal offset of a CAV's lidar from the box centre."""
    mount_deg: float = 5.0
    """Maximum angle between lidar and car."""
    cav_range_m: float = 120.0
    station_range_m: float = 85.0
    min_visible_share: float = 0.1
    """Minimum share of a box that must be visible."""
    gaps_per_s: float = 0.05
    """Assumed rate [1/s] at which an observer loses an object."""
    max_gap_frames: int = 5
    """Assumed longest gap, in frames."""
    label_error_probability: float = 0.03
    """Probability per object and agent; assumed."""
    attribute_error_probability: float = 0.1
    """Probability that an agent does not label a parked object static; a tenth of it for other objects. Assumed."""


CONFUSED_WITH: Mapping[ObjectCategory, ObjectCategory] = {
    ObjectCategory.CAR: ObjectCategory.VAN,
    ObjectCategory.VAN: ObjectCategory.CAR,
    ObjectCategory.BUS: ObjectCategory.TRUCK,
    ObjectCategory.TRUCK: ObjectCategory.STATIC,  # the data contain a "trash can" of 10 m by 3 m
}


def simulate_observers(truth: Recording, noise: ObservationNoise | None, seed: int) -> Recording:
    """Return the scene as its observers record it: one view per CAV (1, 2, ...) and per station (-1, -2, ...).

    `truth` holds all tracks in its first view; `truth.cavs` names the observers, which must be valid in every frame;
    stations are further views with `is_infrastructure` and a pose. Ids become numbers (`assign_numbers`). Without noise
    every observer sees everything exactly, except itself.
    """
    names = assign_numbers(truth)
    tracks = tuple(replace(track, id=names[track.id]) for track in truth.views[0].tracks)
    own = {track.id: track for track in tracks}
    stations = [view for view in truth.views[1:] if view.is_infrastructure]
    observers = {
        **{str(n): _get_cav_pose(own[names[cav]], cav) for n, cav in enumerate(truth.cavs, start=1)},
        **{str(-n): station.pose for n, station in enumerate(stations, start=1)},
    }
    carriers = {str(n): names[cav] for n, cav in enumerate(truth.cavs, start=1)}
    draw = _ObserverDraw(noise, seed, truth.dt_s, _find_walls(truth.map)) if noise is not None else None
    views = tuple(
        _simulate_view(agent, ObserverView(carriers.get(agent, ""), tracks, pose), draw)
        for agent, pose in observers.items()
    )
    return replace(truth, views=views, cavs=tuple(carriers))


def assign_numbers(truth: Recording) -> dict[str, str]:
    """Return the number for each track id: the id itself if all ids are plain numbers, else a counter."""
    ids = [track.id for track in truth.views[0].tracks]
    if all(name.isdecimal() and name == str(int(name)) for name in ids):
        return {name: name for name in ids}
    return {name: str(n) for n, name in enumerate(ids)}


def _get_cav_pose(track: RecordedTrack, cav: str) -> Float:
    if not track.valid.all():
        raise ValueError(f"CAV {cav} must be there in every frame, it is absent in {int((~track.valid).sum())}")
    return np.column_stack((track.x, track.y, track.yaw))


@dataclass(frozen=True)
class _ObserverDraw:
    """What all observers of a scene share."""

    noise: ObservationNoise
    seed: int
    dt_s: float
    walls: BuildingEdges


def _find_walls(map_: HdMap) -> BuildingEdges:
    buildings = tuple(
        Building(id=str(number), polygon=tuple(map(tuple, area.outline.tolist())))
        for number, area in enumerate(map_.buildings)
    )
    return BuildingEdges(RoadMap("", Path(), {}, (), (), (), buildings, None, ""))


def _simulate_view(agent: str, scene: ObserverView, draw: _ObserverDraw | None) -> ObserverView:
    """Simulate one view; `scene` holds all tracks, the carrier's id as observer ("" for a station) and its pose."""
    others = tuple(track for track in scene.tracks if track.id != scene.observer)
    station = agent.startswith("-")
    if draw is None:
        return ObserverView(agent, others, scene.pose, station)
    noise, seed = draw.noise, draw.seed
    pose = scene.pose if station else _offset_sensor(scene.pose, noise, np.random.default_rng(derive_seed(seed, agent)))
    seen = _compute_visibility(scene, pose, draw, noise.station_range_m if station else noise.cav_range_m)
    noted = (
        _observe_track(
            track, seen[track.id], noise, np.random.default_rng(derive_seed(seed, agent, track.id)), draw.dt_s
        )
        for track in others
    )
    return ObserverView(agent, tuple(track for track in noted if track.valid.any()), pose, station)


def _offset_sensor(pose: Float, noise: ObservationNoise, rng: np.random.Generator) -> Float:
    """Return the pose (T, 3) of a lidar mounted on a car."""
    ahead = rng.choice((-1.0, 1.0)) * rng.uniform(*noise.mount_m)
    aside, turn = rng.normal(0.0, 0.05), math.radians(rng.uniform(-noise.mount_deg, noise.mount_deg))
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.column_stack(
        (
            pose[:, 0] + ahead * cos - aside * sin,
            pose[:, 1] + ahead * sin + aside * cos,
            wrap_angles(pose[:, 2] + turn),
        )
    )


def _compute_visibility(scene: ObserverView, pose: Float, draw: _ObserverDraw, range_m: float) -> dict[str, Bool]:
    """Return a mask (T,) per track: True where enough of it is visible past buildings and the other boxes."""
    seen = np.zeros((len(scene.tracks), len(pose)), dtype=np.bool_)
    for t, (x, y, yaw) in enumerate(pose.tolist()):
        rows = [i for i, track in enumerate(scene.tracks) if track.valid[t]]
        ids = [scene.tracks[i].id for i in rows]
        eye = SensorPose(x, y, yaw, ids.index(scene.observer) if scene.observer else None)
        boxes = _build_objects([scene.tracks[i] for i in rows], t)
        seen[rows, t] = SightView(eye, SensingFrame(t, boxes, {}), draw.walls, range_m).visible_rows(
            draw.noise.min_visible_share
        )
    return {track.id: row for track, row in zip(scene.tracks, seen, strict=True)}


def _build_objects(tracks: list[RecordedTrack], t: int) -> Objects:
    rows = np.array([(k.x[t], k.y[t], k.yaw[t], k.length[t], k.width[t]) for k in tracks]).reshape(-1, 5)
    usual = np.array([(0.0, *DEFAULT_SIZE_M[k.category]) for k in tracks]).reshape(-1, 3)
    yaw, length, width = np.where(np.isnan(rows[:, 2:]), usual, rows[:, 2:]).T
    kinds = np.array([k.category.kind for k in tracks], dtype=np.uint8)
    ids = tuple(k.id for k in tracks)
    return Objects(ids, kinds, rows[:, 0], rows[:, 1], yaw, np.zeros(len(rows)), length, width)


def _observe_track(
    track: RecordedTrack, seen: Bool, noise: ObservationNoise, rng: np.random.Generator, dt_s: float
) -> RecordedTrack:
    """Return a track as one agent records it; `seen` is (T,)."""
    count = len(track.valid)
    valid = track.valid & seen & ~_draw_gaps(count, noise, rng, dt_s)
    gone = np.where(valid, 0.0, np.nan)
    walker = track.category is ObjectCategory.PEDESTRIAN
    error = _draw_correlated_error(count, noise, rng, dt_s)
    scale = np.exp(rng.normal(0.0, noise.pedestrian_size if walker else noise.size, (2, count if walker else 1)))
    yaw = _draw_random_yaw(count, noise, rng) if walker else _lag_yaw(track, noise, rng, dt_s)
    mistaken = rng.random() < noise.label_error_probability
    doubt = noise.attribute_error_probability if track.parked else noise.attribute_error_probability / 10
    return replace(
        track,
        category=CONFUSED_WITH.get(track.category, track.category) if mistaken else track.category,
        valid=valid,
        x=track.x + error[:, 0] + gone,
        y=track.y + error[:, 1] + gone,
        yaw=yaw + gone,
        length=track.length * scale[0] + gone,
        width=track.width * scale[1] + gone,
        parked=track.parked != (rng.random() < doubt),
    )


def _draw_gaps(count: int, noise: ObservationNoise, rng: np.random.Generator, dt_s: float) -> Bool:
    """Return a mask (T,) of interruptions."""
    gaps = np.zeros(count, dtype=np.bool_)
    for start in np.flatnonzero(rng.random(count) < noise.gaps_per_s * dt_s).tolist():
        gaps[start : start + int(rng.integers(1, noise.max_gap_frames, endpoint=True))] = True
    return gaps


def _draw_correlated_error(count: int, noise: ObservationNoise, rng: np.random.Generator, dt_s: float) -> Float:
    """Return (T, 2) [m] of a stationary first-order process."""
    keep = math.exp(-dt_s / noise.correlation_s)
    error = rng.normal(0.0, noise.position_m, (count, 2))
    for t in range(1, count):
        error[t] = keep * error[t - 1] + math.sqrt(1 - keep**2) * error[t]
    return error


def _draw_random_yaw(count: int, noise: ObservationNoise, rng: np.random.Generator) -> Float:
    flips = np.cumsum(rng.random(count) < noise.flip_probability).astype(np.float64)
    return wrap_angles(rng.uniform(-math.pi, math.pi) + math.pi * flips)


def _lag_yaw(track: RecordedTrack, noise: ObservationNoise, rng: np.random.Generator, dt_s: float) -> Float:
    """Return the yaw delayed by a low-pass filter over the valid frames."""
    follow = dt_s / (noise.lag_s + dt_s)
    yaw, late = track.yaw.copy(), math.nan
    for t in np.flatnonzero(np.isfinite(yaw)).tolist():
        step = math.remainder(yaw[t] - late, 2 * math.pi) if math.isfinite(late) else 0.0
        late = late + follow * step if math.isfinite(late) else float(yaw[t])
        yaw[t] = late
    return wrap_angles(yaw + rng.normal(0.0, math.radians(noise.yaw_deg), len(yaw)))
