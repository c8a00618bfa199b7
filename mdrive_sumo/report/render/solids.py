"""Solids of a picture in perspective: faces of buildings, road users, signs and traffic lights."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.report.render.canvas import blend
from mdrive_sumo.report.render.rings import lift
from mdrive_sumo.roads.drawing.map_geometry import SignalHead, StopMark
from mdrive_sumo.sensing.lidar_world import BUILDING_M, VAN_LENGTH_M

Triple: TypeAlias = tuple[float, float, float]
SUN = (0.45, -0.6, 0.66)
"""Direction to the light that shades faces."""
MAX_SHADE = 0.3
"""Share of black in a face that points away from the light."""
GLASS = "#2a3038"
WALL_M = 6.0
"""[m] Walls are cut into pieces of this length, so that sorting them by distance puts the right one in front."""
BODY_SHARE, CABIN_LENGTH, CABIN_WIDTH, CABIN_SHIFT = 0.56, 0.52, 0.86, -0.06
"""Of a car: height of the body, and length, width and place of the cabin, as shares of the whole box."""
SIGN_M, SIGN_RADIUS_M, POLE_M = 2.3, 0.45, 0.12
LIGHT_M, LIGHT_RADIUS_M = 3.2, 0.38
OUTSIDE_M = 0.9
"""[m] Distance of a traffic light's pole from the edge of its lane."""


@dataclass(frozen=True, slots=True)
class Face:
    """A plane polygon (K, 3) [m], counter-clockwise seen from outside."""

    corners: Float
    normal: Triple
    """Unit vector to the outside."""
    colour: str
    edge: str = ""

    def faces(self, eye: Float) -> bool:
        """Return whether the outside is visible from a point (3,)."""
        x, y, z = (eye - self.corners[0]).tolist()
        return x * self.normal[0] + y * self.normal[1] + z * self.normal[2] > 0


def build_face(corners: Float, colour: str, edge: str = "", shaded: bool = True) -> Face:
    """Return a face (K, 3), darker the more it points away from the light if it is shaded."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners[:3].tolist()
    (ux, uy, uz), (vx, vy, vz) = (bx - ax, by - ay, bz - az), (cx - bx, cy - by, cz - bz)
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    normal = x / size, y / size, z / size
    light = max(sum(a * b for a, b in zip(normal, SUN, strict=True)), 0.0)
    return Face(corners, normal, blend(colour, "#000000", MAX_SHADE * (1 - light)) if shaded else colour, edge)


@dataclass(frozen=True, slots=True)
class Solid:
    """Faces that are painted together, in their order, and the point by which solids are sorted."""

    middle: Float
    """(2,) [m]"""
    faces: tuple[Face, ...]

    def list_visible(self, eye: Float) -> list[Face]:
        """Return the faces that point towards an eye (3,)."""
        return [face for face in self.faces if face.faces(eye)]


def sort_back_to_front(solids: Sequence[Solid], eye: Float) -> list[Solid]:
    """Return solids in the order in which a painter draws them for an eye (3,)."""
    middles = np.array([solid.middle for solid in solids]).reshape(-1, 2)
    distance = ((middles - eye[:2]) * (middles - eye[:2])).sum(-1)
    return [solids[i] for i in np.argsort(-distance, kind="stable").tolist()]


def build_prism(outline: Float, low: float, high: float, colour: str, edge: str = "") -> tuple[Face, ...]:
    """Return walls and roof above an outline (K, 2), counter-clockwise [m]."""
    walls = (
        np.array(((*a, low), (*b, low), (*b, high), (*a, high)))
        for a, b in zip(outline.tolist(), np.roll(outline, -1, axis=0).tolist(), strict=True)
    )
    return tuple(build_face(corners, colour, edge) for corners in (*walls, lift(outline, high)))


def build_buildings(shapes: Sequence[shapely.Polygon]) -> list[list[Solid]]:
    """Return the pieces of the walls of every building; what is lower than a roof does not see it."""
    return [[_build_wall(a, b) for a, b in _list_pieces(shape)] for shape in shapes]


def _list_pieces(shape: shapely.Polygon) -> Iterator[tuple[Float, Float]]:
    ring = shapely.get_coordinates(shapely.orient_polygons(shape).exterior)
    for start, end in pairwise(ring):
        length = float(np.hypot(*(end - start)))
        shares = np.linspace(0.0, 1.0, max(1, math.ceil(length / WALL_M)) + 1)[:, None]
        points = start + shares * (end - start)
        yield from pairwise(points)


def _build_wall(a: Float, b: Float) -> Solid:
    corners = np.array(((*a, 0.0), (*b, 0.0), (*b, BUILDING_M), (*a, BUILDING_M)))
    face = build_face(corners, LIGHT["building"])
    return Solid((a + b) / 2, (replace(face, edge=face.colour),))  # an edge hides the seam between two pieces


def build_road_user(
    kind: Kind, pose: tuple[float, float, float], size: tuple[float, float, float], colour: str
) -> Solid:
    """Return a box, and for a car its body and cabin. pose: x, y [m], yaw [rad]; size: length, width, height [m]."""
    (x, y, yaw), (length, width, height) = pose, size
    outline = box_corners(x, y, yaw, length, width)
    middle = np.array((x, y))
    edge = blend(colour, "#000000", 0.45)
    if kind is not Kind.VEHICLE or length >= VAN_LENGTH_M:
        return Solid(middle, build_prism(outline, 0.0, height, colour, edge))
    body = build_prism(outline, 0.0, BODY_SHARE * height, colour, edge)
    shift = CABIN_SHIFT * length
    place = x + shift * math.cos(yaw), y + shift * math.sin(yaw)
    cabin = box_corners(*place, yaw, CABIN_LENGTH * length, CABIN_WIDTH * width)
    *windows, _ = build_prism(cabin, BODY_SHARE * height, height, GLASS)
    roof = build_face(lift(cabin, height), colour, edge)
    return Solid(middle, (*body, *windows, roof))


def build_stop_sign(mark: StopMark) -> Solid | None:
    """Return the sign beside a stop line, which faces the lane; None without one."""
    if mark.sign is None:
        return None
    across = (mark.line[1] - mark.line[0]) / np.hypot(*(mark.line[1] - mark.line[0]))
    return _build_post(mark.sign, across, SIGN_M, (SIGN_RADIUS_M, 8, LIGHT["bad"]))


def build_signal(head: SignalHead, colours: Sequence[str]) -> Solid:
    """Return a pole beside the end of a lane with a lamp of each colour, which faces the lane."""
    across = np.array((math.sin(head.yaw), -math.cos(head.yaw)))
    place = head.place + across * (head.width / 2 + OUTSIDE_M)
    parts = [
        _build_post(place + across * (2.2 * LIGHT_RADIUS_M * i), across, LIGHT_M, (LIGHT_RADIUS_M, 12, colour))
        for i, colour in enumerate(colours)
    ]
    return Solid(place, tuple(face for part in parts for face in part.faces))


def _build_post(place: Float, across: Float, height: float, plate: tuple[float, int, str]) -> Solid:
    """Return a pole and a plate (radius [m], corners, colour), which is seen from both sides."""
    radius, count, colour = plate
    half = across * POLE_M / 2
    pole = np.array(
        ((*(place - half), 0.0), (*(place + half), 0.0), (*(place + half), height), (*(place - half), height))
    )
    angles = (np.arange(count) + 0.5) * 2 * np.pi / count
    disc = np.concatenate(
        (place + across * radius * np.cos(angles)[:, None], (height + radius * np.sin(angles))[:, None]), axis=1
    )
    grey = LIGHT["muted"]
    faces = (pole, grey, ""), (pole[::-1], grey, ""), (disc[::-1], grey, ""), (disc, colour, "#ffffff")
    return Solid(place, tuple(build_face(corners, paint, edge, shaded=False) for corners, paint, edge in faces))
