"""The boxes of all motions at once: the same answers as one exact test for each pair of boxes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Cause, Reason, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.planning.motion_conflicts import MotionConflicts
from mdrive_sumo.planning.motion_prediction import STRIDE, TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import MARGINS, SafetyMargin
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps
from mdrive_sumo.planning.reference_path import build_path
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

VEHICLE: VehicleFacts = to_vehicle_facts(MKZ_2017)
OTHER = Reason(Cause.AVOID, ("other",))
_S = np.arange(121.0)
PATH = build_path(np.column_stack((_S, 20 * portable.sin(_S / 30))), VEHICLE.rear_to_centre)
CELLS: Int = np.arange(0, len(PATH.xy), 4)


@st.composite
def motions(draw: st.DrawFn) -> PredictedMotion:
    x, y, yaw = draw(st.tuples(st.floats(-20, 140), st.floats(-40, 40), st.floats(-3.1, 3.1)))
    rows = draw(st.integers(1, len(TIMES)))
    stands = draw(st.booleans())
    travelled = np.minimum(draw(st.floats(0, 15)) * TIMES[:rows], draw(st.floats(0, 60)))
    poses = np.column_stack((x + travelled * portable.cos(yaw), y + travelled * portable.sin(yaw), np.full(rows, yaw)))
    length = 5.0 + travelled / 3 if draw(st.booleans()) else 5.0
    return PredictedMotion(poses, length, 2.0, OTHER, stands, draw(st.sampled_from((0.0, 0.0, 3.0))))


def overlap_each(motion: PredictedMotion, length: float, width: float, cells: Int) -> Bool:
    mine = compute_footprints(PATH, length, width, cells)
    x, y, yaw = motion.poses.T
    theirs = boxes_corners(x, y, yaw, np.asarray(motion.length), np.asarray(motion.width))
    met = np.zeros((len(TIMES), len(cells)), dtype=np.bool_)
    met[: len(theirs)] = boxes_overlap(theirs[:, None], mine[None])
    if motion.stands_at_end:
        met[len(theirs) :] = met[len(theirs) - 1]
    return met


def find_blocked(motion: PredictedMotion, margin: SafetyMargin) -> Bool:
    length, width = VEHICLE.length, VEHICLE.width
    met = overlap_each(motion, length + 2 * margin.longitudinal, width + 2 * margin.lateral, CELLS)
    if motion.min_gap_m > margin.longitudinal:
        met |= overlap_each(motion, length + 2 * motion.min_gap_m, width, CELLS)
    return met


@given(st.lists(motions(), max_size=5))
def test_cells_are_blocked_as_by_single_tests(found: list[PredictedMotion]) -> None:
    conflicts = MotionConflicts(PATH, VEHICLE, found)
    expected = np.zeros((len(TIMES), len(CELLS)), dtype=np.bool_)
    after = np.zeros(len(CELLS), dtype=np.bool_)
    for motion in found:
        blocked = find_blocked(motion, MARGINS.plan)
        expected |= blocked
        after |= blocked[-1] & motion.stands_at_end
    assert np.array_equal(conflicts.find_blocked(CELLS, MARGINS.plan), np.repeat(expected, STRIDE, axis=0))
    assert np.array_equal(conflicts.find_blocked_after(CELLS, MARGINS.plan), after)


@given(st.lists(motions(), max_size=5))
def test_a_schedule_meets_what_single_tests_meet(found: list[PredictedMotion]) -> None:
    cells = CELLS[:30]
    expected = np.zeros(len(cells), dtype=np.bool_)
    margin = MARGINS.check
    size = VEHICLE.length + 2 * margin.longitudinal, VEHICLE.width + 2 * margin.lateral
    for motion in found:
        expected |= np.diagonal(overlap_each(motion, *size, cells))
    assert np.array_equal(MotionConflicts(PATH, VEHICLE, found).find_met(cells, margin), expected)


@given(st.integers(0, 70), st.integers(0, 30), st.integers(0, 2**31))
def test_pairs_of_sets_of_any_size_are_those_of_single_tests(first: int, second: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    one, other = (_draw_corners(random, count) for count in (first, second))
    assert np.array_equal(compute_overlaps(one, other), boxes_overlap(one[:, None], other[None]))


def _draw_corners(random: np.random.Generator, count: int) -> Float:
    x, y, yaw = random.uniform(-20, 20, (2, count)), random.uniform(-20, 20, count), random.uniform(-3, 3, count)
    return boxes_corners(x[0], y, yaw, random.uniform(1, 12, count), random.uniform(0.5, 3, count))
