"""Plans as labels, and the rigs that a data set records."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.contract import OwnState, Plan
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.plan_labels import PLAN_TIMES_S, label_plan, move_plan, sample_plan
from mdrive_sumo.learning.recorded_rigs import (
    build_rig_sensors,
    find_recorded_rig,
    find_rig_system,
    format_sensor_id,
    list_stored_images,
    parse_rig_names,
    select_rig_outputs,
)

states = st.builds(
    lambda x, y, yaw: OwnState(x, y, yaw, 5.0, 0.0, 0.0, 0.0),
    st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(-math.pi, math.pi),
)  # fmt: skip
plans = st.builds(
    lambda points, interval_s: Plan(np.array(points), interval_s),
    st.lists(st.tuples(st.floats(-600.0, 600.0), st.floats(-600.0, 600.0)), min_size=1, max_size=12),
    st.sampled_from([0.1, 0.25, 0.5]),
)


@given(plans, states)
def test_a_plan_is_met_at_its_points_and_stays_at_its_end(plan: Plan, own: OwnState) -> None:
    times = plan.interval_s * np.arange(1, len(plan.points) + 1)
    np.testing.assert_allclose(sample_plan(plan, own, times), plan.points, atol=1e-9)
    np.testing.assert_allclose(sample_plan(plan, own, np.array((0.0,))), [(own.x, own.y)])
    np.testing.assert_allclose(sample_plan(plan, own, times[-1:] + 5.0), plan.points[-1:])
    half = (np.array((own.x, own.y)) + plan.points[0]) / 2
    np.testing.assert_allclose(sample_plan(plan, own, times[:1] / 2)[0], half, atol=1e-9)


@given(plans, states)
def test_labels_are_distances_ahead_and_to_the_left(plan: Plan, own: OwnState) -> None:
    labels, there = label_plan(plan, own), sample_plan(plan, own, PLAN_TIMES_S)
    ahead, left = (math.cos(own.yaw), math.sin(own.yaw)), (-math.sin(own.yaw), math.cos(own.yaw))
    gaps = there - (own.x, own.y)
    np.testing.assert_allclose(labels, np.column_stack((gaps @ ahead, gaps @ left)), atol=1e-6)


@given(plans, states, states)
def test_a_moved_plan_looks_the_same_to_the_car_that_gets_it(plan: Plan, first: OwnState, second: OwnState) -> None:
    moved = move_plan(plan, first, second)
    np.testing.assert_allclose(label_plan(moved, second), label_plan(plan, first), atol=1e-6)
    np.testing.assert_allclose(move_plan(moved, second, first).points, plan.points, atol=1e-6)
    assert (moved.interval_s, moved.controller) == (plan.interval_s, plan.controller)


RIGS = sorted({spec.rig for spec in SYSTEMS.values()})


def test_rigs_are_recorded_once_under_the_name_of_the_rig_that_has_their_images() -> None:
    recorded = parse_rig_names([*RIGS, *RIGS])
    assert list(recorded) == sorted(set(recorded))
    assert {find_recorded_rig(rig) for rig in RIGS} == set(recorded)
    for rig in RIGS:
        stored = find_recorded_rig(rig)
        assert find_recorded_rig(stored) == stored
        assert find_rig_system(stored).rig == stored
    with pytest.raises(InputError, match=r"^--rig: .*nowhere"):
        parse_rig_names(["nowhere"])


def test_sensors_of_all_rigs_have_different_ids_and_come_back_under_their_own() -> None:
    recorded = parse_rig_names(RIGS)
    ids = [spec.id for spec in build_rig_sensors(recorded)]
    assert len(set(ids)) == len(ids)
    for spec in SYSTEMS.values():
        own = {one.id for one in find_rig_system(find_recorded_rig(spec.rig)).build_sensors()}
        outputs = select_rig_outputs(spec, {id_: id_ for id_ in ids})
        assert outputs
        assert set(outputs) <= own
        stored = find_recorded_rig(spec.rig)
        assert all(format_sensor_id(stored, name) == id_ for name, id_ in outputs.items())


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_image_that_a_system_sees_is_recorded(name: str) -> None:
    spec = SYSTEMS[name]
    ids = {one.id for one in build_rig_sensors([find_recorded_rig(spec.rig)])}
    for image in spec.images:
        assert set(list_stored_images(spec, image)) <= ids
