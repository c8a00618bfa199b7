"""Tiny scenarios, roads and episodes made by hand, for tests of criteria, metrics and scores."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import Actors, Contact, EgoState, End, FailureReason, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scoring.criteria import (
    RouteProgress,
    build_route_reference,
    compute_time_limit_ticks,
    find_end,
    update_progress,
)

WIDTH = 3.2
BOX = (4.9, 2.0)
Row = tuple[float, float, float, float]
"""x [m], y [m], yaw [rad], speed [m/s]."""
Hits = Mapping[int, Sequence[Contact]]
NO_HITS: Hits = MappingProxyType({})


def lane(lane_id: str, *points: tuple[float, float], junction: bool = False, **more: object) -> Lane:
    """A lane of an edge of its own."""
    facts: dict[str, object] = {"successors": (), "left": "", "right": "", "lights": {}, **more}
    return Lane(
        id=lane_id,
        edge=lane_id,
        index=0,
        width=WIDTH,
        speed_limit=13.9,
        centre=Polyline(np.array(points, dtype=np.float64)),
        junction=junction,
        **facts,
    )


def roads(*lanes: Lane, signs: Sequence[StopSignBox] | None = ()) -> RoadMap:
    """A network of these lanes."""
    return RoadMap(
        name="hand",
        folder=Path(),
        lanes={one.id: one for one in lanes},
        junctions=(),
        pavements=(),
        crossings=(),
        buildings=(),
        stop_signs=None if signs is None else tuple(signs),
        checksum="",
    )


def street(signs: Sequence[StopSignBox] | None = ()) -> RoadMap:
    """200 m: a lane to the east at y = 0 and, to its left, one to the west at y = 3.2."""
    return roads(lane("east", (-50, 0), (150, 0)), lane("west", (150, WIDTH), (-50, WIDTH)), signs=signs)


def ego(ego_id: str = "0", length: int = 100, lanes: Sequence[str] = ("east",), y: float = 0.0) -> Ego:
    """A CAV with a straight route from (0, y) to (length, y)."""
    points = tuple((float(x), y, 0.0) for x in range(length + 1))
    return Ego(id=ego_id, start=Pose(x=0.0, y=y, yaw=0.0), lanes=tuple(lanes), route=points)


def scenario(*egos: Ego, **more: object) -> Scenario:
    """A scenario of these CAVs; one with a straight route of 100 m if there are none."""
    facts = {"id": "s", "bucket": "b", "category": "c", "network": "hand", "egos": egos or (ego(),), **more}
    return Scenario.model_validate(facts)


def straight(ticks: int, speed: float = 10.0, y: float = 0.0, begin: float = 0.0) -> list[Row]:
    """`ticks` frames eastward at constant speed: x = begin, begin + speed / 20 ..."""
    return [(begin + speed * tick / 20, y, 0.0, speed) for tick in range(ticks)]


def arriving(y: float = 0.0) -> list[Row]:
    """The route of 100 m at 10 m/s, 0.5 m a tick.

    The last point is passed at x = 100.5, in tick 201; that completes it, and tick 202 is the CAV's last.
    """
    return straight(203, y=y)


def hit(ego_id: str, other: str, kind: Kind = Kind.VEHICLE) -> Contact:
    return Contact(ego_id, other, kind)


def actor(x: float, y: float, yaw: float = 0.0, speed: float = 0.0, actor_id: str = "npc") -> Actors:
    """One car."""
    return Actors(
        (actor_id,),
        np.array([int(Kind.VEHICLE)], dtype=np.uint8),
        *(np.array([value]) for value in (x, y, yaw, speed, *BOX)),
    )


def episode(
    about: Scenario,
    drives: Mapping[str, Sequence[Row]],
    ends: Mapping[str, End],
    hits: Hits = NO_HITS,
    actors: Actors | None = None,
    signals: Mapping[int, Mapping[str, str]] = NO_HITS,
) -> EpisodeRecord:
    """The recording of CAVs that live as many ticks as they have rows. Signals hold until the next tick named."""
    recorder = Recorder(about.id, {"seed": 1}, {one.id: BOX for one in about.egos})
    shown: Mapping[str, str] = {}
    for tick in range(max(len(rows) for rows in drives.values())):
        shown = signals.get(tick, shown)
        living = {i: EgoState(*rows[tick]) for i, rows in drives.items() if tick < len(rows)}
        frame = Frame(tick, living, actors or Actors.empty(), shown, tuple(hits.get(tick, ())))
        recorder.add(quantize_frame(frame), {}, {}, {})
    return recorder.finish([_ending(i, len(rows) - 1, ends[i]) for i, rows in drives.items()])


def _ending(ego_id: str, tick: int, end: End) -> Ending:
    if end is End.AGENT_FAILED:
        return Ending(ego_id, tick, end, FailureReason.CRASHED, "ValueError: no", tick)
    return Ending(ego_id, tick, end)


def judged(
    about: Scenario, drives: Mapping[str, Sequence[Row]], hits: Iterable[tuple[int, Contact]] = ()
) -> EpisodeRecord:
    """The recording that a live judge makes of these drives: each CAV until its end, then its agent fails."""
    limits = compute_time_limit_ticks(about)
    rows, ends = dict[str, Sequence[Row]](), dict[str, End]()
    for one in about.egos:
        route, trial = build_route_reference(one), RouteProgress()
        end, lived = None, 0
        for tick, row in enumerate(drives[one.id]):
            seen = quantize_frame(Frame(tick, {one.id: EgoState(*row)}, Actors.empty(), {})).egos[one.id]
            trial = update_progress(trial, route, tick, seen.x, seen.y, seen.speed)
            end, lived = find_end(trial, tick, limits[one.id]), tick + 1
            if end is not None:
                break
        rows[one.id], ends[one.id] = drives[one.id][:lived], end or End.AGENT_FAILED
    by_tick: dict[int, list[Contact]] = {}
    for tick, contact in hits:
        if tick < len(rows[contact.ego]):
            by_tick.setdefault(tick, []).append(contact)
    return episode(about, rows, ends, by_tick)


def turned(degrees: float) -> float:
    return math.radians(degrees)
