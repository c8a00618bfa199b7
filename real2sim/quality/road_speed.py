"""The highest speed that is plausible on the road of an actor.

MDrive's 30 m/s is that of a town. On a motorway drivers are faster, and without a limit far faster; but a limit that
the actor's own speed sets would check nothing. So the road sets it: its speed limit, or the traffic around.
"""

from collections.abc import Mapping

import numpy as np

TOWN_MPS = 30.0
"""[m/s] MDrive's limit for all roads."""
HIGHEST_MPS = 70.0
"""[m/s] 252 km/h, about where cars are limited by their makers (250 km/h)."""
OVER_ROAD = 1.5
"""Ours: 195 km/h where 130 km/h are allowed or usual, and 30 m/s up to 72 km/h."""
LEAST_OTHERS = 5
"""Fewer other vehicles say nothing about the traffic."""


def find_plausible_speeds(top_speeds: Mapping[str, float], limits: Mapping[str, float]) -> dict[str, float]:
    """Return the highest plausible speed [m/s] of every moving vehicle.

    `top_speeds`: the highest speed of every moving vehicle [m/s] by track id. `limits`: the highest speed limit [m/s]
    that the map gives on its way, by track id; vehicles without one are missing.
    """
    plausible: dict[str, float] = {}
    for id_ in top_speeds:
        others = [speed for other, speed in top_speeds.items() if other != id_]
        traffic = float(np.median(others)) if len(others) >= LEAST_OTHERS else 0.0
        road = OVER_ROAD * max(limits.get(id_, 0.0), traffic)
        plausible[id_] = min(max(TOWN_MPS, road), HIGHEST_MPS)
    return plausible
