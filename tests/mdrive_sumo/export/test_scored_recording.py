"""Presences of road users, categories, and lanes of vehicles."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.state import Kind
from mdrive_sumo.export.lane_assignment import NO_LANE, assign_lanes
from mdrive_sumo.export.scored_recording import ScoredRecording, list_presences


@given(st.lists(st.booleans(), max_size=40))
def test_presences_cover_the_valid_ticks_in_maximal_runs(valid: list[bool]) -> None:
    presences = list_presences(np.array(valid, dtype=np.bool_))
    assert [tick for presence in presences for tick in presence] == [tick for tick, there in enumerate(valid) if there]
    assert all(len(presence) for presence in presences)
    assert all(after.start > before.stop for before, after in pairwise(presences))


@pytest.mark.slow
def test_categories_follow_the_scenario_then_kind_and_size(recording: ScoredRecording) -> None:
    categories = dict(zip(recording.record.ids, recording.categories, strict=True))
    assert categories == {
        **{"0": "car", "1": "car", "late": "car", "guest": "car"},
        **{"truck": "truck", "walker": "pedestrian", "cyclist": "bicycle", "cone": "static"},
    }


@pytest.mark.slow
def test_cavs_are_on_lanes_of_their_routes_and_walkers_on_none(recording: ScoredRecording) -> None:
    record, roads = recording.record, recording.roads
    lanes, positions = assign_lanes(recording, record.x, record.y)
    for column, ego in enumerate(recording.scenario.egos):
        names = {roads.driving[lane].id for lane in lanes[:, column].tolist()}
        assert names <= set(ego.lanes)
        assert (np.diff(positions[:, column]) > -1e-9).all() or len(names) > 1
    assert (lanes[:, record.kind == Kind.PEDESTRIAN] == NO_LANE).all() and (lanes[~record.valid] == NO_LANE).all()
