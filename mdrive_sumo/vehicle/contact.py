"""Contacts between boxes: CAVs never pass through anything.

A contact is a planar, perfectly plastic impulse with friction at one point. It is a surrogate of CARLA's rigid-body
physics: no crumpling, no bouncing, no third dimension, and everything that is not a CAV (background vehicles,
pedestrians, props, walls) is immovable. Detection is swept over the tick, so that nothing tunnels (impact.py).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.core.state import DT, Actors, Contact, Kind
from mdrive_sumo.vehicle.dynamics import VehicleParameters, VehicleState
from mdrive_sumo.vehicle.impact import (
    Points,
    Pose,
    RigidBody,
    build_box_body,
    build_static_body,
    find_contact,
    resolve_collision,
)

MAX_PASSES = 16
"""Most rounds of pushing apart in a tick; a car squeezed between immovable bodies stays squeezed."""
MAX_SWEEP_M = 5.0
"""An actor that moves further in a tick [m] (100 m/s) was relocated: its path is not swept."""
MARGIN_M = 1.0
"""Slack of the broad phase [m]: how far a car may be pushed in a tick and still meet only known candidates."""


@dataclass(frozen=True, slots=True)
class ObstacleMotion:
    """Immovable boxes at the start and the end of one tick, with the same rows."""

    before: Actors
    after: Actors


@dataclass(frozen=True, slots=True)
class BuildingWalls:
    """Convex static polygons, built once per episode."""

    pieces: tuple[Points, ...]
    centre: Float
    """(2, M) middle of the bounding box [m]."""
    half: Float
    """(2, M) half its size [m]."""


def build_obstacle_motion(before: Actors, after: Actors) -> ObstacleMotion:
    """Return the actors of two successive ticks; an actor that is new in this tick has no motion."""
    if before.ids is after.ids or before.ids == after.ids:
        return ObstacleMotion(before, after)
    row = {actor: i for i, actor in enumerate(before.ids)}
    stay = [(i, row[actor]) for i, actor in enumerate(after.ids) if actor in row]
    x, y, yaw = after.x.copy(), after.y.copy(), after.yaw.copy()
    for i, j in stay:
        x[i], y[i], yaw[i] = before.x[j], before.y[j], before.yaw[j]
    return ObstacleMotion(replace(after, x=x, y=y, yaw=yaw), after)


def build_walls(rings: Iterable[Float]) -> BuildingWalls:
    """Return the walls of buildings with these outlines (N, 2) [m]; concave ones are cut into triangles."""
    pieces = [piece for ring in rings for piece in _convex_pieces(ring)]
    low = np.array([np.min(piece, axis=0) for piece in pieces]).reshape(-1, 2).T
    high = np.array([np.max(piece, axis=0) for piece in pieces]).reshape(-1, 2).T
    return BuildingWalls(tuple(pieces), (low + high) / 2, (high - low) / 2)


def _convex_pieces(ring: Float) -> Iterator[Points]:
    for part in shapely.get_parts(shapely.make_valid(shapely.Polygon(ring))):
        if part.geom_type != "Polygon":
            continue
        convex = shapely.convex_hull(part)
        whole = part.area >= convex.area * (1 - 1e-6)
        for piece in (convex,) if whole else shapely.constrained_delaunay_triangles(part).geoms:
            yield tuple((float(x), float(y)) for x, y in piece.exterior.coords[:-1])


BodyKey = str | int
"""A CAV's id, an actor's index, or ~index of a piece of wall (negative)."""
ContactPair = tuple[str, BodyKey]
"""A CAV and a body that it may touch."""
Axes = Float | tuple[Float, Float]
"""Two rows (N,), along x and along y."""


@dataclass(frozen=True, slots=True)
class _TickState:
    """All inputs of one tick."""

    before: Mapping[str, VehicleState]
    after: Mapping[str, VehicleState]
    vehicles: Mapping[str, VehicleParameters]
    actors: ObstacleMotion
    walls: BuildingWalls


@twin
def resolve_contacts(
    before: Mapping[str, VehicleState],
    after: dict[str, VehicleState],
    vehicles: Mapping[str, VehicleParameters],
    actors: ObstacleMotion,
    buildings: BuildingWalls,
    /,
) -> tuple[dict[str, VehicleState], tuple[Contact, ...]]:
    """Return ego states at the end of the tick without overlaps, and the contacts (sorted, unique).

    `before` and `after` are the states at the start and, as the dynamics propose, at the end of the tick. Bodies
    closer than 1 cm are reported on every tick as long as they stay so; a collision counter must merge them.
    """
    scene = _TickState(before, after, vehicles, actors, buildings)
    pairs = _find_close_pairs(scene)
    if not pairs:
        return dict(after), ()
    bodies = {key: _build_body(key, scene) for pair in pairs for key in pair}
    untouched = dict(bodies)
    met: set[ContactPair] = set()
    for _ in range(MAX_PASSES):
        pushed = [_separate_pair(pair, bodies, met) for pair in pairs]
        if not any(pushed):
            break
    changed = {ego for ego in after if bodies.get(ego) is not untouched.get(ego)}
    settled = {
        ego: _to_vehicle_state(scene, ego, bodies[ego]) if ego in changed else body for ego, body in after.items()
    }
    return settled, _list_contacts(met, actors.after)


def _list_contacts(met: set[ContactPair], actors: Actors) -> tuple[Contact, ...]:
    contacts: set[Contact] = set()
    for ego, other in met:
        if isinstance(other, str):
            contacts |= {Contact(ego, other, Kind.VEHICLE), Contact(other, ego, Kind.VEHICLE)}
        elif other >= 0:
            contacts.add(Contact(ego, actors.ids[other], Kind(int(actors.kind[other]))))
        else:
            contacts.add(Contact(ego, "", Kind.STATIC))
    return tuple(sorted(contacts, key=lambda contact: (contact.ego, contact.other)))


def _find_close_pairs(scene: _TickState) -> list[ContactPair]:
    """Return pairs with overlapping swept bounding squares: CAVs in order of their ids, then actors, then walls."""
    egos = sorted(scene.after)
    spots = [(ego, _compute_reach(scene, ego)) for ego in egos]
    pairs: list[ContactPair] = [
        (first, second)
        for i, (first, (x, y, reach)) in enumerate(spots)
        for second, (u, v, other) in spots[i + 1 :]
        if abs(u - x) < reach + other and abs(v - y) < reach + other
    ]
    if len(scene.actors.after):
        centre, half = _compute_bounding_squares(scene.actors)
        pairs += [(ego, j) for ego, spot in spots for j in _find_near(spot, centre, half)]
    if scene.walls.pieces:
        pairs += [(ego, ~j) for ego, spot in spots for j in _find_near(spot, scene.walls.centre, scene.walls.half)]
    return pairs


def _compute_reach(scene: _TickState, ego: str) -> Pose:
    """Centre of a CAV and the half side of a square that holds it during the tick [m]."""
    start, end, vehicle = scene.before[ego], scene.after[ego], scene.vehicles[ego]
    swept = max(abs(end.x - start.x), abs(end.y - start.y))
    return end.x, end.y, (vehicle.length + vehicle.width) / 2 + swept + MARGIN_M


def _compute_bounding_squares(actors: ObstacleMotion) -> tuple[Axes, Axes]:
    """Centres and half sizes [m] of squares that hold the actors during the tick."""
    start, end = actors.before, actors.after
    swept = np.maximum(np.abs(end.x - start.x), np.abs(end.y - start.y))
    radius = (end.length + end.width) / 2 + swept
    return (end.x, end.y), (radius, radius)


def _find_near(spot: Pose, centre: Axes, half: Axes) -> list[int]:
    """Which rectangles the spot's square meets."""
    x, y, reach = spot
    gap = np.maximum(np.abs(centre[0] - x) - half[0], np.abs(centre[1] - y) - half[1])
    return (gap < reach).nonzero()[0].tolist()


def _build_body(key: BodyKey, scene: _TickState) -> RigidBody:
    if isinstance(key, str):
        return _build_ego_body(scene.before[key], scene.after[key], scene.vehicles[key])
    return _build_actor_body(scene.actors, key) if key >= 0 else build_static_body(scene.walls.pieces[~key])


def _build_ego_body(before: VehicleState, after: VehicleState, vehicle: VehicleParameters) -> RigidBody:
    cos, sin = portable.cos_sin(after.yaw)
    motion = (
        (cos * after.vx - sin * after.vy, sin * after.vx + cos * after.vy),
        after.yaw_rate,
        1 / vehicle.mass,
        1 / vehicle.yaw_inertia,
    )
    start, end = (before.x, before.y, before.yaw), (after.x, after.y, after.yaw)
    return build_box_body(start, end, vehicle.length, vehicle.width, motion)


def _build_actor_body(actors: ObstacleMotion, row: int) -> RigidBody:
    end = actors.after
    x1, y1, yaw1 = _pose_of_row(end, row)
    x0, y0, yaw0 = _pose_of_row(actors.before, row)
    if max(abs(x1 - x0), abs(y1 - y0)) > MAX_SWEEP_M:
        x0, y0, yaw0 = x1, y1, yaw1
    motion = ((x1 - x0) / DT, (y1 - y0) / DT), wrap_angle(yaw1 - yaw0) / DT, 0.0, 0.0
    size = float(end.length[row]), float(end.width[row])
    return build_box_body((x0, y0, yaw0), (x1, y1, yaw1), *size, motion)


def _pose_of_row(actors: Actors, row: int) -> Pose:
    return float(actors.x[row]), float(actors.y[row]), float(actors.yaw[row])


def _separate_pair(pair: ContactPair, bodies: dict[BodyKey, RigidBody], met: set[ContactPair]) -> bool:
    """Separate a pair and return whether that was necessary; adds the pair to `met` if it is in contact."""
    first, second = bodies[pair[0]], bodies[pair[1]]
    contact = find_contact(first, second)
    if contact is None:
        return False
    met.add(pair)
    if contact.depth == 0.0:
        return False
    bodies[pair[0]], bodies[pair[1]] = resolve_collision(first, second, contact)
    return True


def _to_vehicle_state(scene: _TickState, ego: str, rigid_body: RigidBody) -> VehicleState:
    body = scene.after[ego]
    cos, sin = portable.cos_sin(body.yaw)
    vx = cos * rigid_body.velocity[0] + sin * rigid_body.velocity[1]
    return replace(
        body,
        x=rigid_body.centre[0],
        y=rigid_body.centre[1],
        vx=vx,
        vy=cos * rigid_body.velocity[1] - sin * rigid_body.velocity[0],
        yaw_rate=rigid_body.yaw_rate,
        acceleration=(vx - scene.before[ego].vx) / DT,
    )
