"""Poses of the log between its frames, and where paths come near each other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from real2sim.traffic_fidelity.log_simulation import TimedPath
from real2sim.traffic_fidelity.passing_order import CONFLICT_M, find_conflict_points

numbers = st.floats(-1e4, 1e4, width=32)


@given(st.data())
def test_a_pose_is_interpolated_as_numpy_does(data: st.DataObject) -> None:
    times = np.array(sorted(data.draw(st.sets(st.integers(0, 200), min_size=2, max_size=12)))) * 0.1
    states = data.draw(arrays(np.float64, (len(times), 4), elements=numbers))
    path = TimedPath(times, states, stays=True)
    asked = (*times, *data.draw(st.lists(st.floats(times[0] - 1e-7, times[-1] + 5.0), max_size=8)))
    sampled, there = path.sample(np.array(asked))
    assert there.all()
    for k, time in enumerate(asked):
        state = path.at(float(time))
        assert list(state or ()) == sampled[k].tolist()
        expected = [np.interp(time, times, column) for column in states.T]
        assert state is not None
        assert list(state) == expected


def test_an_object_is_there_from_its_first_to_its_last_pose() -> None:
    path = TimedPath(np.array((0.1, 0.2)), np.zeros((2, 4)))
    asked = np.array((0.0, 0.1 - 1e-7, 0.15, 0.2 + 1e-7, 0.3))
    assert path.sample(asked)[1].tolist() == [path.at(time) is not None for time in asked.tolist()]
    assert path.sample(asked)[1].tolist() == [False, True, True, True, False]


def test_paths_meet_where_they_first_come_near() -> None:
    along = np.linspace(0.0, 60.0, 61)
    east = np.column_stack((along, np.zeros(61)))
    north = np.column_stack((np.full(61, 30.0), along - 30.0))
    (point,) = find_conflict_points({"east": east, "north": north})
    assert max(abs(point.first_at[0] - 30.0), abs(point.first_at[1])) <= CONFLICT_M
    assert not find_conflict_points({"east": east, "far": north + np.array((0.0, 200.0))})
    assert not find_conflict_points({"east": east, "beside": east + np.array((0.0, CONFLICT_M + 0.01))})
