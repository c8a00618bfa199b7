"""MDrive's actors: build scripted road users from manifest entries and route files (protocol 3.2 to 3.5)."""

import math
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    HardBrake,
    KindName,
    LaneChange,
    Motion,
    PathMotion,
    ReplayMotion,
    StandingMotion,
)
from real2sim.readers.carla_frame import CarlaFrame
from real2sim.readers.carla_route import RouteFile
from real2sim.readers.mdrive_manifest import DEFAULT_SPEED_BY_ROLE, ActorRole, ActorScript, ManifestEntry
from real2sim.xml_file import parse_finite


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
"""Length and width [m], typical of each class: files mostly name a blueprint and no size."""

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
        prop_name = next((prop for parts, prop in _PROPS if any(part in name for part in parts)), None)
        return (
            UNKNOWN_PROP
            if prop_name is None
            else BlueprintShape(PROPS[prop_name].length, PROPS[prop_name].width, PROPS[prop_name].kind)
        )
    return None


MIN_POINT_GAP_M = 1e-3
"""[m] Closer points of a path are duplicates."""
_SHAPE_BY_ROLE: dict[ActorRole, BlueprintShape] = {
    "npc": CAR,
    "pedestrian": PEDESTRIAN,
    "bicycle": BICYCLE,
    "static": UNKNOWN_PROP,
}


@dataclass(frozen=True, slots=True)
class AuthoredActor:
    """An actor as described by its files."""

    role: ActorRole
    entry: ManifestEntry
    route: RouteFile
    script: ActorScript | None

    @property
    def is_replay(self) -> bool:
        """Whether it repeats a log: the route file's control mode takes precedence over the manifest's.

        Times without any mode count as a log: in MDrive a flag of the whole run decides (protocol 3.5).
        """
        mode = self.route.attributes.get("control_mode") or self.entry.control_mode or "replay"
        return self.route.times_s is not None and len(self.route.xy_carla) > 1 and mode == "replay"

    @property
    def speed(self) -> float:
        """[m/s]"""
        given = (self.entry.speed, self.entry.target_speed, self.read_attribute("speed"))
        return next((value for value in given if value is not None), DEFAULT_SPEED_BY_ROLE[self.role])

    def read_attribute(self, name: str) -> float | None:
        """Return a number from the attributes of its route; raise InputError."""
        text = self.route.attributes.get(name)
        return None if text is None else parse_finite(f"{self.route.path}: route: {name}", text)


def build_actor(id_: str, authored: AuthoredActor, frame: CarlaFrame) -> tuple[Actor, tuple[str, ...]]:
    """Build the road user in the map's frame, with notes on what was skipped; raise InputError."""
    shape = find_blueprint_shape(_get_model(authored)) or _SHAPE_BY_ROLE[authored.role]
    length, width = _select_size(authored, shape)
    try:
        start, motion, notes = _build_motion(authored, frame)
        script, more = _drop_idle_script(authored.script, motion)
        actor = Actor(
            id=id_,
            kind=_select_kind(authored, shape),
            model=_get_model(authored)[:80],
            length=length,
            width=width,
            start=start,
            motion=motion,
            avoid_collision=authored.entry.avoid_collision is not False,
            trigger=script and script.trigger,
            action=script and script.action,
        )
    except ValidationError as error:
        raise InputError(f"{authored.route.path}: {describe_first_error(error)}") from None
    return actor, tuple(f"{id_}: {note}" for note in (*notes, *more, *_note_ignored(authored, motion)))


def _get_model(authored: AuthoredActor) -> str:
    return authored.route.attributes.get("model") or authored.entry.model or ""


def _select_size(authored: AuthoredActor, shape: BlueprintShape) -> tuple[float, float]:
    """Return the size given by the route, the manifest, the generator's box, or the class, in this order."""
    given = authored.entry
    length = (authored.read_attribute("length"), given.length, authored.read_attribute("bbox_length"))
    width = (authored.read_attribute("width"), given.width, authored.read_attribute("bbox_width"))
    return next(filter(None, length), shape.length), next(filter(None, width), shape.width)


def _select_kind(authored: AuthoredActor, shape: BlueprintShape) -> KindName:
    """Return the kind for collisions: a parked bicycle is a vehicle, like all of CARLA's `vehicle.*`."""
    if authored.role in ("pedestrian", "bicycle"):
        return "pedestrian" if authored.role == "pedestrian" else "cyclist"
    if authored.role == "npc":
        return "cyclist" if shape.kind == "cyclist" else "vehicle"
    return "vehicle" if shape.kind == "cyclist" else shape.kind


def _build_motion(authored: AuthoredActor, frame: CarlaFrame) -> tuple[Pose, Motion, list[str]]:
    xy, yaws = frame.to_map_xy(authored.route.xy_carla), _compute_yaws(authored.route, frame)
    start = Pose(x=xy[0, 0], y=xy[0, 1], yaw=yaws[0])
    # a replayed log can neither brake nor change lanes: an actor that shall do so drives along its points
    is_reactive = authored.script is not None and isinstance(authored.script.action, HardBrake | LaneChange)
    if authored.is_replay and not is_reactive:
        times = np.asarray(authored.route.times_s)
        poses = zip(times.tolist(), xy[:, 0].tolist(), xy[:, 1].tolist(), yaws, strict=True)
        return start, ReplayMotion(poses=tuple(poses)), []
    notes = ["has times, but is driven along its points"] if authored.route.times_s is not None and len(xy) > 1 else []
    points = _drop_repeated(xy)
    if authored.role == "static" and len(points) > 1:
        return start, StandingMotion(), [*notes, f"a static actor with {len(points)} points: stands at the first"]
    if authored.role == "static":
        return start, StandingMotion(), notes
    if len(points) == 1:
        return start, StandingMotion(), [*notes, "a single point: stands there"]
    ahead = math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0])
    path = PathMotion(points=tuple(points), speed=authored.speed)
    return start.model_copy(update={"yaw": ahead}), path, notes


def _note_ignored(authored: AuthoredActor, motion: Motion) -> list[str]:
    """Note what the file requests but does not get."""
    notes: list[str] = []
    if authored.route.attributes.get("snap_to_road", "").lower() == "true":
        notes.append("is not moved onto the road (snap_to_road), but is where its file says")
    if authored.route.has_point_speeds and isinstance(motion, PathMotion):
        notes.append(f"speeds at its points are not read, it drives at {motion.speed:g} m/s")
    return notes


def _compute_yaws(route: RouteFile, frame: CarlaFrame) -> list[float]:
    """Return the yaw [rad] at each point: that of the file, else the direction to the next point."""
    xy = frame.to_map_xy(route.xy_carla)
    if len(xy) == 1:
        return [frame.to_map_yaw(float(np.nan_to_num(route.yaw_carla_deg[0])))]
    hops = np.diff(xy, axis=0)
    ahead = np.arctan2(hops[:, 1], hops[:, 0]).tolist()
    given = route.yaw_carla_deg.tolist()
    return [
        course if math.isnan(yaw) else frame.to_map_yaw(yaw)
        for yaw, course in zip(given, [*ahead, ahead[-1]], strict=True)
    ]


def _drop_repeated(xy: Float) -> list[tuple[float, float]]:
    points: list[tuple[float, float]] = []
    for x, y in xy.tolist():
        if not points or math.dist(points[-1], (x, y)) > MIN_POINT_GAP_M:
            points.append((x, y))
    return points


def _drop_idle_script(script: ActorScript | None, motion: Motion) -> tuple[ActorScript | None, list[str]]:
    """Drop the script of a standing actor: MDrive writes scripts for static actors, too."""
    if script is not None and isinstance(motion, StandingMotion):
        return None, ["its behaviour does nothing, as it stands"]
    return script, []
