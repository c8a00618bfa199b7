"""Infraction: one thing that a CAV did wrong, and what it costs (protocol 7.1)."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Infraction:
    """One event of one CAV. `factor` multiplies its infraction penalty IP; 1.0 only marks the event."""

    kind: str
    tick: int
    x: float
    """Box centre of the CAV in that tick [m]."""
    y: float
    factor: float
    other: str = ""
    """Id of what it concerns: a road user ("" for a building), a stop sign, a traffic light."""


PENALTY: Mapping[str, float] = MappingProxyType(
    {
        "collision-pedestrian": 0.50,
        "collision-vehicle": 0.60,
        "collision-static": 0.65,
        "red-light": 0.70,
        "stop-sign": 0.80,
    }
)
"""Factors of the table; "outside-lanes" costs 1 - share instead, ends such as "blocked" cost nothing."""
