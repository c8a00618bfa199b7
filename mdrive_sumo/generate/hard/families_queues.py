"""Families at gaps of standing queues: behind the queue comes a stream of road users that pass it closely."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import HEADWAY, OLD_TOWNS, SITE, name_number
from mdrive_sumo.generate.hard.junction_users import (
    CavColumn,
    build_columns,
)
from mdrive_sumo.generate.hard.riders import PEDELEC_MPS
from mdrive_sumo.generate.hard.sites.crossroads import Crossroads, are_opposite, find_crossroads
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    choose_site,
    find_junction_conflicts,
    refuse_place,
)
from mdrive_sumo.generate.hard.sites.no_stopping import build_zebras
from mdrive_sumo.generate.hard.standing_rows import place_beside
from mdrive_sumo.generate.hard.streams import RoadUserStream, build_stream
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_actor, build_mast
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_route_line, compute_chain_length, compute_pose

RIM_M = 8.0
"""[m] No vehicle of a queue has its middle this close to an end of its lanes: a bus is 12 m long."""
REACH_M = 12.0
"""[m] Along a route before and behind the middle of a lane that it crosses: a left turn crosses it askew."""
BESIDE_M = 2.5
"""[m] Half the width of a lane, and a car's half: where a CAV beside its line touches what stands in the lane."""
CLEAR_M = CAR.width / 2 + 0.45
"""[m] No vehicle of a queue stands closer to the route, which may bend towards it: CAVs would drive around it."""
QUEUE_GAP_M = 0.8
"""[m] Between vehicles that stand in a queue."""
MAST_EVERY_M = 15.0
"""[m] Between roadside units above a stream: of those who come one behind the other each sees the nearest two."""
NUDGE_M = 0.1
"""[m] By which a vehicle is moved on until a CAV has room."""
PASS_S = 2.2
"""[s] By which a pause is longer for each CAV of a column: one behind the other they pass in it."""
HIGH = ("bus", "truck")
"""Models that hide a car from a LiDAR on a roof too."""
MOST_QUEUED, BEHIND = 12, 2
"""Vehicles before the gap at most, and behind it."""
MODELS = ("van", "truck", "van", "bus", "car")
"""Models of the rest of a queue."""
FLANK_M = 1.15
"""[m] From the middle of a lane to the flank of a queue in it: drivers of buses keep to the kerb to let riders pass."""


@dataclass(frozen=True, slots=True)
class QueueGap:
    """A gap in the queue on a chain of lanes, through which a route leads."""

    own: Lanes
    lanes: Lanes
    """Those on which the queue stands."""
    crossing: Float
    """Rows (N, 3) [m] along the route: its station, that of the same place on the lanes, its offset to their left."""

    def locate(self, offset_m: float) -> tuple[float, float]:
        """Return the stations [m] on the route and on the lanes at which the route is so far to the left of these."""
        rows = self.crossing[np.argsort(self.crossing[:, 2], kind="stable")]
        own_m, lane_m = (float(np.interp(offset_m, rows[:, 2], rows[:, k])) for k in (0, 1))
        return own_m, lane_m

    def find_offset(self, own_m: float) -> float:
        """Return how far [m] a station of the route is to the left of the lanes."""
        return float(np.interp(own_m, self.crossing[:, 0], self.crossing[:, 2]))


def find_gap(roads: RoadMap, conflict: JunctionConflict) -> QueueGap:
    """Return the gap that a queue on the other way of a conflict leaves for the own way."""
    line, curve = build_route_line(roads, conflict.own.lanes), build_route_line(roads, conflict.other.lanes).curve
    begin = max(round(conflict.own_m - REACH_M), 0)
    stations = range(begin, min(round(conflict.own_m + REACH_M), line.last_m))
    rows = np.array([(float(k), *curve.project(*line.xy[k].tolist())) for k in stations])
    return QueueGap(conflict.own.lanes, conflict.other.lanes, rows)


def build_queue(
    roads: RoadMap,
    gap: QueueGap,
    models: tuple[Sequence[str], Sequence[str]],
    free_m: float,
    flank_m: float,
    name: str = "queue",
    also: Lanes = (),
) -> tuple[Actor, ...]:
    """Return the vehicles that stand before and behind a gap until the end, none on a zebra.

    models: of those before it and behind it, from the gap on. free_m: from the line of a CAV to the nearest ones.
    flank_m: from the middle of the lane to the flanks past which a stream goes; negative: to the right.
    also: another route that leads straight through the gap.
    """
    line, whole = _select_line(roads, gap), shapely.LineString(build_route_line(roads, gap.own).xy)
    line = line.union(shapely.LineString(build_route_line(roads, also).xy)) if also else line
    end_m, zebras = compute_chain_length(roads, gap.lanes) - RIM_M, build_zebras(roads)
    shapely.prepare(zebras)
    actors: list[Actor] = []
    for step, chosen in zip((-1.0, 1.0), models, strict=True):
        at_m = gap.locate(0.0)[1]
        for number, model in enumerate(chosen):
            half_m = BODY_SIZES[model][0] / 2
            pose, box = place_beside(roads, gap.lanes, at_m + step * half_m, (flank_m, -flank_m), model)
            while RIM_M < at_m < end_m and (box.intersects(zebras) or (not number and box.distance(line) < free_m)):
                at_m += step * NUDGE_M
                pose, box = place_beside(roads, gap.lanes, at_m + step * half_m, (flank_m, -flank_m), model)
            at_m += step * half_m
            if not RIM_M < at_m < end_m or shapely.distance(box, whole) < CLEAR_M:
                break
            actors.append(build_actor(f"{name}{len(actors)}", BODIES[model], pose))
            at_m += step * (half_m + QUEUE_GAP_M)
    return tuple(actors)


def _select_line(roads: RoadMap, gap: QueueGap) -> shapely.LineString:
    """Return the route where it crosses the lane of a queue."""
    inside = gap.crossing[np.abs(gap.crossing[:, 2]) < BESIDE_M]
    return shapely.LineString(build_route_line(roads, gap.own).xy[inside[:, 0].astype(np.int64)])


def build_queue_stream(
    roads: RoadMap, gap: QueueGap, values: Values, model: str, flank_m: float
) -> tuple[CavColumn, tuple[Actor, ...]]:
    """Return a column of CAVs and the stream behind the queue that they meet."""
    offset = flank_m + math.copysign(values["behind_m"] + BODIES[model].width / 2, flank_m)
    own_m, lane_m = gap.locate(offset)
    passing = max(round(values["own"]), round(values.get("back", 0.0)))
    stream = RoadUserStream(
        gap.lanes,
        lane_m,
        offset,
        model,
        values["speed"],
        values["due_s"] - values["before_s"],
        values["every_s"],
        max(round((values["before_s"] + values["flows_s"]) / values["every_s"]), 2),
        values["pause_s"] + passing * PASS_S,
    )
    column = CavColumn(gap.own, own_m, round(values["own"]), values["due_s"], values["headway_s"])
    return column, build_stream(roads, model, stream)


def _choose_crossing(roads: RoadMap, values: Values) -> Crossroads:
    """Return a crossing straight on: a left turn would lead towards the stream in the other lane."""
    sites = [
        one
        for one in find_crossroads(roads, ("yield", "stop", "right-before-left"))
        if one.meeting.own.turn == "straight" and one.far is not None and one.back is not None
    ]
    if not sites:
        raise refuse_place(roads, "a crossing of streets with lanes in both directions")
    return choose_site(sites, values["site"])


def stage_filtering_motorcycles(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that leave a side street through the gap of a queue, past whose far flank motorcycles filter."""
    conflict = min(_choose_crossing(roads, values).others, key=lambda one: one.own_m)
    gap = find_gap(roads, conflict)
    column, riders = build_queue_stream(roads, gap, values, "motorcycle", FLANK_M)
    egos = build_columns(roads, (column,))
    queue = build_queue(roads, gap, choose_models(values, seed), CAR.width / 2 + values["gap_m"], FLANK_M)
    return FamilyScene(egos, (), (*queue, *riders), (build_mast_beyond(roads, column, values),))


@lru_cache(maxsize=128)
def find_left_turns(roads: RoadMap) -> tuple[JunctionConflict, ...]:
    """Return the left turns across the way of the other direction of the same street."""
    return tuple(
        one
        for one in find_junction_conflicts(roads)
        if one.own.turn == "left" and one.other.turn == "straight" and are_opposite(roads, one.own, one.other)
    )


def stage_filtering_cyclists(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that turn left through the gap of the oncoming queue, past whose right flank pedelecs come."""
    turns = find_left_turns(roads)
    if not turns:
        raise refuse_place(roads, "a left turn across an oncoming lane")
    return _stage_at_kerb(values, seed, roads, choose_site(turns, values["site"]))


def stage_cyclists_beyond(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that cross a main street through the gap of the queue on its far lane; cyclists pass behind it."""
    conflict = max(_choose_crossing(roads, values).others, key=lambda one: one.own_m)
    return _stage_at_kerb(values, seed, roads, conflict)


def _stage_at_kerb(values: Values, seed: str, roads: RoadMap, conflict: JunctionConflict) -> FamilyScene:
    """Return CAVs that cross a queue through its gap and then cyclists between the queue and the kerb."""
    gap = find_gap(roads, conflict)
    column, riders = build_queue_stream(roads, gap, values, "bicycle", -FLANK_M)
    queue = build_queue(roads, gap, choose_models(values, seed), CAR.width / 2 + values["gap_m"], -FLANK_M)
    egos = build_columns(roads, (column,))
    return FamilyScene(egos, (), (*queue, *riders), (build_mast_beyond(roads, column, values),))


def stage_two_queues(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of both sides that cross two queues through gaps; mopeds filter between the queues."""
    site = _choose_crossing(roads, values)
    assert site.back is not None, "it is a crossing"
    coming, other = sorted(site.others, key=lambda one: one.from_left)
    facing = next(
        one for one in find_junction_conflicts(roads) if (one.own, one.other) == (site.back.own, coming.other)
    )
    gap, beside, opposite = (find_gap(roads, one) for one in (coming, other, facing))
    middle_m = gap.find_offset(beside.locate(0.0)[0]) / 2
    flank_m = middle_m - values["behind_m"] - BODIES["moped"].width / 2
    column, riders = build_queue_stream(roads, gap, values, "moped", flank_m)
    back_m, due_s = opposite.locate(middle_m)[0], values["due_s"] + values["back_s"]
    back = CavColumn(opposite.own, back_m, round(values["back"]), due_s, values["headway_s"])
    free_m, also = CAR.width / 2 + values["gap_m"], site.back.own.lanes
    queues = [
        build_queue(roads, one, choose_models(values, f"{seed}/{name}", True), free_m, flank_m, name, also)
        for one, name in ((gap, "queue"), (beside, "beside"))
    ]
    egos = build_columns(roads, (column, back))
    masts = tuple(
        build_mast(f"rsu{k}", compute_pose(roads, gap.lanes, gap.locate(middle_m)[1] - k * MAST_EVERY_M, middle_m))
        for k in range(round(values["masts"]))
    )
    return FamilyScene(egos, (), (*queues[0], *queues[1], *riders), masts)


def build_mast_beyond(roads: RoadMap, column: CavColumn, values: Values) -> RoadsideUnit:
    """Return a roadside unit above the route of a column, as far beyond the stream as `mast_m` says."""
    return build_mast("rsu", compute_pose(roads, column.lanes, column.at_m + values["mast_m"]))


def choose_models(values: Values, seed: str, hides_both: bool = False) -> tuple[list[str], list[str]]:
    """Return the models before and behind a gap: high ones beside it, and as many as the queue is long.

    hides_both: behind it too.
    """
    rng = random.Random(f"{seed}/queue")
    before, behind = (["articulated-bus", rng.choice(HIGH), *rng.choices(MODELS, k=MOST_QUEUED)] for _ in range(2))
    count = int(np.searchsorted(np.cumsum([BODY_SIZES[model][0] for model in before]), values["queue_m"])) + 1
    return before[:count], behind[: count if hides_both else BEHIND]


_STREAM = (
    FamilyParameter("gap_m", 0.45, 0.8, "m", "distance of the queue from the side of a CAV in its gap"),
    FamilyParameter("behind_m", 0.3, 0.4, "m", "distance of the stream from the flanks of the queue"),
    FamilyParameter("flows_s", 6.0, 8.5, "s", "for how long after the first CAV is due it goes on"),
    FamilyParameter("pause_s", 2.0, 4.0, "s", "pause before it comes again, besides the time that the CAVs need"),
    FamilyParameter("queue_m", 50.0, 90.0, "m", "length of the queue before the gap"),
)
_MAST = FamilyParameter(
    "mast_m", 1.0, 6.0, "m", "distance of a roadside unit behind the stream, above the way of the CAVs"
)
_BEFORE = FamilyParameter("before_s", 0.8, 2.2, "s", "how much earlier than the first CAV the stream begins")
_OWN = name_number("own", 2.0, 4.4, "in the column that has to cross")
DUE = FamilyParameter("due_s", 3.5, 5.0, "s", "time after which the first CAV is due at the stream")
_CYCLISTS = (
    FamilyParameter("before_s", 0.2, 0.8, "s", _BEFORE.meaning),
    _MAST,
    FamilyParameter("speed", *PEDELEC_MPS, "m/s", "speed of the cyclists"),
    FamilyParameter("every_s", 1.0, 1.4, "s", "time between two cyclists"),
)
# none has zebras: a queue leaves them free, and one sees through the gaps
_STRAIGHT_PLACES = (
    *OLD_TOWNS[:2],  # the streets of corridors end at the main one
    *(
        PlaceChoice("crossing", {"arms": 4, "control": "priority", "area": area, "speed_kmh": 50, "zebras": False})
        for area in ("town", "suburb", "commercial")
    ),
    PlaceChoice("town_block", {"area": "town", "control": "main_street", "columns": 3, "keeps_sight": False}),
)
CYCLE_PLACES = (
    *(
        PlaceChoice(
            "crossing",
            {"arms": 4, "control": "priority", "area": area, "speed_kmh": 50, "zebras": False, "beside": "cycle_lanes"},
        )
        for area in ("old_town", "town", "suburb")
    ),
    PlaceChoice("crossing", {"arms": 3, "control": "priority", "area": "town", "speed_kmh": 50, "zebras": False}),
    OLD_TOWNS[0],
    OLD_TOWNS[2],
)

FAMILIES = (
    ScenarioFamily(
        "filtering-motorcycles",
        "CAVs leave a side street through the gap of a standing queue, past which motorcycles filter on its far side.",
        _STRAIGHT_PLACES,
        (
            SITE,
            _OWN,
            DUE,
            HEADWAY,
            *_STREAM,
            _BEFORE,
            _MAST,
            FamilyParameter("speed", 11.0, 14.0, "m/s", "speed of the motorcycles"),
            FamilyParameter("every_s", 0.6, 0.8, "s", "time between two motorcycles"),
        ),
        stage_filtering_motorcycles,
    ),
    ScenarioFamily(
        "filtering-cyclists",
        "CAVs turn left through the gap of the oncoming queue, past which cyclists ride on the side of the kerb.",
        CYCLE_PLACES,
        (
            SITE,
            _OWN,
            DUE,
            HEADWAY,
            *_STREAM,
            *_CYCLISTS,
        ),
        stage_filtering_cyclists,
    ),
    ScenarioFamily(
        "cyclists-beyond-queue",
        "CAVs of a minor street cross the far lane of a main one through the gap of a queue; behind it come cyclists.",
        (*CYCLE_PLACES[:3], _STRAIGHT_PLACES[0], _STRAIGHT_PLACES[-1]),
        (
            SITE,
            _OWN,
            DUE,
            HEADWAY,
            *_STREAM,
            *_CYCLISTS,
        ),
        stage_cyclists_beyond,
    ),
    ScenarioFamily(
        "two-queues",
        "CAVs of a minor street cross two standing queues through gaps; between the queues mopeds filter.",
        _STRAIGHT_PLACES,
        (
            SITE,
            name_number("own", 1.5, 3.4, "on the first approach"),
            name_number("back", 1.0, 3.4, "on the opposite approach"),
            FamilyParameter("back_s", -0.5, 1.5, "s", "how much later those on the opposite approach are due"),
            DUE,
            HEADWAY,
            *_STREAM,
            _BEFORE,
            FamilyParameter(
                "masts", 1.6, 4.4, "", "number of roadside units above the stream, from the gap on, rounded"
            ),
            FamilyParameter("speed", 10.0, 12.5, "m/s", "speed of the mopeds"),
            FamilyParameter("every_s", 0.6, 0.8, "s", "time between two mopeds"),
        ),
        stage_two_queues,
    ),
)
