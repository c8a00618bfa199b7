"""Families at crossings of two streets without signals: platoons, hidden vehicles, traffic that sends nothing."""

from collections.abc import Iterator, Sequence

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import (
    AMBULANCE_MPS,
    COLUMNS,
    CROSS,
    EQUAL,
    EQUAL_PLACES,
    GIVING_WAY,
    HEDGES,
    HIDDEN,
    MAIN_STREET,
    MAST,
    MOST_SEEN_S,
    OLD_TOWNS,
    STOP_PLACES,
    VAN,
    WITNESSES,
    name_flow,
    name_number,
)
from mdrive_sumo.generate.hard.junction_users import (
    CavColumn,
    build_columns,
    build_due_vehicle,
    build_masts,
    build_traffic_on,
    compute_due_behind,
)
from mdrive_sumo.generate.hard.sites.crossroads import Crossroads, choose_crossroads
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor


def _list_columns(site: Crossroads, values: Values, delay_s: float = 0.0) -> Iterator[CavColumn]:
    """Yield the columns of the street of the first approach: on that approach, and on the opposite one."""
    due_s, headway_s = values["due_s"], values["headway_s"]
    one = site.meeting
    yield CavColumn(one.own.lanes, one.own_m, round(values["own"]), due_s, headway_s, delay_s=delay_s)
    if site.back is not None and round(values["back"]):
        lanes, at_m = site.back.own.lanes, site.back.own_m
        yield CavColumn(lanes, at_m, round(values["back"]), due_s + values["back_s"], headway_s, delay_s=delay_s)


def _list_cross_columns(site: Crossroads, values: Values) -> Iterator[CavColumn]:
    """Yield the columns of the other street: on the way that the first approach meets first, and the opposite one."""
    for conflict, name in zip(site.others, ("near", "far"), strict=False):
        if round(values[name]):
            due_s = values["due_s"] + values[f"{name}_s"]
            yield CavColumn(conflict.other.lanes, conflict.other_m, round(values[name]), due_s, values["headway_s"])


def _list_witnesses(roads: RoadMap, site: Crossroads, hidden: Sequence[Actor], values: Values) -> Iterator[CavColumn]:
    """Yield the columns of CAVs behind the hidden vehicles of the other street."""
    for conflict, name, ahead in zip(site.others, ("near", "far"), hidden, strict=False):
        if round(values[name]):
            way = (conflict.other.lanes, conflict.other_m)
            due_s = compute_due_behind(roads, ahead, way, values["behind_s"])
            yield CavColumn(*way, round(values[name]), due_s, values["headway_s"])


def _stage_platoons(values: Values, seed: str, roads: RoadMap, controls: tuple[JunctionKind, ...]) -> FamilyScene:
    site = choose_crossroads(roads, values["site"], controls, MOST_SEEN_S)
    egos = build_columns(roads, (*_list_columns(site, values), *_list_cross_columns(site, values)))
    ways = [one.other for one in site.others]
    return FamilyScene(egos, build_traffic_on(roads, ways, values["flow"], seed, egos))


def stage_platoon_crossing(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return platoons of CAVs that reach a crossing with a main street together."""
    return _stage_platoons(values, seed, roads, GIVING_WAY)


def stage_equal_crossing(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return platoons of CAVs that reach a crossing with priority to the right together."""
    return _stage_platoons(values, seed, roads, EQUAL)


def _build_hidden(roads: RoadMap, site: Crossroads, values: Values) -> tuple[Actor, ...]:
    """Return a vehicle that sends nothing on each way of the other street."""
    return tuple(
        build_due_vehicle(
            roads,
            f"hidden{k}",
            "car" if values["van"] < 0.5 else "van",
            (one.other.lanes, one.other_m),
            values["due_s"] + values["gap_s"] + k * values["far_s"],
            one.other.limit * values["share"],
        )
        for k, one in enumerate(site.others)
    )


def stage_blind_crossing(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of a minor street that meet hidden vehicles, which CAVs follow or a roadside unit sees."""
    return _stage_hidden(values, seed, roads, GIVING_WAY)


def stage_sign_runner(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of a main street that meet vehicles that do not stop at their stop signs, as the CAVs behind do."""
    return _stage_hidden(values, seed, roads, MAIN_STREET)


def _stage_hidden(values: Values, seed: str, roads: RoadMap, controls: tuple[JunctionKind, ...]) -> FamilyScene:
    site = choose_crossroads(roads, values["site"], controls, MOST_SEEN_S)
    hidden = _build_hidden(roads, site, values)
    witnesses = [] if values["mast"] >= 0.5 else _list_witnesses(roads, site, hidden, values)
    egos = build_columns(roads, (*_list_columns(site, values), *witnesses))
    ways = [one.other for one in site.others]
    vehicles = build_traffic_on(roads, ways, values["flow"], seed, (*egos, *hidden))
    return FamilyScene(egos, vehicles, hidden, build_masts(roads, site.meeting, values))


def stage_mixed_crossing(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of a minor street that cross traffic of a main street, of which few are connected."""
    site = choose_crossroads(roads, values["site"], GIVING_WAY, MOST_SEEN_S)
    egos = build_columns(roads, (*_list_columns(site, values), *_list_cross_columns(site, values)))
    ways = [one.other for one in site.others]
    vehicles = build_traffic_on(roads, ways, values["flow"], seed, egos)
    return FamilyScene(egos, vehicles, (), build_masts(roads, site.meeting, values))


def stage_emergency_vehicle(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return an ambulance that comes out of a minor street and crosses a main one without stopping."""
    site = choose_crossroads(roads, values["site"], MAIN_STREET, MOST_SEEN_S)
    one = site.meeting
    ambulance = build_due_vehicle(
        roads,
        "ambulance",
        "ambulance",
        (one.other.lanes, one.other_m),
        values["due_s"] + values["gap_s"],
        max(one.other.limit, AMBULANCE_MPS) * values["share"],
        avoid_collision=False,
    )
    columns = list(_list_columns(site, values))
    way = (one.other.lanes, one.other_m)
    if values["mast"] < 0.5:
        columns.append(CavColumn(*way, 1, compute_due_behind(roads, ambulance, way, values["behind_s"]), 1.0))
    egos = build_columns(roads, columns)
    ways = [one.own, *([site.back.own] if site.back else [])]
    vehicles = build_traffic_on(roads, ways, values["flow"], seed, (*egos, ambulance))
    return FamilyScene(egos, vehicles, (ambulance,), build_masts(roads, one, values))


FAMILIES = (
    ScenarioFamily(
        "platoon-crossing",
        "Columns of CAVs of two streets reach a crossing with a main street together; houses or hedges hide them.",
        (*OLD_TOWNS, *HEDGES),
        (*COLUMNS, *CROSS, name_flow(0.0, 300.0, "the main street")),
        stage_platoon_crossing,
    ),
    ScenarioFamily(
        "right-before-left",
        "Columns of CAVs reach a crossing with priority to the right together; corner houses hide them.",
        EQUAL_PLACES,
        (*COLUMNS, *CROSS, name_flow(0.0, 200.0, "one street")),
        stage_equal_crossing,
    ),
    ScenarioFamily(
        "blind-crossing",
        "CAVs of a minor street meet vehicles of the main street that corner houses or hedges hide.",
        (*OLD_TOWNS, *HEDGES),
        (
            *COLUMNS,
            *WITNESSES,
            *HIDDEN,
            VAN,
            MAST,
            name_flow(0.0, 300.0, "the main street"),
        ),
        stage_blind_crossing,
    ),
    ScenarioFamily(
        "stop-sign-runner",
        "CAVs of a main street meet vehicles that run a stop sign and that corner houses or hedges hide.",
        STOP_PLACES,
        (
            *COLUMNS,
            *WITNESSES,
            *HIDDEN,
            VAN,
            MAST,
            name_flow(0.0, 300.0, "the minor street"),
        ),
        stage_sign_runner,
    ),
    ScenarioFamily(
        "mixed-crossing",
        "CAVs of a minor street cross the traffic of a main street, which sends nothing, but for single CAVs in it.",
        (*OLD_TOWNS, *HEDGES),
        (
            *COLUMNS,
            name_number("near", 0.0, 1.0, "on the near way of the main street"),
            FamilyParameter("near_s", -1.0, 2.5, "s", "how much later it is due"),
            name_number("far", 0.0, 1.0, "on the far way of the main street"),
            FamilyParameter("far_s", -1.0, 2.5, "s", "how much later it is due"),
            MAST,
            name_flow(450.0, 1000.0, "the main street"),
        ),
        stage_mixed_crossing,
    ),
    ScenarioFamily(
        "emergency-vehicle",
        "An ambulance on call crosses a main street out of a minor one and comes into view at the last moment.",
        (*OLD_TOWNS[:2], *HEDGES, *STOP_PLACES),  # streets of corridors end at the main one
        (*COLUMNS, *HIDDEN, MAST, name_flow(0.0, 400.0, "the main street")),
        stage_emergency_vehicle,
    ),
)
