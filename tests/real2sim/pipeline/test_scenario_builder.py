"""What a scenario takes from a log beside its traffic."""

import numpy as np
from testing.small_log import FRAMES

from real2sim.pipeline.scenario_builder import _build_roadside_units
from real2sim.recording import ObserverView


def test_stations_stand_where_their_sensor_was_most_of_the_time() -> None:
    pose = np.tile((60.0, 12.0, 0.0), (FRAMES, 1))
    pose[:5] = (0.0, 0.0, 0.0)
    pose[5:9] = np.nan
    unseen = np.full((FRAMES, 3), np.nan)
    views = (
        ObserverView("-1", (), pose, is_infrastructure=True),
        ObserverView("-2", (), unseen, is_infrastructure=True),
        ObserverView("3", (), pose),
    )
    assert [(one.id, one.x, one.y) for one in _build_roadside_units(views)] == [("rsu1", 60.0, 12.0)]
