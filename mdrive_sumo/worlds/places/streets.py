"""Training networks along a street: bends, side streets, several junctions, and a motorway."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
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


def build_town(draft: NetworkDraft, pitch_m: tuple[float, float], speed: float, rng: random.Random) -> None:
    """Add four crossings of narrow streets at the corners of a block, priority to the right."""
    corners = {
        f"{'nw'[1 - i]}{j}": (i * pitch_m[0] + rng.uniform(-5, 5), j * pitch_m[1] + rng.uniform(-5, 5))
        for i in (0, 1)
        for j in (0, 1)
    }
    for name, at in corners.items():
        draft.nodes.append(Node(name, *at, "right_before_left", 5.8))
    pairs = (("w0", "n0"), ("w1", "n1"), ("w0", "w1"), ("n0", "n1"))
    for a, b in pairs:
        line = np.array((corners[a], corners[b]))
        _add_town_street(draft, f"{a}{b}", (a, b), line, speed)
    arms = {"w0": (180, 270), "n0": (0, 270), "w1": (180, 90), "n1": (0, 90)}
    for name, angles in arms.items():
        for angle in angles:
            heading = math.radians(angle + rng.uniform(-6, 6))
            line = trace_line(corners[name], heading, draw_arm(rng, rng.uniform(60, 75), 0.4))
            arm = f"{name}_{angle}"
            draft.nodes.append(Node(arm, float(line[-1, 0]), float(line[-1, 1])))
            _add_town_street(draft, arm, (arm, name), line[::-1], speed)
    draft.crossings += [("w0", "w0_180_in w0_180_out"), ("n1", "n1_90_in n1_90_out")]


def _add_town_street(draft: NetworkDraft, name: str, ends: Sequence[str], line: Float, speed: float) -> None:
    draft.streets.append(Street(name, ends[0], ends[1], line, (1, 1), speed, 3, sidewalk_m=1.5))


def build_motorway(draft: NetworkDraft, curve_m: float) -> None:
    """Add a carriageway of three lanes that loses its right-hand one, and an on-ramp that joins it further on."""
    arc = (0.0, 0.0), 0.0
    wide = trace_line(*arc, ((120.0, 0.0), (50.0, curve_m)))
    heading = 50.0 / curve_m
    narrow = trace_line(tuple(wide[-1].tolist()), heading, ((60.0, curve_m), (70.0, 0.0)))
    heading += 60.0 / curve_m
    beside = trace_line(tuple(narrow[-1].tolist()), heading, ((115.0, 0.0),))
    after = trace_line(tuple(beside[-1].tolist()), heading, ((130.0, -curve_m),))
    spots = {"start": wide[0], "drop": wide[-1], "join": narrow[-1], "merge": beside[-1], "end": after[-1]}
    for name, at in spots.items():
        draft.nodes.append(
            Node(name, float(at[0]), float(at[1]), "priority" if name in ("drop", "join", "merge") else "")
        )
    chain = (("wide", "start", "drop", wide, 3), ("narrow", "drop", "join", narrow, 2))
    chain += (("beside", "join", "merge", beside, 3), ("after", "merge", "end", after, 2))
    for name, a, b, line, lanes in chain:
        draft.streets.append(Street(name, a, b, line, (lanes, 0), 22.22, 6, names=(name, "")))
    _add_ramp(draft, narrow[-1], heading)
    draft.connections += [("wide", 2, "narrow", 1), ("wide", 1, "narrow", 0), ("wide", 0, "narrow", 0)]
    draft.connections += [("narrow", 0, "beside", 1), ("narrow", 1, "beside", 2), ("ramp", 0, "beside", 0)]
    draft.connections += [("beside", 1, "after", 0), ("beside", 2, "after", 1)]


def _add_ramp(draft: NetworkDraft, join: Float, heading: float) -> None:
    """Add a ramp that ends as the lane to the right of the two of the carriageway."""
    side = np.array((portable.sin(heading), -portable.cos(heading))) * 2 * draft.lane_m
    end = (float(join[0] + side[0]), float(join[1] + side[1]))
    line = trace_line(end, heading + math.pi, ((14.0, 0.0), (40.0, 170.0), (60.0, 110.0), (40.0, 0.0)))[::-1]
    draft.nodes.append(Node("ramp_start", float(line[0, 0]), float(line[0, 1])))
    draft.streets.append(Street("ramp", "ramp_start", "join", line, (1, 0), 16.67, 3, names=("ramp", "")))
