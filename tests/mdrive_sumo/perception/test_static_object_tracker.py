"""Static object tracker: duration and mean of standstills."""

import math

import numpy as np
import pytest
from testing.bent_road import things

from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.static_object_tracker import StaticObjectTracker

RECALL_S = 1.0


def test_an_object_that_moved_is_remembered() -> None:
    standing = StaticObjectTracker()
    for tick, x in enumerate((20.0, 20.0, 25.0, 25.0)):
        seen = things((x, 0.0, 0.0), (40.0, 0.0, 0.0))
        never_moved = standing.update(tick, seen, RECALL_S).never_moved
        assert never_moved.tolist() == [tick < 2, True]


class TestStanding:
    def test_the_mean_of_noisy_detections_is_more_accurate(self) -> None:
        rng, standing = np.random.default_rng(0), StaticObjectTracker()
        detections = [things((20.0 + rng.normal(0, 0.2), rng.normal(0, 0.2), rng.normal(0, 0.5))) for _ in range(20)]
        durations = [standing.update(4 * i, noisy, RECALL_S).duration_s for i, noisy in enumerate(detections)]
        best = standing.replace_by_means(detections[-1], np.array([True]))
        assert durations[-1] == pytest.approx([3.8])
        assert math.hypot(best.x[0] - 20.0, best.y[0]) < 0.12
        assert best.speed[0] == 0.0
        assert best.kind[0] == Kind.STATIC

    def test_a_creeping_object_does_not_stand(self) -> None:
        standing = StaticObjectTracker()
        for tick in range(0, 240, 4):
            duration_s = standing.update(tick, things((20.0 + 0.3 * tick * DT, 0.0, 0.3)), RECALL_S).duration_s
            assert duration_s[0] < 8.0

    def test_a_missed_object_is_added_for_a_second(self) -> None:
        standing, nothing = StaticObjectTracker(), things()
        for tick in range(0, 44, 4):
            standing.update(tick, things((20.0, 0.0, 0.0)), RECALL_S)
        assert standing.update(50, nothing, 1.0).objects.ids == ("b0",)
        assert standing.update(50, nothing, 3.0).objects.ids == ()
        assert standing.update(70, nothing, 1.0).objects.ids == ()
