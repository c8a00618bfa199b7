"""Fits the traffic of a scenario to reconstructed tracks: CAVs, background vehicles, scripted actors.

Disposition of tracks:
- CAVs: egos that start as in the log, with the route they drove there.
- Moving vehicles with a route: background vehicles with a schedule. One that begins inside a junction departs at the
  end of the edge before it, and its schedule begins with the distance it is ahead of that. One that enters or leaves
  the map at an end of its lanes is present while it is on the map.
- Moving vehicles that leave the roads elsewhere or drive beside another one in a lane, pedestrians, cyclists: actors on
  their path of the log, which stop for obstacles, in every mode.
- Static objects: standing actors. SUMO's traffic ignores actors that were driven around (`centreline_traffic`).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundMode
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from real2sim.fit.background_vehicle import RoutedTrack, build_background_vehicle, route_track
from real2sim.fit.cavs import build_ego
from real2sim.fit.centreline_traffic import CentrelineTraffic, find_abreast, place_on_centrelines
from real2sim.fit.driver_parameters import estimate_driving
from real2sim.fit.scripted_actors import build_replay_actor, build_standing_actor
from real2sim.match import LaneMatch
from real2sim.recording import ObjectCategory, RecordedTrack

ACTION_STEP_S = 0.1
"""[s] Drivers of a log react at its frame rate, which SUMO's insertion and schedules need."""
LEAST_FRAMES = 2
"""A track of fewer frames has no motion."""
LONG_NAME, SHORT_NAME = 16, 6
"""Names of more characters are shortened, but to no fewer than the second."""
DRIVEN_KINDS = frozenset(
    (ObjectCategory.CAR, ObjectCategory.VAN, ObjectCategory.TRUCK, ObjectCategory.BUS, ObjectCategory.MOTORCYCLE)
)


class Disposition(StrEnum):
    """What a track of the log becomes in the scenario."""

    CAV = "CAV"
    BACKGROUND = "background"
    """A vehicle that SUMO drives along its schedule."""
    ACTOR = "actor"
    """A scripted road user on its path of the log."""
    STANDING = "standing"
    """An object that never moves."""
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class TrackRole:
    """Disposition of one track and its reason; "" if the reason is obvious."""

    disposition: Disposition
    reason: str = ""


@dataclass(frozen=True)
class FittedTraffic:
    """The traffic of a scenario."""

    egos: tuple[Ego, ...]
    background: Background
    actors: tuple[Actor, ...]
    roles: Mapping[str, TrackRole]
    """Disposition and reason by track id; whatever could not be kept is LEFT_OUT with a reason."""
    names: Mapping[str, str]
    """Track id -> id in the scenario."""


@dataclass
class _FitContext:
    """Inputs and results shared by the steps of one fit."""

    matches: Mapping[str, LaneMatch]
    roads: RoadMap
    dt_s: float
    names: dict[str, str]
    roles: dict[str, TrackRole]


def fit_traffic(
    tracks: Sequence[RecordedTrack],
    matches: Mapping[str, LaneMatch],
    roads: RoadMap,
    cavs: Sequence[str],
    mode: BackgroundMode,
    dt_s: float,
) -> FittedTraffic:
    """Fit the traffic to reconstructed tracks, their lane matches by track id (vehicles only) and the ids of the CAVs'
    tracks.

    Raises InputError for a CAV that is not present in the first frame or has no route through the network.
    """
    track_by_id = {track.id: track for track in tracks}
    for name in cavs:
        if name not in track_by_id:
            raise InputError(
                f"CAV {name}: expected one of the tracks {_list_some(sorted(track_by_id))}, found none of that name"
            )
    work = _FitContext(matches, roads, dt_s, make_scenario_names(tracks), {})
    egos = tuple(_fit_ego(work, track_by_id[name]) for name in cavs)
    rest = [track for track in tracks if track.id not in cavs]
    drivers = _select_background_vehicles(work, rest)
    following = estimate_driving(drivers, dt_s) if drivers else []
    vehicles = [
        build_background_vehicle(driver, work.names[driver.track.id], driving, dt_s, mode != "reactive")
        for driver, driving in zip(drivers, following, strict=True)
    ]
    on_road, traffic = {driver.track.id for driver in drivers}, place_on_centrelines(drivers, roads)
    actors = [actor for track in rest if track.id not in on_road for actor in _build_actors(work, track, traffic)]
    background = Background(vehicles=tuple(vehicles), action_step_s=ACTION_STEP_S, mode=mode)
    return FittedTraffic(egos, background, tuple(actors), work.roles, work.names)


def make_scenario_names(tracks: Sequence[RecordedTrack]) -> dict[str, str]:
    """Return ids that scenario files allow, long ones shortened to a unique prefix, equal ones numbered."""
    plain = {track.id: re.sub(r"[^A-Za-z0-9_.+-]", "-", track.id) for track in tracks}
    plain = {id_: text if re.match(r"[A-Za-z0-9]", text) else f"t{text}" for id_, text in plain.items()}
    names: dict[str, str] = {}
    for id_, text in plain.items():
        stem = _shorten(text, plain.values())
        name, k = stem, 1
        while name in names.values():
            k += 1
            name = f"{stem}.{k}"
        names[id_] = name
    return names


def _shorten(text: str, texts: Iterable[str]) -> str:
    """Return the text or, if it is long (a hash), its shortest unique prefix."""
    if len(text) <= LONG_NAME:
        return text
    others = [other for other in texts if other != text]
    length = next((n for n in range(SHORT_NAME, 70) if not any(other.startswith(text[:n]) for other in others)), 70)
    return text[:length]


def _list_some(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _fit_ego(work: _FitContext, track: RecordedTrack) -> Ego:
    match = work.matches.get(track.id)
    if match is None:
        raise InputError(f"CAV {track.id}: expected a vehicle, found a {track.category.value}")
    ego, said = build_ego(track, match, work.roads, work.names[track.id], work.dt_s)
    work.roles[track.id] = TrackRole(Disposition.CAV, said)
    return ego


def _select_background_vehicles(work: _FitContext, tracks: Sequence[RecordedTrack]) -> list[RoutedTrack]:
    """Return the moving vehicles that SUMO can drive; the others get a reason."""
    routed_tracks: list[RoutedTrack] = []
    for track in tracks:
        if track.parked or track.category not in DRIVEN_KINDS or track.valid.sum() < LEAST_FRAMES:
            continue
        match = work.matches.get(track.id)
        routed = route_track(track, match, work.roads) if match is not None else "it was not matched to lanes"
        if isinstance(routed, str):
            work.roles[track.id] = TrackRole(Disposition.ACTOR, routed)
            continue
        routed_tracks.append(routed)
    beside = find_abreast(place_on_centrelines(routed_tracks, work.roads), work.dt_s)
    for routed in routed_tracks:
        out = routed.track.id in beside
        role = (
            TrackRole(Disposition.ACTOR, beside[routed.track.id])
            if out
            else TrackRole(Disposition.BACKGROUND, routed.omitted_part)
        )
        work.roles[routed.track.id] = role
    return [routed for routed in routed_tracks if routed.track.id not in beside]


def _build_actors(work: _FitContext, track: RecordedTrack, traffic: CentrelineTraffic) -> list[Actor]:
    name = work.names[track.id]
    frames = int(track.valid.sum())
    if frames < LEAST_FRAMES and not (track.parked and frames):
        work.roles[track.id] = TrackRole(Disposition.LEFT_OUT, f"seen in {frames} frames only")
        return []
    if track.parked or track.category.kind is Kind.STATIC:
        actor, said = build_standing_actor(track, name, traffic, work.dt_s)
        work.roles[track.id] = TrackRole(Disposition.STANDING, said)
        return [actor]
    actor, said = build_replay_actor(track, name, traffic, work.roads, work.dt_s)
    before = work.roles[track.id].reason if track.id in work.roles else ""
    work.roles[track.id] = TrackRole(Disposition.ACTOR, "; ".join(part for part in (before, said) if part))
    return [actor]
