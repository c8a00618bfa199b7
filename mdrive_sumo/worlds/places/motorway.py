"""Kinds of places: a motorway with an on-ramp, an exit, both, or a lane that ends."""

import random
from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.worlds.places.carriageway import (
    SCENERY,
    Carriageway,
    Section,
    add_bank,
    add_opposite_carriageway,
    add_ramp,
    add_taper,
    connect_lanes,
    draw_axis,
    draw_carriageway,
    furnish_motorway,
)
from mdrive_sumo.worlds.places.frontage import Roadside
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose

BEFORE_M = (170.0, 240.0)
"""[m] Range of the carriageway before the place where lanes change; chosen: 5 s to 9 s of driving."""
BEHIND_M = (130.0, 190.0)
"""[m] Range of the carriageway behind that place; chosen: routes end there."""


@dataclass(frozen=True)
class MotorwayParameters:
    """Parameters of all motorways."""

    lanes: int = choose(2, 3, doc="Lanes of the carriageway.", weights=(3.0, 2.0))
    limit_kmh: float = choose(80.0, 100.0, 120.0, 130.0, doc="Speed limit [km/h].", weights=(3.0, 3.0, 3.0, 1.0))
    lane_m: float = between(3.5, 3.75, doc="Width of a lane [m] (RAA 2008: 3.50 m or 3.75 m).")
    sinuosity: float = between(0.0, 1.0, doc="Share of the carriageway in bends.")
    carriageways: int = choose(1, 2, doc="2: with that of the other direction.", weights=(1.0, 0.0))
    scenery: str = choose(*SCENERY, doc="What stands beside the carriageway.")


@dataclass(frozen=True)
class MergeParameters(MotorwayParameters):
    """Parameters of an on-ramp."""

    ramp_limit_kmh: float = choose(60.0, 80.0, doc="Speed limit of the ramp [km/h].", weights=(3.0, 1.0))
    auxiliary_m: float = between(
        150.0, 250.0, doc="Length [m] of the acceleration lane (RAA 2008: 150 m urban, 250 m rural)."
    )
    has_bank: bool = choose(False, True, doc="An earth bank hides ramp and carriageway from each other.")


@dataclass(frozen=True)
class ExitParameters(MotorwayParameters):
    """Parameters of an exit."""

    ramp_limit_kmh: float = choose(60.0, 80.0, doc="Speed limit of the ramp [km/h].", weights=(3.0, 1.0))
    auxiliary_m: float = between(
        150.0, 250.0, doc="Length [m] of the deceleration lane (RAA 2008: 150 m urban, 250 m rural)."
    )


@dataclass(frozen=True)
class WeaveParameters(MotorwayParameters):
    """Parameters of a weaving section."""

    ramp_limit_kmh: float = choose(60.0, 80.0, doc="Speed limit of both ramps [km/h].", weights=(3.0, 1.0))
    auxiliary_m: float = between(
        180.0, 350.0, doc="Length [m] of the lane from ramp to ramp (RAA 2008: 180 m or more)."
    )
    has_bank: bool = choose(False, True, doc="Earth banks hide ramps and carriageway from each other.")


@dataclass(frozen=True)
class LaneDropParameters(MotorwayParameters):
    """Parameters of a lane that ends; `lanes` counts those that go on."""

    side: str = choose("right", "left", doc="Which lane ends.", weights=(2.0, 1.0))


def build_merge(draft: NetworkDraft, parameters: MergeParameters, rng: random.Random) -> None:
    """Fill a draft with an on-ramp."""
    road, join, split = _draw_road(draft, parameters, parameters.auxiliary_m, rng.uniform(*BEFORE_M), rng)
    _add_entry(road, parameters, join, rng)
    add_taper(road, split, 1, parameters.lanes * parameters.lane_m)
    _furnish(road, parameters, rng, {"on_ramp": join} if parameters.has_bank else {})


def build_exit(draft: NetworkDraft, parameters: ExitParameters, rng: random.Random) -> None:
    """Fill a draft with an exit."""
    road, join, split = _draw_road(draft, parameters, parameters.auxiliary_m, rng.uniform(*BEHIND_M), rng)
    connect_lanes(draft, "main", "beside", [(0, 0)])
    add_taper(road, join, -1, parameters.lanes * parameters.lane_m)
    _add_exit(road, parameters, split, rng)
    _furnish(road, parameters, rng, {})


def build_weave(draft: NetworkDraft, parameters: WeaveParameters, rng: random.Random) -> None:
    """Fill a draft with an on-ramp and an exit that share a lane."""
    road, join, split = _draw_road(draft, parameters, parameters.auxiliary_m, rng.uniform(*BEFORE_M), rng)
    _add_entry(road, parameters, join, rng)
    _add_exit(road, parameters, split, rng)
    _furnish(road, parameters, rng, {"on_ramp": join, "off_ramp": split} if parameters.has_bank else {})


def build_lane_drop(draft: NetworkDraft, parameters: LaneDropParameters, rng: random.Random) -> None:
    """Fill a draft with a carriageway that loses its rightmost or leftmost lane; SUMO merges both by turns."""
    n, is_right = parameters.lanes, parameters.side == "right"
    wide, narrow = rng.uniform(*BEFORE_M), rng.uniform(*BEHIND_M)
    axis = draw_axis(rng, wide + narrow, parameters.limit_kmh, parameters.sinuosity)
    narrow_right_m = 0.0 if is_right else parameters.lane_m
    sections = (Section("wide", wide, n + 1, "drop", "zipper"), Section("narrow", narrow, n, "end", "", narrow_right_m))
    road = draw_carriageway(draft, sections, parameters.lane_m, parameters.limit_kmh, axis)
    pairs = [(i + 1, i) for i in range(n)] + [(0, 0)] if is_right else [(i, i) for i in range(n)] + [(n, n - 1)]
    connect_lanes(draft, "wide", "narrow", pairs)
    if is_right:
        add_taper(road, wide, 1, n * parameters.lane_m)
    _furnish(road, parameters, rng, {})


def _draw_road(
    draft: NetworkDraft, parameters: MotorwayParameters, beside_m: float, before_m: float, rng: random.Random
) -> tuple[Carriageway, float, float]:
    """Add a carriageway with an auxiliary lane at the right of its middle part; return where that begins and ends."""
    behind, n = rng.uniform(*BEHIND_M), parameters.lanes
    axis = draw_axis(rng, before_m + beside_m + behind, parameters.limit_kmh, parameters.sinuosity)
    sections = (
        Section("main", before_m, n, "join"),
        Section("beside", beside_m, n + 1, "split"),
        Section("after", behind, n, "end"),
    )
    road = draw_carriageway(draft, sections, parameters.lane_m, parameters.limit_kmh, axis)
    connect_lanes(draft, "main", "beside", [(i, i + 1) for i in range(n)])
    connect_lanes(draft, "beside", "after", [(i + 1, i) for i in range(n)])
    return road, before_m, before_m + beside_m


def _add_entry(
    road: Carriageway, parameters: MergeParameters | WeaveParameters, join_m: float, rng: random.Random
) -> None:
    add_ramp(road, "on_ramp", join_m, parameters.lanes, parameters.ramp_limit_kmh, rng)
    connect_lanes(road.draft, "on_ramp", "beside", [(0, 0)])


def _add_exit(
    road: Carriageway, parameters: ExitParameters | WeaveParameters, split_m: float, rng: random.Random
) -> None:
    add_ramp(road, "off_ramp", split_m, parameters.lanes, parameters.ramp_limit_kmh, rng)
    connect_lanes(road.draft, "beside", "off_ramp", [(0, 0)])


def _furnish(road: Carriageway, parameters: MotorwayParameters, rng: random.Random, banks: Mapping[str, float]) -> None:
    """Add the other carriageway, banks beside ramps (by the station of the nose) and scenery."""
    if parameters.carriageways == 2:
        add_opposite_carriageway(road, parameters.lanes)
    roadside = Roadside(road.draft)
    for name, nose_m in banks.items():
        add_bank(roadside, road, name, nose_m, parameters.lanes)
    furnish_motorway(roadside, road, parameters.scenery, rng)


MOTORWAY_KINDS = (
    PlaceKind("motorway_merge", "a motorway with an on-ramp and its acceleration lane", MergeParameters, build_merge),
    PlaceKind("motorway_exit", "a motorway with an exit and its deceleration lane", ExitParameters, build_exit),
    PlaceKind("motorway_weave", "a motorway where an on-ramp and an exit share a lane", WeaveParameters, build_weave),
    PlaceKind("lane_drop", "a motorway carriageway that loses a lane", LaneDropParameters, build_lane_drop),
)
