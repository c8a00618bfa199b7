"""`idm` advances by the time between two observations, whatever that is."""

import numpy as np
import pytest
from testing.planning import briefing, own, seen, things

from mdrive_sumo.agents.idm import IdmAgent
from mdrive_sumo.contract import Plan
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT

SPEED = 5.0


def plan_after(seconds: float, stride: int) -> Float:
    """The planned points at that time, of a car at constant speed that is asked in every `stride`-th tick."""
    agent, points = IdmAgent({}), np.zeros((0, 2))
    agent.start(briefing())
    for tick in range(0, round(seconds / DT) + 1, stride):
        plan = agent.act(seen(tick, own(SPEED * tick * DT, speed=SPEED), things())).plan
        assert isinstance(plan, Plan)
        points = plan.points
    return points


@pytest.mark.parametrize("stride", [2, 3, 4])
def test_plans_do_not_depend_on_how_often_it_is_asked(stride: int) -> None:
    """In open loop it is asked five times a second, with a late clock once per reply: it used to advance by a tick."""
    seconds = 96 * DT  # the reference has caught up with the car, from a standstill
    assert plan_after(seconds, stride)[:, 0] == pytest.approx(plan_after(seconds, 1)[:, 0], abs=0.25)
