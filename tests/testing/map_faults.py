"""Maps with known faults: clean ones from packaged networks or the test's own, lanes reversed and links taken away."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from real2sim.hd_map import HdMap, LaneKind, MapLane


def as_map(roads: RoadMap, directed: bool = True) -> HdMap:
    """The driving lanes of a network as the map of a log."""
    return HdMap(
        lanes={
            lane.id: MapLane(
                id=lane.id,
                kind=LaneKind.DRIVING,
                centre=lane.centre.xy,
                exits=lane.successors,
                left_neighbour=lane.left,
                right_neighbour=lane.right,
                width=lane.width,
                speed_limit=lane.speed_limit,
                directed=directed,
                junction=lane.junction,
            )
            for lane in roads.driving
        }
    )


def lane(id_: str, points: object, exits: tuple[str, ...] = (), **more: object) -> MapLane:
    """A driving lane through the given points."""
    return MapLane(id_, LaneKind.DRIVING, np.asarray(points, dtype=np.float64), exits=exits, **more)


def lanes_map(*lanes: MapLane) -> HdMap:
    """A map of these lanes."""
    return HdMap(lanes={one.id: one for one in lanes})


@dataclass(frozen=True)
class Planted:
    """A faulty map and what is wrong with it."""

    map: HdMap
    reversed: frozenset[str]
    removed: frozenset[tuple[str, str]]


def plant(clean: HdMap, rng: np.random.Generator, reversed_share: float, removed_share: float) -> Planted:
    """Reverses the drawing of lanes, and takes links away, at random; both ends of a link forget it."""
    lanes = dict(clean.lanes)
    turned = frozenset(id_ for id_ in sorted(lanes) if rng.random() < reversed_share)
    links = sorted(all_links(clean.lanes))
    removed = frozenset(link for link in links if rng.random() < removed_share)
    for id_, one in lanes.items():
        centre = one.centre[::-1] if id_ in turned else one.centre
        exits = tuple(b for b in one.exits if (id_, b) not in removed)
        entries = tuple(a for a in one.entries if (a, id_) not in removed)
        lanes[id_] = replace(one, centre=centre, exits=exits, entries=entries)
    return Planted(replace(clean, lanes=lanes), turned, removed)


def all_links(lanes: Mapping[str, MapLane]) -> set[tuple[str, str]]:
    """Links to lanes that exist, from exits and entries."""
    links = {(id_, b) for id_, one in lanes.items() for b in one.exits}
    links |= {(a, id_) for id_, one in lanes.items() for a in one.entries}
    return {(a, b) for a, b in links if a in lanes and b in lanes}


def drive(points: Float, speed: float = 10.0, dt_s: float = 0.1) -> Float:
    """Poses (N, 3) along a line at constant speed."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    at = np.arange(0.0, s[-1], speed * dt_s)
    xy = np.column_stack([np.interp(at, s, points[:, axis]) for axis in (0, 1)])
    yaw = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    return np.column_stack((xy, yaw[np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(yaw) - 1)]))
