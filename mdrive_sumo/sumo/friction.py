"""Slippery roads for SUMO's traffic: SUMO's friction device, which slows drivers down where a road is slippery.

At share f of the dry road's friction a driver takes -0.3491 f^2 + 0.8922 f + 0.4493 of the speed he would drive (SUMO's
documentation, Simulation/Friction; 0.90 at 0.7). SUMO's drivers brake as hard as ever. Those who keep to a schedule do
not ask for the speed limit and so do not slow down.
"""

# pyright: basic
import libsumo


def friction_options(grip: float) -> list[str]:
    """SUMO's options: on a slippery road everybody has the device, and none misjudges the road."""
    if grip == 1.0:
        return []  # a device draws random numbers: without it all is as on a road that nobody has thought about
    return ["--device.friction.probability", "1", "--device.friction.stdDev", "0"]


def make_slippery(grip: float) -> None:
    """All roads give that share of a dry road's friction. After the start of SUMO."""
    if grip < 1.0:
        for edge in libsumo.edge.getIDList():
            libsumo.edge.setFriction(edge, grip)
