"""Convert recorded episodes to logs: the simulated motion becomes a Recording.

All road users are in one view without any error (ground truth); `write_v2xpnp` derives the views of observers. The
frame is that of the network.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.lane_assignment import find_predecessors, offset_points
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.hd_map import HdMap, LaneKind, MapArea, MapLane, StopLine
from real2sim.readers.map_geometry import build_cross_line
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

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
SPACING_M = 0.5
"""[m] Maximum distance between points of a lane, as in V2XPnP's maps."""


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
        ObserverView(rsu.id, (), np.tile((rsu.x, rsu.y, STATION_YAW), (len(ticks), 1)), True) for rsu in scenario.rsus
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
    category_by_value = {category.value: category for category in ObjectCategory}
    return [
        category_by_value.get(models.get(name, ""), _guess_category(Kind(int(kind)), float(length)))
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


def build_hd_map(roads: RoadMap) -> HdMap:
    """Build the HD map of a network: car lanes with boundaries, links, neighbours, limits; crosswalks, signs, houses.

    Footways are omitted: a RoadMap contains only their outlines.
    """
    entries = find_predecessors(roads)
    return HdMap(
        lanes={lane.id: _build_lane(lane, entries[lane.id]) for lane in roads.driving},
        crosswalks=tuple(_build_crosswalk(line, width) for line, width in roads.crossings),
        stop_lines=tuple(_build_stop_lines(roads)),
        signals=_build_signals(roads),
        buildings=tuple(MapArea(building.outline) for building in roads.buildings),
    )


def _build_lane(lane: Lane, entries: tuple[str, ...]) -> MapLane:
    line = shapely.segmentize(shapely.LineString(lane.centre.xy), SPACING_M)
    centre: Float = shapely.get_coordinates(line)
    return MapLane(
        id=lane.id,
        kind=LaneKind.DRIVING,
        centre=centre,
        left=offset_points(centre, lane.width / 2),
        right=offset_points(centre, -lane.width / 2),
        entries=entries,
        exits=lane.successors,
        left_neighbour=lane.left,
        right_neighbour=lane.right,
        group=lane.edge,
        width=lane.width,
        speed_limit=lane.speed_limit,
        junction=lane.junction,
    )


def _build_crosswalk(line: Float, width: float) -> Float:
    strip = shapely.buffer(shapely.LineString(line), width / 2, cap_style="flat")
    return shapely.get_coordinates(shapely.get_exterior_ring(strip))[:-1]


def _build_stop_lines(roads: RoadMap) -> Iterator[StopLine]:
    for sign in roads.stop_signs or ():
        lane = roads.lanes[sign.lane]
        yield StopLine(build_cross_line(lane.centre, sign.line_pos_m, lane.width), (lane.id,), "stop")


def _build_signals(roads: RoadMap) -> Mapping[str, tuple[str, ...]]:
    """Return traffic light id -> ids of the lanes it controls."""
    lanes: defaultdict[str, list[str]] = defaultdict(list)
    for lane in roads.driving:
        for light in sorted({link.rpartition(":")[0] for link in lane.lights.values()}):
            lanes[light].append(lane.id)
    return {light: tuple(controlled) for light, controlled in lanes.items()}
