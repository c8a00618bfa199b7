"""Made-up logs with a known truth: `truth(seed)` makes the tracks, `observed` and `alone` what is recorded of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Float, wrap_angles
from real2sim.hd_map import HdMap
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

DT = 0.1
SIZES = {ObjectCategory.CAR: (4.6, 1.85), ObjectCategory.TRUCK: (8.5, 2.5), ObjectCategory.PEDESTRIAN: (0.5, 0.5)}


@dataclass(frozen=True)
class Log:
    """A recording and what really happened: `names[k]` is the id of truth k in all views."""

    recording: Recording
    truth: tuple[RecordedTrack, ...]


def profile(rng: np.random.Generator, frames: int) -> Float:
    """Distance gone (T,) [m]: cruising, braking to a stop, waiting, driving off, all with bounded jerk."""
    speed = rng.uniform(4, 13)
    t = np.arange(frames) * DT
    v = np.full(frames, speed) * (1 + 0.1 * np.sin(2 * np.pi * t / rng.uniform(6, 12) + rng.uniform(0, 6)))
    if rng.random() < 0.5:
        begin, wait, length = rng.uniform(1, 5), rng.uniform(1, 3), speed / rng.uniform(1.5, 2.5)
        down = np.clip((t - begin) / length, 0, 1)
        up = np.clip((t - begin - length - wait) / (1.2 * length), 0, 1)
        v *= 1 - down**2 * (3 - 2 * down) + up**2 * (3 - 2 * up)
    return np.concatenate(((0.0,), np.cumsum(v[:-1]) * DT))


def along_bend(s: Float, radius: float, before: float) -> tuple[Float, Float, Float]:
    """x, y, yaw at arc length s of a way that goes straight, turns left by 90° with easing, and goes straight."""
    fine = np.arange(-60.0, 400.0, 0.25)
    length = radius * np.pi / 2
    turn = np.clip((fine - before) / (1.5 * length), 0, 1)
    yaw = np.pi / 2 * turn**2 * (3 - 2 * turn)
    x, y = (np.cumsum(np.where(fine >= -60, of(yaw), 0)) * 0.25 for of in (np.cos, np.sin))
    return np.interp(s, fine, x - x[240]), np.interp(s, fine, y - y[240]), np.interp(s, fine, yaw)


def truth(seed: int, vehicles: int = 60, walkers: int = 12, frames: int = 100) -> tuple[RecordedTrack, ...]:
    """Platoons on lanes 3.5 m apart (straight and bending), a row of parked cars 2.6 m apart, walkers in pairs."""
    rng = np.random.default_rng(seed)
    tracks: list[RecordedTrack] = []
    lane = 0
    while len(tracks) < vehicles - 10:
        s, bend = profile(rng, frames), rng.random() < 0.5
        block, row = divmod(lane, 3)
        bend = bend and block % 2 == 1
        s = s * (4.5 / 13 if bend else 1.0)
        radius, base = 15.0 - 3.5 * row, np.array((0.0, 70.0 * block))
        for place in range(min(5, vehicles - 10 - len(tracks))):
            category = ObjectCategory.TRUCK if rng.random() < 0.1 else ObjectCategory.CAR
            way = s - 13.0 * place
            x, y, yaw = along_bend(way, radius, 30.0) if bend else (way, np.zeros(frames), np.zeros(frames))
            tracks.append(made(len(tracks), category, (x + base[0], y + base[1] + 3.5 * row, yaw)))
        lane += 1
    for place in range(vehicles - len(tracks)):
        pose = (np.full(frames, -30.0 + 2.6 * place), np.full(frames, -15.0), np.full(frames, np.pi / 2))
        tracks.append(made(len(tracks), ObjectCategory.CAR, pose))
    t = np.arange(frames) * DT
    for n in range(walkers):
        pair, beside = divmod(n, 2)
        angle, speed = 0.7 * pair, 1.0 + 0.1 * (pair % 5)
        goes = t * speed + 0.4 * np.sin(t * 0.5)
        x = 5 * pair + goes * np.cos(angle) - 0.8 * beside * np.sin(angle)
        y = -30 + goes * np.sin(angle) + 0.8 * beside * np.cos(angle)
        tracks.append(made(len(tracks), ObjectCategory.PEDESTRIAN, (x, y, np.full(frames, angle))))
    return tuple(tracks)


def made(number: int, category: ObjectCategory, pose: tuple[Float, Float, Float]) -> RecordedTrack:
    frames = len(pose[0])
    length, width = SIZES[category]
    full = np.full(frames, 1.0)
    return RecordedTrack(f"{100 + number}", category, full > 0, *pose, length * full, width * full)


def alone(things: Sequence[RecordedTrack], seed: int, noise: float = 1.0) -> Log:
    """What one all-seeing observer without a pose records: there is no other observer to correct it."""
    frames = len(things[0].x)
    view = seen(things, "log", np.zeros((frames, 3)), (np.random.default_rng(seed + 20_000), noise), reach=1e6)
    recording = Recording(f"made-{seed}", "made", DT, frames, (replace(view, pose=np.zeros((0, 3))),), HdMap())
    return Log(recording, tuple(things))


def observed(things: Sequence[RecordedTrack], seed: int, noise: float = 1.0, cavs: Sequence[int] = (0, 7)) -> Log:
    """What two CAVs and two posts record: ids shared, own boxes missing, sizes and centres off by observer, range 90 m.

    `noise` scales everything that is uncertain; with 0 all observers tell the truth and walkers' headings are right.
    """
    rng = np.random.default_rng(seed + 10_000)
    frames = len(things[0].x)
    posts = [("-1", (10.0, 30.0)), ("-2", (40.0, 90.0))]
    views: list[ObserverView] = []
    for number, cav in enumerate(cavs):
        own = things[cav]
        pose = np.column_stack((own.x, own.y, own.yaw))
        shift = noise * 0.6
        pose[:, 0] += shift * np.cos(own.yaw)
        pose[:, 1] += shift * np.sin(own.yaw)
        pose[:, 2] += noise * np.radians(5.0)
        views.append(seen(things, str(number + 1), pose, (rng, noise), skip=cav))
    for name, (x, y) in posts:
        pose = np.tile((x, y, 0.0), (frames, 1))
        views.append(seen(things, name, pose, (rng, noise)))
    names = tuple(view.observer for view in views if not view.is_infrastructure)
    return Log(Recording(f"made-{seed}", "made", DT, frames, tuple(views), HdMap(), names), tuple(things))


def seen(
    things: Sequence[RecordedTrack],
    observer: str,
    pose: Float,
    uncertainty: tuple[np.random.Generator, float],
    skip: int = -1,
    reach: float = 90.0,
) -> ObserverView:
    rng, noise = uncertainty
    tracks: list[RecordedTrack] = []
    for n, thing in enumerate(things):
        near = np.hypot(thing.x - pose[:, 0], thing.y - pose[:, 1]) < reach
        if n == skip or near.sum() < 5:
            continue
        off, jitter = rng.normal(0, 0.1 * noise, 2), rng.normal(0, 0.03 * noise, (2, len(thing.x)))
        scale = 1 + noise * rng.uniform(-0.06, 0.06)
        walker = thing.category is ObjectCategory.PEDESTRIAN
        turned = rng.uniform(-np.pi, np.pi, len(thing.x)) if walker else rng.normal(0, 0.01, len(thing.x))
        columns = {
            "x": thing.x + off[0] + jitter[0],
            "y": thing.y + off[1] + jitter[1],
            "yaw": wrap_angles(thing.yaw + noise * turned),
            "length": thing.length * scale,
            "width": thing.width * scale,
        }
        hidden = {name: np.where(near, values, np.nan) for name, values in columns.items()}
        tracks.append(replace(thing, valid=near, **hidden))
    return ObserverView(observer, tuple(tracks), pose, observer.startswith("-"))
