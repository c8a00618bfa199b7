"""What a route does at each of its points: follows its lane, turns, or changes lanes.

A surrogate of the commands that CARLA's planner reads off its map: a briefing knows no junctions.
"""

import math
from enum import IntEnum
from itertools import pairwise

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int, wrap_angles

TURN_RAD = math.radians(45)
"""A bend in which the route turns by more than that is a turn."""
BEND_RAD_PER_M = 0.02
"""A route that turns by more than that per point (1 m) is in a bend: radii below 50 m."""
ASIDE_RAD = math.radians(4)
"""A route that leaves the direction of its lane by more than that changes lanes."""


class RouteCommand(IntEnum):
    """What a route does at a point; the numbers are places in the one-hot vectors of learned systems."""

    FOLLOW = 0
    LEFT = 1
    RIGHT = 2
    CHANGE_LEFT = 3
    CHANGE_RIGHT = 4


def find_route_commands(route_xy: Float, route_yaw: Float) -> Int:
    """Return the `RouteCommand` (N,) at each point of a route: points (N, 2) every metre [m], lane directions (N,)
    [rad].

    Bends that turn by more than `TURN_RAD` are turns; where the route leaves the direction of its lane by more than
    `ASIDE_RAD` it changes lanes; the rest follows the lane, straight across junctions too.
    """
    commands = np.full(len(route_yaw), int(RouteCommand.FOLLOW))
    turned = wrap_angles(np.diff(route_yaw, append=route_yaw[-1:]))
    bends = np.sign(turned) * (np.abs(turned) > BEND_RAD_PER_M)
    edges = [0, *(np.flatnonzero(np.diff(bends)) + 1).tolist(), len(bends)]
    for first, last in pairwise(edges):
        if bends[first] and abs(turned[first:last].sum()) > TURN_RAD:
            commands[first:last] = RouteCommand.LEFT if bends[first] > 0 else RouteCommand.RIGHT
    if len(route_yaw) > 1:
        along = np.gradient(route_xy, axis=0)
        aside = wrap_angles(portable.atan2(along[:, 1], along[:, 0]) - route_yaw)
        changes = (np.abs(aside) > ASIDE_RAD) & (commands == RouteCommand.FOLLOW)
        commands[changes] = np.where(aside[changes] > 0, int(RouteCommand.CHANGE_LEFT), int(RouteCommand.CHANGE_RIGHT))
    return commands
