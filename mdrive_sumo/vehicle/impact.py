"""Contact of one pair of convex bodies within a tick: detection and response.

Detection is a swept separating-axis test (Ericson, Real-Time Collision Detection, 5.5), response a perfectly plastic
planar impulse with Coulomb friction (Hahn 1988; no restitution, so energy can only shrink).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from mdrive_sumo.core import portable

Pair = tuple[float, float]
Pose = tuple[float, float, float]
Points = tuple[Pair, ...]
Motion = tuple[Pair, float, float, float]
"""The last four fields of `RigidBody`."""
STANDING: Motion = (0.0, 0.0), 0.0, 0.0, 0.0

PENETRATION_TOLERANCE_M = 1e-3
"""Bodies may overlap by this much [m] before they are pushed apart, so that one sliding along another never snags."""
CONTACT_DISTANCE_M = 0.01
"""Bodies closer than this [m] are in contact."""
FRICTION = 0.5
"""Coulomb friction between bodies. Assumption: sheet metal on sheet metal."""


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A convex body in one tick, world frame."""

    start: Points
    """Corners [m] at the start of the tick."""
    end: Points
    """Corners [m] at its end."""
    normals: Points
    """Unit normals of the sides; the opposite directions are understood."""
    centre: Pair = (0.0, 0.0)
    velocity: Pair = (0.0, 0.0)
    yaw_rate: float = 0.0
    inverse_mass: float = 0.0
    """1 / mass [1/kg]; 0 for immovable bodies."""
    inverse_inertia: float = 0.0
    """1 / yaw inertia [1/(kg m2)]"""


def build_static_body(piece: Points) -> RigidBody:
    """Return an immovable body for a convex polygon [m]."""
    sides = [(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in zip(piece, piece[1:] + piece[:1], strict=True)]
    lengths = [portable.hypot(dx, dy) for dx, dy in sides]
    return RigidBody(piece, piece, tuple((dy / d, -dx / d) for (dx, dy), d in zip(sides, lengths, strict=True)))


def build_box_body(before: Pose, after: Pose, length: float, width: float, motion: Motion = STANDING) -> RigidBody:
    """Return a box at its poses (x, y, yaw) at the start and the end of the tick."""
    yaws = (after[2],) if after[2] == before[2] else (after[2], before[2])
    normals = [portable.cos_sin(yaw) for yaw in yaws]
    normals += [(-y, x) for x, y in normals]
    return RigidBody(
        _corners(*before, length / 2, width / 2),
        _corners(*after, length / 2, width / 2),
        tuple(normals),
        after[:2],
        *motion,
    )


def _corners(x: float, y: float, yaw: float, ahead: float, left: float) -> Points:
    cos, sin = portable.cos_sin(yaw)
    ax, ay, lx, ly = ahead * cos, ahead * sin, -left * sin, left * cos
    return (
        (x + ax + lx, y + ay + ly),
        (x - ax + lx, y - ay + ly),
        (x - ax - lx, y - ay - ly),
        (x + ax - lx, y + ay - ly),
    )


@dataclass(frozen=True, slots=True)
class ContactManifold:
    """Contact of two bodies."""

    normal: Pair
    """Unit vector from the first to the second."""
    depth: float
    """Penetration along the normal [m]; 0 if they only touch."""


def find_contact(first: RigidBody, second: RigidBody) -> ContactManifold | None:
    """Return the contact of two bodies in this tick, or None; gaps change linearly between start and end."""
    entered, left, gap, apart = 0.0, 1.0, -math.inf, False
    # (0, least overlap) among directions that overlapped at the start, then (1, latest entry)
    best = -1, -math.inf
    meeting = ContactManifold((1.0, 0.0), 0.0)
    for normal in _separating_axes(first, second):
        start, end = _compute_gap(first.start, second.start, normal), _compute_gap(first.end, second.end, normal)
        gap = max(gap, end)
        if start > -PENETRATION_TOLERANCE_M and end > -PENETRATION_TOLERANCE_M:
            if end > CONTACT_DISTANCE_M:
                return None
            apart = True
            continue
        share = (start + PENETRATION_TOLERANCE_M) / (start - end) if start != end else 0.0
        if start <= -PENETRATION_TOLERANCE_M < end:
            left = min(left, share)
        rank = (1, share) if start > -PENETRATION_TOLERANCE_M else (0, start)
        if rank > best:
            best, entered, meeting = rank, share if rank[0] else 0.0, ContactManifold(normal, -end)
    if apart or entered > left or (best[0] == 0 and gap > -PENETRATION_TOLERANCE_M):
        return ContactManifold(meeting.normal, 0.0) if gap <= CONTACT_DISTANCE_M else None
    return meeting


def _separating_axes(first: RigidBody, second: RigidBody) -> Iterator[Pair]:
    for x, y in first.normals + second.normals:
        yield x, y
        yield -x, -y


def _compute_gap(first: Points, second: Points, normal: Pair) -> float:
    """Return the gap [m] from the first to the second body along a direction; negative if they overlap."""
    nx, ny = normal
    return min([x * nx + y * ny for x, y in second]) - max([x * nx + y * ny for x, y in first])


def resolve_collision(first: RigidBody, second: RigidBody, meeting: ContactManifold) -> tuple[RigidBody, RigidBody]:
    """Return both bodies separated (in proportion to their inverse masses) and not approaching at the contact point."""
    nx, ny = meeting.normal
    share = meeting.depth / (first.inverse_mass + second.inverse_mass)
    first = _shift(first, -nx * share * first.inverse_mass, -ny * share * first.inverse_mass)
    second = _shift(second, nx * share * second.inverse_mass, ny * share * second.inverse_mass)
    point = _contact_point(first.end, second.end, meeting.normal)
    # One after the other, normal then friction: each only takes energy away.
    first, second, press = _apply_stopping_impulse(first, second, point, meeting.normal, (0.0, math.inf))
    rub = FRICTION * press
    first, second, _ = _apply_stopping_impulse(first, second, point, (-ny, nx), (-rub, rub))
    return first, second


def _shift(thing: RigidBody, dx: float, dy: float) -> RigidBody:
    if not thing.inverse_mass:
        return thing
    end = tuple((x + dx, y + dy) for x, y in thing.end)
    return replace(thing, end=end, centre=(thing.centre[0] + dx, thing.centre[1] + dy))


def _contact_point(first: Points, second: Points, normal: Pair) -> Pair:
    """Return the middle of the interval that the touching features (corner or side) of both share."""
    nx, ny = normal
    most, least = max(x * nx + y * ny for x, y in first), min(x * nx + y * ny for x, y in second)
    a = [y * nx - x * ny for x, y in first if x * nx + y * ny > most - CONTACT_DISTANCE_M]
    b = [y * nx - x * ny for x, y in second if x * nx + y * ny < least + CONTACT_DISTANCE_M]
    along = (max(min(a), min(b)) + min(max(a), max(b))) / 2
    return most * nx - along * ny, most * ny + along * nx


def _apply_stopping_impulse(
    first: RigidBody, second: RigidBody, point: Pair, axis: Pair, limits: Pair
) -> tuple[RigidBody, RigidBody, float]:
    """Apply the impulse [N s] within `limits` that best stops the relative motion at the point along the axis."""
    speed = _speed_at(second, point, axis) - _speed_at(first, point, axis)
    inverse_mass = _inverse_mass_at(first, point, axis) + _inverse_mass_at(second, point, axis)
    impulse = max(limits[0], min(limits[1], -speed / inverse_mass))
    return _apply_impulse(first, point, axis, -impulse), _apply_impulse(second, point, axis, impulse), impulse


def _inverse_mass_at(thing: RigidBody, point: Pair, axis: Pair) -> float:
    return thing.inverse_mass + thing.inverse_inertia * portable.square(_lever(thing, point, axis))


def _lever(thing: RigidBody, point: Pair, axis: Pair) -> float:
    return (point[0] - thing.centre[0]) * axis[1] - (point[1] - thing.centre[1]) * axis[0]


def _speed_at(thing: RigidBody, point: Pair, axis: Pair) -> float:
    straight = thing.velocity[0] * axis[0] + thing.velocity[1] * axis[1]
    return straight + thing.yaw_rate * _lever(thing, point, axis)


def _apply_impulse(thing: RigidBody, point: Pair, axis: Pair, impulse: float) -> RigidBody:
    if not thing.inverse_mass:
        return thing
    change = impulse * thing.inverse_mass
    return replace(
        thing,
        velocity=(thing.velocity[0] + change * axis[0], thing.velocity[1] + change * axis[1]),
        yaw_rate=thing.yaw_rate + impulse * thing.inverse_inertia * _lever(thing, point, axis),
    )
