"""Forged MCMs: priority without an agreement, and broken promises to yield."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.attacks.attack_settings import ForgedClaim
from mdrive_sumo.v2x.attacks.route_point import Receiver, RouteFollower, measure_square
from mdrive_sumo.v2x.content import MAX_NAMES, Intention, Mcm

REACH_M = 150.0
"""[m] Receivers further away are left alone: they are out of the range of most conflicts."""
ARRIVAL_S = 2.0
"""[s] Chosen: the sender says that it reaches the receiver's route in this time, before the receiver does."""
VALID_TICKS = 5 * TICKS_PER_SECOND
"""Chosen: longer than any agreement of the built-in agents holds."""


class McmForger:
    """Forges the MCMs of one attacker."""

    def __init__(self, name: str, claim: ForgedClaim) -> None:
        """name: the attacker's station id in messages."""
        self._name, self._claim, self._follower = name, claim, RouteFollower()

    def forge(self, mcm: Mcm, receivers: Sequence[Receiver]) -> Mcm:
        """Return the MCM that the attacker sends instead of its agent's."""
        near = [one for one in receivers if measure_square(one, mcm.pose.x, mcm.pose.y) < REACH_M * REACH_M]
        near = sorted(near, key=lambda one: (measure_square(one, mcm.pose.x, mcm.pose.y), one.name))[: MAX_NAMES - 1]
        names = [one.name for one in near]
        if self._claim is ForgedClaim.YIELD:
            return self._promise_to_yield(mcm, names)
        return self._claim_priority(mcm, names, near)

    def _promise_to_yield(self, mcm: Mcm, names: Sequence[str]) -> Mcm:
        """Return the MCM of a sender that stands from now on, and goes last."""
        standing = np.repeat(np.array([(mcm.pose.x, mcm.pose.y)]), max(len(mcm.planned), 1), axis=0)
        return replace(
            mcm,
            intention=Intention.STOP,
            planned=standing,
            desired=mcm.desired if len(mcm.desired) else mcm.planned,
            requests={self._name: Intention.STOP},
            answers=dict.fromkeys(names, True),
            until_tick=mcm.pose.tick + VALID_TICKS,
        )

    def _claim_priority(self, mcm: Mcm, names: Sequence[str], near: Sequence[Receiver]) -> Mcm:
        """Return the MCM of a sender that goes first, and will stand where the nearest receiver has to drive."""
        target = _find_target(self._follower, near)
        path = mcm.planned if target is None else _build_line(mcm, target)
        return replace(
            mcm,
            intention=Intention.FASTER,
            planned=path,
            desired=path,
            requests={**dict.fromkeys(names, Intention.STOP), self._name: Intention.FASTER},
            answers=dict.fromkeys(names, False),
            group=tuple(sorted((*names, self._name))),
            until_tick=mcm.pose.tick + VALID_TICKS,
        )


def _find_target(follower: RouteFollower, near: Sequence[Receiver]) -> tuple[float, float] | None:
    """Return the point [m] before which the nearest receiver has to brake."""
    for receiver in near:
        row = follower.find_braking_row(receiver)
        if row is not None:
            x, y = receiver.route[row].tolist()
            return x, y
    return None


def _build_line(mcm: Mcm, target: tuple[float, float]) -> Float:
    """Return points (K, 2) [m] from the sender straight to a target, where it then stands."""
    steps = (1.0 + np.arange(max(len(mcm.planned), 1))) * mcm.interval_s / ARRIVAL_S
    here = np.array((mcm.pose.x, mcm.pose.y))
    return here + np.minimum(steps, 1.0)[:, None] * (np.array(target) - here)
