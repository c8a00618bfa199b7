"""Drivers without messages that try to make up for it: faster than the limits, or more cautious than `single`.

The tier must not be solved by a choice of options. So the search drives these too, and the suite bounds their means.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OptionedDriver:
    """A built-in agent with options."""

    name: str
    """How figures and tables call it."""
    agent: str
    config: Mapping[str, float]


def _build_single(name: str, **options: float) -> OptionedDriver:
    return OptionedDriver(f"single, {name}", "single", dict(options))


SPEEDING_DRIVERS = tuple(_build_single(f"{share:g} x the limit", speed_share=share) for share in (1.2, 1.5, 2.0))
"""Haste as a substitute for messages."""
CAUTIOUS_DRIVERS = (
    _build_single("0.85 x the limit", speed_share=0.85),
    _build_single("0.7 x the limit", speed_share=0.7),
    _build_single("0.55 x the limit", speed_share=0.55),
    _build_single("0.6 x the limit at junctions", junction_share=0.6),
    _build_single("0.4 x the limit at junctions", junction_share=0.4),
    _build_single("0.25 x the limit at junctions", junction_share=0.25),
    _build_single("0.8 x the limit, 0.4 x at junctions", speed_share=0.8, junction_share=0.5),
    OptionedDriver("idm", "idm", {}),
    OptionedDriver("idm, gaps of 2.5 s", "idm", {"time_gap": 2.5}),
    OptionedDriver("take-turns, 4 slots", "take-turns", {"slots": 4.0}),
)
"""Slower everywhere, slower where others may come from behind a corner, and rules that yield to all or wait. A quarter
of 50 km/h is a walk of 3.5 m/s, at which a car stops within two metres."""
