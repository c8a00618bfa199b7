"""Class and size of CARLA blueprints, for files that name a blueprint without a size.

Sizes are typical for the class that the name suggests, not measured on CARLA's meshes: sizes in a file take precedence
(`mdrive_actors`).
"""

from dataclasses import dataclass

from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scripted_actor import KindName


@dataclass(frozen=True, slots=True)
class BlueprintShape:
    """A class of blueprints: length and width [m] and kind."""

    length: float
    width: float
    kind: KindName


CAR = BlueprintShape(4.7, 1.9, "vehicle")
PEDESTRIAN = BlueprintShape(0.5, 0.5, "pedestrian")
UNKNOWN_PROP = BlueprintShape(0.8, 0.8, "static")
"""A prop with an unknown name."""

BICYCLE = BlueprintShape(1.75, 0.6, "cyclist")
_MOTORCYCLE = BlueprintShape(2.2, 0.8, "vehicle")
_VAN = BlueprintShape(5.9, 2.0, "vehicle")
_TRUCK = BlueprintShape(8.5, 2.5, "vehicle")
_BUS = BlueprintShape(10.5, 2.5, "vehicle")
_SMALL = BlueprintShape(2.5, 1.5, "vehicle")

_VEHICLES: tuple[tuple[tuple[str, ...], BlueprintShape], ...] = (
    (("crossbike", "century", "omafiets", "bicycle", "cyclist", "bike."), BICYCLE),
    (("harley", "yamaha", "kawasaki", "vespa", "motorcycle", "scooter"), _MOTORCYCLE),
    (("firetruck", "carlacola", "truck.", "european_hgv"), _TRUCK),
    (("fusorosa", "bus."), _BUS),
    (("ambulance", "sprinter", "volkswagen.t2", "van."), _VAN),
    (("isetta", "microlino"), _SMALL),
)
"""Name parts (a dot is appended to each name); the first match counts. All others are cars."""

_PROPS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("cone",), "cone"),
    (("barrier", "guardrail"), "barrier"),
    (("crate", "box"), "crate"),
    (("trashcan", "trash", "bin", "container", "garbage"), "bin"),
    (("pallet",), "pallet"),
    (("sign", "warning"), "sign"),
)


def find_blueprint_shape(model: str) -> BlueprintShape | None:
    """Return the class of a blueprint such as `vehicle.lincoln.mkz_2017`; None if the name is not a blueprint."""
    name = model.lower() + "."
    if name.startswith("vehicle."):
        return next((shape for parts, shape in _VEHICLES if any(part in name for part in parts)), CAR)
    if name.startswith("walker."):
        return PEDESTRIAN
    if name.startswith("static."):
        known = next((prop for parts, prop in _PROPS if any(part in name for part in parts)), None)
        return (
            UNKNOWN_PROP
            if known is None
            else BlueprintShape(PROPS[known].length, PROPS[known].width, PROPS[known].kind)
        )
    return None
