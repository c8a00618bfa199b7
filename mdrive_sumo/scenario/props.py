"""Props: static objects by name, with the size of their box and the kind of collision with them.

Sizes are of common products (traffic cones 0.3 to 0.5 m wide, New Jersey barriers 0.6 m wide and here cut into pieces
of 2 m, Euro pallets 1.2 m x 0.8 m), not measured on CARLA's meshes, which are not available here.
"""

from dataclasses import dataclass

from mdrive_sumo.scenario.scripted_actor import KindName


@dataclass(frozen=True, slots=True)
class PropType:
    """Length and width [m] of a prop; hitting it counts as a collision with `kind`.

    The infraction penalty is multiplied by 0.65 for a static object, by 0.60 for a vehicle (protocol 7.1).
    """

    length: float
    width: float
    kind: KindName = "static"


PROPS: dict[str, PropType] = {
    "cone": PropType(0.4, 0.4),
    "barrier": PropType(2.0, 0.6),
    "crate": PropType(1.2, 0.8),
    "bin": PropType(0.8, 0.8),
    "pallet": PropType(1.2, 0.8),
    "sign": PropType(0.8, 0.3),
    "parked-car": PropType(4.6, 1.85, "vehicle"),
    "parked-van": PropType(5.9, 2.0, "vehicle"),
    "parked-truck": PropType(8.5, 2.5, "vehicle"),
}
