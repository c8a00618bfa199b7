"""Families where CAVs cross a stream: a row of lorries that stand beside it hides it from them."""

import random
from collections.abc import Iterator
from functools import lru_cache
from itertools import chain

from shapely.geometry.base import BaseGeometry

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import SITE, name_number
from mdrive_sumo.generate.hard.junction_users import CavColumn, build_columns
from mdrive_sumo.generate.hard.sites.crossroads import are_opposite
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    choose_site,
    find_junction_conflicts,
    refuse_place,
)
from mdrive_sumo.generate.hard.sites.no_stopping import build_crossing_street, build_zebras
from mdrive_sumo.generate.hard.standing_rows import build_row
from mdrive_sumo.generate.hard.streams import RoadUserStream, build_stream
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES, build_mast
from mdrive_sumo.worlds.placement.lane_chains import compute_pose
from mdrive_sumo.worlds.signalled_crossings import has_green_at_start

HIGH = ("truck", "bus")
"""Models of vehicles that stand: a LiDAR on a roof does not look over them."""
ROW_GAP_M = 1.0
"""[m] Between them."""


def _turns_before_oncoming(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way turns left across the right one of two lanes from ahead, at lights with green at first."""
    lane = roads.lanes[one.other.approach]
    return (
        are_opposite(roads, one.own, one.other)
        and bool(lane.left)
        and not roads.lanes[lane.left].left
        and (one.own.control != "traffic-light" or has_green_at_start(roads, one.own.approach, one.own.inside))
    )


def _leaves_minor_street(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way that must give way crosses a lane straight on from the left, with at most one lane at its
    right and none at its left."""
    lane = roads.lanes[one.other.approach]
    return (
        one.own.control in ("yield", "stop")
        and one.other.turn == "straight"
        and one.from_left
        and not are_opposite(roads, one.own, one.other)
        and not lane.left
        and not (lane.right and roads.lanes[lane.right].right)
    )


@lru_cache(maxsize=128)
def _find_left_turns(roads: RoadMap) -> tuple[JunctionConflict, ...]:
    return tuple(
        one
        for one in find_junction_conflicts(roads)
        if one.own.turn == "left" and one.other.turn == "straight" and _turns_before_oncoming(roads, one)
    )


@lru_cache(maxsize=128)
def _find_facing_streets(roads: RoadMap) -> tuple[tuple[JunctionConflict, JunctionConflict], ...]:
    """Return left turns out of minor streets, each with the way straight on out of the one that faces it."""
    leaving = [one for one in find_junction_conflicts(roads) if _leaves_minor_street(roads, one)]
    return tuple(
        (one, back)
        for one in leaving
        for back in leaving
        if (one.own.turn, back.own.turn) == ("left", "straight")
        and one.own.junction == back.own.junction
        and are_opposite(roads, one.own, back.own)
    )


def stage_left_turn(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that turn left in front of lorries that wait to turn left, too, and hide a stream beside them."""
    sites = _find_left_turns(roads)
    if not sites:
        raise refuse_place(roads, "a left turn across two lanes from ahead")
    one = choose_site(sites, values["site"])
    egos = build_columns(roads, [_build_column(one, values, "own", 0.0)])
    actors = build_hidden_stream(roads, one, 1.0, values, (seed, ""), build_zebras(roads))
    masts = build_stream_masts(roads, one, -values["mast_m"])
    return FamilyScene(egos, (), actors, masts, one.own.control == "traffic-light")


def stage_facing_streets(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of two minor streets that face each other, each of which a hidden stream passes from the left: those
    of one turn left, those of the other drive straight on, so that they meet when the streams have passed."""
    sites = _find_facing_streets(roads)
    if not sites:
        raise refuse_place(roads, "two minor streets that face each other")
    one, back = choose_site(sites, values["site"])
    columns = [_build_column(one, values, "own", 0.0), _build_column(back, values, "back", values["back_s"])]
    egos = build_columns(roads, columns)
    actors = (
        *build_hidden_stream(roads, one, -1.0, values, (seed, ""), list_closed(roads, one)),
        *build_hidden_stream(roads, back, -1.0, values, (seed, "-back"), list_closed(roads, back)),
    )
    watched = (one, back)[: round(values["masts"])]
    masts = [build_stream_masts(roads, site, values["mast_m"], f"rsu{k}") for k, site in enumerate(watched)]
    return FamilyScene(egos, (), actors, tuple(chain.from_iterable(masts)))


def _build_column(one: JunctionConflict, values: Values, count: str, later_s: float) -> CavColumn:
    due_s = values["due_s"] + later_s
    return CavColumn(one.own.lanes, one.own_m, round(values[count]), due_s, values["headway_s"])


def list_closed(roads: RoadMap, one: JunctionConflict) -> BaseGeometry:
    """Return where nothing parks along the other way of a conflict: in front of the own street, and on zebras."""
    return build_zebras(roads).union(build_crossing_street(roads, one.other))


def build_hidden_stream(
    roads: RoadMap,
    one: JunctionConflict,
    left: float,
    values: Values,
    names: tuple[str, str],
    closed: BaseGeometry,
) -> tuple[Actor, ...]:
    """Return a row and a stream beside it. names: the seed, and the end of their ids; closed: where no row stands."""
    seed, ending = names
    model = "truck" if values["buses"] < 0.5 else "bus"
    flank_m = left * (BODY_SIZES[model][1] / 2 + values["gap_m"])
    standing = random.Random(f"{seed}/row{ending}").choices(HIGH, k=round(values["standing"]))
    row = build_row(roads, one, flank_m, values["side_m"], (standing, ROW_GAP_M), closed)
    stream = RoadUserStream(
        one.other.lanes,
        one.other_m,
        0.0,
        model,
        one.other.limit * values["share"],
        values["due_s"] - values["before_s"],
        values["every_s"],
        count=2,
        pause_s=values["pause_s"],
        groups=1 + round((values["before_s"] + values["lasts_s"]) / (values["every_s"] + values["pause_s"])),
    )
    row = tuple(actor.model_copy(update={"id": f"{actor.id}{ending}"}) for actor in row)
    return (*row, *build_stream(roads, f"stream{ending}", stream))


def build_stream_masts(
    roads: RoadMap, one: JunctionConflict, aside_m: float, name: str = "rsu"
) -> tuple[RoadsideUnit, ...]:
    """Return a roadside unit so far to the left of the middle of the stream."""
    return (build_mast(name, compute_pose(roads, one.other.lanes, one.other_m, aside_m)),)


def _choose_crossing(area: str, control: str, **more: str | bool) -> PlaceChoice:
    parameters = {
        "area": area,
        "arms": 4,
        "control": control,
        "main_lanes": 2,
        "speed_kmh": 50,
        "turn_lanes": False,
        "zebras": False,
    }
    return PlaceChoice("crossing", {**parameters, **more})


def _choose_street(area: str) -> PlaceChoice:
    parameters = {"area": area, "arms": 4, "control": "priority", "main_lanes": 1, "speed_kmh": 50, "zebras": False}
    return PlaceChoice("crossing", {**parameters, "beside": "parking", "keeps_sight": False})


def _describe_stream(
    share: tuple[float, float], pause_s: tuple[float, float], lasts_s: tuple[float, float], most_mast_m: float
) -> Iterator[FamilyParameter]:
    """Yield parameters of a stream with their bounds: who turns left is slow, so less time between pairs meets all."""
    yield FamilyParameter("share", *share, "", "speed of the stream as a share of the limit")
    yield FamilyParameter("pause_s", *pause_s, "s", "time from a pair of the stream to the next")
    yield FamilyParameter("lasts_s", *lasts_s, "s", "from the first CAV to the last pair of the stream, roughly")
    yield FamilyParameter(
        "mast_m", 0.0, most_mast_m, "m", "from the stream to the mast: if it is near, each lorry hides the next one"
    )


_PARAMETERS = (
    SITE,
    FamilyParameter("due_s", 5.5, 7.0, "s", "time after which the first CAV is due at the conflict"),
    FamilyParameter("headway_s", 1.0, 1.8, "s", "time headway of the CAVs"),
    FamilyParameter("gap_m", 0.3, 0.5, "m", "from the flanks of the lorries that stand to the stream"),
    FamilyParameter("side_m", 1.85, 2.4, "m", "from the first lorry to the middle of the CAVs' way"),
    FamilyParameter("standing", 4.0, 7.4, "", "number of lorries and buses that stand, rounded"),
    FamilyParameter("before_s", 2.5, 4.5, "s", "from the first vehicle of the stream to the first CAV"),
    FamilyParameter("every_s", 1.3, 1.8, "s", "time between the two vehicles of a pair"),
    FamilyParameter("buses", 0.0, 1.0, "", "whether the stream is of buses (from 0.5 on) or of lorries"),
)
_FACING = (
    *_PARAMETERS,
    *_describe_stream((1.0, 1.3), (2.6, 3.4), (4.0, 5.5), 1.2),
    name_number("own", 1.5, 2.4, "that turn left"),
    name_number("back", 0.6, 2.4, "that come from the other side and drive straight on"),
    FamilyParameter("back_s", -0.5, 1.0, "s", "how much later those are due"),
    FamilyParameter("masts", 0.6, 2.4, "", "number of streams that a roadside unit sees, rounded"),
)
FAMILIES = (
    ScenarioFamily(
        "left-turn",
        "CAVs turn left in front of lorries that wait to turn left; beside them vehicles come straight on.",
        (
            *(_choose_crossing(area, "signals", program="permitted") for area in ("town", "suburb", "commercial")),
            _choose_crossing("town", "priority"),
        ),
        (
            *_PARAMETERS,
            *_describe_stream((0.95, 1.1), (2.0, 2.7), (4.5, 6.5), 1.7),
            name_number("own", 2.3, 4.4, "that turn left"),
        ),
        stage_left_turn,
    ),
    ScenarioFamily(
        "parked-rows",
        "CAVs of two minor streets cross a main one: lorries are parked along it and hide those that pass them.",
        tuple(_choose_street(area) for area in ("old_town", "town")),
        _FACING,
        stage_facing_streets,
    ),
)
