"""Boxes never pass through each other; impulses obey mechanics. Shapely is the independent judge of overlap."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples

from mdrive_sumo.contract import Control
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import DT, Actors, Contact, Kind
from mdrive_sumo.vehicle.contact import build_obstacle_motion, build_walls, resolve_contacts
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleParameters, VehicleState, step

pytestmark = pytest.mark.slow

NOBODY = build_obstacle_motion(Actors.empty(), Actors.empty())
NOTHING = build_walls([])
LIGHT = VehicleParameters(mass=1000.0, yaw_inertia=2000.0)


def actors(*boxes: tuple[str, float, float, float], size: tuple[float, float] = (4.5, 1.8)) -> Actors:
    ids = tuple(box[0] for box in boxes)
    x, y, yaw = (np.array([box[k] for box in boxes], dtype=float) for k in (1, 2, 3))
    n = len(boxes)
    kind = np.full(n, Kind.VEHICLE, dtype=np.uint8)
    return Actors(ids, kind, x, y, yaw, np.zeros(n), np.full(n, size[0]), np.full(n, size[1]))


def outline(body: VehicleState, vehicle: VehicleParameters = MKZ_2017) -> shapely.Polygon:
    return shapely.Polygon(box_corners(body.x, body.y, body.yaw, vehicle.length, vehicle.width))


def depth(first: shapely.Polygon, second: shapely.Polygon) -> float:
    """How thick the overlap of two convex shapes is [m]: width of the intersection's rotated rectangle."""
    common = first.intersection(second)
    if common.area < 1e-9:
        return 0.0
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(common))
    return float(np.hypot(*np.diff(corners, axis=0).T).min())


def coasted(body: VehicleState) -> VehicleState:
    """The body one tick later with nothing acting on it."""
    sin, cos = math.sin(body.yaw), math.cos(body.yaw)
    vx, vy = cos * body.vx - sin * body.vy, sin * body.vx + cos * body.vy
    yaw = body.yaw + body.yaw_rate * DT
    sin, cos = math.sin(yaw), math.cos(yaw)
    return replace(
        body, x=body.x + vx * DT, y=body.y + vy * DT, yaw=yaw, vx=cos * vx + sin * vy, vy=cos * vy - sin * vx
    )


def momentum(body: VehicleState, vehicle: VehicleParameters) -> Float:
    sin, cos = math.sin(body.yaw), math.cos(body.yaw)
    return vehicle.mass * np.array((cos * body.vx - sin * body.vy, sin * body.vx + cos * body.vy))


def energy(body: VehicleState, vehicle: VehicleParameters) -> float:
    return 0.5 * (vehicle.mass * (body.vx**2 + body.vy**2) + vehicle.yaw_inertia * body.yaw_rate**2)


def pair(
    first: VehicleState, second: VehicleState
) -> tuple[dict[str, VehicleState], tuple[Contact, ...], dict[str, VehicleState]]:
    before = {"a": first, "b": second}
    after = {ego: coasted(body) for ego, body in before.items()}
    cars = {"a": MKZ_2017, "b": LIGHT}
    settled, met = resolve_contacts(before, after, cars, NOBODY, NOTHING)
    return settled, met, after


speeds = st.floats(-5.0, 40.0)
angles = st.floats(-math.pi, math.pi)
bodies = st.builds(
    VehicleState,
    x=st.floats(-6.0, 6.0),
    y=st.floats(-6.0, 6.0),
    yaw=angles,
    vx=speeds,
    vy=st.floats(-3.0, 3.0),
    yaw_rate=st.floats(-2.0, 2.0),
)
centred = st.builds(VehicleState, x=st.just(0.0), y=st.just(0.0), yaw=angles, vx=speeds, yaw_rate=st.floats(-2.0, 2.0))


def apart(*shapes: shapely.Polygon) -> bool:
    return all(a.distance(b) > 0.0 for i, a in enumerate(shapes) for b in shapes[i + 1 :])


@settings(max_examples=examples(80, 300), deadline=None)
@given(centred, bodies)
def test_two_cavs_end_apart_and_mechanics_holds(first: VehicleState, second: VehicleState) -> None:
    if not apart(outline(first), outline(second, LIGHT)):
        return
    settled, met, after = pair(first, second)
    assert depth(outline(settled["a"]), outline(settled["b"], LIGHT)) < 0.01
    cars = {"a": MKZ_2017, "b": LIGHT}
    now = sum(momentum(settled[ego], cars[ego]) for ego in cars)
    then = sum(momentum(after[ego], cars[ego]) for ego in cars)
    assert now == pytest.approx(then, abs=1e-6 * 1e5)
    assert sum(energy(settled[ego], cars[ego]) for ego in cars) <= (
        sum(energy(after[ego], cars[ego]) for ego in cars) * (1 + 1e-12)
    )
    if depth(outline(after["a"]), outline(after["b"], LIGHT)) > 0.005:
        assert met == (Contact("a", "b", Kind.VEHICLE), Contact("b", "a", Kind.VEHICLE))


@settings(max_examples=examples(80, 300), deadline=None)
@given(centred, st.floats(-6, 6), st.floats(-6, 6), angles, st.floats(-2, 2), st.floats(-2, 2))
def test_a_cav_never_enters_an_actor(ego: VehicleState, x: float, y: float, yaw: float, dx: float, dy: float) -> None:
    start, end = actors(("v", x, y, yaw)), actors(("v", x + dx, y + dy, yaw))
    shapes = [shapely.Polygon(box_corners(a.x[0], a.y[0], a.yaw[0], 4.5, 1.8)) for a in (start, end)]
    if not apart(outline(ego), shapes[0]):
        return
    proposed = coasted(ego)
    settled, met = resolve_contacts(
        {"e": ego}, {"e": proposed}, {"e": MKZ_2017}, build_obstacle_motion(start, end), NOTHING
    )
    assert depth(outline(settled["e"]), shapes[1]) < 0.01
    if depth(outline(proposed), shapes[1]) > 0.005:
        assert met == (Contact("e", "v", Kind.VEHICLE),)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (VehicleState(0, 0, 0, vx=40.0), VehicleState(5.5, 0, math.pi, vx=40.0)),  # head-on, 4 m in the tick
        (VehicleState(0, 0, 0, vx=40.0), VehicleState(4.0, -1.2, math.pi / 2, vx=0.0)),  # T-bone
        (VehicleState(0, 0, 0, vx=40.0), VehicleState(5.2, 0.5, 0.0, vx=1.0)),  # rear-end
        (
            VehicleState(0, 0, 0, vx=0.0, vy=60.0),
            VehicleState(0.0, 2.3, 0.0, vy=-60.0),
        ),  # sideways, 6 m: through each other
    ],
)
def test_nothing_tunnels(first: VehicleState, second: VehicleState) -> None:
    settled, met, _ = pair(first, second)
    assert len(met) == 2
    towards = np.array((second.x - first.x, second.y - first.y))
    gap = np.array((settled["b"].x - settled["a"].x, settled["b"].y - settled["a"].y))
    assert towards @ gap > 0.0  # same side as before
    assert depth(outline(settled["a"]), outline(settled["b"], LIGHT)) < 0.01


def test_a_central_crash_is_perfectly_plastic() -> None:
    settled, _, _ = pair(VehicleState(0, 0, 0, vx=20.0), VehicleState(5.0, 0, 0, vx=0.0))
    common = 20.0 * MKZ_2017.mass / (MKZ_2017.mass + LIGHT.mass)
    assert settled["a"].vx == pytest.approx(common)
    assert settled["b"].vx == pytest.approx(common)
    assert settled["a"].acceleration == pytest.approx((common - 20.0) / DT)


def spin(body: VehicleState, vehicle: VehicleParameters, at: VehicleState) -> float:
    """Angular momentum about the world's origin of a body that moves as `body`, placed at `at`."""
    px, py = momentum(body, vehicle)
    return vehicle.yaw_inertia * body.yaw_rate + at.x * float(py) - at.y * float(px)


def test_an_eccentric_crash_keeps_angular_momentum_and_spins_both() -> None:
    settled, _, after = pair(VehicleState(0, 0, 0, vx=20.0), VehicleState(5.2, 1.2, math.pi, vx=10.0))
    cars = {"a": MKZ_2017, "b": LIGHT}
    now = sum(spin(settled[ego], cars[ego], settled[ego]) for ego in cars)
    then = sum(spin(after[ego], cars[ego], settled[ego]) for ego in cars)
    assert now == pytest.approx(then)
    assert min(abs(settled[ego].yaw_rate) for ego in cars) > 0.3


def test_an_immovable_actor_stops_or_carries_the_car() -> None:
    parked = build_obstacle_motion(actors(("v", 5.0, 0, 0)), actors(("v", 5.0, 0, 0)))
    body = VehicleState(0, 0, 0, vx=20.0)
    settled, met = resolve_contacts({"e": body}, {"e": coasted(body)}, {"e": MKZ_2017}, parked, NOTHING)
    assert settled["e"].vx == pytest.approx(0.0, abs=1e-9)
    assert settled["e"].x == pytest.approx(5.0 - 4.5 / 2 - 4.9 / 2)
    assert met == (Contact("e", "v", Kind.VEHICLE),)
    body, moving = VehicleState(0, 0, 0), build_obstacle_motion(actors(("v", -4.8, 0, 0)), actors(("v", -4.3, 0, 0)))
    settled, met = resolve_contacts({"e": body}, {"e": body}, {"e": MKZ_2017}, moving, NOTHING)
    assert settled["e"].vx == pytest.approx(0.5 / DT)
    assert met == (Contact("e", "v", Kind.VEHICLE),)


def test_resting_against_something_is_contact_on_every_tick() -> None:
    for gap, touching in ((0.0, True), (0.009, True), (0.011, False)):
        parked = build_obstacle_motion(actors(("v", 4.7 + gap, 0, 0)), actors(("v", 4.7 + gap, 0, 0)))
        body = VehicleState(0, 0, 0)
        settled, met = resolve_contacts({"e": body}, {"e": body}, {"e": MKZ_2017}, parked, NOTHING)
        assert settled == {"e": body}
        assert bool(met) is touching


def test_sliding_along_does_not_snag() -> None:
    """A car that brushes past a parked one keeps going: the neighbour's corner is no obstacle."""
    parked = build_obstacle_motion(actors(("v", 12.0, 1.9, 0)), actors(("v", 12.0, 1.9, 0)))
    body = VehicleState(0, 0.0, 0, vx=10.0)  # the sides touch: 1.0 + 0.9 m
    for _ in range(60):
        settled, _ = resolve_contacts({"e": body}, {"e": coasted(body)}, {"e": MKZ_2017}, parked, NOTHING)
        body = settled["e"]
    assert (body.x, body.vx) == (pytest.approx(30.0), pytest.approx(10.0))


def test_friction_slows_what_scrapes_along() -> None:
    wall = build_walls([np.array(((-50, 1.2), (50, 1.2), (50, 2), (-50, 2)))])
    body = VehicleState(0, 0, 0.0, vx=10.0, vy=8.0)
    settled, met = resolve_contacts({"e": body}, {"e": coasted(body)}, {"e": MKZ_2017}, NOBODY, wall)
    assert met == (Contact("e", "", Kind.STATIC),)
    assert settled["e"].vy == pytest.approx(0.0, abs=1e-9)
    assert settled["e"].vx == pytest.approx(10.0 - 0.5 * 8.0)  # Coulomb: 0.5 of the normal impulse


L_SHAPE = np.array(((0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (8.0, 8.0), (8.0, 20.0), (0.0, 20.0)))


def test_walls_cover_exactly_the_building() -> None:
    pieces = build_walls([L_SHAPE, L_SHAPE[:4] + 50.0])
    whole = shapely.union_all([shapely.Polygon(piece) for piece in pieces.pieces])
    expected = shapely.union_all([shapely.Polygon(L_SHAPE), shapely.Polygon(L_SHAPE[:4] + 50.0)])
    assert whole.symmetric_difference(expected).area == pytest.approx(0.0, abs=1e-9)
    for i, piece in enumerate(pieces.pieces):
        polygon = shapely.Polygon(piece)
        assert polygon.area == pytest.approx(polygon.convex_hull.area)
        low, high = pieces.centre[:, i] - pieces.half[:, i], pieces.centre[:, i] + pieces.half[:, i]
        assert (*low, *high) == pytest.approx(polygon.bounds)


@settings(max_examples=examples(60, 200), deadline=None)
@given(bodies)
def test_a_cav_never_enters_a_building(ego: VehicleState) -> None:
    ego = replace(ego, x=ego.x + 10.0, y=ego.y + 10.0)
    building = shapely.Polygon(L_SHAPE)
    if outline(ego).intersects(building):
        return
    proposed = coasted(ego)
    settled, met = resolve_contacts({"e": ego}, {"e": proposed}, {"e": MKZ_2017}, NOBODY, build_walls([L_SHAPE]))
    assert outline(settled["e"]).intersection(building).area < 0.01
    if outline(proposed).intersection(building).area > 0.01:
        assert met == (Contact("e", "", Kind.STATIC),)


def test_actors_are_matched_by_id_and_newcomers_do_not_sweep() -> None:
    before = actors(("a", 0, 0, 0), ("b", 10, 0, 0), ("far", 0, 50, 0))
    after = actors(("b", 11, 0, 0), ("far", 90, 50, 0), ("new", 5, 5, 0))
    moved = build_obstacle_motion(before, after)
    assert moved.before.x.tolist() == [10.0, 0.0, 5.0]  # b moved, new stands
    assert moved.after.x.tolist() == [11.0, 90.0, 5.0]
    body = VehicleState(45.0, 50.0, 0.0)  # far was put there: it did not sweep what lies between
    assert resolve_contacts({"e": body}, {"e": body}, {"e": MKZ_2017}, moved, NOTHING) == ({"e": body}, ())
    same = actors(("a", 1, 0, 0), ("b", 10, 0, 0), ("far", 0, 50, 0))
    assert build_obstacle_motion(before, same).before is before


@pytest.mark.parametrize(
    ("step_m", "is_swept"), [(4.5, True), (6.0, False), (20.0, False), (49.0, False), (400.0, False)]
)
def test_what_moves_faster_than_any_vehicle_was_relocated_and_hits_nothing_on_its_way(
    step_m: float, is_swept: bool
) -> None:
    """No road user drives 100 m/s, which are 5 m in a tick. A bollard passes over a car that stands half way."""
    half, thin = step_m / 2, (0.4, 0.4)
    jumps = build_obstacle_motion(actors(("v", 0.0, -half, 0), size=thin), actors(("v", 0.0, half, 0), size=thin))
    body = VehicleState(0, 0, 0)
    settled, met = resolve_contacts({"e": body}, {"e": body}, {"e": MKZ_2017}, jumps, NOTHING)
    assert met == ((Contact("e", "v", Kind.VEHICLE),) if is_swept else ())
    assert (settled["e"] != body) is is_swept


@pytest.mark.parametrize("length", [0.4, 12.0, 80.0])
@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi / 2])
def test_what_touches_is_found_however_long_it_is(length: float, yaw: float) -> None:
    """A car before the end of a barrier, at right angles to it."""
    for gap, touching in ((0.005, True), (0.5, False)):
        away = length / 2 + gap + 1.0
        barrier = actors(("v", away * math.cos(yaw), away * math.sin(yaw), yaw), size=(length, 0.3))
        body = VehicleState(0, 0, yaw + math.pi / 2)
        _, met = resolve_contacts(
            {"e": body}, {"e": body}, {"e": MKZ_2017}, build_obstacle_motion(barrier, barrier), NOTHING
        )
        assert bool(met) is touching


@settings(max_examples=examples(60, 600), deadline=None)
@given(centred, st.floats(-7, 7), st.floats(-4, 4), angles, st.floats(-4.9, 4.9), st.floats(-4.9, 4.9))
def test_contacts_are_those_of_the_swept_boxes(
    ego: VehicleState, x: float, y: float, yaw: float, dx: float, dy: float
) -> None:
    """Two boxes, apart at first, one of which moves without turning: they touch if the hull of its ends touches."""
    ego = replace(ego, vx=0.0, yaw_rate=0.0)
    start, end = actors(("v", x, y, yaw)), actors(("v", x + dx, y + dy, yaw))
    boxes = [shapely.Polygon(box_corners(a.x[0], a.y[0], a.yaw[0], 4.5, 1.8)) for a in (start, end)]
    if not apart(outline(ego), boxes[0]):
        return
    gap = shapely.union_all(boxes).convex_hull.distance(outline(ego))
    _, met = resolve_contacts({"e": ego}, {"e": ego}, {"e": MKZ_2017}, build_obstacle_motion(start, end), NOTHING)
    if gap > 0.02:
        assert not met
    elif depth(shapely.union_all(boxes).convex_hull, outline(ego)) > 0.02:
        assert met


def test_two_that_pass_corner_by_corner_do_not_touch() -> None:
    """The other one is clear of the length of the first, 4.9 m, before it comes level with its side, 2 m."""
    before, after = VehicleState(4.89, 2.3, 0.0), VehicleState(5.2, 1.7, 0.0)
    standing = VehicleState(0, 0, 0)
    cars = dict.fromkeys("ab", MKZ_2017)
    passed = resolve_contacts({"a": standing, "b": before}, {"a": standing, "b": after}, cars, NOBODY, NOTHING)
    assert passed == ({"a": standing, "b": after}, ())


@pytest.mark.parametrize("overlap", [0.05, 0.5])
def test_boxes_that_overlap_already_are_pushed_apart_and_those_that_part_are_not(overlap: float) -> None:
    """What was put onto a car, or a car that starts in something."""
    put = actors(("v", 0.0, 1.9 - overlap, 0.0))
    body = VehicleState(0, 0, 0)
    settled, met = resolve_contacts({"e": body}, {"e": body}, {"e": MKZ_2017}, build_obstacle_motion(put, put), NOTHING)
    assert met == (Contact("e", "v", Kind.VEHICLE),)
    assert settled["e"].y == pytest.approx(-overlap, abs=0.002)
    parting = replace(body, y=-overlap - 0.1)
    settled, _ = resolve_contacts(
        {"e": body}, {"e": parting}, {"e": MKZ_2017}, build_obstacle_motion(put, put), NOTHING
    )
    assert settled["e"] == parting


def test_order_of_egos_does_not_matter() -> None:
    rows = {f"e{i}": VehicleState(4.8 * i, 0.1 * i, 0, vx=10.0 - 6 * i) for i in range(4)}
    cars = dict.fromkeys(rows, MKZ_2017)
    after = {ego: coasted(body) for ego, body in rows.items()}
    forward = resolve_contacts(rows, after, cars, NOBODY, NOTHING)
    backward = resolve_contacts(rows, dict(reversed(after.items())), cars, NOBODY, NOTHING)
    assert forward == (backward[0], backward[1])
    assert list(forward[1]) == sorted(forward[1], key=lambda c: (c.ego, c.other))


ARENA = [
    np.array(((-20.0, -20.0), (20.0, -20.0), (20.0, -19.0), (-20.0, -19.0))),
    np.array(((-20.0, 19.0), (20.0, 19.0), (20.0, 20.0), (-20.0, 20.0))),
    np.array(((-20.0, -20.0), (-19.0, -20.0), (-19.0, 20.0), (-20.0, 20.0))),
    np.array(((19.0, -20.0), (20.0, -20.0), (20.0, 20.0), (19.0, 20.0))),
    np.array(((-3.0, -3.0), (3.0, -3.0), (3.0, -1.0), (-1.0, -1.0), (-1.0, 3.0), (-3.0, 3.0))),
]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.full)])
def test_bumper_cars_stay_in_the_arena(seed: int) -> None:
    """Four cars with random pedals for 30 s: they never overlap each other or a wall, nor leave."""
    rng = np.random.default_rng(seed)
    arena = build_walls(ARENA)
    bodies = {
        f"e{i}": VehicleState(10 * math.cos(i * 1.57), 10 * math.sin(i * 1.57), rng.uniform(-3, 3)) for i in range(4)
    }
    cars, seen = dict.fromkeys(bodies, MKZ_2017), 0
    orders = {ego: Control(1, 0, 0) for ego in bodies}
    for tick in range(600):
        if tick % 20 == 0:
            orders = {ego: Control(rng.uniform(), float(rng.uniform() < 0.1), rng.uniform(-1, 1)) for ego in bodies}
        proposed = {ego: step(body, orders[ego], MKZ_2017) for ego, body in bodies.items()}
        bodies, met = resolve_contacts(bodies, proposed, cars, NOBODY, arena)
        seen += bool(met)
        shapes = [outline(body) for body in bodies.values()]
        for i, shape in enumerate(shapes):
            assert max(map(abs, shape.bounds)) < 19.01
            assert all(depth(shape, other) < 0.01 for other in shapes[i + 1 :])
            assert all(depth(shape, shapely.Polygon(piece)) < 0.01 for piece in arena.pieces)
    assert seen > 100
