"""Kind of place: a street of a town with side streets, parked rows, crossings for pedestrians and bus stops."""

import math
import random
from dataclasses import dataclass
from itertools import pairwise

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import draw_bends, trace_axis
from mdrive_sumo.worlds.places.frontage import Roadside, build_box, find_kerb, list_sight_triangles
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_parking import (
    BUS_STOP_M,
    CYCLE_M,
    add_bus_stop,
    add_parking,
    add_tree,
    close_ends,
    pave_cycle_lane,
)
from mdrive_sumo.worlds.places.street_spine import (
    HalfSection,
    Joint,
    SideArm,
    Spine,
    SpinePlan,
    StreetSection,
    build_spine,
    compute_arm_heading,
    list_signal_arguments,
)

FRONTAGES = {
    "terraces": HouseRows((0.5, 1.5), (0.5, 5.0), (10.0, 24.0), (9.0, 14.0)),
    "villas": HouseRows((3.0, 7.0), (5.0, 14.0), (9.0, 16.0), (8.0, 13.0)),
    "blocks": HouseRows((5.0, 12.0), (8.0, 25.0), (18.0, 45.0), (11.0, 15.0), 0.85),
}
"""Rows of houses by style; distances chosen by what German towns of 1900, 1930 and 1970 look like."""
PARKING_M = 2.1
"""[m] Width of a parking lane (RASt 06, table 22: 2.00 m to 2.30 m)."""
END_M = (60.0, 90.0)
"""[m] Range of the street before its first and after its last junction; chosen: cars reach the limit in it."""
STOP_BEHIND_M = 28.0
"""[m] From the centre of a junction to that of the bus stop behind it; chosen."""
SHELTER_M = (4.0, 1.5)
"""[m] Length and depth of a shelter; chosen."""


@dataclass(frozen=True)
class CorridorParameters:
    """Parameters of a corridor."""

    junctions: int = choose(0, 1, 2, 3, 4, 5, doc="Side streets or crossings on the way.", weights=(0, 0, 3, 4, 2, 1))
    lanes: int = choose(1, 2, doc="Lanes for cars in each direction.", weights=(3.0, 2.0))
    limit_kmh: float = choose(30.0, 50.0, doc="Speed limit [km/h].", weights=(1.0, 3.0))
    lane_m: float = between(2.8, 3.5, doc="Width of a lane [m] (RASt 06: 2.75 m to 3.50 m).")
    pavement_m: float = between(2.0, 3.5, doc="Width of a pavement [m] (RASt 06: 2.50 m).")
    parking: str = choose("none", "one_side", "both_sides", doc="Parking lanes.", weights=(2.0, 2.0, 4.0))
    has_cycle_lanes: bool = choose(False, True, doc="Cycle lanes between cars and pavement.", weights=(2.0, 1.0))
    signals: str = choose("none", "some", "all", doc="Junctions with signals.", weights=(3.0, 5.0, 2.0))
    zebras: int = choose(
        0,
        1,
        2,
        doc="Zebra crossings between junctions; with two lanes, signals.",
        weights=(2.0, 3.0, 1.0),
    )
    has_bus_stops: bool = choose(False, True, doc="A bus stop in each direction.")
    spacing_m: float = between(80.0, 130.0, doc="Mean distance [m] of junctions.")
    sinuosity: float = between(0.0, 0.7, doc="Share of the street in bends.")
    frontage: str = choose(*FRONTAGES, doc="Houses: terraces at the pavement, villas, or blocks that stand back.")
    keeps_sight: bool = choose(True, False, doc="Sight triangles are free; if not: an old town.", weights=(9.0, 1.0))


def build_corridor(draft: NetworkDraft, parameters: CorridorParameters, rng: random.Random) -> None:
    """Fill a draft with a corridor."""
    stations, length = _draw_stations(parameters, rng)
    bends = draw_bends(rng, length, max(parameters.limit_kmh, 50.0), parameters.sinuosity, (5.0, 25.0))
    axis = trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), bends)
    joints = _draw_joints(parameters, axis, stations, rng)
    plan = SpinePlan(axis, _build_section(parameters), tuple(joints), parameters.limit_kmh / 3.6)
    spine = build_spine(draft, plan)
    draft.netconvert = (*list_signal_arguments(rng.choice((60, 70, 80, 90))), "--walkingareas", "true")
    roadside = Roadside(draft)
    if parameters.keeps_sight:
        roadside.clear += list_sight_triangles(spine, parameters.limit_kmh)
    _furnish_kerbs(roadside, spine, parameters, rng)
    rows = FRONTAGES[parameters.frontage]
    for edge in draft.edges:
        roadside.add_house_row(find_kerb(edge), rows, rng)


def _draw_stations(parameters: CorridorParameters, rng: random.Random) -> tuple[list[float], float]:
    """Return the stations [m] of the junctions and the length of the street."""
    station, stations = rng.uniform(*END_M), list[float]()
    for _ in range(parameters.junctions):
        stations.append(station)
        station += parameters.spacing_m * rng.uniform(0.85, 1.15)
    end = stations[-1] if stations else station + parameters.spacing_m
    return stations, end + rng.uniform(*END_M)


def _build_section(parameters: CorridorParameters) -> StreetSection:
    halves = [
        HalfSection(
            parameters.lanes,
            parameters.lane_m,
            CYCLE_M * parameters.has_cycle_lanes,
            PARKING_M * has_parking,
            parameters.pavement_m,
        )
        for has_parking in (parameters.parking != "none", parameters.parking == "both_sides")
    ]
    return StreetSection(halves[0], halves[1])


def _draw_joints(
    parameters: CorridorParameters, axis: Polyline, stations: list[float], rng: random.Random
) -> list[Joint]:
    """Return the junctions and the zebra crossings halfway between some of them."""
    joints = [_draw_junction(parameters, axis, k, station, rng) for k, station in enumerate(stations, 1)]
    middles = [(a + b) / 2 for a, b in pairwise(stations)] or [axis.length / 2]
    type_ = "priority" if parameters.lanes == 1 else "traffic_light"  # R-FGÜ 2001: no zebra crossing over two lanes
    for k, middle in enumerate(rng.sample(middles, min(parameters.zebras, len(middles))), 1):
        if all(abs(middle - station) > 25.0 for station in stations):
            joints.append(Joint(f"zebra_{k}", middle + rng.uniform(-6.0, 6.0), type_, 1.5, zebras=("before",)))
    return sorted(joints, key=lambda joint: joint.station)


def _draw_junction(parameters: CorridorParameters, axis: Polyline, k: int, station: float, rng: random.Random) -> Joint:
    has_signals = parameters.signals == "all" or (parameters.signals == "some" and rng.random() < 0.5)
    is_crossing = has_signals or (parameters.lanes == 1 and rng.random() < 0.35)  # four lanes are crossed with signals
    sides = (1, -1) if is_crossing else (rng.choice((1, -1)),)
    type_, sign = _draw_control(parameters, has_signals, rng)
    arms: list[SideArm] = []
    for side in sides:
        heading = compute_arm_heading(axis, station, side, math.radians(rng.uniform(-12.0, 12.0)))
        pieces = [(25.0, 0.0), *draw_bends(rng, rng.uniform(40.0, 70.0), 30.0, rng.choice((0.0, 0.5)))]
        half = HalfSection(1, 3.0, pavement_m=2.0)
        priority = 6 if type_ == "right_before_left" else 2
        arms.append(
            SideArm(f"{'left' if side > 0 else 'right'}_{k}", heading, tuple(pieces), half, 30 / 3.6, sign, priority)
        )
    names = [arm.id for arm in arms]
    with_zebra = () if type_ == "right_before_left" else tuple(name for name in names if rng.random() < 0.4)
    zebras = ("before", "after", *names) if has_signals else with_zebra
    return Joint(f"junction_{k}", station, type_, rng.uniform(7.0, 8.5), tuple(arms), zebras)


def _draw_control(parameters: CorridorParameters, has_signals: bool, rng: random.Random) -> tuple[str, str]:
    """Return SUMO's type of a junction and the sign of its side streets."""
    if has_signals:
        return "traffic_light", ""
    if parameters.limit_kmh <= 30.0 and rng.random() < 0.6:
        return "right_before_left", ""
    return ("priority_stop", "stop") if rng.random() < 0.25 else ("priority", "yield")


def _furnish_kerbs(roadside: Roadside, spine: Spine, parameters: CorridorParameters, rng: random.Random) -> None:
    """Add bus stops, parked rows with trees between them, and the surface of cycle lanes."""
    draft = roadside.draft
    stops = _choose_bus_stops(spine, rng) if parameters.has_bus_stops else {}
    for edge in spine.list_main_edges():
        closures = close_ends(spine, edge)
        if edge.id in stops:
            closures.append(add_bus_stop(draft, edge, stops[edge.id]))
            kerb = find_kerb(edge)
            roadside.add("shelter", build_box(kerb, stops[edge.id], -1.2, *SHELTER_M), 0.1)
        if any(lane.use == "park" for lane in edge.lanes):
            for station in add_parking(draft, edge, closures, (3, 7), rng):
                add_tree(draft, edge, station)
        pave_cycle_lane(draft, edge)


def _choose_bus_stops(spine: Spine, rng: random.Random) -> dict[str, float]:
    """Return the station [m] of a bus stop by edge: one in each direction, behind a junction."""
    stops: dict[str, float] = {}
    for edges in spine.edges.values():
        long = [edge for edge in edges if edge.line.length > STOP_BEHIND_M + BUS_STOP_M + 15.0]
        if long:
            stops[rng.choice(long).id] = STOP_BEHIND_M
    return stops


CORRIDOR = PlaceKind(
    "corridor",
    "a street of a town with side streets, signals or not, parked rows, zebra crossings and bus stops",
    CorridorParameters,
    build_corridor,
)
