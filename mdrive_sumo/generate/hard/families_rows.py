"""Families where CAVs turn left across a stream: a row of lorries that stand beside it hides it from them."""

import random
from collections.abc import Callable
from functools import lru_cache

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
Fits = Callable[[RoadMap, JunctionConflict], bool]


def _turns_before_oncoming(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way turns left across the right one of two lanes from ahead, at lights with green at first."""
    lane = roads.lanes[one.other.approach]
    return (
        are_opposite(roads, one.own, one.other)
        and bool(lane.left)
        and not roads.lanes[lane.left].left
        and (one.own.control != "traffic-light" or has_green_at_start(roads, one.own.approach, one.own.inside))
    )


def _turns_out_of_minor_street(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way that must give way turns left across the left one of two lanes from the left."""
    lane = roads.lanes[one.other.approach]
    return (
        one.own.control in ("yield", "stop")
        and one.from_left
        and not are_opposite(roads, one.own, one.other)
        and bool(lane.right)
        and not lane.left
    )


def _passes_parked_row(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way that must give way turns left across the only lane from the left."""
    lane = roads.lanes[one.other.approach]
    return (
        one.own.control in ("yield", "stop")
        and one.from_left
        and not are_opposite(roads, one.own, one.other)
        and not lane.right
        and not lane.left
    )


@lru_cache(maxsize=128)
def _find_sites(roads: RoadMap, fits: Fits) -> tuple[JunctionConflict, ...]:
    """Return the left turns across ways straight on that fit."""
    return tuple(
        one
        for one in find_junction_conflicts(roads)
        if one.own.turn == "left" and one.other.turn == "straight" and fits(roads, one)
    )


def stage_left_turn(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that turn left in front of lorries that wait to turn left, too, and hide a stream beside them."""
    return _stage(values, seed, roads, _turns_before_oncoming, 1.0)


def stage_minor_left_turn(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that turn left out of a minor street in front of lorries, which hide those who pass them."""
    return _stage(values, seed, roads, _turns_out_of_minor_street, -1.0)


def stage_convoy(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that leave a minor street at the end of a parked row, along which a convoy on call comes."""
    return _stage(values, seed, roads, _passes_parked_row, -1.0)


def _stage(values: Values, seed: str, roads: RoadMap, fits: Fits, left: float) -> FamilyScene:
    """left: 1 where the row stands at the left of the stream, -1 at its right."""
    sites = _find_sites(roads, fits)
    if not sites:
        raise refuse_place(roads, "a way that turns left across a stream beside a row")
    one = choose_site(sites, values["site"])
    columns = [CavColumn(one.own.lanes, one.own_m, round(values["own"]), values["due_s"], values["headway_s"])]
    egos = build_columns(roads, columns)
    actors = _build_hidden_stream(roads, one, left, values, (seed, ""))
    return FamilyScene(
        egos, (), actors, _build_masts(roads, one, -left * values["mast_m"]), one.own.control == "traffic-light"
    )


def _build_hidden_stream(
    roads: RoadMap, one: JunctionConflict, left: float, values: Values, names: tuple[str, str]
) -> tuple[Actor, ...]:
    """Return a row and a stream beside it. names: the seed, and the end of their ids."""
    seed, ending = names
    model = "truck" if values["buses"] < 0.5 else "bus"
    flank_m = left * (BODY_SIZES[model][1] / 2 + values["gap_m"])
    standing = random.Random(f"{seed}/row{ending}").choices(HIGH, k=round(values["standing"]))
    row = build_row(roads, one, flank_m, values["side_m"], (standing, ROW_GAP_M))
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


def stage_both_sides(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of both minor streets of a crossing, each of which a hidden stream passes from the left: those of
    one turn left, those of the other drive straight on, so that they meet when the streams have passed."""
    sites = [
        (one, back)
        for one in _find_sites(roads, _turns_out_of_minor_street)
        for back in find_junction_conflicts(roads)
        if back.own.turn == back.other.turn == "straight"
        and are_opposite(roads, one.own, back.own)
        and back.own.junction == one.own.junction
        and _turns_out_of_minor_street(roads, back)
    ]
    if not sites:
        raise refuse_place(roads, "two minor streets that face each other across two lanes of a direction")
    one, back = choose_site(sites, values["site"])
    first_s, headway_s = values["due_s"], values["headway_s"]
    columns = [
        CavColumn(one.own.lanes, one.own_m, round(values["own"]), first_s, headway_s),
        CavColumn(back.own.lanes, back.own_m, round(values["back"]), first_s + values["back_s"], headway_s),
    ]
    egos = build_columns(roads, columns)
    actors = (
        *_build_hidden_stream(roads, one, -1.0, values, (seed, "")),
        *_build_hidden_stream(roads, back, -1.0, values, (seed, "-back")),
    )
    return FamilyScene(egos, (), actors, _build_masts(roads, one, values["mast_m"]))


def _build_masts(roads: RoadMap, one: JunctionConflict, aside_m: float) -> tuple[RoadsideUnit, ...]:
    """Return a roadside unit so far to the left of the middle of the stream."""
    return (build_mast("rsu", compute_pose(roads, one.other.lanes, one.other_m, aside_m)),)


def _choose_crossing(area: str, control: str, **more: str | bool) -> PlaceChoice:
    parameters = {"area": area, "arms": 4, "control": control, "main_lanes": 2, "speed_kmh": 50, "turn_lanes": False}
    return PlaceChoice("crossing", {**parameters, **more})


def _choose_street(area: str, **more: str | bool) -> PlaceChoice:
    parameters = {"area": area, "arms": 4, "control": "priority", "main_lanes": 1, "speed_kmh": 50}
    return PlaceChoice("crossing", {**parameters, "keeps_sight": False, **more})


_PARAMETERS = (
    SITE,
    name_number("own", 2.3, 4.4, "that have to cross the stream"),
    FamilyParameter("due_s", 4.5, 6.0, "s", "time after which the first CAV is due at the conflict"),
    FamilyParameter("headway_s", 1.0, 1.8, "s", "time headway of the CAVs"),
    FamilyParameter("share", 0.95, 1.1, "", "speed of the stream as a share of the limit"),
    FamilyParameter("gap_m", 0.3, 0.5, "m", "from the flanks of the lorries that stand to the stream"),
    FamilyParameter("side_m", 1.3, 2.2, "m", "from the first lorry to the middle of the CAVs' way"),
    FamilyParameter("standing", 4.0, 7.4, "", "number of lorries and buses that stand, rounded"),
    FamilyParameter("before_s", 2.5, 4.5, "s", "from the first vehicle of the stream to the first CAV"),
    FamilyParameter("lasts_s", 5.5, 8.0, "s", "from the first CAV to the last vehicle of the stream"),
    FamilyParameter("every_s", 1.3, 1.8, "s", "time between the two vehicles of a pair"),
    FamilyParameter("pause_s", 2.4, 3.0, "s", "time from a pair of the stream to the next"),
    FamilyParameter("buses", 0.0, 1.0, "", "whether the stream is of buses (from 0.5 on) or of lorries"),
    FamilyParameter(
        "mast_m", 0.0, 1.6, "m", "from the stream to the mast: if it is near, each lorry hides the next one"
    ),
)
_TWO_LANES = (
    _choose_crossing("old_town", "priority", keeps_sight=False),
    _choose_crossing("town", "priority"),
    _choose_crossing("town", "stop"),
)
FAMILIES = (
    ScenarioFamily(
        "both-sides",
        "CAVs of two minor streets that face each other cross hidden streams, and meet when these have passed.",
        _TWO_LANES,
        (
            *(one for one in _PARAMETERS if one.name != "own"),
            name_number("own", 1.5, 3.4, "that turn left"),
            name_number("back", 1.5, 3.4, "that come from the other side and drive straight on"),
            FamilyParameter("back_s", -0.5, 1.0, "s", "how much later those are due"),
        ),
        stage_both_sides,
    ),
    ScenarioFamily(
        "left-turn",
        "CAVs turn left in front of lorries that wait to turn left; beside them vehicles come straight on.",
        (
            *(_choose_crossing(area, "signals", program="permitted") for area in ("town", "suburb", "commercial")),
            _choose_crossing("town", "priority"),
        ),
        _PARAMETERS,
        stage_left_turn,
    ),
    ScenarioFamily(
        "convoy",
        "CAVs turn left out of a minor street; parked lorries hide a convoy on call that passes them.",
        (
            *(_choose_street(area, beside="parking") for area in ("old_town", "town", "suburb")),
            PlaceChoice(
                "corridor",
                {"junctions": 3, "limit_kmh": 50.0, "signals": "none", "parking": "both_sides", "keeps_sight": False},
            ),
        ),
        _PARAMETERS,
        stage_convoy,
    ),
    ScenarioFamily(
        "minor-left-turn",
        "CAVs turn left out of a minor street in front of lorries that stand in the first lane; others pass them.",
        _TWO_LANES,
        _PARAMETERS,
        stage_minor_left_turn,
    ),
)
