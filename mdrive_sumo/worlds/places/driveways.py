"""Kinds of places: a street with a car park, and a street with driveways."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads.network_file import ParkingRow
from mdrive_sumo.worlds.places.building_rows import add_surroundings
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.sight_triangles import Approach, build_sight_triangles
from mdrive_sumo.worlds.places.street_lines import Piece
from mdrive_sumo.worlds.places.streets import SideStreet, StreetPlan, build_street
from mdrive_sumo.worlds.places.surroundings import SURROUNDINGS

STALL_M = (5.0, 2.5)
"""[m] Length and width of a stall at right angles to its aisle (EAR 05, table 4.2-2)."""
AISLE_M = 6.5
"""[m] Width of an aisle for both directions; EAR 05 has 6.0 m or more."""
AISLE_SPACING_M = AISLE_M + 2 * STALL_M[0] + 8.0
"""[m] With a planted strip between two rows, which leaves room for the curves of cars at the end of an aisle."""
AISLE_SPEED, DRIVEWAY_SPEED = 2.78, 2.78
"""[m/s] Walking speed to 10 km/h, as on car parks."""
LOT_TYPE = "right_before_left"
"""SUMO's junction type on car parks, where no signs stand."""
CORNER_M = 8.5
"""[m] Radius in which the distributor road turns into the last aisle: its inner lane has 6.9 m."""
FIRST_STALL_M = 10.0
"""[m] From the middle of a distributor road to the first stall of an aisle."""
STORE_DEPTH_M = 22.0
"""[m] Depth of the store beside a car park; chosen."""
GATE_M = 34.0
"""[m] From the middle of the street to the car park: room for two cars that wait, behind the pavement."""
DRIVEWAY_M = 20.0
"""[m] From the middle of the street to the yard at the end of a driveway."""
YARD_M = 8.0
"""[m] Length of the yard at the end of a driveway: room for a car and a door; chosen."""
GATE_RADIUS_M, DRIVEWAY_RADIUS_M, LOT_RADIUS_M = 6.5, 5.5, 6.5
"""[m] Of corners at the kerb, outside of pavements; lanes turn 3 to 4 m farther out."""
STREET_M = (75.0, 95.0)
"""[m] Length of the street before its first and after its last junction."""


@dataclass(frozen=True)
class CarParkParameters:
    """Parameters of a street with a car park."""

    area: str = choose("town", "suburb", "commercial", doc="Kind of neighbourhood.", weights=(1.0, 1.0, 2.0))
    speed_kmh: int = choose(30, 50, doc="Speed limit of the street [km/h].", weights=(1.0, 3.0))
    lanes: int = choose(1, 2, doc="Lanes each way of the street.", weights=(3.0, 1.0))
    aisles: int = choose(1, 2, 3, doc="Aisles of the car park.")
    stalls: int = choose(8, 10, 12, 14, 16, doc="Stalls on each side of an aisle.")
    store: bool = choose(True, False, doc="Whether a store stands behind the car park.", weights=(3.0, 1.0))
    bend: float = between(0.0, 1.0, doc="How much the street bends: 1 is a radius of 120 m.")


@dataclass(frozen=True)
class DrivewaysParameters:
    """Parameters of a street with driveways."""

    area: str = choose("town", "suburb", doc="Kind of neighbourhood.", weights=(1.0, 2.0))
    speed_kmh: int = choose(30, 50, doc="Speed limit of the street [km/h].", weights=(2.0, 1.0))
    driveways: int = choose(2, 3, 4, 5, doc="Driveways that join the street.")
    spacing_m: float = between(28.0, 42.0, doc="Distance between two driveways [m].")
    bend: float = between(0.0, 1.0, doc="How much the street bends: 1 is a radius of 120 m.")


def build_car_park(draft: NetworkDraft, parameters: CarParkParameters, rng: random.Random) -> None:
    """Fill a draft with a street and a car park beside it."""
    surroundings = SURROUNDINGS[parameters.area]
    draft.lane_m = AISLE_M / 2
    draft.description = (
        f"a street {surroundings.words}, {parameters.speed_kmh} km/h, with the way out of a car park of"
        f" {2 * parameters.aisles * parameters.stalls} stalls"
    )
    side = rng.choice((1, -1))
    plan = StreetPlan(
        tuple(_draw_section(rng, rng.uniform(*STREET_M), parameters.bend) for _ in range(2)),
        (SideStreet(side, type="priority", length_m=GATE_M, speed=DRIVEWAY_SPEED, radius=GATE_RADIUS_M),),
        parameters.lanes,
        round(parameters.speed_kmh / 3.6, 2),
        surroundings.pavement_m,
        bend=0.0,
    )
    build_street(draft, plan, rng, math.radians(rng.uniform(0.0, 360.0)))
    gate = next(street for street in draft.streets if not street.id.startswith("main"))
    draft.yields.append(gate.edge_ids[0])
    sight = _build_sight(draft)
    blocks = _add_aisles(draft, gate, parameters, rng)
    add_surroundings(draft, surroundings, [*sight, *blocks], rng)


def build_driveways(draft: NetworkDraft, parameters: DrivewaysParameters, rng: random.Random) -> None:
    """Fill a draft with a street and driveways that join it."""
    surroundings = SURROUNDINGS[parameters.area]
    draft.lane_m = surroundings.lane_m
    draft.description = (
        f"a street {surroundings.words}, {parameters.speed_kmh} km/h, with {parameters.driveways} driveways"
    )
    lengths = [rng.uniform(*STREET_M), *[parameters.spacing_m] * (parameters.driveways - 1), rng.uniform(*STREET_M)]
    sides = [rng.choice((1, -1)) for _ in range(parameters.driveways)]
    plan = StreetPlan(
        tuple(_draw_section(rng, length, parameters.bend) for length in lengths),
        tuple(
            SideStreet(side, type="priority", length_m=DRIVEWAY_M, speed=DRIVEWAY_SPEED, radius=DRIVEWAY_RADIUS_M)
            for side in sides
        ),
        1,
        round(parameters.speed_kmh / 3.6, 2),
        surroundings.pavement_m,
        bend=0.0,
    )
    build_street(draft, plan, rng, math.radians(rng.uniform(0.0, 360.0)))
    ways = [street for street in draft.streets if not street.id.startswith("main")]
    draft.yields += [street.edge_ids[0] for street in ways]
    for street in ways:
        _add_yard(draft, street)
    add_surroundings(draft, surroundings, _build_sight(draft), rng)


def _draw_section(rng: random.Random, length_m: float, bend: float) -> tuple[Piece, ...]:
    """Return a straight section or one with a bend in its middle."""
    radius_m = rng.choice((-1.0, 1.0)) * 120.0 / max(bend, 0.1)
    if bend < 0.1 or length_m < 50.0:
        return ((length_m, 0.0),)
    return ((length_m * 0.35, 0.0), (length_m * 0.35, radius_m), (length_m * 0.3, 0.0))


def _get_frame(street: Street) -> tuple[Float, Float, Float]:
    """Return the outer end [m] of a way into a property, the direction away from the street, and that to its left."""
    end, before = street.line[0], street.line[1]
    ahead = end - before
    ahead = ahead / portable.hypot(float(ahead[0]), float(ahead[1]))
    return end, ahead, np.array((-ahead[1], ahead[0]))


def _add_aisles(
    draft: NetworkDraft, gate: Street, parameters: CarParkParameters, rng: random.Random
) -> list[BaseGeometry]:
    """Add distributor road, aisles, stalls and store; return what the store takes."""
    end, ahead, left = _get_frame(gate)
    first = -rng.randrange(parameters.aisles)
    draft.nodes = [
        replace(node, type=LOT_TYPE, radius=LOT_RADIUS_M) if node.id == gate.begin else node for node in draft.nodes
    ]
    length_m = FIRST_STALL_M + parameters.stalls * STALL_M[1] + 1.0
    last = first + parameters.aisles - 1
    nodes = {k: gate.begin if k == 0 else f"lot{k - first + 1}" for k in range(first, last + 1)}
    for k in nodes:
        name = f"aisle{k - first + 1}"
        begin = end + k * AISLE_SPACING_M * left
        tip = begin + length_m * ahead
        draft.nodes.append(Node(name, float(tip[0]), float(tip[1])))
        _add_stalls(draft, (begin, ahead, left), name, parameters.stalls)
        inward = (k < 0) - (k > 0)
        before = end + (k + inward) * AISLE_SPACING_M * left
        if k not in (first, last) or k == 0:  # the aisle begins at a junction
            _add_aisle(draft, name, (nodes[k], name), np.array((begin, tip)))
            if k != 0:
                draft.nodes.append(Node(nodes[k], float(begin[0]), float(begin[1]), LOT_TYPE, LOT_RADIUS_M))
                _add_aisle(draft, nodes[k], (nodes[k + inward], nodes[k]), np.array((before, begin)))
        else:  # the distributor road turns into it
            corner = [
                begin + CORNER_M * ((1.0 - cos) * ahead + inward * (1.0 - sin) * left)
                for cos, sin in (portable.cos_sin(step * math.pi / 10) for step in range(6))
            ]
            _add_aisle(draft, name, (nodes[k + inward], name), np.array((before, *corner, tip)))
    low, high = ((first + part) * AISLE_SPACING_M for part in (-0.5, parameters.aisles - 0.5))
    draft.paved_areas.append(_build_rectangle(end, ahead, left, (-AISLE_M / 2 - 1.0, length_m), (low, high)))
    if not parameters.store:
        return []
    store = _build_rectangle(end, ahead, left, (length_m + 3.0, length_m + 3.0 + STORE_DEPTH_M), (low, high))
    draft.buildings.append(store)
    return [shapely.Polygon(store)]


def _add_aisle(draft: NetworkDraft, name: str, ends: tuple[str, str], line: Float) -> None:
    draft.streets.append(Street(name, *ends, line, (1, 1), AISLE_SPEED, 1))


def _add_stalls(draft: NetworkDraft, frame: tuple[Float, Float, Float], name: str, count: int) -> None:
    """Add stalls on both sides of an aisle; cars stand with their front to the outside."""
    begin, ahead, left = frame
    for side, word in ((1, "left"), (-1, "right")):
        for i in range(count):
            at = begin + (FIRST_STALL_M + (i + 0.5) * STALL_M[1]) * ahead
            ends = (at + side * (AISLE_M / 2 + reach) * left for reach in (0.0, STALL_M[0]))
            line = tuple((round(float(x), 1), round(float(y), 1)) for x, y in ends)
            draft.parking.append(ParkingRow(id=f"{name}_{word}_{i + 1}", line=line, width_m=STALL_M[1]))


def _add_yard(draft: NetworkDraft, street: Street) -> None:
    """Add the paved yard at the end of a driveway, with room for a parked car."""
    end, ahead, left = _get_frame(street)
    draft.paved_areas.append(_build_rectangle(end, ahead, left, (-1.0, YARD_M), (-YARD_M / 2 - 1.0, YARD_M / 2 + 1.0)))
    ends = (end + (YARD_M / 2 + reach) * ahead + 2.5 * left for reach in (-STALL_M[0] / 2, STALL_M[0] / 2))
    line = tuple((round(float(x), 1), round(float(y), 1)) for x, y in ends)
    draft.parking.append(ParkingRow(id=f"{street.id}_yard", line=line, width_m=STALL_M[1]))


def _build_rectangle(
    origin: Float, ahead: Float, left: Float, along: tuple[float, float], across: tuple[float, float]
) -> Float:
    corners = ((along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1]))
    return np.array([origin + a * ahead + b * left for a, b in corners])


def _build_sight(draft: NetworkDraft) -> Sequence[BaseGeometry]:
    """Return the sight triangles where ways out of properties meet the street."""
    areas: list[BaseGeometry] = []
    for node in (node for node in draft.nodes if node.type):
        approaches: list[Approach] = []
        for street in draft.streets:
            if node.id in (street.begin, street.end):
                line = street.line if street.begin == node.id else street.line[::-1]
                gives_way = street.edge_ids[0] in draft.yields
                approaches.append(Approach(line, street.lanes, draft.lane_m, street.speed, not gives_way, gives_way))
        areas += build_sight_triangles(approaches)
    return areas


CAR_PARK = PlaceKind("car_park", "a street with a car park beside it", CarParkParameters, build_car_park)
DRIVEWAYS = PlaceKind("driveways", "a street that driveways join", DrivewaysParameters, build_driveways)
