"""Families at junctions that queues block, and on ways with several junctions."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import (
    DUE,
    HEADWAY,
    HIDDEN,
    MAST,
    OLD_TOWNS,
    SITE,
    VAN,
    name_flow,
    name_number,
)
from mdrive_sumo.generate.hard.junction_users import (
    MAST_M,
    QUEUE,
    QUEUE_GAP_M,
    SETS_OFF_S,
    CavColumn,
    build_columns,
    build_due_vehicle,
    build_masts,
    build_queued_vehicle,
    build_traffic_on,
    build_waiting_vehicle,
    compute_due_behind,
)
from mdrive_sumo.generate.hard.sites.crossroads import choose_crossroads
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    choose_site,
    find_junction_conflicts,
    refuse_place,
)
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, compute_timing, find_junction_ways
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import build_mast, space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import (
    compute_chain_length,
    compute_lane_begins,
    compute_pose,
    find_station,
)

RIM_M = 8.0
"""[m] No vehicle of a queue has its middle this close to an end of its lanes: a bus is 12 m long."""
FAST_MPS = 13.0
"""[m/s] Least speed limit of a way across several streets: at 30 km/h CAVs stop for what they see."""


def stage_blocked_junction(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that cross the gap of a queue; what comes on the other lane is behind the queue."""
    queue, moving = _choose_gap(roads, values)
    due_s = values["due_s"] + values["gap_s"]
    way = (moving.other.lanes, moving.other_m)
    model = "car" if values["van"] < 0.5 else "van"
    hidden = build_due_vehicle(roads, "hidden", model, way, due_s, moving.other.limit * values["share"])
    columns = [CavColumn(moving.own.lanes, moving.own_m, round(values["own"]), values["due_s"], values["headway_s"])]
    if values["mast"] < 0.5:
        behind_s = compute_due_behind(roads, hidden, way, values["behind_s"])
        columns.append(CavColumn(*way, round(values["oncoming"]), behind_s, values["headway_s"]))
    egos = build_columns(roads, columns)
    actors = (hidden, *_build_queue(roads, queue, values))
    vehicles = build_traffic_on(roads, [moving.other], values["flow"], seed, (*egos, *actors))
    return FamilyScene(egos, vehicles, actors, build_masts(roads, moving, values))


def stage_gap_platoons(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that cross the gap of a queue, and CAVs that pass the queue on the other lane."""
    queue, moving = _choose_gap(roads, values)
    first, later_s, headway_s = values["due_s"], values["gap_s"], values["headway_s"]
    egos = build_columns(
        roads,
        (
            CavColumn(moving.own.lanes, moving.own_m, round(values["own"]), first, headway_s),
            CavColumn(moving.other.lanes, moving.other_m, round(values["oncoming"]), first + later_s, headway_s),
        ),
    )
    actors = _build_queue(roads, queue, values)
    vehicles = build_traffic_on(roads, [moving.other], values["flow"], seed, (*egos, *actors))
    return FamilyScene(egos, vehicles, actors)


def _choose_gap(roads: RoadMap, values: Values) -> tuple[JunctionConflict, JunctionConflict]:
    """Return the conflicts of a way with the lane that it crosses first, where a queue stands, and the one behind."""
    site = choose_crossroads(roads, values["site"], ("yield", "right-before-left"))
    if site.far is None:
        raise refuse_place(roads, "a street with lanes in both directions")
    queue, moving = sorted(site.others, key=lambda one: one.own_m)
    return queue, moving


def _build_queue(roads: RoadMap, gap: JunctionConflict, values: Values) -> tuple[Actor, ...]:
    """Return the vehicles of a queue on both sides of the gap that it has left for the own way."""
    room_m = CAR.width / 2 + values["gap_m"]
    count = round(values["queue"])
    places = (
        *space_vehicles(QUEUE[:count], gap.other_m + room_m, QUEUE_GAP_M, step=1.0),
        *space_vehicles(QUEUE[1 : 1 + count], gap.other_m - room_m, QUEUE_GAP_M),
    )
    end_m = compute_chain_length(roads, gap.other.lanes) - RIM_M
    return tuple(
        build_queued_vehicle(roads, f"queue{k}", model, gap.other, middle, SETS_OFF_S + k)
        for k, (model, middle) in enumerate(places)
        if RIM_M < middle < end_m
    )


def stage_crossing_series(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that meet hidden vehicles at several crossings one after the other."""
    series = list(_find_series(roads))
    if not series:
        raise refuse_place(roads, "a way across two streets or more")
    way, conflicts = choose_site(series, values["site"])
    timing = compute_timing(roads, way.lanes)
    (one, first), *others = conflicts
    columns = [CavColumn(way.lanes, first, round(values["own"]), values["due_s"], values["headway_s"], goal_m=400.0)]
    due_s = values["due_s"] + values["gap0_s"]
    meeting = (one.other.lanes, one.other_m)
    speed = max(one.other.limit, values["fast"])
    hidden = [build_due_vehicle(roads, "hidden0", "car", meeting, due_s, speed)]
    if values["mast"] < 0.5:
        behind_s = compute_due_behind(roads, hidden[0], meeting, values["behind_s"])
        columns.append(CavColumn(*meeting, round(values["witnesses"]), behind_s, values["headway_s"]))
    egos = build_columns(roads, columns)
    start_m = find_station(roads, way.lanes, egos[0].start.x, egos[0].start.y)
    for k, (conflict, station) in enumerate(others, start=1):
        mean_speed = (station - start_m) / timing.compute_between(start_m, station)
        met_m = station - start_m + values[f"gap{k}_s"] * mean_speed
        ways = (conflict.other.lanes, conflict.other_m)
        speed = max(conflict.other.limit, values["fast"])
        hidden.append(build_waiting_vehicle(roads, f"hidden{k}", "car", ways, egos[0], (met_m, mean_speed), speed))
    masts = tuple(
        build_mast(f"rsu{k}", compute_pose(roads, way.lanes, station, MAST_M))
        for k, (_, station) in enumerate(conflicts)
        if k or values["mast"] >= 0.5
    )
    vehicles = build_traffic_on(roads, [way], values["flow"], seed, (*egos, *hidden))
    return FamilyScene(egos, vehicles, tuple(hidden), masts)


def _find_series(roads: RoadMap) -> Iterator[tuple[JunctionWay, list[tuple[JunctionConflict, float]]]]:
    """Yield straight ways with the crossings on them, two or three: the conflict from the right or, without one, from
    the left, and its station [m]."""
    crossings = [
        one
        for one in find_junction_conflicts(roads)
        if one.is_crossing and one.own.turn == one.other.turn == "straight"
    ]
    for way in find_junction_ways(roads):
        if way.turn != "straight" or way.index != 0 or way.limit < FAST_MPS:
            continue
        begins = dict(zip(way.lanes, compute_lane_begins(roads, way.lanes), strict=True))
        steps = set(pairwise(way.lanes))
        by_junction: dict[str, tuple[JunctionConflict, float]] = {}
        for one in sorted(crossings, key=lambda x: x.from_left):
            if (one.own.approach, one.own.inside) in steps:
                station = begins[one.own.inside] + one.own_m - one.own.stop_m
                by_junction.setdefault(one.own.junction, (one, station))
        met = sorted(by_junction.values(), key=lambda pair: pair[1])[:3]
        if len(met) >= 2:
            yield way, met


_ONCOMING = name_number("oncoming", 1.0, 3.0, "behind the hidden vehicle")
_OWN = name_number("own", 2.0, 5.0, "in the column that has to cross")
_SERIES_PLACES = tuple(
    PlaceChoice("town_block", {"area": area, "control": control, "columns": 3, "keeps_sight": False})
    for area, control in (("old_town", "main_street"), ("town", "main_street"), ("suburb", "main_street"))
)


def _list_gaps(names: Sequence[str]) -> Iterator[FamilyParameter]:
    for name in names:
        yield FamilyParameter(name, -0.5, 0.5, "s", "how much later than the first CAV a hidden vehicle is due")


_QUEUE_PLACES = (
    *OLD_TOWNS,
    PlaceChoice("crossing", {"arms": 4, "control": "priority", "area": "town", "speed_kmh": 50}),
)
_QUEUE = (
    FamilyParameter("gap_m", 1.0, 3.0, "m", "distance of the queue from the side of a CAV in its gap"),
    FamilyParameter("queue", 2.0, 6.0, "", "number of vehicles of the queue on each side of the gap, rounded"),
)

FAMILIES = (
    ScenarioFamily(
        "blocked-junction",
        "CAVs cross the gap of a standing queue, which hides what comes on the other lane.",
        _QUEUE_PLACES,
        (
            SITE,
            _OWN,
            DUE,
            HEADWAY,
            _ONCOMING,
            *HIDDEN,
            VAN,
            MAST,
            *_QUEUE,
            name_flow(0.0, 300.0, "the lane that moves"),
        ),
        stage_blocked_junction,
    ),
    ScenarioFamily(
        "gap-platoons",
        "CAVs cross the gap of a standing queue, which hides the CAVs that come on the other lane.",
        _QUEUE_PLACES,
        (
            SITE,
            _OWN,
            DUE,
            HEADWAY,
            name_number("oncoming", 2.0, 5.0, "on the lane that moves"),
            HIDDEN[0],
            *_QUEUE,
            name_flow(0.0, 300.0, "the lane that moves"),
        ),
        stage_gap_platoons,
    ),
    ScenarioFamily(
        "crossing-series",
        "CAVs drive across two or three streets, and at each meet a vehicle that corner houses hide.",
        _SERIES_PLACES,
        (
            SITE,
            _OWN,
            FamilyParameter("due_s", 2.4, 3.6, "s", "time after which the first CAV is due at the first street"),
            HEADWAY,
            *_list_gaps(("gap0_s", "gap1_s", "gap2_s")),
            FamilyParameter("fast", 11.0, 15.0, "m/s", "least speed of the hidden vehicles"),
            name_number("witnesses", 1.0, 3.0, "behind the first hidden vehicle"),
            MAST,
            FamilyParameter("behind_s", 1.0, 2.2, "s", "how much later than a hidden vehicle the CAV behind it is due"),
            name_flow(0.0, 200.0, "the way of the CAVs"),
        ),
        stage_crossing_series,
    ),
)
