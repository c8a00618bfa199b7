"""Twins of a scenario: the same scenario with exactly one factor changed (decision 093).

What hides a road user is found in the drive of `omniscient`: buildings, props and standing vehicles that any line of
sight from a CAV to the box of the road user meets, from the start until the two are nearest. The pairs are those of the
certificates: the conflicts of `need.json`, and the intervals that matter of `occlusion.json`.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Int, boxes_corners
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.planning.driving_options import ROAD_RANGE_M
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scenario.weather import WEATHERS, Weather
from mdrive_sumo.study.need.occluders import find_opaque
from mdrive_sumo.study.need_certificate import NeedCertificateFile
from mdrive_sumo.study.occlusion_certificate import EVERY_TICKS, OcclusionCertificateFile

Pair = tuple[str, str]
"""A CAV and a road user that is hidden from it."""
STANDING_SPEED = 0.1
"""What is slower [m/s] stands, as for stop signs."""
CLEAR: Weather = WEATHERS["default"]


class TwinFactor(StrEnum):
    """What differs between a scenario and its twin."""

    OCCLUDER = "occluder"
    """What hides the road users of certified or occluded conflicts is gone."""
    CONNECTION = "connection"
    """No other station sends: every CAV drives as if no other one were connected."""
    BACKGROUND = "background"
    """Traffic of SUMO is gone but for occluders and road users of certified or occluded conflicts."""
    WEATHER = "weather"
    """A clear day instead of rain or night."""
    STRANGER = "stranger"
    """One CAV, drawn by the seed, is driven by another agent."""


@dataclass(frozen=True, slots=True)
class Occluders:
    """What stands between CAVs and road users."""

    buildings: frozenset[int] = frozenset()
    """Indices into `RoadMap.buildings`."""
    users: frozenset[str] = frozenset()
    """Ids of props, parked and other standing vehicles that are no CAVs."""


NO_OCCLUDERS = Occluders()


@dataclass(frozen=True, slots=True)
class HiddenConflicts:
    """The pairs of a scenario's certificates, and what hides the one from the other in the drive of `omniscient`."""

    pairs: frozenset[Pair] = frozenset()
    occluders: Occluders = NO_OCCLUDERS


NO_CONFLICTS = HiddenConflicts()


@dataclass(frozen=True, slots=True)
class Twin:
    """A scenario with one factor changed. The channel and other agents are no part of a scenario: see `study.twins`."""

    factor: TwinFactor
    scenario: Scenario
    roads: RoadMap
    """Of the original, or without some of its buildings."""
    changes: tuple[str, ...]
    """What differs, in words."""


def list_hidden_pairs(suite: Suite) -> Mapping[str, frozenset[Pair]]:
    """Return the pairs of the certificates beside a suite or its parts, by scenario id. Raises InputError."""
    pairs: dict[str, set[Pair]] = {scenario.id: set() for scenario in suite.scenarios}
    for name, need in NeedCertificateFile.load(suite).items():
        pairs[name] |= {(conflict.ego, conflict.road_user) for conflict in need.conflicts}
    for name, certificate in OcclusionCertificateFile.load(suite).items():
        pairs[name] |= {(hidden.ego, hidden.actor) for hidden in certificate.hidden if hidden.matters}
    return {name: frozenset(found) for name, found in pairs.items()}


def find_hidden_conflicts(pairs: Collection[Pair], drive: EpisodeRecord, roads: RoadMap) -> HiddenConflicts:
    """Return the pairs with what hides them in a recorded drive."""
    met = {user for _, user in pairs}
    parts = [
        _find_between(drive, roads, drive.ids.index(ego), drive.ids.index(user))
        for ego, user in sorted(pairs)
        if ego in drive.ids and user in drive.ids
    ]
    buildings = frozenset[int]().union(*(part.buildings for part in parts))
    users = frozenset[str]().union(*(part.users for part in parts)) - met - set(drive.ego_ids)
    return HiddenConflicts(frozenset(pairs), Occluders(buildings, users))


def _find_between(drive: EpisodeRecord, roads: RoadMap, ego: int, user: int) -> Occluders:
    """Return what the lines of sight from a CAV to the centre and the corners of a road user meet; both are columns."""
    ticks = np.flatnonzero(drive.valid[:, ego] & drive.valid[:, user])[::EVERY_TICKS]
    away = portable.hypot(drive.x[ticks, ego] - drive.x[ticks, user], drive.y[ticks, ego] - drive.y[ticks, user])
    if len(ticks):
        ticks = ticks[: int(away.argmin()) + 1][away[: int(away.argmin()) + 1] <= ROAD_RANGE_M]
    if not len(ticks):
        return NO_OCCLUDERS
    lines = _draw_sight_lines(drive, ticks, ego, user)
    hits = shapely.STRtree(roads.building_shapes).query(lines.ravel(), predicate="intersects")
    opaque = find_opaque(drive, over_roofs=False)
    opaque[[ego, user]] = False
    columns = np.flatnonzero(opaque)
    corners = boxes_corners(
        drive.x[np.ix_(ticks, columns)],
        drive.y[np.ix_(ticks, columns)],
        drive.yaw[np.ix_(ticks, columns)],
        drive.length[columns],
        drive.width[columns],
    )
    stands = drive.valid[np.ix_(ticks, columns)] & (np.abs(drive.speed[np.ix_(ticks, columns)]) < STANDING_SPEED)
    rows, places = np.nonzero(stands)
    boxes = shapely.polygons(corners[rows, places])
    blocks = shapely.intersects(np.asarray(lines)[rows], np.asarray(boxes)[:, None]).any(axis=1)
    return Occluders(
        frozenset(hits[1].tolist()), frozenset(drive.ids[columns[place]] for place in set(places[blocks].tolist()))
    )


def _draw_sight_lines(drive: EpisodeRecord, ticks: Int, ego: int, user: int) -> Float:
    """Return lines (K, 5) from the centre of the CAV to centre and corners of the road user's box."""
    x, y, yaw = (values[ticks, user] for values in (drive.x, drive.y, drive.yaw))
    ends = np.concatenate(
        (np.stack((x, y), axis=-1)[:, None], boxes_corners(x, y, yaw, drive.length[user], drive.width[user])), axis=1
    )
    starts = np.broadcast_to(np.stack((drive.x[ticks, ego], drive.y[ticks, ego]), axis=-1)[:, None], ends.shape)
    return np.asarray(shapely.linestrings(np.stack((starts, ends), axis=2)))


def make_twin(
    scenario: Scenario, roads: RoadMap, factor: TwinFactor, conflicts: HiddenConflicts = NO_CONFLICTS
) -> Twin:
    """Return the twin of a scenario in which this factor is changed. Raises InputError if it cannot be made."""
    return _MAKERS[factor](scenario, roads, conflicts)


def _remove_occluders(scenario: Scenario, roads: RoadMap, conflicts: HiddenConflicts) -> Twin:
    buildings, users = conflicts.occluders.buildings, conflicts.occluders.users
    if not conflicts.pairs:
        raise _refuse(scenario, TwinFactor.OCCLUDER, "a certified or occluded conflict", "none")
    if not buildings and not users:
        raise _refuse(
            scenario, TwinFactor.OCCLUDER, "a building, prop or standing vehicle that hides a road user",
            "none: what hides it moves, or is a CAV",
        )  # fmt: skip
    kept = tuple(one for i, one in enumerate(roads.buildings) if i not in buildings)
    changed = scenario.model_copy(update={"absent": tuple(sorted(users))})
    changes = (*((_count(len(buildings), "building"),) if buildings else ()), *sorted(users))
    return Twin(TwinFactor.OCCLUDER, changed, replace(roads, buildings=kept), changes)


def _keep_scenario(scenario: Scenario, roads: RoadMap, conflicts: HiddenConflicts) -> Twin:  # noqa: ARG001 (all makers have one form)
    if len(scenario.egos) + len(scenario.rsus) < 2:
        raise _refuse(scenario, TwinFactor.CONNECTION, "two stations or more", "one CAV and no road-side unit")
    return Twin(TwinFactor.CONNECTION, scenario, roads, ("no station sends",))


def _remove_background(scenario: Scenario, roads: RoadMap, conflicts: HiddenConflicts) -> Twin:
    kept = conflicts.occluders.users | {user for _, user in conflicts.pairs}
    gone = {vehicle.id for vehicle in scenario.background.vehicles} - kept
    if not gone:
        raise _refuse(
            scenario, TwinFactor.BACKGROUND, "vehicles in the background that neither hide anything nor are hidden",
            "none",
        )  # fmt: skip
    changed = scenario.model_copy(update={"absent": tuple(sorted(gone))})
    return Twin(TwinFactor.BACKGROUND, changed, roads, (_count(len(gone), "vehicle"),))


def _clear_weather(scenario: Scenario, roads: RoadMap, conflicts: HiddenConflicts) -> Twin:  # noqa: ARG001
    if replace(WEATHERS[scenario.weather], name=CLEAR.name) == CLEAR:
        raise _refuse(scenario, TwinFactor.WEATHER, "rain or night", scenario.weather)
    changed = scenario.model_copy(update={"weather": CLEAR.name})
    return Twin(TwinFactor.WEATHER, changed, roads, (f"{CLEAR.name} instead of {scenario.weather}",))


def _leave_one(scenario: Scenario, roads: RoadMap, conflicts: HiddenConflicts) -> Twin:  # noqa: ARG001
    if len(scenario.egos) < 2:
        raise _refuse(scenario, TwinFactor.STRANGER, "two CAVs or more", "one")
    return Twin(TwinFactor.STRANGER, scenario, roads, ("one CAV has another agent",))


_MAKERS = {
    TwinFactor.OCCLUDER: _remove_occluders,
    TwinFactor.CONNECTION: _keep_scenario,
    TwinFactor.BACKGROUND: _remove_background,
    TwinFactor.WEATHER: _clear_weather,
    TwinFactor.STRANGER: _leave_one,
}


def _refuse(scenario: Scenario, factor: TwinFactor, expected: str, found: str) -> InputError:
    return InputError(f"{scenario.id}: twin {factor}: expected {expected}, found {found}")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
