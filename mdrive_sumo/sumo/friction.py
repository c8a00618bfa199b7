"""Slippery roads for SUMO's traffic: SUMO's friction device reduces the speed of drivers.

At share f of the dry road's friction, a driver drives at -0.3491 f^2 + 0.8922 f + 0.4493 of the desired speed (SUMO's
documentation, Simulation/Friction; 0.90 at 0.7). Braking is unchanged. Vehicles on schedule ignore the speed limit, so
they do not slow down.
"""

# pyright: basic
# Because libsumo has no type information.
import libsumo


def build_friction_options(grip: float) -> list[str]:
    """Return SUMO's options: on a slippery road every vehicle has the device, without measurement error."""
    if grip == 1.0:
        return []  # the device draws random numbers, so a dry run must not have it
    return ["--device.friction.probability", "1", "--device.friction.stdDev", "0"]


def make_slippery(grip: float) -> None:
    """Set the friction of all roads to a share of a dry road's. Call after the start of SUMO."""
    if grip < 1.0:
        for edge in libsumo.edge.getIDList():
            libsumo.edge.setFriction(edge, grip)
