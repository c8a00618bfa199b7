"""Families where CAVs of two sides wait for one pause of a hidden stream, and meet in it: they need an order."""

from collections.abc import Iterator
from functools import lru_cache

from mdrive_sumo.generate.hard.families_queues import (
    CYCLE_PLACES,
    DUE,
    FLANK_M,
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
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import BODIES

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


_COLUMNS = (
    SITE,
    FamilyParameter("back_s", -0.5, 1.0, "s", "how much later those of the other side are due"),
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
)
