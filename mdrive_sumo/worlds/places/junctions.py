"""Training networks around one junction: arms with drawn angles, bends and lanes; with and without lights."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street
from mdrive_sumo.worlds.places.street_lines import draw_arm, trace_line

FLARE_M = 24.0
"""[m] From the ring to where the lanes of an arm part around its splitter island."""
ARM_STEP_M = 6.0
"""[m] Distance of points on the part of an arm that parts around the island."""
COMPASS = ("east", "north", "west", "south")


@dataclass(frozen=True, slots=True)
class JunctionPlan:
    """How a junction and its arms look."""

    angles_deg: tuple[float, ...]
    """Directions of the arms, counter-clockwise; one that is negative stands for an arm that there is not."""
    lanes: tuple[tuple[int, int], ...]
    """Lanes into the junction and out of it, by arm."""
    type: str = "right_before_left"
    radius: float = 5.0
    speed: float = 8.33
    main: tuple[int, ...] = ()
    """Arms with priority."""
    length_m: float = 100.0
    bend: float = 0.0
    """Share of arms with a bend."""
    jitter_deg: float = 4.0
    sidewalk_m: float = 1.5
    zebras: bool = False


def build_junction(draft: NetworkDraft, plan: JunctionPlan, rng: random.Random) -> list[str]:
    """Add a junction with its arms to the draft; return the ids of the arms."""
    draft.nodes.append(Node("x", 0.0, 0.0, plan.type, plan.radius))
    arms: list[str] = []
    for k, (angle, lanes) in enumerate(zip(plan.angles_deg, plan.lanes, strict=True)):
        heading = math.radians(angle + rng.uniform(-plan.jitter_deg, plan.jitter_deg))
        line = trace_line((0.0, 0.0), heading, draw_arm(rng, plan.length_m * rng.uniform(0.9, 1.15), plan.bend))
        arm = COMPASS[round(angle / 90) % 4]
        draft.nodes.append(Node(arm, float(line[-1, 0]), float(line[-1, 1])))
        priority = 6 if k in plan.main else 3
        draft.streets.append(Street(arm, arm, "x", line[::-1], lanes, plan.speed, priority, sidewalk_m=plan.sidewalk_m))
        if plan.zebras:
            draft.crossings.append(("x", f"{arm}_in {arm}_out"))
        arms.append(arm)
    if plan.type == "priority_stop":
        draft.stops += [f"{arm}_in" for k, arm in enumerate(arms) if k not in plan.main]
    return arms


def add_turn_lane_connections(draft: NetworkDraft, arms: Sequence[str], lanes: Sequence[tuple[int, int]]) -> None:
    """Connect arms (counter-clockwise, each with a left-turn lane) explicitly: right and straight, straight, left."""
    first = 1 if draft.streets[-1].sidewalk_m else 0
    for k, arm in enumerate(arms):
        inside = lanes[k][0]
        right, ahead, left = ((k + 1) % 4, (k + 2) % 4, (k + 3) % 4)
        moves = [(0, right, 0)]
        moves += [(i, ahead, min(i, lanes[ahead][1] - 1)) for i in range(inside - 1)]
        moves += [(inside - 1, left, lanes[left][1] - 1)]
        for lane, target, to_lane in moves:
            draft.connections.append((f"{arm}_in", first + lane, f"{arms[target]}_out", first + to_lane))


def build_roundabout(
    draft: NetworkDraft,
    radius: float,
    lanes: int,
    angles_deg: Sequence[float],
    arm_m: float,
    bends: Sequence[float] = (),
    speed: float = 13.89,
) -> None:
    """Add a roundabout of a ring with `lanes` lanes and as many on each arm; the ring has priority.

    bends: curvature [1/m] of each arm beyond its splitter island; (): all are straight. speed: limit on the arms [m/s].
    """
    half = math.radians(19.0 if lanes == 1 else 17.0)
    base = lanes * draft.lane_m / 2 + 0.55
    flare = [base + share * (radius * portable.sin(half) - base) for share in (0.0, 0.22, 0.56, 1.0)]
    away = [radius + FLARE_M, radius + 15.0, radius + 8.0, radius * portable.cos(half)]
    nodes, cuts = list[str](), list[float]()
    for k, angle in enumerate(angles_deg):
        arm, axis = f"arm_{k + 1}", math.radians(angle)
        outside = _trace_arm(radius + FLARE_M, arm_m - FLARE_M, bends[k] if bends else 0.0)
        entering, leaving = (
            np.array([_rotate(x, y, axis) for x, y in (*(p + sign * base * n for p, n in outside), *near)])
            for sign, near in ((1, zip(away, flare, strict=True)), (-1, zip(away, (-y for y in flare), strict=True)))
        )
        leaving = leaving[::-1]
        end = (entering[0] + leaving[-1]) / 2
        draft.nodes += [Node(arm, float(end[0]), float(end[1]))]
        draft.nodes += [Node(f"{arm}_x", float(leaving[0, 0]), float(leaving[0, 1]), "priority", 2.5)]
        draft.nodes += [Node(f"{arm}_n", float(entering[-1, 0]), float(entering[-1, 1]), "priority", 2.5)]
        draft.streets.append(
            Street(f"{arm}_in", arm, f"{arm}_n", entering, (lanes, 0), speed, 2, 0.0, True, (f"{arm}_in", ""))
        )
        draft.streets.append(
            Street(f"{arm}_out", f"{arm}_x", arm, leaving, (lanes, 0), speed, 2, 0.0, True, (f"{arm}_out", ""))
        )
        nodes += [f"{arm}_x", f"{arm}_n"]
        cuts += [axis - half, axis + half]
    _add_ring(draft, radius, lanes, nodes, cuts)


def _trace_arm(begin_m: float, length_m: float, bend: float) -> list[tuple[Float, Float]]:
    """Return points of an arm beyond its splitter island, outermost first, each with its normal to the left.

    The arm runs along the x axis from `begin_m` on. bend: curvature [1/m].
    """
    count = max(math.ceil(length_m / ARM_STEP_M), 1) if bend else 1
    points: list[tuple[Float, Float]] = []
    for k in range(count, 0, -1):
        along = k * length_m / count
        if not bend:
            points.append((np.array((begin_m + along, 0.0)), np.array((0.0, 1.0))))
            continue
        cos, sin = portable.cos_sin(bend * along)
        points.append((np.array((begin_m + sin / bend, (1.0 - cos) / bend)), np.array((-sin, cos))))
    return points


def _rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    return x * portable.cos(angle) - y * portable.sin(angle), x * portable.sin(angle) + y * portable.cos(angle)


def _add_ring(draft: NetworkDraft, radius: float, lanes: int, nodes: Sequence[str], cuts: Sequence[float]) -> None:
    """Add the edges of the ring, counter-clockwise, and all connections."""
    count = len(nodes)
    for k in range(count):
        begin, end = cuts[k], cuts[(k + 1) % count]
        end += 2 * math.pi if end < begin else 0.0
        angles = np.linspace(begin, end, max(math.ceil((end - begin) * radius / 2.5), 2))
        line = radius * np.stack((portable.cos(angles), portable.sin(angles)), 1)
        name = f"ring_{k + 1}"
        draft.streets.append(
            Street(name, nodes[k], nodes[(k + 1) % count], line, (lanes, 0), 8.33, 5, 0.0, True, (name, ""))
        )
    for k, node in enumerate(nodes):
        before, after = f"ring_{(k - 1) % count + 1}", f"ring_{k + 1}"
        arm = node[:-2]
        for lane in range(lanes):
            if node.endswith("_n"):
                draft.connections.append((f"{arm}_in", lane, after, lane))
            elif lane == 0 or lanes > 1:
                draft.connections.append((before, lane, f"{arm}_out", lane))
            draft.connections.append((before, lane, after, lane))
    draft.ring = (nodes, [f"ring_{k + 1}" for k in range(count)])
