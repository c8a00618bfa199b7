"""Read MDrive's `actors_manifest.json` and `actors_behavior.json` (protocol 3.3, 3.4)."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.scenario_part import Seconds, Speed
from mdrive_sumo.scenario.scripted_actor import Action, DistanceTrigger, HardBrake, LaneChange, StartMotion

MANIFEST = "actors_manifest.json"
BEHAVIOR = "actors_behavior.json"

ActorRole = Literal["ego", "npc", "static", "pedestrian", "bicycle"]
ROLE_BY_KEY: Mapping[str, ActorRole] = {
    "ego": "ego",
    "npc": "npc",
    "static": "static",
    "static_prop": "static",
    "pedestrian": "pedestrian",
    "walker": "pedestrian",
    "bicycle": "bicycle",
    "cyclist": "bicycle",
    "bike": "bicycle",
}
"""Keys of the manifest, including aliases."""
DEFAULT_SPEED_BY_ROLE: Mapping[ActorRole, float] = {"npc": 8.0, "pedestrian": 1.5, "bicycle": 4.0, "static": 0.0}
"""[m/s] Used where the files give no speed."""

_T = TypeVar("_T")
DEFAULT_DISTANCE_M = 8.0
"""[m] Distance of a trigger that names none, as in MDrive (protocol 3.4)."""
DISTANCE_LIMITS_M = (1.0, 50.0)
"""Trigger distances are clamped to these."""


class _ManifestModel(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False, coerce_numbers_to_str=True)


class ManifestEntry(_ManifestModel):
    """A road user or a prop."""

    file: str
    """Path of its route file in the scenario folder."""
    name: str = ""
    route_id: str | None = None
    town: str | None = None
    model: str | None = None
    speed: Speed | None = None
    target_speed: Speed | None = None
    """Speeds [m/s]; the first one that is given counts."""
    length: float | None = Field(default=None, gt=0, le=40)
    width: float | None = Field(default=None, gt=0, le=40)
    """Length and width [m] of the box."""
    avoid_collision: bool | None = None
    control_mode: str | None = None


class TriggerEntry(_ManifestModel):
    """Trigger of an actor; MDrive has only this kind."""

    type: Literal["distance_to_vehicle"] = "distance_to_vehicle"
    vehicle: str
    distance_m: float | None = None


class ActionEntry(_ManifestModel):
    """Action of an actor."""

    type: Literal["start_motion", "hard_brake", "lane_change"] = "start_motion"
    direction: Literal["left", "right"] | None = None
    target_vehicle: str | None = None
    brake_hold_s: Seconds | None = None
    resume_speed_mps: Speed | None = None
    pacing: bool | None = None
    min_drive_distance_m: float | None = Field(default=None, ge=0, le=1000)


class BehaviorEntry(_ManifestModel):
    """Behaviour of an actor."""

    actor_name: str
    route_id: str | None = None
    trigger: TriggerEntry | None = None
    action: ActionEntry | None = None


class _BehaviorFile(_ManifestModel):
    behaviors: tuple[BehaviorEntry, ...]


def read_manifest(folder: Path) -> tuple[tuple[ActorRole, ManifestEntry], ...]:
    """Return all entries with their roles, in the order of the file; raise InputError."""
    path = folder / MANIFEST
    groups = _read_json(path, TypeAdapter(dict[str, tuple[ManifestEntry, ...]]))
    for key in groups:
        if key not in ROLE_BY_KEY:
            raise InputError(f"{path}: expected lists named {', '.join(ROLE_BY_KEY)}, found {key!r}")
    return tuple((ROLE_BY_KEY[key], entry) for key, entries in groups.items() for entry in entries)


def read_behaviors(folder: Path) -> tuple[BehaviorEntry, ...]:
    """Return the behaviours of a scenario, none without the file; raise InputError."""
    path = folder / BEHAVIOR
    return _read_json(path, TypeAdapter(_BehaviorFile)).behaviors if path.is_file() else ()


def _read_json(path: Path, shape: TypeAdapter[_T]) -> _T:
    try:
        data: Any = json.loads(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # broken JSON, no text at all, or nested without end
        raise InputError(f"{path}: expected JSON, found: {error}") from None
    try:
        return shape.validate_python(data)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None


@dataclass(frozen=True, slots=True)
class ActorScript:
    """Trigger and action of an actor."""

    trigger: DistanceTrigger
    action: Action


@dataclass(frozen=True, slots=True)
class ActorScripts:
    """Scripts by actor name, with notes on what was skipped or changed."""

    by_actor: Mapping[str, ActorScript]
    notes: tuple[str, ...]


def read_scripts(folder: Path, route_id: str, actors: Collection[str], vehicles: Mapping[str, str]) -> ActorScripts:
    """Read the behaviours of a scenario; raise InputError.

    Only those of route `route_id` count. `actors` are the names in the manifest, `vehicles` maps the names of CAVs
    (`Vehicle 1` is ego 0) to their ids.
    """
    of: dict[str, ActorScript] = {}
    notes: list[str] = []
    for number, entry in enumerate(read_behaviors(folder)):
        where = f"{folder / BEHAVIOR}: behavior {number}"
        if entry.route_id not in (None, route_id):
            notes.append(f"behaviour {number} of {entry.actor_name} is of route {entry.route_id}: skipped")
            continue
        if entry.actor_name not in actors:
            names = ", ".join(actors) or "none"
            raise InputError(
                f"{where}: actor_name: expected an actor of the manifest ({names}), found {entry.actor_name!r}"
            )
        if entry.trigger is None or entry.actor_name in of:
            why = "without a trigger" if entry.trigger is None else "a second one"
            notes.append(f"behaviour {number} of {entry.actor_name}: {why}, skipped")
            continue
        of[entry.actor_name] = _build_script(where, entry, entry.trigger, vehicles)
        notes += _note_clamping(entry)
    return ActorScripts(of, tuple(notes))


def map_vehicle_names(egos: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return names of CAVs -> ids, from (id, name in the manifest): `Vehicle k` is ego k - 1 whatever its name."""
    return {name: id_ for id_, name in egos if name} | {f"Vehicle {int(id_) + 1}": id_ for id_, _ in egos}


def _build_script(where: str, entry: BehaviorEntry, trigger: TriggerEntry, vehicles: Mapping[str, str]) -> ActorScript:
    distance = DEFAULT_DISTANCE_M if trigger.distance_m is None else trigger.distance_m
    return ActorScript(
        DistanceTrigger(
            vehicle=_find_vehicle(f"{where}: trigger: vehicle", trigger.vehicle, vehicles),
            distance_m=min(max(distance, DISTANCE_LIMITS_M[0]), DISTANCE_LIMITS_M[1]),
        ),
        _build_action(where, entry.action or ActionEntry(), vehicles),
    )


def _build_action(where: str, entry: ActionEntry, vehicles: Mapping[str, str]) -> Action:
    driven = 0.0 if entry.min_drive_distance_m is None else entry.min_drive_distance_m
    if entry.type == "hard_brake":
        return HardBrake(
            hold_s=HardBrake().hold_s if entry.brake_hold_s is None else entry.brake_hold_s,
            resume_speed=entry.resume_speed_mps,
            pacing=entry.pacing is not False,
            least_driven_m=driven,
        )
    if entry.type == "lane_change":
        target = entry.target_vehicle
        return LaneChange(
            direction=entry.direction,
            target_vehicle=target and _find_vehicle(f"{where}: action: target_vehicle", target, vehicles),
            pacing=entry.pacing is not False,
            least_driven_m=driven,
        )
    return StartMotion()


def _find_vehicle(where: str, name: str, vehicles: Mapping[str, str]) -> str:
    if name not in vehicles:
        raise InputError(f"{where}: expected one of {', '.join(vehicles)}, found {name!r}")
    return vehicles[name]


def _note_clamping(entry: BehaviorEntry) -> list[str]:
    distance = None if entry.trigger is None else entry.trigger.distance_m
    if distance is None or DISTANCE_LIMITS_M[0] <= distance <= DISTANCE_LIMITS_M[1]:
        return []
    return [f"trigger distance of {entry.actor_name}: {distance:g} m, clamped to [1, 50] m"]
