"""Streams of riders that pass closely behind what stands at the kerb, and CAVs that cross their line.

The riders keep their course and their speed, and follow so closely one behind the other that no driver without messages
gets through between two of them. Who knows of them waits for the pause behind a group.
"""

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.hard.family import FamilyScene, Values
from mdrive_sumo.generate.hard.junction_users import CavColumn, build_columns
from mdrive_sumo.generate.hard.sites.junction_conflicts import choose_site, refuse_place
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay
from mdrive_sumo.generate.hard.sites.no_stopping import build_crossing_street, build_zebras
from mdrive_sumo.generate.hard.sites.rider_sites import (
    RiderSite,
    RiderStrip,
    find_crossing_sites,
    find_opposite,
)
from mdrive_sumo.generate.hard.streams import RoadUserStream, build_stream
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR, build_user_box
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_mast, build_parked_vehicle
from mdrive_sumo.worlds.placement.cavs import NoRoomError
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    build_pose_line,
    compute_lane_begins,
    compute_pose,
)
from mdrive_sumo.worlds.placement.occupancy import overlaps_building

FRONT_STEP_M = 0.05
"""[m] Steps in which a row is moved back until it is clear."""
ROW_GAP_M = 0.4
"""[m] Between vehicles of a row: parked bumper to bumper, so that there is no sight between them."""
BEND_M = 0.15
"""[m] What stands beside riders whose way bends may be so much nearer to it."""
CAV_CLEAR_M = 0.8
"""[m] From a row to the side of a CAV on its way: at 0.5 to 0.6 m the built-in planners stop behind the row, as in 11
of 26 drives of `sharing+negotiation` that were late without a contact in the first season drawn."""
SHIFTS_M = (0.0, 0.1, 0.2, 0.3, 0.4)
"""[m] Long vehicles beside a bend stand so much farther aside: an arc of 100 m rises by 0.3 m over 16 m."""
MOST_GAP_M = 1.5
"""[m] From the row to the middle of the riders: past wider gaps drivers see enough of them."""
ROW_BEGIN_M = 8.0
"""[m] A row begins at least so far behind the begin of its lane."""
BEYOND_M = 5.0
"""[m] Beyond the riders' line, from where the front of a row is sought."""
PATH_M = 65.0, 20.0
"""[m] Length of a way before and behind the riders' line of which a row keeps its distance."""
STREAM_M, BEYOND_STREAM_M = 100.0, 60.0
"""[m] Before the crossing to where riders appear, and beyond it to where they leave, at most, ..."""
LEAST_STREAM_M, LEAST_BEYOND_M = 40.0, 25.0
"""[m] ... and at least, where houses, trees or hedges stand in their way: at 8.3 m/s that is 5 s."""
PEDELEC_MPS = (7.5, 8.6)
"""[m/s] Brisk groups on a free track, 27 to 31 km/h: the motors of pedelecs help up to 25 km/h (StVG section 1 (3)),
those of S-pedelecs up to 45 km/h (EU 168/2013, L1e-B). At 25 km/h certificates of level `all` fail that hold at 27.
Riders are 1 to 1.5 s apart, as those who start one after the other at a green light."""
SCOOTER_MPS = (4.5, 5.6)
"""[m/s] E-scooters go up to 20 km/h (eKFV section 1 (1))."""
GROUPS = 3
"""Later ones meet CAVs that have missed two pauses, which the time limits do not allow."""
ROW_M = 45.0
"""[m] Length of a row, past which there is no sight from where CAVs start."""
DELIVERING = {"truck": 3.0, "semitrailer": 3.0, "bus": 3.0, "van": 1.0}
"""Models of the first vehicle of a row by weight: one that delivers at the corner, in front of which riders are hidden.
Long ones stand there more often than on streets: through the gap behind a van of 6 m riders are seen in time. Of 36
rows of 18 candidates certificates of level `all` held at 4 of 5 that begin with 12 m or more, at 4 of 27 with 9.5 m, at
none of 4 with a van."""
PARKED = {"van": 4.0, "car": 3.0, "truck": 3.0}
"""Models of those behind it by weight: an assumption, too."""
BUSES = {"articulated-bus": 1.0, "bus": 1.0}
"""What stands in the lane beside it instead."""
MAST_M = 2.5
"""[m] A roadside unit stands so far to the left of the lane where it crosses the riders' line."""


@dataclass(frozen=True, slots=True)
class RiderKind:
    """Who rides, what stands at the kerb, and where."""

    rider: str
    """Model of `BODIES`."""
    first: Mapping[str, float]
    """Models of what stands beside the CAVs' way at the riders' line, by weight."""
    row: Mapping[str, float]
    """Models of those behind it, by weight."""
    controls: tuple[JunctionKind, ...]
    """Of the CAVs' approach."""
    beside_lane: bool = False
    """Whether the row stands in another lane at the right, not at the kerb."""


@dataclass(frozen=True, slots=True)
class RiderCrossing:
    """A way across a strip."""

    way: JunctionWay
    strip: RiderStrip
    own_m: float
    """Station [m] on the way."""
    at_m: float
    """Station [m] on the lanes of the strip."""


def stage_riders(kind: RiderKind, values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that cross streams of riders behind what stands at the kerb. Raises ProposalRejected, NoRoomError."""
    sites = find_crossing_sites(roads, kind.controls, kind.beside_lane)
    if not sites:
        raise refuse_place(roads, "an approach to a street with traffic both ways")
    site = choose_site(sites, values["site"])
    opposite = find_opposite(roads, site, sites)
    crossings = [find_rider_crossing(roads, one, values) for one in (site, opposite) if one is not None]
    actors = [
        actor
        for k, crossing in enumerate(crossings)
        for actor in build_hidden_riders(roads, kind, crossing, values, (seed, k, crossing.strip.line))
    ]
    masts = tuple(
        build_rider_mast(roads, one, k) for k, one in enumerate(crossings) if values[("mast", "mast_back")[k]] >= 0.5
    )
    return FamilyScene(build_columns(roads, _list_columns(crossings, values)), (), tuple(actors), masts)


def find_rider_crossing(roads: RoadMap, site: RiderSite, values: Values) -> RiderCrossing:
    """Return where a way crosses the line of riders, `wall_m` beside the street. Raises NoRoomError."""
    strip = RiderStrip(roads, site.lanes, site.edge_m + values["wall_m"])
    met = strip.find_met(site.way)
    if met is None:
        raise NoRoomError(f"network {roads.name}: expected a way across the riders' line, found none")
    return RiderCrossing(site.way, strip, *met)


def _list_columns(crossings: Sequence[RiderCrossing], values: Values) -> list[CavColumn]:
    """Return the column of the first way, and that of the second one, if there is one."""
    numbers = (round(values["own"]), round(values["back"]))
    due_s = (values["due_s"], values["due_s"] + values["back_s"])
    return [
        CavColumn(one.way.lanes, one.own_m, count, due, values["headway_s"])
        for one, count, due in zip(crossings, numbers, due_s, strict=False)
        if count
    ]


def build_rider_mast(roads: RoadMap, crossing: RiderCrossing, number: int) -> RoadsideUnit:
    """Return a roadside unit where a way crosses the riders' line."""
    return build_mast(f"rsu{number}", compute_pose(roads, crossing.way.lanes, crossing.own_m, MAST_M))


def build_hidden_riders(
    roads: RoadMap,
    kind: RiderKind,
    crossing: RiderCrossing,
    values: Values,
    place: tuple[str, int, shapely.LineString | shapely.MultiLineString],
    later_s: float = 0.0,
) -> tuple[Actor, ...]:
    """Return the riders that a way crosses, `later_s` later than the values say, and the row that hides them.

    place: the seed, which draws the row, number of the way, and the lines of all riders, which stay free. Raises
    NoRoomError.
    """
    seed, number, lines = place
    stream = _describe_stream(roads, kind, crossing, values, later_s)
    models = draw_row(kind, random.Random(f"{seed}/row{number}"))
    row = tuple(_build_row(roads, kind, crossing, values, (f"parked{number}_", models, lines)))
    if not row or build_user_box(row[0]).distance(crossing.strip.line) > MOST_GAP_M:
        raise NoRoomError(f"network {roads.name}: expected room for a row up to the riders' line, found none")
    return (*build_stream(roads, f"rider{number}_", stream), *row)


def draw_row(kind: RiderKind, rng: random.Random) -> tuple[str, ...]:
    """Return the models of a row, from the riders' line back, until it is `ROW_M` long."""
    models = rng.choices(tuple(kind.first), tuple(kind.first.values()))
    while sum(BODY_SIZES[one][0] + ROW_GAP_M for one in models) < ROW_M:
        models += rng.choices(tuple(kind.row), tuple(kind.row.values()))
    return tuple(models)


def _describe_stream(
    roads: RoadMap, kind: RiderKind, crossing: RiderCrossing, values: Values, later_s: float
) -> RoadUserStream:
    """Raises NoRoomError where the riders' way is not free."""
    begin_m, end_m = crossing.strip.find_free(
        (crossing.at_m - STREAM_M, crossing.at_m, crossing.at_m + BEYOND_STREAM_M), BODIES[kind.rider].width / 2
    )
    if crossing.at_m - begin_m < LEAST_STREAM_M or end_m - crossing.at_m < LEAST_BEYOND_M:
        raise NoRoomError(
            f"network {roads.name}: expected a free way of riders of {LEAST_STREAM_M:g} m before the crossing and"
            f" {LEAST_BEYOND_M:g} m beyond it, found {crossing.at_m - begin_m:.1f} m and {end_m - crossing.at_m:.1f} m"
        )
    return RoadUserStream(
        crossing.strip.lanes,
        crossing.at_m,
        crossing.strip.offset,
        kind.rider,
        round(values["riding"], 2),
        values["due_s"] - values["before_s"] + later_s,
        values["every_s"],
        round(values["lasts_s"] / values["every_s"]) + 1,
        values["pause_s"],
        GROUPS,
        begin_m,
        end_m - crossing.at_m,
    )


@dataclass(frozen=True, slots=True)
class _Room:
    """What a row keeps clear of."""

    roads: RoadMap
    lines: shapely.LineString | shapely.MultiLineString
    """Of the riders."""
    rider_m: float
    path: shapely.LineString
    """Of the CAVs."""
    closed: BaseGeometry
    """Carriageway of the street that crosses, and zebras."""

    def is_free(self, box: shapely.Polygon, slack_m: float) -> bool:
        """Return whether a box stands in no building, not where it would block others, and clear of riders, up to
        `slack_m` [m], and CAVs."""
        return (
            box.distance(self.lines) >= self.rider_m - slack_m
            and box.distance(self.path) >= CAR.width / 2 + CAV_CLEAR_M
            and not box.intersects(self.closed)
            and not overlaps_building(box, self.roads)
        )


def _build_row(
    roads: RoadMap,
    kind: RiderKind,
    crossing: RiderCrossing,
    values: Values,
    what: tuple[str, Sequence[str], shapely.LineString | shapely.MultiLineString],
) -> Iterator[Actor]:
    """Yield what stands beside a way, up to the riders' line; what: begin of the ids, models, lines to keep free."""
    name, models, lines = what
    rider_m, side_m = BODIES[kind.rider].width / 2 + values["free_m"], values["side_m"]
    closed = build_zebras(roads).union(build_crossing_street(roads, crossing.way))
    room = _Room(roads, lines, rider_m, _build_path(roads, crossing), closed)
    front_m, begin_m = crossing.own_m + BEYOND_M, _find_begin(roads, crossing.way)
    last = shapely.Polygon()
    for k, model in enumerate(models):
        length = BODY_SIZES[model][0]
        found: Actor | None = None
        while found is None and front_m - length > begin_m:
            slack_m = BEND_M if k else 0.0
            placed = _list_places(roads, crossing.way.lanes, (front_m, side_m), (f"{name}{k}", model))
            found = next((one for one in placed if _is_placed(room, one, last, slack_m)), None)
            front_m -= FRONT_STEP_M
        if found is not None:
            yield found
            last = build_user_box(found)
            front_m -= length


def _is_placed(room: _Room, parked: Actor, last: shapely.Polygon, slack_m: float) -> bool:
    box = build_user_box(parked)
    return room.is_free(box, slack_m) and (last.is_empty or box.distance(last) >= ROW_GAP_M)


def _list_places(roads: RoadMap, lanes: Lanes, place: tuple[float, float], who: tuple[str, str]) -> Iterator[Actor]:
    """Yield a vehicle whose front is at a station [m] and whose flank is at a distance [m] from the lanes, and the same
    ever farther aside; who: id and model."""
    length, width = BODY_SIZES[who[1]]
    front_m, flank_m = place
    for shift_m in SHIFTS_M:
        pose = compute_pose(roads, lanes, front_m - length / 2, -(flank_m + width / 2 + shift_m))
        yield build_parked_vehicle(*who, pose, mirrored=False)


def _build_path(roads: RoadMap, crossing: RiderCrossing) -> shapely.LineString:
    """Return the line of a way around the place where it crosses the riders' line."""
    stations = np.arange(max(crossing.own_m - PATH_M[0], 0.0), crossing.own_m + PATH_M[1])
    return build_pose_line([compute_pose(roads, crossing.way.lanes, one) for one in stations.tolist()])


def _find_begin(roads: RoadMap, way: JunctionWay) -> float:
    """Return where a row beside a way begins at the earliest: on the last lane that begins well before the junction."""
    begins = [one for one in compute_lane_begins(roads, way.lanes) if one < way.stop_m - 2 * ROW_BEGIN_M]
    return max(begins, default=0.0) + ROW_BEGIN_M
