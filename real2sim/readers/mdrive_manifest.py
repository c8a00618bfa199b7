"""Read MDrive's `actors_manifest.json` and `actors_behavior.json` (protocol 3.3, 3.4)."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.scenario_part import Seconds, Speed

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
    """[m/s]"""
    length: float | None = Field(default=None, gt=0, le=40)
    width: float | None = Field(default=None, gt=0, le=40)
    """[m]"""
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
