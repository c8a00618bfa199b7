"""When an MCM is due."""

from dataclasses import replace

import numpy as np
import pytest

from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose
from mdrive_sumo.v2x.services.mcm_rule import McmRule


def drive(tick: int, speed: float = 5.0, **changes: object) -> Mcm:
    """What a car announces that drives straight on from the origin."""
    x = speed * tick / 20
    planned = np.column_stack((x + speed * 0.2 * np.arange(1.0, 21.0), np.zeros(20)))
    mcm = Mcm(ReferencePose(x, 0.0, 0.0, tick), speed, Intention.KEEP, Direction.FOLLOW, 0.2, planned)
    return replace(mcm, **changes)


def test_a_car_that_does_what_it_announced_sends_once_a_second() -> None:
    rule = McmRule()
    assert [tick for tick in range(0, 60, 4) if rule.check(tick, drive(tick))] == [0, 20, 40]


@pytest.mark.parametrize(
    "changes",
    [
        {"intention": Intention.STOP},
        {"direction": Direction.LEFT},
        {"requests": {"b": Intention.SLOWER}},
        {"answers": {"b": True}},
        {"group": ("a", "b")},
        {"until_tick": 30},
        {"pose": ReferencePose(2.1, 0.0, 0.0, 4)},
        {"planned": np.zeros((20, 2))},
    ],
)
def test_what_it_intends_or_agrees_to_is_told_when_it_changes(changes: dict[str, object]) -> None:
    rule = McmRule()
    assert rule.check(0, drive(0))
    assert rule.check(4, drive(4, **changes))


def test_a_longer_validity_is_told_only_when_the_earlier_one_ends() -> None:
    rule = McmRule()
    sent = [tick for tick in range(0, 20, 4) if rule.check(tick, drive(tick, until_tick=28 + tick))]
    assert sent == [0, 8, 16]


def test_congestion_control_makes_the_interval_longer_up_to_a_second() -> None:
    rule = McmRule()
    changing = [drive(tick, group=(str(tick),)) for tick in range(0, 40, 4)]
    assert [mcm.pose.tick for mcm in changing if rule.check(mcm.pose.tick, mcm, dcc_ticks=10)] == [0, 12, 24, 36]
    assert [tick for tick in range(40, 80, 4) if rule.check(tick, drive(tick), dcc_ticks=999)] == [56, 76]
