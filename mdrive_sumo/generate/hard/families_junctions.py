"""Families at junctions that queues block."""

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
    QUEUE,
    QUEUE_GAP_M,
    SETS_OFF_S,
    CavColumn,
    build_columns,
    build_due_vehicle,
    build_masts,
    build_queued_vehicle,
    build_traffic_on,
    compute_due_behind,
)
from mdrive_sumo.generate.hard.sites.crossroads import choose_crossroads
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    refuse_place,
)
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import (
    compute_chain_length,
)

RIM_M = 8.0
"""[m] No vehicle of a queue has its middle this close to an end of its lanes: a bus is 12 m long."""


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


_ONCOMING = name_number("oncoming", 1.0, 3.0, "behind the hidden vehicle")
_OWN = name_number("own", 2.0, 5.0, "in the column that has to cross")
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
)
