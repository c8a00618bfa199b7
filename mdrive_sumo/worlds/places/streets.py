"""Training networks along a street: bends, side streets, several junctions, and a motorway."""

import math
import random
from dataclasses import dataclass

from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street
from mdrive_sumo.worlds.places.street_lines import Piece, compute_end_heading, draw_arm, trace_line


@dataclass(frozen=True, slots=True)
class SideStreet:
    """A street that meets the main one."""

    side: int
    """1: from the left of the main street's line, -1: from the right, 0: from both."""
    lanes: int = 1
    type: str = "priority"
    zebras: bool = False
    length_m: float = 75.0
    speed: float = 8.33
    radius: float = 6.0
    """[m] Of the corners."""


@dataclass(frozen=True, slots=True)
class StreetPlan:
    """A main street as a chain of sections, with a junction between each two."""

    sections: tuple[tuple[Piece, ...], ...]
    sides: tuple[SideStreet, ...] = ()
    lanes: int = 1
    speed: float = 8.33
    sidewalk_m: float = 1.5
    bend: float = 0.5
    """Share of side streets with a bend."""
    priority: int = 6


def build_street(draft: NetworkDraft, plan: StreetPlan, rng: random.Random, heading: float = 0.0) -> None:
    """Add the main street and its side streets to the draft; the first section begins at the origin."""
    at, where = (0.0, 0.0), "west"
    draft.nodes.append(Node(where, *at))
    for k, pieces in enumerate(plan.sections):
        line = trace_line(at, heading, pieces)
        heading = compute_end_heading(heading, pieces)
        at = (float(line[-1, 0]), float(line[-1, 1]))
        last = k == len(plan.sections) - 1
        there = "east" if last else f"j{k + 1}"
        if not last:
            side = plan.sides[k]
            draft.nodes.append(Node(there, *at, side.type, side.radius))
        else:
            draft.nodes.append(Node(there, *at))
        draft.streets.append(
            Street(
                f"main_{k + 1}",
                where,
                there,
                line,
                (plan.lanes, plan.lanes),
                plan.speed,
                plan.priority,
                sidewalk_m=plan.sidewalk_m,
                names=(f"eastward_{k + 1}", f"westward_{k + 1}"),
            )
        )
        if not last:
            _add_side_streets(draft, plan, plan.sides[k], (k + 1, at, heading), rng)
        where = there


def _add_side_streets(
    draft: NetworkDraft,
    plan: StreetPlan,
    side: SideStreet,
    place: tuple[int, tuple[float, float], float],
    rng: random.Random,
) -> None:
    k, at, heading = place
    node = f"j{k}"
    around = [f"eastward_{k} westward_{k}", f"eastward_{k + 1} westward_{k + 1}"]
    for sign, word in ((1, "north"), (-1, "south")):
        if side.side not in (0, sign):
            continue
        name = f"{word}_{k}"
        away = heading + sign * math.pi / 2 + math.radians(rng.uniform(-9.0, 9.0))
        line = trace_line(at, away, draw_arm(rng, side.length_m * rng.uniform(0.9, 1.1), plan.bend))
        draft.nodes.append(Node(name, float(line[-1, 0]), float(line[-1, 1])))
        priority = plan.priority if side.type == "right_before_left" else 2
        draft.streets.append(
            Street(
                name, name, node, line[::-1], (side.lanes, side.lanes), side.speed, priority, sidewalk_m=plan.sidewalk_m
            )
        )
        around.append(f"{name}_in {name}_out")
        if side.type == "priority_stop":
            draft.stops.append(f"{name}_in")
    if side.zebras:
        draft.crossings += [(node, edges) for edges in around]
