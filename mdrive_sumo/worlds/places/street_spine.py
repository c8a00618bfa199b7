"""Street with junctions, crossings and pockets along an axis: edges in both directions, their nodes and connections."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import (
    Piece,
    compute_heading,
    cut_line,
    find_point,
    reverse_line,
    shift_line,
    trace_axis,
)
from mdrive_sumo.worlds.places.draft_edge import DraftEdge, DraftLane
from mdrive_sumo.worlds.places.junction_connections import JunctionArm, connect_junction
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node

FORWARD, BACKWARD = "forward", "backward"
ARM_PRIORITY = 2
MAIN_PRIORITY = 6
"""Priorities of edges for netconvert, of which only the order counts: the main street goes first."""
ALL_RED_S = 2
"""[s] Red for all after amber, in which waiting vehicles leave the junction (RiLSA 2015, section 2.7: 1 s to 3 s)."""


@dataclass(frozen=True, slots=True)
class HalfSection:
    """Cross-section of one direction of a street, from its centre outwards [m]."""

    lanes: int = 1
    lane_m: float = 3.25
    cycle_m: float = 0.0
    parking_m: float = 0.0
    pavement_m: float = 0.0

    @property
    def carriageway_m(self) -> float:
        """Width of the lanes for cars and cycles."""
        return self.lanes * self.lane_m + self.cycle_m

    @property
    def width_m(self) -> float:
        """Width of all lanes."""
        return self.carriageway_m + self.parking_m + self.pavement_m

    def build_lanes(self, turn_lanes: int = 0) -> tuple[DraftLane, ...]:
        """Return the lanes from the kerb to the centre, with further ones for turns at the centre."""
        beside = (
            DraftLane("walk", self.pavement_m), DraftLane("park", self.parking_m), DraftLane("cycle", self.cycle_m)
        )  # fmt: skip
        cars = (DraftLane("drive", self.lane_m),) * (self.lanes + turn_lanes)
        return (*(lane for lane in beside if lane.width_m), *cars)


@dataclass(frozen=True, slots=True)
class StreetSection:
    """Cross-section of a street: forward lies to the right of its axis, backward to the left."""

    forward: HalfSection
    backward: HalfSection
    median_m: float = 0.0

    def get_half(self, direction: str) -> HalfSection:
        """Return the half for a direction."""
        return self.forward if direction == FORWARD else self.backward


@dataclass(frozen=True, slots=True)
class SideArm:
    """A street that meets the main one."""

    id: str
    heading: float
    """Direction [rad] away from the junction."""
    pieces: tuple[Piece, ...]
    half: HalfSection
    """Cross-section of both of its directions."""
    speed: float
    sign: str = ""
    """Sign at its end: "yield", "stop" or "" where signals or priority to the right decide."""
    priority: int = ARM_PRIORITY


@dataclass(frozen=True, slots=True)
class Joint:
    """A node on the axis: a junction, or a crossing for pedestrians."""

    id: str
    station: float
    type: str = "priority"
    radius: float = 6.5
    arms: tuple[SideArm, ...] = ()
    zebras: tuple[str, ...] = ()
    """Which ways a zebra crossing leads across: "before", "after" (the main street) and ids of arms."""
    turn_lanes: tuple[str, ...] = ()
    """Directions of the main street that have a lane for left turns."""
    turn_lane_m: float = 0.0
    """Length of these lanes."""


@dataclass(frozen=True, eq=False)
class SpinePlan:
    """A main street with its joints, in order of their stations."""

    axis: Polyline
    section: StreetSection
    joints: tuple[Joint, ...]
    speed: float
    priority: int = MAIN_PRIORITY


@dataclass(eq=False)
class Spine:
    """A main street in a draft."""

    plan: SpinePlan
    edges: dict[str, list[DraftEdge]] = field(default_factory=lambda: {FORWARD: [], BACKWARD: []})
    """Edges of the main street by direction, in order of the axis."""
    arms: dict[str, tuple[DraftEdge, DraftEdge]] = field(default_factory=dict[str, tuple[DraftEdge, DraftEdge]])
    """Edges of side streets, inward and outward, by their ids."""

    def list_main_edges(self) -> list[DraftEdge]:
        """Return the edges of the main street in both directions."""
        return [*self.edges[FORWARD], *self.edges[BACKWARD]]


def build_spine(draft: NetworkDraft, plan: SpinePlan) -> Spine:
    """Add a street with its side streets, connections and zebra crossings to a draft."""
    spine = Spine(plan)
    for name, station in (("begin", 0.0), ("end", plan.axis.length)):
        draft.nodes.append(Node(name, *find_point(plan.axis, station)))
    for joint in plan.joints:
        draft.nodes.append(Node(joint.id, *find_point(plan.axis, joint.station), joint.type, joint.radius))
        for arm in joint.arms:
            spine.arms[arm.id] = _add_arm(draft, joint, find_point(plan.axis, joint.station), arm)
    for direction in (FORWARD, BACKWARD):
        spine.edges[direction] = _add_direction(draft, plan, direction)
    leading, leaving = _index_edges(spine)
    for joint in plan.joints:
        arms = [
            JunctionArm(leading[inward, joint.id], leaving[outward, joint.id], inward in joint.turn_lanes)
            for inward, outward in ((FORWARD, BACKWARD), (BACKWARD, FORWARD))
        ]
        arms += [JunctionArm(*spine.arms[arm.id]) for arm in joint.arms]
        draft.connections += connect_junction(arms)
        _add_zebras(draft, joint, arms)
    return spine


def _index_edges(spine: Spine) -> tuple[dict[tuple[str, str], DraftEdge], dict[tuple[str, str], DraftEdge]]:
    """Return the main edges that lead to a node and those that leave it, by direction and node."""
    pairs = [(direction, edge) for direction, edges in spine.edges.items() for edge in edges]
    return {(d, edge.end): edge for d, edge in pairs}, {(d, edge.begin): edge for d, edge in pairs}


def _add_arm(draft: NetworkDraft, joint: Joint, at: tuple[float, float], arm: SideArm) -> tuple[DraftEdge, DraftEdge]:
    line = trace_axis(at, arm.heading, arm.pieces)
    draft.nodes.append(Node(f"{arm.id}_end", *line.at(line.length)))
    lanes = arm.half.build_lanes()
    end = f"{arm.id}_end"
    inward = DraftEdge(f"{arm.id}_in", end, joint.id, reverse_line(line), lanes, arm.speed, arm.priority)
    outward = DraftEdge(f"{arm.id}_out", joint.id, end, line, lanes, arm.speed, arm.priority)
    draft.edges += [inward, outward]
    signs = {"yield": draft.yields, "stop": draft.stops}
    if arm.sign:
        signs[arm.sign].append(inward.id)
    return inward, outward


def _add_direction(draft: NetworkDraft, plan: SpinePlan, direction: str) -> list[DraftEdge]:
    """Add the edges of one direction, in order of the axis; those before a junction may have a turn lane."""
    half, side = plan.section.get_half(direction), -1 if direction == FORWARD else 1
    edges: list[DraftEdge] = []
    for k, part in enumerate(_list_stretches(draft, plan, direction)):
        left_m = side * (plan.section.median_m / 2 - part.turn_lanes * half.lane_m)
        line = shift_line(cut_line(plan.axis, part.begin, part.end), left_m)
        lanes = half.build_lanes(part.turn_lanes)
        first, last = (part.start, part.stop) if direction == FORWARD else (part.stop, part.start)
        line = line if direction == FORWARD else reverse_line(line)
        edges.append(DraftEdge(f"{direction}_{k}", first, last, line, lanes, plan.speed, plan.priority))
    draft.edges += edges
    for before, after in pairwise(edges):
        first, second = (before, after) if direction == FORWARD else (after, before)
        if first.end.startswith("pocket"):
            draft.connections += connect_junction([JunctionArm(first, None), JunctionArm(None, second)])
            draft.connections.append((first.id, first.car_lanes[-1], second.id, second.car_lanes[-1]))
    return edges


class _Stretch(NamedTuple):
    """An edge of the main street, in the direction of the axis."""

    begin: float
    end: float
    turn_lanes: int
    start: str
    """Node at `begin`."""
    stop: str


def _list_stretches(draft: NetworkDraft, plan: SpinePlan, direction: str) -> list[_Stretch]:
    """Return the edges of a direction in order of the axis; add the nodes where turn lanes begin."""
    marks: list[tuple[float, str]] = [(0.0, "begin")]
    turns: dict[str, int] = defaultdict(int)
    for joint in plan.joints:
        split = [(joint.station, joint.id)]
        if direction in joint.turn_lanes:
            sign = -1 if direction == FORWARD else 1
            pocket, station = f"pocket_{direction}_{joint.id}", joint.station + sign * joint.turn_lane_m
            at = find_point(plan.axis, station, sign * plan.section.median_m / 2)
            draft.nodes.append(Node(pocket, *at, "priority", 1.5))
            split.append((station, pocket))
            turns[joint.id if direction == FORWARD else pocket] = 1
        marks += sorted(split)
    marks.append((plan.axis.length, "end"))
    return [_Stretch(begin, end, turns[stop], start, stop) for (begin, start), (end, stop) in pairwise(marks)]


def _add_zebras(draft: NetworkDraft, joint: Joint, arms: Sequence[JunctionArm]) -> None:
    """Add the zebra crossings of a joint across the ways that it names."""
    ways = dict(zip(("before", "after", *(arm.id for arm in joint.arms)), arms, strict=True))
    for name in joint.zebras:
        inward, outward = ways[name].inward, ways[name].outward
        assert inward is not None
        assert outward is not None
        draft.crossings.append((joint.id, f"{inward.id} {outward.id}"))


def list_signal_arguments(cycle_s: int) -> tuple[str, ...]:
    """Return netconvert's arguments for programs of signals with a cycle time [s]; it makes them up itself."""
    return ("--tls.cycle.time", str(cycle_s), "--tls.allred.time", str(ALL_RED_S))


def compute_arm_heading(axis: Polyline, station: float, side: int, skew: float) -> float:
    """Return the direction [rad] of a side street on a side (1: left, -1: right) that leans by `skew` [rad]."""
    return compute_heading(axis, station) + side * 1.5707963267948966 + skew
