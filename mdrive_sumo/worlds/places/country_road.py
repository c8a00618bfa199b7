"""Kind of place: a road in the country with bends, farm tracks and what hides them: hedges, barns, houses, a wood."""

import math
import random
from dataclasses import dataclass

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import draw_bends, trace_axis
from mdrive_sumo.worlds.places.frontage import Roadside, build_block, find_kerb, list_sight_triangles
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_spine import (
    HalfSection,
    Joint,
    SideArm,
    Spine,
    SpinePlan,
    StreetSection,
    build_spine,
    compute_arm_heading,
)

HAMLET = HouseRows((3.0, 10.0), (6.0, 30.0), (10.0, 22.0), (8.0, 12.0), 0.8)
FARMS = HouseRows((8.0, 40.0), (60.0, 160.0), (12.0, 30.0), (10.0, 18.0), 0.6)
"""Rows of houses in a hamlet, and single farms along a road; distances chosen."""
TRACK_LANE_M = 2.25
"""[m] Half of a farm track (RLW 2016: 4.50 m and more where two vehicles pass)."""
TRACK_KMH = 30.0
"""[km/h] What a farm track is driven at; chosen."""
END_M = (110.0, 160.0)
"""[m] Range of the road before its first and after its last track; chosen: 5 s to 6 s of driving."""
BARN_M = ((15.0, 28.0), (10.0, 16.0))
"""[m] Ranges of length and depth of a barn; chosen."""


@dataclass(frozen=True)
class CountryRoadParameters:
    """Parameters of a road in the country."""

    tracks: int = choose(0, 1, 2, 3, doc="Farm tracks or lanes that join.", weights=(1.0, 3.0, 3.0, 1.0))
    limit_kmh: float = choose(60.0, 70.0, 80.0, 100.0, doc="Speed limit [km/h].", weights=(1.0, 3.0, 3.0, 2.0))
    lane_m: float = between(2.75, 3.5, doc="Width of a lane [m] (RAL 2012: 3.00 m to 3.50 m, less on old roads).")
    sinuosity: float = between(0.2, 1.0, doc="Share of the road in bends.")
    roadside: str = choose(
        "open",
        "hedges",
        "barns",
        "hamlet",
        "wood",
        doc="What stands beside the road.",
        weights=(1.0, 2.0, 2.0, 1.0, 1.0),
    )
    spacing_m: float = between(120.0, 200.0, doc="Mean distance [m] of tracks.")
    keeps_sight: bool = choose(True, False, doc="Sight triangles at tracks are free.", weights=(3.0, 2.0))


def build_country_road(draft: NetworkDraft, parameters: CountryRoadParameters, rng: random.Random) -> None:
    """Fill a draft with a road in the country."""
    stations, station = list[float](), rng.uniform(*END_M)
    for _ in range(parameters.tracks):
        stations.append(station)
        station += parameters.spacing_m * rng.uniform(0.8, 1.2)
    length = (stations[-1] if stations else 2.0 * parameters.spacing_m) + rng.uniform(*END_M)
    bends = draw_bends(rng, length, parameters.limit_kmh, parameters.sinuosity, (15.0, 55.0))
    axis = trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), bends)
    half = HalfSection(1, parameters.lane_m)
    joints = tuple(_draw_junction(axis, k, station, rng) for k, station in enumerate(stations, 1))
    spine = build_spine(draft, SpinePlan(axis, StreetSection(half, half), joints, parameters.limit_kmh / 3.6))
    roadside = Roadside(draft)
    if parameters.keeps_sight:
        roadside.clear += list_sight_triangles(spine, parameters.limit_kmh)
    _furnish(roadside, spine, parameters.roadside, rng)


def _draw_junction(axis: Polyline, k: int, station: float, rng: random.Random) -> Joint:
    sides = (1, -1) if rng.random() < 0.3 else (rng.choice((1, -1)),)
    is_stop = rng.random() < 0.25
    arms: list[SideArm] = []
    for side in sides:
        heading = compute_arm_heading(axis, station, side, math.radians(rng.uniform(-10.0, 10.0)))
        pieces = ((22.0, 0.0), *draw_bends(rng, rng.uniform(40.0, 75.0), TRACK_KMH, rng.choice((0.0, 0.6))))
        name, sign = f"{'left' if side > 0 else 'right'}_{k}", "stop" if is_stop else "yield"
        arms.append(SideArm(name, heading, pieces, HalfSection(1, TRACK_LANE_M), TRACK_KMH / 3.6, sign))
    type_ = "priority_stop" if is_stop else "priority"
    return Joint(f"junction_{k}", station, type_, rng.uniform(9.0, 11.0), tuple(arms))


def _furnish(roadside: Roadside, spine: Spine, style: str, rng: random.Random) -> None:
    """Add barns and houses at the junctions and hedges, a wood or single farms along the road."""
    kerbs = [find_kerb(edge) for edge in roadside.draft.edges]
    if style == "barns":
        for kerb in kerbs:
            _add_barns(roadside, kerb, rng)
    for kerb in kerbs:
        if style == "hedges":
            roadside.add_hedges(kerb, rng)
        elif style == "wood":
            roadside.add_strip("wood", kerb, rng.uniform(4.0, 7.0), 8.0, 15.0)
        elif style == "hamlet":
            roadside.add_house_row(kerb, HAMLET, rng)
    for edge in spine.list_main_edges():
        roadside.add_house_row(find_kerb(edge), FARMS, rng)


def _add_barns(roadside: Roadside, kerb: Polyline, rng: random.Random) -> None:
    """Add barns near both ends of a road, where it meets others."""
    for at_end in (False, True):
        length, depth = rng.uniform(*BARN_M[0]), rng.uniform(*BARN_M[1])
        away = rng.uniform(6.0, 14.0)
        station = kerb.length - away - length if at_end else away
        if rng.random() < 0.7 and 0.0 < station < kerb.length - length:
            roadside.add("barn", build_block(kerb, station, length, rng.uniform(2.0, 5.0), depth), 1.5)


COUNTRY_ROAD = PlaceKind(
    "country_road",
    "a road in the country with bends and farm tracks between hedges, barns or houses",
    CountryRoadParameters,
    build_country_road,
)
