"""Roundabouts: the ring, and arms that part around splitter islands."""

import math
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street

FLARE_M = 24.0
"""[m] From the ring to where the lanes of an arm part around its splitter island."""
ARM_STEP_M = 6.0
"""[m] Distance of points on the part of an arm that parts around the island."""


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
