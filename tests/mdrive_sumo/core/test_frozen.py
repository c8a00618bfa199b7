"""Instances of frozen dataclasses: what their own constructor makes."""

from dataclasses import FrozenInstanceError, dataclass

import numpy as np
import pytest
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.contract import Observation, OwnState, Plan, Reply
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.state import Actors, Frame


@dataclass(frozen=True, slots=True)
class Nothing:
    """Has no field."""


@pytest.mark.parametrize(
    ("cls", "values"),
    [
        (Nothing, ()),
        (OwnState, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.1, 0.2, 0.3)),
        (Plan, (np.ones((3, 2)), 0.2, "tracker")),
        (Reply, (None, None, (), (), None)),
        (Frame, (3, {}, Actors.empty(), {"a": "g"}, ())),
        (Observation, (5, None, None, {}, (), None, {}, {}, None, None, None, {})),
    ],
)
def test_instances_are_equal(cls: type, values: tuple[object, ...]) -> None:
    compare_twins("core_frozen_build_frozen", cls, *values)


def test_an_instance_is_frozen_and_lives_no_longer_than_it_is_used() -> None:
    points = np.ones((3, 2))
    plan = build_frozen(Plan, points, 0.2, "tracker")
    assert plan.points is points
    with pytest.raises(FrozenInstanceError):
        plan.interval_s = 0.3  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(TypeError):
        get_compiled("core_frozen_build_frozen")(Plan, points)
    with pytest.raises(AttributeError):
        get_compiled("core_frozen_build_frozen")(int, 3)
    with pytest.raises(TypeError, match="expected a class"):
        get_compiled("core_frozen_build_frozen")(plan, points, 0.2, "tracker")
