"""An infraction of a CAV and its penalty factor (protocol 7.1)."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class InfractionEvent:
    """One infraction of one CAV. `factor` multiplies its infraction penalty IP; 1.0 marks an event without penalty."""

    kind: str
    tick: int
    x: float
    """Box centre of the CAV in that tick [m]."""
    y: float
    factor: float
    other: str = ""
    """Id of the road user ("" for a building), stop sign or traffic light concerned."""
    impact_speed: float | None = None
    """Relative speed [m/s] in the tick before the contact; None for infractions other than collisions."""
