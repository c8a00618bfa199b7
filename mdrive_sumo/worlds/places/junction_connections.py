"""Connections of a junction between edges of any lanes: which lane leads to which."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.worlds.places.alignment import compute_heading
from mdrive_sumo.worlds.places.draft_edge import DraftEdge

STRAIGHT_RAD = math.radians(35.0)
"""Ways that turn by less are straight on."""
Connection = tuple[str, int, str, int]
"""From edge and lane, to edge and lane."""


@dataclass(frozen=True, eq=False)
class JunctionArm:
    """A road at a junction: the edge that leads in, and the one that leads out; one of them may be missing."""

    inward: DraftEdge | None
    outward: DraftEdge | None
    has_left_turn_lane: bool = False
    """Whether the leftmost lane leads to the left only."""


def connect_junction(arms: Sequence[JunctionArm]) -> list[Connection]:
    """Return all connections of a junction; there are no U-turns.

    The right turn leaves from the rightmost lane for cars and the left turn from the leftmost one; lanes straight on
    keep their order. Cyclists stay on cycle lanes where the next road has one.
    """
    connections: list[Connection] = []
    for arm in arms:
        if arm.inward is not None:
            exits = _find_exits(arm.inward, [other.outward for other in arms if other is not arm and other.outward])
            connections += _connect_cars(arm.inward, exits, arm.has_left_turn_lane)
            connections += _connect_cyclists(arm.inward, exits)
    return connections


def _find_exits(inward: DraftEdge, outward: Sequence[DraftEdge]) -> dict[str, DraftEdge]:
    """Return the ways on by direction: right, straight, left."""
    heading = compute_heading(inward.line, inward.line.length)
    turns = sorted((wrap_angle(compute_heading(edge.line, 0.0) - heading), i) for i, edge in enumerate(outward))
    if not turns:
        return {}
    ahead = min(turns, key=lambda turn: abs(turn[0]))
    exits = {"straight": outward[ahead[1]]} if abs(ahead[0]) <= STRAIGHT_RAD else {}
    for turn, i in turns:
        if outward[i] not in exits.values():
            exits["left" if turn > (ahead[0] if exits.get("straight") else 0.0) else "right"] = outward[i]
    return exits


def _connect_cars(inward: DraftEdge, exits: dict[str, DraftEdge], has_left_turn_lane: bool) -> list[Connection]:
    lanes = list(inward.car_lanes)
    ways: list[Connection] = []
    if "right" in exits:
        ways.append((inward.id, lanes[0], exits["right"].id, exits["right"].car_lanes[0]))
    if "straight" in exits:
        ahead = lanes[:-1] if has_left_turn_lane and len(lanes) > 1 else lanes
        targets = exits["straight"].car_lanes
        ways += [(inward.id, lane, exits["straight"].id, target) for lane, target in zip(ahead, targets, strict=False)]
    if "left" in exits:
        ways.append((inward.id, lanes[-1], exits["left"].id, exits["left"].car_lanes[-1]))
    return ways


def _connect_cyclists(inward: DraftEdge, exits: dict[str, DraftEdge]) -> list[Connection]:
    """Return the ways of a cycle lane: straight on and to the right, else to the left."""
    if inward.cycle_lane is None:
        return []
    wanted = [turn for turn in ("right", "straight") if turn in exits]
    if "straight" not in exits:
        wanted += ["left"] * ("left" in exits)
    targets = [exits[turn] for turn in wanted]
    return [
        (inward.id, inward.cycle_lane, edge.id, edge.car_lanes[0] if edge.cycle_lane is None else edge.cycle_lane)
        for edge in targets
    ]
