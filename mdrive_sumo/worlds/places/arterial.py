"""Kind of place: an arterial road with a median, lanes for left turns and signals."""

import math
import random
from dataclasses import dataclass
from itertools import pairwise

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import buffer_line, cut_line, draw_bends, trace_axis
from mdrive_sumo.worlds.places.frontage import Roadside, build_box, find_kerb
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_houses import HouseRows
from mdrive_sumo.worlds.places.street_parking import CYCLE_M, TREE_M, add_bus_stop, pave_cycle_lane
from mdrive_sumo.worlds.places.street_spine import (
    BACKWARD,
    FORWARD,
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
    "blocks": HouseRows((6.0, 14.0), (8.0, 30.0), (18.0, 50.0), (11.0, 16.0), 0.9),
    "halls": HouseRows((12.0, 25.0), (15.0, 60.0), (30.0, 70.0), (20.0, 40.0), 0.7),
    "avenue": HouseRows((2.0, 5.0), (1.0, 8.0), (14.0, 30.0), (11.0, 15.0)),
}
"""Rows of houses by style; distances chosen by what main roads of 1970, 1990 and 1900 look like."""
END_M = (110.0, 150.0)
"""[m] Range of the road before its first and after its last junction; chosen: a turn lane and 60 m before it."""
PLANTED_FROM_M = 12.0
"""[m] From the end of a turn lane to the first tree; chosen."""
TREE_EVERY_M, HEDGE_M = 14.0, 1.2
"""[m] Between trees of the median, and width of a hedge; chosen."""
STOP_BEHIND_M = 40.0
"""[m] From the centre of a junction to that of the bus stop behind it; chosen."""


@dataclass(frozen=True)
class ArterialParameters:
    """Parameters of an arterial road."""

    junctions: int = choose(0, 1, 2, 3, doc="Junctions with signals.", weights=(0, 3, 4, 2))
    lanes: int = choose(2, 3, doc="Lanes for cars in each direction.", weights=(3.0, 1.0))
    limit_kmh: float = choose(50.0, 60.0, 70.0, doc="Speed limit [km/h].", weights=(3.0, 2.0, 2.0))
    lane_m: float = between(3.0, 3.5, doc="Width of a lane [m] (RASt 06: 3.00 m to 3.50 m).")
    median_m: float = between(5.5, 8.0, doc="Width of the median [m]: a turn lane and 1.5 m or more.")
    turn_lane_m: float = between(35.0, 60.0, doc="Length of lanes for left turns [m] (RASt 06: 20 m or more queue).")
    median: str = choose("grass", "trees", "hedge", doc="What grows on the median.")
    has_cycle_lanes: bool = choose(False, True, doc="Cycle lanes between cars and pavement.")
    has_bus_stops: bool = choose(False, True, doc="A bus stop in each direction.")
    side_lanes: int = choose(1, 2, doc="Lanes of side streets in each direction.", weights=(2.0, 1.0))
    spacing_m: float = between(170.0, 240.0, doc="Mean distance [m] of junctions.")
    sinuosity: float = between(0.0, 0.6, doc="Share of the road in bends.")
    frontage: str = choose(*FRONTAGES, doc="Houses: blocks or halls that stand back, or an avenue of closed fronts.")


def build_arterial(draft: NetworkDraft, parameters: ArterialParameters, rng: random.Random) -> None:
    """Fill a draft with an arterial road."""
    stations = _draw_stations(parameters, rng)
    length = (stations[-1] if stations else parameters.spacing_m) + rng.uniform(*END_M)
    bends = draw_bends(rng, length, parameters.limit_kmh, parameters.sinuosity, (5.0, 20.0))
    axis = trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), bends)
    cycle_m = CYCLE_M * parameters.has_cycle_lanes
    half = HalfSection(parameters.lanes, parameters.lane_m, cycle_m, 0.0, 3.0)
    joints = tuple(_draw_junction(parameters, axis, k, station, rng) for k, station in enumerate(stations, 1))
    plan = SpinePlan(axis, StreetSection(half, half, parameters.median_m), joints, parameters.limit_kmh / 3.6)
    spine = build_spine(draft, plan)
    draft.netconvert = (*list_signal_arguments(rng.choice((70, 80, 90))), "--walkingareas", "true")
    roadside = Roadside(draft)
    _add_bus_stops(roadside, spine, parameters, rng)
    _plant_median(draft, spine, parameters)
    for edge in draft.edges:
        pave_cycle_lane(draft, edge)
        roadside.add_house_row(find_kerb(edge), FRONTAGES[parameters.frontage], rng)


def _draw_stations(parameters: ArterialParameters, rng: random.Random) -> list[float]:
    stations, station = list[float](), rng.uniform(*END_M)
    for _ in range(parameters.junctions):
        stations.append(station)
        station += parameters.spacing_m * rng.uniform(0.9, 1.1)
    return stations


def _draw_junction(parameters: ArterialParameters, axis: Polyline, k: int, station: float, rng: random.Random) -> Joint:
    sides = (1, -1) if rng.random() < 0.75 else (rng.choice((1, -1)),)
    arms: list[SideArm] = []
    for side in sides:
        heading = compute_arm_heading(axis, station, side, math.radians(rng.uniform(-8.0, 8.0)))
        pieces = ((35.0, 0.0), *draw_bends(rng, rng.uniform(50.0, 70.0), 50.0, rng.choice((0.0, 0.4))))
        half = HalfSection(parameters.side_lanes, 3.25, pavement_m=2.5)
        arms.append(SideArm(f"{'left' if side > 0 else 'right'}_{k}", heading, pieces, half, 50 / 3.6))
    zebras = ("before", "after", *(arm.id for arm in arms))
    turns = tuple(direction for direction, side in ((FORWARD, 1), (BACKWARD, -1)) if side in sides)
    radius = rng.uniform(8.0, 11.0)
    return Joint(f"junction_{k}", station, "traffic_light", radius, tuple(arms), zebras, turns, parameters.turn_lane_m)


def _add_bus_stops(roadside: Roadside, spine: Spine, parameters: ArterialParameters, rng: random.Random) -> None:
    """Add a bus stop with its shelter behind a junction in each direction."""
    for edges in spine.edges.values() if parameters.has_bus_stops else ():
        behind = [edge for edge in edges if edge.begin.startswith("junction") and edge.line.length > 2 * STOP_BEHIND_M]
        if behind:
            edge = rng.choice(behind)
            add_bus_stop(roadside.draft, edge, STOP_BEHIND_M)
            roadside.add("shelter", build_box(find_kerb(edge), STOP_BEHIND_M, -1.2, 4.0, 1.5), 0.1)


def _plant_median(draft: NetworkDraft, spine: Spine, parameters: ArterialParameters) -> None:
    """Add trees or a hedge in the middle of the median where it has its whole width."""
    axis, margin = spine.plan.axis, parameters.turn_lane_m + PLANTED_FROM_M
    marks = [-margin, *(joint.station for joint in spine.plan.joints), axis.length + margin]
    for before, after in pairwise(marks):
        begin, end = before + margin, after - margin
        if parameters.median == "trees":
            for k in range(int((end - begin) / TREE_EVERY_M) + 1 if end > begin else 0):
                draft.obstacles.append(("tree", build_box(axis, begin + k * TREE_EVERY_M, 0.0, TREE_M, TREE_M)))
        elif parameters.median == "hedge" and end - begin > 6.0:
            part = cut_line(axis, begin, end)
            draft.obstacles.append(("hedge", buffer_line(part, HEDGE_M / 2, HEDGE_M / 2)))


ARTERIAL = PlaceKind(
    "arterial",
    "an arterial road with a median, lanes for left turns and junctions with signals",
    ArterialParameters,
    build_arterial,
)
