"""Commands of a route: turns by angle and side, lane changes by side, everything else follows the lane."""

import math

import numpy as np
import pytest

from mdrive_sumo.agents.learned.system_spec import COMMANDS
from mdrive_sumo.planning.route_commands import RouteCommand, find_route_commands


def bend(turn: float) -> tuple[np.ndarray, np.ndarray]:
    """20 m straight, a bend of radius 10 m by that angle [rad], 20 m straight."""
    yaw = np.concatenate((np.zeros(20), np.linspace(0, turn, int(abs(turn) * 10) + 1), np.full(20, turn)))
    middle = (yaw[1:] + yaw[:-1]) / 2
    steps = np.column_stack((np.cos(middle), np.sin(middle)))
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0))), yaw


@pytest.mark.parametrize(
    ("turn_deg", "command"),
    [(90, RouteCommand.LEFT), (-90, RouteCommand.RIGHT), (50, RouteCommand.LEFT), (40, None), (-40, None)],
)
def test_a_bend_is_a_turn_from_45_degrees_on(turn_deg: float, command: RouteCommand | None) -> None:
    found = find_route_commands(*bend(math.radians(turn_deg)))
    assert set(found) == {RouteCommand.FOLLOW} | ({command} if command else set())


def test_the_commands_of_learned_systems_have_the_same_order() -> None:
    names = [command.name.lower().replace("_", "-") for command in RouteCommand]
    assert tuple(names) == COMMANDS and [int(command) for command in RouteCommand] == list(range(len(COMMANDS)))


def test_a_route_of_one_point_follows_its_lane() -> None:
    assert find_route_commands(np.zeros((1, 2)), np.zeros(1)).tolist() == [RouteCommand.FOLLOW]
