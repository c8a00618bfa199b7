"""SUMO's own traffic: background vehicles of a scenario, added once and held where an impact stops them."""

# pyright: basic
from collections.abc import Collection

import libsumo

from mdrive_sumo.scenario.traffic import Background, BackgroundVehicle
from mdrive_sumo.state import TICKS_PER_SECOND

HELD_TICKS = 2 * TICKS_PER_SECOND
"""How long a struck background vehicle stands (design/architecture, decisions)."""


class Traffic:
    """Background vehicles from their departure on. One object an episode."""

    def __init__(self, background: Background) -> None:
        self._background = background
        self._held: dict[str, int] = {}

    def add(self) -> None:
        """Hands all vehicles over to SUMO; they depart by themselves. Once, after the start of SUMO."""
        for vehicle in self._background.vehicles:
            _add(vehicle)

    def hold(self, struck: Collection[str], tick: int) -> None:
        """Struck vehicles stand for a while: a surrogate, SUMO knows no impact."""
        ours = {vehicle.id for vehicle in self._background.vehicles} if struck else set()
        self._held |= dict.fromkeys(ours.intersection(struck), tick + HELD_TICKS)
        if not self._held:
            return
        present = set(libsumo.vehicle.getIDList())
        for vehicle, until in sorted(self._held.items()):
            if vehicle not in present or tick >= until:
                del self._held[vehicle]
                if vehicle in present:
                    libsumo.vehicle.setSpeed(vehicle, -1)
            else:
                libsumo.vehicle.setPreviousSpeed(vehicle, 0.0)
                libsumo.vehicle.setSpeed(vehicle, 0.0)


def _add(vehicle: BackgroundVehicle) -> None:
    libsumo.route.add(vehicle.id, list(vehicle.edges))
    libsumo.vehicle.add(
        vehicle.id, vehicle.id, depart=f"{vehicle.depart_s:.3f}", departLane=str(vehicle.depart_lane),
        departPos=str(vehicle.depart_pos_m), departSpeed=str(vehicle.depart_speed),
    )  # fmt: skip
