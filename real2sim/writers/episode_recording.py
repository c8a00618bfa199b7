"""Convert recorded episodes to logs: the simulated motion becomes a Recording.

All road users are in one view without any error (ground truth); `write_v2xpnp` derives the views of observers. The
frame is that of the network.
"""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.episode_map import build_hd_map

DT_S = 0.1
STRIDE = round(DT_S * TICKS_PER_SECOND)
"""Ticks between two frames of the log."""
CATEGORY_BY_LENGTH: tuple[tuple[float, ObjectCategory], ...] = (
    (5.4, ObjectCategory.CAR),
    (6.5, ObjectCategory.VAN),
    (np.inf, ObjectCategory.TRUCK),
)
"""Category of vehicles by length [m], where the scenario names none."""
STATION_YAW = 0.0
"""Stations observe all directions."""


def record_episode(
    episode: EpisodeRecord, scenario: Scenario, roads: RoadMap, window_s: tuple[float, float] | None = None
) -> Recording:
    """Return the episode as a 10 Hz log: all road users in the first view, one further view per station.

    `window_s` [s since the start] selects a part; by default from the start until the first CAV leaves, because an
    observer must be present in all frames. Other CAVs are ordinary vehicles and are listed in the notes. Raises
    InputError for an episode of another scenario or a window without frames.
    """
    if (episode.scenario, episode.ego_ids) != (scenario.id, tuple(ego.id for ego in scenario.egos)):
        raise InputError(f"recording of {episode.scenario}: expected an episode of scenario {scenario.id}")
    ticks = _select_ticks(episode, window_s)
    there = episode.valid[ticks]
    cavs = tuple(ego for n, ego in enumerate(episode.ego_ids) if there[:, n].all())
    categories = _assign_categories(episode, scenario)
    tracks = tuple(_build_track(episode, n, ticks, categories[n]) for n in np.flatnonzero(there.any(axis=0)).tolist())
    posts = tuple(
        ObserverView(rsu.id, (), _build_station_pose(rsu.x, rsu.y, len(ticks)), True) for rsu in scenario.rsus
    )
    return Recording(
        id=scenario.id,
        source="mdrive-sumo",
        dt_s=DT_S,
        frame_count=len(ticks),
        views=(ObserverView("log", tracks), *posts),
        map=build_hd_map(roads),
        cavs=cavs,
        notes=tuple(f"CAV {ego} is not there throughout" for ego in episode.ego_ids if ego not in cavs),
    )


def _select_ticks(episode: EpisodeRecord, window_s: tuple[float, float] | None) -> np.ndarray:
    """Return the ticks that become frames of the log."""
    if window_s is None:
        first, last = 0, int(episode.valid[:, : episode.egos].sum(axis=0).min()) - 1
    else:
        first, last = (round(second * TICKS_PER_SECOND) for second in window_s)
    ticks = np.arange(max(first, 0), min(last, episode.ticks - 1) + 1, STRIDE)
    if not len(ticks):
        raise InputError(
            f"recording of {episode.scenario}: expected a window within its {episode.ticks / TICKS_PER_SECOND:g} s,"
            f" found {window_s}"
        )
    return ticks


def _assign_categories(episode: EpisodeRecord, scenario: Scenario) -> Sequence[ObjectCategory]:
    """Return the category of every episode column: that of the scenario, else by kind and size."""
    models = {actor.id: actor.model for actor in scenario.actors}
    known = {category.value: category for category in ObjectCategory}
    return [
        known.get(models.get(name, ""), _guess_category(Kind(int(kind)), float(length)))
        for name, kind, length in zip(episode.ids, episode.kind, episode.length, strict=True)
    ]


def _guess_category(kind: Kind, length: float) -> ObjectCategory:
    if kind is Kind.VEHICLE:
        return next(category for largest, category in CATEGORY_BY_LENGTH if length <= largest)
    others = {
        Kind.PEDESTRIAN: ObjectCategory.PEDESTRIAN,
        Kind.CYCLIST: ObjectCategory.BICYCLE,
        Kind.STATIC: ObjectCategory.STATIC,
    }
    return others[kind]


def _build_track(episode: EpisodeRecord, column: int, ticks: np.ndarray, category: ObjectCategory) -> RecordedTrack:
    valid = episode.valid[ticks, column]
    x, y, yaw = (np.where(valid, values[ticks, column], np.nan) for values in (episode.x, episode.y, episode.yaw))
    full = np.where(valid, 1.0, np.nan)
    length, width = float(episode.length[column]) * full, float(episode.width[column]) * full
    still = not (episode.speed[ticks, column][valid] > 0).any()
    return RecordedTrack(episode.ids[column], category, valid, x, y, yaw, length, width, parked=still)


def _build_station_pose(x: float, y: float, frames: int) -> Float:
    return np.tile((x, y, STATION_YAW), (frames, 1))
