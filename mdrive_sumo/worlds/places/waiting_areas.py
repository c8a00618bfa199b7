"""Corners of junctions that pavements and turning vehicles take, as netconvert shapes them.

netconvert ends each arm square to it, where the rounding of its sharper corner begins, and joins the pavements of two
neighbouring arms by a straight line between their ends.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node
from mdrive_sumo.worlds.places.street_houses import measure_half_widths

SAME_ARM_RAD = math.radians(8.0)
"""Streets whose directions differ by less are both directions of one arm."""
STRAIGHT_RAD = math.radians(155.0)
"""Between arms that enclose a larger angle there is no corner."""
SHARP_RAD = math.radians(75.0)
"""Where one corner is sharper, vehicles cut the others: their arms end far from them."""
EXTRA_M = 4.0
"""[m] Added to where an arm with a zebra crossing ends; found with `check_place` on 500 crossings."""


@dataclass(eq=False)
class _Arm:
    heading: float
    left_m: float
    right_m: float
    end_m: float = 0.0
    """Distance from the node at which the arm ends."""


def build_waiting_areas(draft: NetworkDraft) -> Iterator[BaseGeometry]:
    """Return the corners of all junctions with zebra crossings, and of those with a sharp corner."""
    crossed = {name for name, _ in draft.crossings}
    for node in (node for node in draft.nodes if node.type):
        arms = _list_arms(draft, node)
        angles = [_measure_angle(arm, arms[(k + 1) % len(arms)]) for k, arm in enumerate(arms)]
        if node.id in crossed:
            yield from _build_corners(node, arms, EXTRA_M)
        elif any(SAME_ARM_RAD < angle < SHARP_RAD for angle in angles):
            yield from _build_corners(node, arms, 0.0)


def _measure_angle(arm: _Arm, following: _Arm) -> float:
    """Return the angle [rad] from an arm counter-clockwise to the next."""
    return (following.heading - arm.heading) % (2 * math.pi)


def _list_arms(draft: NetworkDraft, node: Node) -> list[_Arm]:
    """Return the arms of a node, counter-clockwise."""
    arms: list[_Arm] = []
    for street in draft.streets:
        if node.id not in (street.begin, street.end):
            continue
        is_begin = street.begin == node.id
        line = street.line if is_begin else street.line[::-1]
        sides = measure_half_widths(draft, street)
        left, right = sides if is_begin else sides[::-1]
        step = line[1] - line[0]
        arms.append(_Arm(portable.atan2(float(step[1]), float(step[0])), left, right))
    arms.sort(key=lambda arm: arm.heading)
    merged: list[_Arm] = []
    for arm in arms:
        if merged and arm.heading - merged[-1].heading < SAME_ARM_RAD:
            merged[-1].left_m = max(merged[-1].left_m, arm.left_m)
            merged[-1].right_m = max(merged[-1].right_m, arm.right_m)
        else:
            merged.append(arm)
    return merged


def _build_corners(node: Node, arms: list[_Arm], extra_m: float) -> Iterator[BaseGeometry]:
    pairs = [(arm, arms[(k + 1) % len(arms)]) for k, arm in enumerate(arms)]
    corners: list[tuple[_Arm, _Arm, float]] = []
    for arm, following in pairs:
        angle = _measure_angle(arm, following)
        if not SAME_ARM_RAD < angle < STRAIGHT_RAD:
            continue
        cos, sin = portable.cos_sin(angle)
        along = (following.right_m + arm.left_m * cos) / sin
        beside = (arm.left_m + following.right_m * cos) / sin
        rounding = node.radius / portable.tan(angle / 2)
        arm.end_m = max(arm.end_m, along + rounding + extra_m)
        following.end_m = max(following.end_m, beside + rounding + extra_m)
        corners.append((arm, following, along))
    origin = np.array((node.x, node.y))
    for arm, following, along in corners:
        points = (
            _place_point(origin, arm.heading, along, arm.left_m),
            _place_point(origin, arm.heading, arm.end_m, arm.left_m),
            _place_point(origin, following.heading, following.end_m, -following.right_m),
        )
        yield shapely.MultiPoint([origin, *points]).convex_hull


def _place_point(origin: Float, heading: float, ahead: float, left: float) -> Float:
    """Return the point [m] so far ahead, and to the left, of an origin in a direction."""
    cos, sin = portable.cos_sin(heading)
    return origin + np.array((ahead * cos - left * sin, ahead * sin + left * cos))
