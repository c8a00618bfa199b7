"""Drivers without messages that try to make up for it: faster than the limits, or more cautious than `single`.

The tier must not be solved by a choice of options. So the search drives these too, and the suite bounds their means.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OptionedDriver:
    """A built-in agent with options."""

    name: str
    """In figures and tables."""
    agent: str
    config: Mapping[str, float]


def _build_single(name: str, **options: float) -> OptionedDriver:
    return OptionedDriver(f"single, {name}", "single", dict(options))


SPEEDING_DRIVERS = tuple(_build_single(f"{share:g} x the limit", speed_share=share) for share in (1.2, 1.5, 2.0))
"""Haste as a substitute for messages."""
CAUTIOUS_DRIVERS = (
    _build_single("0.9 x the limit", speed_share=0.9),
    _build_single("0.8 x the limit", speed_share=0.8),
    _build_single("0.7 x the limit", speed_share=0.7),
    _build_single("0.55 x the limit", speed_share=0.55),
    OptionedDriver("idm", "idm", {}),
    OptionedDriver("idm, 0.7 x the limit", "idm", {"speed_share": 0.7}),
    OptionedDriver("take-turns, 4 slots", "take-turns", {"slots": 4.0}),
    OptionedDriver("creeping", "constant-speed", {"speed": 2.0}),
)
