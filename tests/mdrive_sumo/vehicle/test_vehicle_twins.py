"""Compiled dynamics, controllers and contacts have the bits of the Python text."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.contract import Control, Plan
from mdrive_sumo.core.state import Actors, EgoState
from mdrive_sumo.vehicle.contact import build_obstacle_motion, build_walls
from mdrive_sumo.vehicle.control.tracker import Tracker
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleParameters, VehicleState, to_vehicle_facts

ANY = st.floats(allow_nan=True, allow_infinity=True)
SHARES = st.one_of(st.floats(-1.0, 1.0), st.sampled_from((0.0, -0.0, 1.0)))
PLACES = st.one_of(st.floats(-60.0, 60.0), st.integers(-3, 3).map(float))
SPEEDS = st.one_of(st.floats(-5.0, 60.0), st.sampled_from((0.0, -0.0, 3.0, 57.5)))
STATES = st.builds(
    VehicleState,
    x=st.floats(-1e3, 1e3),
    y=st.floats(-1e3, 1e3),
    yaw=st.floats(-4.0, 4.0),
    vx=SPEEDS,
    vy=st.floats(-3.0, 3.0),
    yaw_rate=SHARES,
    steer_angle=SHARES,
    drive=SHARES,
    brake=SHARES,
)
NAMES = [field.name for field in fields(VehicleState)]
CONTROLS = st.builds(Control, throttle=SHARES, brake=SHARES, steer=SHARES)
WET = replace(MKZ_2017, grip=0.4)


@given(STATES, CONTROLS, st.sampled_from((MKZ_2017, WET)), st.sampled_from((1, 5, 7, 0, -1)))
def test_steps(state: VehicleState, control: Control, vehicle: VehicleParameters, sub_steps: int) -> None:
    compare_twins("vehicle_dynamics_step", state, control, vehicle, sub_steps)
    compare_twins("vehicle_dynamics_to_ego_state", state)


@given(STATES, CONTROLS, st.dictionaries(st.sampled_from(NAMES), ANY, min_size=1, max_size=3))
def test_steps_of_odd_states(state: VehicleState, control: Control, odd: dict[str, float]) -> None:
    compare_twins("vehicle_dynamics_step", replace(state, **odd), control, MKZ_2017)


@pytest.mark.parametrize("field", [field.name for field in fields(VehicleParameters)])
def test_steps_of_odd_vehicles(field: str) -> None:
    control = Control(0.5, 0.5, 0.5)
    for value in (0.0, -1.0, math.nan, math.inf):
        for vx in (0.0, 9.0):
            state = VehicleState(0.0, 0.0, 1.0, vx, 0.1, 0.1)
            compare_twins("vehicle_dynamics_step", state, control, replace(MKZ_2017, **{field: value}))


POINTS = st.one_of(
    st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=9),
    st.builds(
        lambda count, hop, turn: [(hop * i, turn * i * i) for i in range(1, count + 1)],
        st.integers(1, 60),
        st.floats(0.0, 2.0),
        st.floats(-0.05, 0.05),
    ),
)
PLANS = st.builds(Plan, POINTS.map(np.array), st.sampled_from((0.05, 0.1, 0.2, 0.5, 3.0)))
OWN = st.builds(
    EgoState, x=PLACES, y=PLACES, yaw=st.floats(-4.0, 4.0), speed=SPEEDS, acceleration=SHARES, yaw_rate=SHARES
)
FACTS = to_vehicle_facts(MKZ_2017)


@given(PLANS, OWN, st.integers(0, 90))
def test_tracked_plans(plan: Plan, own: EgoState, age_ticks: int) -> None:
    control = compare_twins("vehicle_control_tracker_follow_plan", plan, own, age_ticks, FACTS)
    assert control == Tracker(FACTS).follow(plan, own, age_ticks)


@given(PLANS, OWN, st.lists(ANY, max_size=4), st.dictionaries(st.sampled_from(("x", "yaw", "speed")), ANY), ANY)
def test_tracked_odd_plans(
    plan: Plan, own: EgoState, values: list[float], odd: dict[str, float], interval_s: float
) -> None:
    plan.points.ravel()[: len(values)] = values[: plan.points.size]
    for one in (plan, replace(plan, interval_s=interval_s), replace(plan, interval_s=0.0)):
        compare_twins("vehicle_control_tracker_follow_plan", one, replace(own, **odd), 3, FACTS)


@given(st.one_of(SHARES, ANY), st.one_of(SHARES, st.integers(-20000, 20000).map(lambda n: (n + 0.5) / 1e4)))
def test_rounded_controls(throttle: float, steer: float) -> None:
    compare_twins("vehicle_control_plan_reader_round_control", throttle, 1.0 - throttle, steer)


@given(PLANS, OWN, st.integers(0, 90), st.one_of(st.floats(-2.0, 20.0), st.sampled_from((0.2, 0.5, 1.0, 7.0))))
def test_read_plans(plan: Plan, own: EgoState, age_ticks: int, ahead: float) -> None:
    compare_twins("vehicle_control_plan_reader_sample_waypoints", plan, own, age_ticks, ahead, 4)
    compare_twins("vehicle_control_plan_reader_find_aim_point", plan, own, age_ticks, ahead)


@pytest.mark.parametrize("name", ["sample_waypoints", "find_aim_point"])
def test_a_plan_without_points_or_of_a_car_nowhere_is_refused(name: str) -> None:
    own, arguments = EgoState(0.0, 0.0, 0.0, 0.0), (0, 1.0, *((4,) if name == "sample_waypoints" else ()))
    for points, where in (
        (np.zeros((0, 2)), own),
        (np.ones((3, 3)), own),
        (np.ones((2, 2)), replace(own, yaw=math.nan)),
    ):
        with pytest.raises(ValueError, match=r"expected|found"):
            get_compiled(f"vehicle_control_plan_reader_{name}")(Plan(points, 0.1), where, *arguments)


CARS = st.builds(
    VehicleState,
    x=st.one_of(st.floats(-9.0, 9.0), st.integers(-9, 9).map(float)),
    y=st.one_of(st.floats(-4.0, 4.0), st.integers(-4, 4).map(float)),
    yaw=st.one_of(st.floats(-4.0, 4.0), st.sampled_from((0.0, 1.5))),
    vx=SPEEDS,
    vy=st.floats(-3.0, 3.0),
    yaw_rate=SHARES,
)
MOVES = st.tuples(*[st.one_of(st.floats(-2.0, 2.0), st.sampled_from((0.0, 1.0, 6.0)))] * 3)
Moving = list[tuple[VehicleState, tuple[float, ...]]]
MOVING = st.lists(st.tuples(CARS, MOVES), max_size=4)
TOWN = build_walls(
    [
        np.array(((6.0, -2.0), (9.0, -2.0), (9.0, 3.0), (8.0, 4.0), (6.0, 3.0))),
        np.array(((-9.0, 2.0), (9.0, 2.0), (0.0, 3.0))),
    ]
)


def build_actors(cars: list[VehicleState]) -> Actors:
    x, y, yaw = (np.array([getattr(car, name) for car in cars], dtype=float) for name in ("x", "y", "yaw"))
    ids, kind = tuple(f"v{i}" for i in range(len(cars))), np.arange(len(cars), dtype=np.uint8)
    return Actors(ids, kind, x, y, yaw, np.zeros(len(cars)), np.full(len(cars), 4.5), np.full(len(cars), 1.8))


def move(car: VehicleState, way: tuple[float, ...]) -> VehicleState:
    return replace(car, x=car.x + way[0], y=car.y + way[1], yaw=car.yaw + way[2] / 10)


def compare_contacts(
    cavs: list[tuple[VehicleState, VehicleState]], others: list[tuple[VehicleState, VehicleState]]
) -> None:
    names = [f"cav{(7 * i) % 5}" for i in range(len(cavs))]  # in no order
    before = {name: pair[0] for name, pair in zip(names, cavs, strict=True)}
    after = {name: pair[1] for name, pair in zip(names, cavs, strict=True)}
    vehicles = dict(zip(names, (MKZ_2017, replace(MKZ_2017, mass=900.0, yaw_inertia=1500.0)) * 2, strict=False))
    obstacles = build_obstacle_motion(*(build_actors([pair[i] for pair in others]) for i in (0, 1)))
    for walls in (TOWN, build_walls([])):
        compare_twins("vehicle_contact_resolve_contacts", before, after, vehicles, obstacles, walls)


@pytest.mark.slow
@given(MOVING, MOVING)
def test_contacts(
    cavs: list[tuple[VehicleState, tuple[float, ...]]], others: list[tuple[VehicleState, tuple[float, ...]]]
) -> None:
    compare_contacts(*([(car, move(car, way)) for car, way in cars] for cars in (cavs, others)))


@pytest.mark.slow
@given(
    MOVING, MOVING, st.lists(st.tuples(st.integers(0, 9), st.sampled_from(("x", "y", "yaw", "vx")), ANY), max_size=3)
)
def test_contacts_of_odd_bodies(
    cavs: list[tuple[VehicleState, tuple[float, ...]]],
    others: list[tuple[VehicleState, tuple[float, ...]]],
    odd: list[tuple[int, str, float]],
) -> None:
    groups = [[[car, move(car, way)] for car, way in cars] for cars in (cavs, others)]
    states = [pair for group in groups for pair in group]
    for i, name, value in odd:
        if i // 2 < len(states):
            states[i // 2][i % 2] = replace(states[i // 2][i % 2], **{name: value})
    compare_contacts(*groups)


def test_cars_that_nearly_stand_and_nearly_touch() -> None:
    rng = np.random.default_rng(0)
    for _ in range(400):
        vx, vy, yaw_rate = rng.uniform(-1.0, 1.0, 3) * 10 ** rng.uniform(-4.0, 0.0, 3)
        slow = VehicleState(0.0, 0.0, 0.3, float(vx), float(vy), float(yaw_rate))
        compare_twins("vehicle_dynamics_step", slow, Control(0.0, 0.0, 0.1), MKZ_2017)
        first, second = VehicleState(0.0, 0.0, 0.0, 3.0, 0.0, 0.0), VehicleState(4.7, 0.0, 0.0, 0.0, 0.0, 0.0)
        moved = replace(
            second,
            x=4.7 + rng.choice((0.0, 0.01, -1e-3)) + rng.uniform(-1e-3, 1e-3) * rng.choice((1.0, 0.1)),
            y=rng.uniform(-3.0, 3.0),
        )
        compare_contacts(
            [(first, replace(first, yaw=rng.choice((0.0, 0.01))))],
            [(moved, replace(moved, x=float(moved.x) + rng.choice((0.0, 0.002))))],
        )


def test_plans_that_nearly_collapse() -> None:
    rng = np.random.default_rng(0)
    for _ in range(400):
        hops = rng.choice((0.0, 2e-6, 9e-7, 0.05, 0.055, 0.25, 0.26), (int(rng.integers(1, 9)), 1)) * rng.choice(
            (0.0, 1.0), 2
        )
        own = EgoState(*rng.uniform(-0.2, 0.2, 4).tolist())
        plan = Plan(np.cumsum(hops, axis=0) + rng.choice((0.0, 0.105), 2), 0.2)
        compare_twins("vehicle_control_tracker_follow_plan", plan, own, 1, FACTS)
        compare_twins("vehicle_control_plan_reader_find_aim_point", plan, replace(own, x=0.0, y=0.0), 0, 0.3)
