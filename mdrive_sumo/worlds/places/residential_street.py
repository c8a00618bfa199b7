"""Kind of place: a residential street with driveways, front gardens and parked vehicles."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads.network_file import ParkingRow
from mdrive_sumo.worlds.places.alignment import buffer_line, cut_line, draw_bends, find_point, trace_axis
from mdrive_sumo.worlds.places.draft_edge import DraftEdge
from mdrive_sumo.worlds.places.frontage import Roadside, find_kerb
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_parking import DRIVEWAY, Closure, add_parking, add_tree, close_ends
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

HOUSES = {
    "detached": HouseRows((4.0, 7.0), (4.0, 9.0), (9.0, 14.0), (9.0, 13.0)),
    "rows": HouseRows((3.0, 4.5), (0.5, 4.0), (18.0, 40.0), (9.0, 11.0)),
    "blocks": HouseRows((6.0, 10.0), (10.0, 22.0), (25.0, 50.0), (11.0, 13.0)),
}
"""Rows of houses by style; distances chosen by German residential streets."""
PARKING_M = 2.0
"""[m] Width of a parking lane (RASt 06, table 22)."""
END_M = (60.0, 85.0)
"""[m] Range of the street before its first and after its last junction; chosen: cars reach the limit in it."""
PLOT_M = (15.0, 26.0)
"""[m] Range of the distance of two driveways on the same side; chosen: widths of plots."""
DRIVEWAY_LANE_M = 2.5
"""[m] Half of a driveway to a double garage or a yard."""
DRIVEWAY_KMH = 10.0
"""[km/h] Walking speed to 10 km/h, as on car parks."""
JOINT_GAP_M = 34.0
"""[m] Least distance of a driveway from the next junction or driveway that is connected."""
STALL_M = (2.8, 5.5)
"""[m] Width and length of a stall in a front garden (EAR 2005: 2.50 m by 5.00 m, and room to open doors)."""
HEDGE_M = 0.7
"""[m] Width of a garden hedge; chosen (0.5 m to 1 m)."""


@dataclass(frozen=True)
class ResidentialStreetParameters:
    """Parameters of a residential street."""

    junctions: int = choose(0, 1, 2, doc="Side streets, with priority to the right.", weights=(2.0, 3.0, 2.0))
    limit_kmh: float = choose(20.0, 30.0, doc="Speed limit [km/h].", weights=(1.0, 4.0))
    lane_m: float = between(2.5, 3.0, doc="Width of a lane [m] (RASt 06: 4.50 m to 5.50 m for both).")
    pavement_m: float = between(1.5, 2.5, doc="Width of a pavement [m].")
    parking: str = choose("none", "one_side", "both_sides", doc="Parking lanes.", weights=(1.0, 3.0, 2.0))
    yards: int = choose(0, 1, 2, 3, 4, doc="Driveways of which the network knows.", weights=(1.0, 2.0, 3.0, 2.0, 1.0))
    stall_share: float = between(0.2, 0.8, doc="Share of plots with a stall in front of the house.")
    gardens: str = choose("open", "hedges", "walls", doc="What stands between garden and pavement.")
    spacing_m: float = between(90.0, 130.0, doc="Mean distance [m] of side streets.")
    sinuosity: float = between(0.0, 0.8, doc="Share of the street in bends.")
    houses: str = choose(*HOUSES, doc="Houses: detached ones, rows or blocks of flats.", weights=(3.0, 2.0, 1.0))


def build_residential_street(draft: NetworkDraft, parameters: ResidentialStreetParameters, rng: random.Random) -> None:
    """Fill a draft with a residential street."""
    streets, station = list[float](), rng.uniform(*END_M)
    for _ in range(parameters.junctions):
        streets.append(station)
        station += parameters.spacing_m * rng.uniform(0.9, 1.1)
    length = (streets[-1] if streets else parameters.spacing_m) + rng.uniform(*END_M)
    bends = draw_bends(rng, length, 40.0, parameters.sinuosity, (8.0, 35.0))
    axis = trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), bends)
    joints = [_draw_junction(parameters, axis, k, station, rng) for k, station in enumerate(streets, 1)]
    joints += _draw_yards(parameters, axis, streets, rng)
    halves = [
        HalfSection(1, parameters.lane_m, 0.0, PARKING_M * has_parking, parameters.pavement_m)
        for has_parking in (parameters.parking != "none", parameters.parking == "both_sides")
    ]
    ordered = tuple(sorted(joints, key=lambda joint: joint.station))
    spine = build_spine(
        draft, SpinePlan(axis, StreetSection(halves[0], halves[1]), ordered, parameters.limit_kmh / 3.6, 3)
    )
    draft.netconvert = ("--walkingareas", "true")
    roadside = Roadside(draft)
    _furnish(roadside, spine, parameters, rng)


def _draw_junction(
    parameters: ResidentialStreetParameters, axis: Polyline, k: int, station: float, rng: random.Random
) -> Joint:
    sides = (1, -1) if rng.random() < 0.4 else (rng.choice((1, -1)),)
    arms: list[SideArm] = []
    for side in sides:
        heading = compute_arm_heading(axis, station, side, math.radians(rng.uniform(-8.0, 8.0)))
        pieces = ((22.0, 0.0), *draw_bends(rng, rng.uniform(35.0, 55.0), 30.0, rng.choice((0.0, 0.5))))
        half = HalfSection(1, parameters.lane_m, pavement_m=parameters.pavement_m)
        name = f"{'left' if side > 0 else 'right'}_{k}"
        arms.append(SideArm(name, heading, pieces, half, parameters.limit_kmh / 3.6, priority=3))
    return Joint(f"junction_{k}", station, "right_before_left", rng.uniform(8.0, 9.0), tuple(arms))


def _draw_yards(
    parameters: ResidentialStreetParameters, axis: Polyline, streets: Sequence[float], rng: random.Random
) -> list[Joint]:
    """Return the driveways that are part of the network, where there is room for them."""
    taken, joints = [0.0, *streets, axis.length], list[Joint]()
    for _ in range(30):
        if len(joints) == parameters.yards:
            break
        station, side = rng.uniform(JOINT_GAP_M, axis.length - JOINT_GAP_M), rng.choice((1, -1))
        if any(abs(station - other) < JOINT_GAP_M for other in taken):
            continue
        taken.append(station)
        k = len(joints) + 1
        heading = compute_arm_heading(axis, station, side, math.radians(rng.uniform(-2.0, 2.0)))
        half = HalfSection(1, DRIVEWAY_LANE_M)
        pieces = ((rng.uniform(20.0, 28.0), 0.0),)
        arm = SideArm(f"yard_{k}", heading, pieces, half, DRIVEWAY_KMH / 3.6, priority=1)
        joints.append(Joint(f"{DRIVEWAY}_{k}", station, "priority", 8.0, (arm,)))
    return joints


def _furnish(roadside: Roadside, spine: Spine, parameters: ResidentialStreetParameters, rng: random.Random) -> None:
    """Add stalls, parked rows, hedges or walls in front of gardens, and houses."""
    draft = roadside.draft
    for edge in spine.list_main_edges():
        closures = close_ends(spine, edge)
        closures += _add_stalls(roadside, edge, closures, parameters, rng)
        if any(lane.use == "park" for lane in edge.lanes):
            for station in add_parking(draft, edge, closures, (2, 5), rng):
                add_tree(draft, edge, station)
    for edge in draft.edges if parameters.gardens != "open" else ():
        if not edge.id.startswith("yard"):
            kind = "hedge" if parameters.gardens == "hedges" else "wall"
            roadside.add_strip(kind, find_kerb(edge), 0.4, HEDGE_M if kind == "hedge" else 0.3, 5.0)
    for edge in draft.edges:
        roadside.add_house_row(find_kerb(edge), HOUSES[parameters.houses], rng)


def _add_stalls(
    roadside: Roadside,
    edge: DraftEdge,
    closures: Sequence[Closure],
    parameters: ResidentialStreetParameters,
    rng: random.Random,
) -> list[Closure]:
    """Add stalls in front gardens beside an edge; return where parked rows leave them free."""
    driveways, kerb = list[Closure](), find_kerb(edge)
    walk_m = sum(lane.width_m for lane in edge.lanes if lane.use in {"walk", "park"})
    station = rng.uniform(4.0, PLOT_M[0])
    while station < kerb.length - 4.0:
        closure = Closure(station - STALL_M[0] / 2 - 0.3, station + STALL_M[0] / 2 + 0.3)
        is_clear = all(closure.end < other.begin or closure.begin > other.end for other in closures)
        if is_clear and rng.random() < parameters.stall_share:
            part = cut_line(kerb, station - STALL_M[0] / 2, station + STALL_M[0] / 2)
            area = shapely.Polygon(buffer_line(part, -0.2, STALL_M[1] + 0.3))
            if roadside.is_free(area, 0.1):
                roadside.clear.append(area)
                roadside.draft.paved_areas.append(buffer_line(part, walk_m, STALL_M[1] + 0.3))
                _add_stall_row(roadside.draft, kerb, station, is_nose_in=rng.random() < 0.7)
                driveways.append(closure)
        station += rng.uniform(*PLOT_M)
    return driveways


def _add_stall_row(draft: NetworkDraft, kerb: Polyline, station: float, *, is_nose_in: bool) -> None:
    ends = [find_point(kerb, station, -away) for away in (0.3, STALL_M[1])]
    line = np.round(np.array(ends if is_nose_in else ends[::-1]), 2).tolist()
    name = f"row_{len(draft.parking) + 1}"
    draft.parking.append(ParkingRow(id=name, line=tuple((x, y) for x, y in line), width_m=STALL_M[0] - 0.3))


RESIDENTIAL_STREET = PlaceKind(
    "residential_street",
    "a residential street with driveways, front gardens and parked rows; priority to the right",
    ResidentialStreetParameters,
    build_residential_street,
)
