"""Made-up logs with a known truth, and faults planted into them.

`truth(seed)` makes the tracks, `observed` what several observers record of them; each `plant_*` function takes a log
and returns it with some faults and the list of what was planted: a test can look at each one after cleaning.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.geometry import Float, wrap_angles
from real2sim.hdmap import HdMap
from real2sim.recording import Category, Recording, Track, View

DT = 0.1
SIZES = {Category.CAR: (4.6, 1.85), Category.TRUCK: (8.5, 2.5), Category.PEDESTRIAN: (0.5, 0.5)}


@dataclass(frozen=True)
class Log:
    """A recording and what really happened: `names[k]` is the id of truth k in all views."""

    recording: Recording
    truth: tuple[Track, ...]


@dataclass(frozen=True)
class Fault:
    """What was planted: the kind, which true thing, which frames, in which view."""

    kind: str
    thing: int
    frames: tuple[int, ...]
    observer: str


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


def truth(seed: int, vehicles: int = 60, walkers: int = 12, frames: int = 100) -> tuple[Track, ...]:
    """Platoons on lanes 3.5 m apart (straight and bending), a row of parked cars 2.6 m apart, walkers in pairs."""
    rng = np.random.default_rng(seed)
    tracks: list[Track] = []
    lane = 0
    while len(tracks) < vehicles - 10:
        s, bend = profile(rng, frames), rng.random() < 0.5
        block, row = divmod(lane, 3)
        bend = bend and block % 2 == 1
        s = s * (4.5 / 13 if bend else 1.0)
        radius, base = 15.0 - 3.5 * row, np.array((0.0, 70.0 * block))
        for place in range(min(5, vehicles - 10 - len(tracks))):
            category = Category.TRUCK if rng.random() < 0.1 else Category.CAR
            way = s - 13.0 * place
            x, y, yaw = along_bend(way, radius, 30.0) if bend else (way, np.zeros(frames), np.zeros(frames))
            tracks.append(made(len(tracks), category, (x + base[0], y + base[1] + 3.5 * row, yaw)))
        lane += 1
    for place in range(vehicles - len(tracks)):
        pose = (np.full(frames, -30.0 + 2.6 * place), np.full(frames, -15.0), np.full(frames, np.pi / 2))
        tracks.append(made(len(tracks), Category.CAR, pose))
    t = np.arange(frames) * DT
    for n in range(walkers):
        pair, beside = divmod(n, 2)
        angle, speed = 0.7 * pair, 1.0 + 0.1 * (pair % 5)
        goes = t * speed + 0.4 * np.sin(t * 0.5)
        x = 5 * pair + goes * np.cos(angle) - 0.8 * beside * np.sin(angle)
        y = -30 + goes * np.sin(angle) + 0.8 * beside * np.cos(angle)
        tracks.append(made(len(tracks), Category.PEDESTRIAN, (x, y, np.full(frames, angle))))
    return tuple(tracks)


def made(number: int, category: Category, pose: tuple[Float, Float, Float]) -> Track:
    frames = len(pose[0])
    length, width = SIZES[category]
    full = np.full(frames, 1.0)
    return Track(f"{100 + number}", category, full > 0, *pose, length * full, width * full)


def alone(things: Sequence[Track], seed: int, noise: float = 1.0) -> Log:
    """What one all-seeing observer without a pose records: there is nobody to correct it."""
    frames = len(things[0].x)
    view = seen(things, "log", np.zeros((frames, 3)), (np.random.default_rng(seed + 20_000), noise), reach=1e6)
    recording = Recording(f"made-{seed}", "made", DT, frames, (replace(view, pose=np.zeros((0, 3))),), HdMap())
    return Log(recording, tuple(things))


def observed(things: Sequence[Track], seed: int, noise: float = 1.0, cavs: Sequence[int] = (0, 7)) -> Log:
    """What two CAVs and two posts record: ids shared, own boxes missing, sizes and centres off by observer, range 90 m.

    `noise` scales everything that is uncertain; with 0 all observers tell the truth and walkers' headings are right.
    """
    rng = np.random.default_rng(seed + 10_000)
    frames = len(things[0].x)
    posts = [("-1", (10.0, 30.0)), ("-2", (40.0, 90.0))]
    views: list[View] = []
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
    names = tuple(view.observer for view in views if not view.infrastructure)
    return Log(Recording(f"made-{seed}", "made", DT, frames, tuple(views), HdMap(), names), tuple(things))


def seen(
    things: Sequence[Track],
    observer: str,
    pose: Float,
    uncertainty: tuple[np.random.Generator, float],
    skip: int = -1,
    reach: float = 90.0,
) -> View:
    rng, noise = uncertainty
    tracks: list[Track] = []
    for n, thing in enumerate(things):
        near = np.hypot(thing.x - pose[:, 0], thing.y - pose[:, 1]) < reach
        if n == skip or near.sum() < 5:
            continue
        off, jitter = rng.normal(0, 0.1 * noise, 2), rng.normal(0, 0.03 * noise, (2, len(thing.x)))
        scale = 1 + noise * rng.uniform(-0.06, 0.06)
        walker = thing.category is Category.PEDESTRIAN
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
    return View(observer, tuple(tracks), pose, observer.startswith("-"))


def with_tracks(log: Log, observer: int, tracks: Sequence[Track]) -> Log:
    views = list(log.recording.views)
    views[observer] = replace(views[observer], tracks=tuple(tracks))
    return replace(log, recording=replace(log.recording, views=tuple(views)))


def without(track: Track, frames: np.ndarray) -> Track:
    """The track, not there in some frames."""
    gone = np.zeros(len(track.x), dtype=np.bool_)
    gone[frames] = True
    hidden = {name: np.where(gone, np.nan, getattr(track, name)) for name in ("x", "y", "yaw", "length", "width")}
    return replace(track, valid=track.valid & ~gone, **hidden)


def number_of(track: Track) -> int:
    return int(track.id) - 100


Planted = tuple[Log, list[Fault]]
Avoid = frozenset[int]
NOTHING: Avoid = frozenset()


def picked(
    log: Log, rng: np.random.Generator, count: int, suits: Callable[[Track], bool], avoid: Avoid
) -> list[tuple[int, int]]:
    """(view, track) of some different true things that suit."""
    found = [
        (v, t)
        for v, view in enumerate(log.recording.views)
        for t, track in enumerate(view.tracks)
        if number_of(track) < len(log.truth) and number_of(track) not in avoid and suits(track)
    ]
    rng.shuffle(found)
    chosen: dict[str, tuple[int, int]] = {}
    for v, t in found:
        chosen.setdefault(log.recording.views[v].tracks[t].id, (int(v), int(t)))
    return list(chosen.values())[:count]


def plant_duplicates(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 5) -> Planted:
    """A second track of the same thing under another name, a little beside it, for a part of the time."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(log, rng, count, lambda track: track.valid.sum() > 40, avoid):
        view = log.recording.views[v]
        track = view.tracks[t]
        frames = track.frames[: int(rng.integers(20, track.valid.sum()))]
        off = rng.normal(0, 0.08, 2) if track.category is Category.PEDESTRIAN else rng.normal(0, 0.2, 2)
        copy = without(track, np.setdiff1d(np.arange(len(track.x)), frames))
        copy = replace(copy, id=f"{9000 + len(faults)}", x=copy.x + off[0], y=copy.y + off[1])
        log = with_tracks(log, v, [*view.tracks, copy])
        faults.append(Fault("duplicate", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_id_flips(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 5) -> Planted:
    """From one frame on two things of one observer have each other's names."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    used: set[str] = set()
    for v, t in picked(log, rng, 10 * count, lambda track: track.valid.all(), avoid):
        view = log.recording.views[v]
        a = view.tracks[t]
        frame = int(rng.integers(15, len(a.x) - 15))
        others = [b for b in view.tracks if b.valid.all() and b.category is a.category and b.id not in used | {a.id}]
        others = [b for b in others if number_of(b) < len(log.truth) and number_of(b) not in avoid]
        far = [b for b in others if 2.0 < np.hypot(a.x[frame] - b.x[frame], a.y[frame] - b.y[frame]) < 60]
        if not far or a.id in used or len(faults) >= 2 * count:
            continue
        b = far[int(rng.integers(len(far)))]
        used |= {a.id, b.id}
        log = with_tracks(log, v, [swapped(track, a, b, frame) for track in view.tracks])
        rest = tuple(range(frame, len(a.x)))
        faults += [Fault("id flip", number_of(thing), rest, view.observer) for thing in (a, b)]
    return log, faults


def swapped(track: Track, a: Track, b: Track, frame: int) -> Track:
    if track.id not in (a.id, b.id):
        return track
    other = b if track.id == a.id else a
    later = np.arange(len(track.x)) >= frame
    columns = {
        name: np.where(later, getattr(other, name), getattr(track, name))
        for name in ("x", "y", "yaw", "length", "width")
    }
    return replace(track, **columns)


def plant_jumps(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6, longest: int = 8) -> Planted:
    """For some frames a thing is 2 m (to 3 m) elsewhere, for one observer."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(log, rng, count, lambda track: track.valid.all(), avoid):
        view = log.recording.views[v]
        track = view.tracks[t]
        begin = int(rng.integers(12, len(track.x) - 25))
        frames = np.arange(begin, begin + int(rng.integers(1, longest + 1)))
        angle, size = rng.uniform(-np.pi, np.pi), rng.uniform(2, 3)
        x, y = track.x.copy(), track.y.copy()
        x[frames] += size * np.cos(angle)
        y[frames] += size * np.sin(angle)
        log = with_tracks(
            log, v, [replace(track, x=x, y=y) if n == t else other for n, other in enumerate(view.tracks)]
        )
        faults.append(Fault("jump", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_ego_ghosts(log: Log, seed: int, avoid: Avoid = NOTHING) -> Planted:
    """A CAV lists itself as somebody else."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, view in enumerate(log.recording.views):
        own = [thing for thing in log.truth if len(view.pose) and not view.infrastructure and is_own(thing, view)]
        for thing in own:
            off = rng.normal(0, 0.15, 2)
            ghost = replace(thing, id=f"{8000 + v}", x=thing.x + off[0], y=thing.y + off[1])
            log = with_tracks(log, v, [*view.tracks, ghost])
            faults.append(Fault("ego ghost", number_of(thing), tuple(range(len(thing.x))), view.observer))
    return log, faults


def is_own(thing: Track, view: View) -> bool:
    away = np.hypot(thing.x - view.pose[:, 0], thing.y - view.pose[:, 1])
    return bool(np.median(away) < 1.0)


def plant_headings(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6) -> Planted:
    """Boxes look backwards for some frames."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(
        log, rng, count, lambda track: track.valid.all() and track.category is not Category.PEDESTRIAN, avoid
    ):
        view = log.recording.views[v]
        track = view.tracks[t]
        begin = int(rng.integers(0, len(track.x) - 40))
        frames = np.arange(begin, begin + int(rng.integers(1, 40)))
        yaw = track.yaw.copy()
        yaw[frames] = wrap_angles(yaw[frames] + np.pi)
        log = with_tracks(log, v, [replace(track, yaw=yaw) if n == t else other for n, other in enumerate(view.tracks)])
        faults.append(Fault("heading", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_gaps(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6, longest: int = 15) -> Planted:
    """For some frames nobody sees a thing."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    everywhere = {log.truth[n].id for n in range(len(log.truth)) if n not in (0, 7)}
    for v, t in picked(log, rng, count, lambda track: bool(track.valid.all()) and track.id in everywhere, avoid):
        track = log.recording.views[v].tracks[t]
        begin = int(rng.integers(12, len(track.x) - 12 - longest))
        frames = np.arange(begin, begin + int(rng.integers(1, longest + 1)))
        for w, view in enumerate(log.recording.views):
            tracks = [without(other, frames) if other.id == track.id else other for other in view.tracks]
            log = with_tracks(log, w, tracks)
        faults.append(Fault("gap", number_of(track), tuple(frames.tolist()), "all"))
    return log, faults


PLANTS: dict[str, Callable[[Log, int, Avoid], Planted]] = {
    "duplicate": plant_duplicates,
    "id flip": plant_id_flips,
    "jump": plant_jumps,
    "ego ghost": plant_ego_ghosts,
    "heading": plant_headings,
    "gap": plant_gaps,
}
