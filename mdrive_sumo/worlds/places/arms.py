"""Arms of a junction: streets that end there, with left-turn lanes that open in front of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street
from mdrive_sumo.worlds.places.sight_triangles import Approach
from mdrive_sumo.worlds.places.street_lines import cut_line, measure_line, offset_line

TURN_LANE_M = 40.0
"""[m] Length of a left-turn lane up to the centre of the junction: room for four cars (chosen)."""
TAPER_M = 30.0
"""[m] Over which lanes move aside for a left-turn lane; RASt 06 has 20 to 30 m at 50 km/h."""
TAPER_STEP_M = 5.0
"""[m] Distance of points on a taper: steps of half a metre aside at 30 m of taper."""
THROUGH_RAD = math.radians(40.0)
"""Smaller changes of heading are ways straight on."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A street that ends at a junction."""

    name: str
    """Edges: NAME_in leads to the junction, NAME_out away from it, NAME_far to NAME_in where a turn lane opens."""
    line: Float
    """Points (N, 2) [m] from the junction's centre outwards."""
    lanes: int
    """In each direction, without a turn lane."""
    speed: float
    priority: int
    turn_lane: bool = False
    pavement_m: float = 0.0
    cycle_m: float = 0.0
    parking_m: float = 0.0
    far_node: str = ""
    """Id of the node at the other end; "": a new one, with the arm's name."""

    @property
    def first_car_lane(self) -> int:
        """Index of the rightmost lane for cars."""
        return (self.pavement_m > 0) + (self.cycle_m > 0) + (self.parking_m > 0)

    @property
    def lanes_in(self) -> int:
        """Lanes for cars at the junction, with the turn lane."""
        return self.lanes + self.turn_lane

    def build_approach(self, lane_m: float, *, has_priority: bool, gives_way: bool) -> Approach:
        """Return the arm as an approach for sight triangles."""
        return Approach(self.line, (self.lanes_in, self.lanes), lane_m, self.speed, has_priority, gives_way)


def add_arm(draft: NetworkDraft, node: str, arm: Arm) -> None:
    """Add the streets of an arm to a draft."""
    far_node = arm.far_node or arm.name
    if not arm.far_node:
        draft.nodes.append(Node(arm.name, float(arm.line[-1, 0]), float(arm.line[-1, 1])))
    if not arm.turn_lane:
        names = (f"{arm.name}_in", f"{arm.name}_out")
        draft.streets.append(
            _build_street(arm, arm.name, (far_node, node), arm.line[::-1], (arm.lanes, arm.lanes), names)
        )
        return
    opening = f"{arm.name}_opening"
    near = cut_line(arm.line, 0.0, measure_line(arm.line) - TURN_LANE_M)[::-1]
    far = _shift_aside(cut_line(arm.line, TURN_LANE_M, 0.0), draft.lane_m)[::-1]
    draft.nodes.append(Node(opening, float(far[-1, 0]), float(far[-1, 1]), "priority", 2.0))
    streets = (
        (f"{arm.name}_far", (far_node, opening), far, arm.lanes),
        (f"{arm.name}_in", (opening, node), near, arm.lanes + 1),
        (f"{arm.name}_out", (node, far_node), arm.line, arm.lanes),
    )
    for name, ends, line, lanes in streets:
        draft.streets.append(_build_street(arm, name, ends, line, (lanes, 0), (name, "")))
    first = arm.first_car_lane
    for lane in range(arm.lanes):
        draft.connections.append((f"{arm.name}_far", first + lane, f"{arm.name}_in", first + lane))
    last = first + arm.lanes
    draft.connections.append((f"{arm.name}_far", last - 1, f"{arm.name}_in", last))
    if arm.cycle_m:
        draft.connections.append((f"{arm.name}_far", first - 1, f"{arm.name}_in", first - 1))


def _build_street(
    arm: Arm, name: str, ends: tuple[str, str], line: Float, lanes: tuple[int, int], names: tuple[str, str]
) -> Street:
    return Street(
        name,
        *ends,
        line,
        lanes,
        arm.speed,
        arm.priority,
        arm.pavement_m,
        names=names,
        cycle_m=arm.cycle_m,
        parking_m=arm.parking_m,
    )


def _shift_aside(line: Float, width_m: float) -> Float:
    """Return a line that begins `width_m` to its left and comes back to itself over the taper.

    The line runs outwards: traffic into the junction, on its left, moves to its right, away from the middle.
    """
    whole = shapely.LineString(line)
    taper_m = min(TAPER_M, whole.length - 1.0)
    stations = np.arange(0.0, taper_m, TAPER_STEP_M)
    near = shapely.get_coordinates(whole.interpolate(stations))
    points = np.concatenate((near, cut_line(line, taper_m, 0.0)))
    share = np.concatenate((1.0 - stations / taper_m, np.zeros(len(points) - len(near))))
    smooth = share * share * (3.0 - 2.0 * share)
    return points + (offset_line(points, width_m) - points) * smooth[:, None]


def connect_arms(draft: NetworkDraft, arms: Sequence[Arm]) -> None:
    """Connect the arms of a junction lane by lane: right from the rightmost lane, left from the leftmost."""
    for arm in arms:
        for other in arms:
            if other is not arm:
                pairs = _pair_lanes(arm, other)
                if arm.cycle_m and other.cycle_m:
                    pairs.append((-1, -1))
                for lane, target in pairs:
                    begin, end = arm.first_car_lane + lane, other.first_car_lane + target
                    draft.connections.append((f"{arm.name}_in", begin, f"{other.name}_out", end))


def _pair_lanes(arm: Arm, other: Arm) -> list[tuple[int, int]]:
    """Return the pairs of lanes for cars, counted from the right, that lead from an arm to another."""
    turn = compute_turn(arm, other)
    if turn > THROUGH_RAD:
        return [(arm.lanes_in - 1, other.lanes - 1)]
    if turn < -THROUGH_RAD:
        return [(0, 0)]
    return [(lane, lane) for lane in range(min(arm.lanes, other.lanes))]


def compute_turn(arm: Arm, other: Arm) -> float:
    """Return the change of heading [rad] from an arm to another at the junction; positive to the left."""
    arriving, leaving = arm.line[0] - arm.line[1], other.line[1] - other.line[0]
    return wrap_angle(portable.atan2(float(leaving[1]), float(leaving[0])) - portable.atan2(*arriving[::-1].tolist()))
