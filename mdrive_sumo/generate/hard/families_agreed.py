"""Families where CAVs of two sides wait for one pause of a hidden stream, and meet in it: they need an order."""

import random
from collections.abc import Iterator
from functools import lru_cache

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.families_queues import (
    CYCLE_PLACES,
    DUE,
    FLANK_M,
    HIGH,
    PASS_S,
    build_mast_beyond,
    build_queue,
    build_queue_stream,
    choose_models,
    find_gap,
    find_left_turns,
)
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.hard.junction_parameters import HEADWAY, OLD_TOWNS, SITE, name_number
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
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import BODIES, build_mast
from mdrive_sumo.worlds.placement.lane_chains import compute_pose

ROW_GAP_M = 1.0
"""[m] Between vehicles of a row."""
LANE_FLANK_M = 1.6
"""[m] From the middle of the left lane to the flanks of those that stand in the right one, which use all of it."""

Merge = tuple[JunctionConflict, JunctionConflict]
"""A left turn and a way straight on into the same street, with the way that both cross."""


@lru_cache(maxsize=128)
def find_merges(roads: RoadMap) -> tuple[Merge, ...]:
    """Return the left turns across oncoming traffic into a street to which others come straight from opposite."""
    return tuple(pair for turn in find_left_turns(roads) for pair in _pair_turn(roads, turn))


def _pair_turn(roads: RoadMap, turn: JunctionConflict) -> Iterator[Merge]:
    for one in find_junction_conflicts(roads):
        if (
            one.other == turn.other
            and one.own.turn == "straight"
            and not are_opposite(roads, one.own, one.other)
            and set(one.own.lanes[one.own.index + 1 :]) & set(turn.own.lanes[turn.own.index + 1 :])
        ):
            yield turn, one


def stage_merge_behind_queue(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs that turn left through the gap of the oncoming queue, and others that cross the main street through
    the same gap into the same street; past the far flank of the queue pedelecs come."""
    merges = find_merges(roads)
    if not merges:
        raise refuse_place(roads, "a left turn and a way straight on into the same street")
    turn, straight = choose_site(merges, values["site"])
    gap, beside = find_gap(roads, turn), find_gap(roads, straight)
    own, back = round(values["own"]), round(values["back"])
    pause_s = values["pause_s"] + (own + back - max(own, back)) * PASS_S
    column, riders = build_queue_stream(roads, gap, {**values, "pause_s": pause_s}, "bicycle", -FLANK_M)
    offset = -(FLANK_M + values["behind_m"] + BODIES["bicycle"].width / 2)
    due_s = values["due_s"] + values["back_s"]
    other = CavColumn(beside.own, beside.locate(offset)[0], back, due_s, values["headway_s"])
    free_m = CAR.width / 2 + values["gap_m"]
    queue = build_queue(roads, gap, choose_models(values, seed), free_m, -FLANK_M, also=beside.own)
    egos = build_columns(roads, (column, other))
    return FamilyScene(egos, (), (*queue, *riders), (build_mast_beyond(roads, column, values),))


@lru_cache(maxsize=128)
def find_facing(roads: RoadMap) -> tuple[Merge, ...]:
    """Return the left turns out of minor streets across the left one of two lanes, each with a way out of the facing
    street that crosses it, and with the lanes that these ways cross first."""
    conflicts = find_junction_conflicts(roads)
    crossed = {(one.own, one.other) for one in conflicts if one.is_crossing}
    ways = [one for one in conflicts if one.own.turn != "right" and _passes_row(roads, one)]
    return tuple(
        (one, back)
        for one in ways
        for back in ways
        if one.own.turn == "left" and are_opposite(roads, one.own, back.own) and (one.own, back.own) in crossed
    )


def _passes_row(roads: RoadMap, one: JunctionConflict) -> bool:
    """Return whether a way that must give way crosses the left one of two lanes, which comes from the left."""
    lane = roads.lanes[one.other.approach]
    return (
        one.own.control in ("yield", "stop")
        and one.other.turn == "straight"
        and one.from_left
        and not are_opposite(roads, one.own, one.other)
        and bool(lane.right)
        and not lane.left
    )


def stage_facing_streets(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return CAVs of two minor streets that face each other, whose ways cross; before each stands a row of lorries in
    the first lane of the main street, past which motorcycles filter."""
    pairs = find_facing(roads)
    if not pairs:
        raise refuse_place(roads, "ways out of facing streets that cross each other and two lanes of a direction")
    pair = choose_site(pairs, values["site"])
    due = (values["due_s"], values["due_s"] + values["back_s"])
    columns = [
        CavColumn(one.own.lanes, one.own_m, round(values[name]), due_s, values["headway_s"])
        for one, name, due_s in zip(pair, ("own", "back"), due, strict=True)
    ]
    egos = build_columns(roads, columns)
    actors = [
        actor for one, end in zip(pair, ("", "-back"), strict=True) for actor in _hide(roads, one, values, (seed, end))
    ]
    mast = build_mast("rsu", compute_pose(roads, pair[0].other.lanes, pair[0].other_m, values["mast_m"]))
    return FamilyScene(egos, (), tuple(actors), (mast,))


def _hide(roads: RoadMap, one: JunctionConflict, values: Values, names: tuple[str, str]) -> tuple[Actor, ...]:
    """Return a row and a stream that it hides. names: the seed, and the end of their ids."""
    seed, end = names
    models = random.Random(f"{seed}/row{end}").choices(HIGH, k=round(values["standing"]))
    row = build_row(roads, one, -LANE_FLANK_M, values["side_m"], (models, ROW_GAP_M))
    stream = RoadUserStream(
        one.other.lanes,
        one.other_m,
        values["behind_m"] + BODIES["motorcycle"].width / 2 - LANE_FLANK_M,
        "motorcycle",
        values["speed"],
        values["due_s"] - values["before_s"],
        values["every_s"],
        round((values["before_s"] + values["flows_s"]) / values["every_s"]),
        values["pause_s"] + (round(values["own"]) + round(values["back"])) * PASS_S,
    )
    row = tuple(actor.model_copy(update={"id": f"{actor.id}{end}"}) for actor in row)
    return (*row, *build_stream(roads, f"motorcycle{end}", stream))


_COLUMNS = (
    SITE,
    FamilyParameter("back_s", -0.5, 0.5, "s", "how much later those of the other side are due"),
    DUE,
    HEADWAY,
)
_CYCLISTS = (
    FamilyParameter("gap_m", 0.5, 0.6, "m", "distance of the queue from the side of a CAV in its gap"),
    FamilyParameter("behind_m", 0.3, 0.4, "m", "distance of the stream from the flanks of the queue"),
    FamilyParameter("before_s", 2.0, 3.0, "s", "how much earlier than the first CAV the stream begins"),
    FamilyParameter("flows_s", 6.5, 8.5, "s", "for how long after the first CAV is due it goes on"),
    FamilyParameter("pause_s", 3.5, 5.5, "s", "pause before it comes again, besides the time that the CAVs need"),
    FamilyParameter(
        "mast_m", 0.0, 6.0, "m", "distance of a roadside unit behind the stream, above the way of the CAVs"
    ),
    FamilyParameter("queue_m", 50.0, 90.0, "m", "length of the queue before the gap"),
    FamilyParameter("speed", 8.0, 9.0, "m/s", "speed of the cyclists, on pedelecs"),
    FamilyParameter("every_s", 0.65, 0.8, "s", "time between two cyclists"),
)
FAMILIES = (
    ScenarioFamily(
        "merge-behind-queue",
        "CAVs turn left through the gap of the oncoming queue, others cross it into the same street; behind it come"
        " cyclists.",
        (*CYCLE_PLACES[:3], *OLD_TOWNS[:2]),  # streets of corridors end at the main one
        (
            *_COLUMNS,
            name_number("own", 2.5, 4.4, "that turn left"),
            name_number("back", 1.6, 3.0, "that drive straight on"),
            *_CYCLISTS,
        ),
        stage_merge_behind_queue,
    ),
    ScenarioFamily(
        "facing-streets",
        "CAVs of two minor streets whose ways cross wait until motorcycles have passed, which standing lorries hide.",
        tuple(
            PlaceChoice(
                "crossing",
                {
                    "area": area,
                    "arms": 4,
                    "control": control,
                    "main_lanes": 2,
                    "speed_kmh": 50,
                    "turn_lanes": False,
                },
            )
            for area, control in (("town", "priority"), ("old_town", "priority"), ("suburb", "priority"))
        ),
        (
            *_COLUMNS,
            name_number("own", 1.6, 2.6, "that turn left"),
            name_number("back", 1.8, 3.2, "of the facing street"),
            FamilyParameter("side_m", 1.3, 1.8, "m", "from the first lorry to the middle of the CAVs' way"),
            FamilyParameter("behind_m", 0.3, 0.4, "m", "distance of the stream from the flanks of the lorries"),
            FamilyParameter("standing", 4.6, 7.4, "", "number of lorries and buses that stand, rounded"),
            FamilyParameter("before_s", 2.5, 3.2, "s", "how much earlier than the first CAV the stream begins"),
            FamilyParameter("flows_s", 5.2, 6.2, "s", "for how long after the first CAV is due it goes on"),
            FamilyParameter("pause_s", 5.0, 7.0, "s", "pause before it comes again, besides the CAVs' time"),
            FamilyParameter("speed", 12.0, 14.0, "m/s", "speed of the motorcycles"),
            FamilyParameter("every_s", 0.7, 0.82, "s", "time between two motorcycles"),
            FamilyParameter("mast_m", 1.0, 3.0, "m", "from the first stream to the roadside unit in the junction"),
        ),
        stage_facing_streets,
    ),
)
