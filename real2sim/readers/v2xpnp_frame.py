"""Read agent folders and frames of V2XPnP and its relatives: one 10 Hz YAML file of one agent.

Most files have one fixed layout (PyYAML's dump of the dataset's fields), for which libyaml takes seconds per log. They
are parsed by one regular expression; every other file goes through the YAML parser with the same result.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.input_files import read_text
from real2sim.readers.input_checks import check_frame_count, describe_value
from real2sim.recording import ObjectCategory

COLUMNS = ("angle", "center", "extent", "location")
"""Fields of an object, three numbers each, in the order of `V2xpnpFrame.boxes`."""

AGENT = re.compile(r"-?[0-9]+")
"""Name of the folder of an agent."""
RIGID = 1e-3
"""Largest error of the product of a rotation and its transpose; poses in files of V2V4Real are rounded near 1e-6."""

SAFE_DEPTH = 1000
"""Levels of nested values that libyaml's binding reads without trouble; a frame has four."""
CATEGORY_BY_LABEL: Mapping[str, ObjectCategory] = MappingProxyType(
    {
        **dict.fromkeys(("car", "policecar"), ObjectCategory.CAR),
        **dict.fromkeys(("van", "ambulance"), ObjectCategory.VAN),
        **dict.fromkeys(("truck", "longvehicle", "concretetruck", "firetruck", "trailer"), ObjectCategory.TRUCK),
        "bus": ObjectCategory.BUS,
        **dict.fromkeys(("motorcycle", "motorcyclerider"), ObjectCategory.MOTORCYCLE),
        **dict.fromkeys(("bicyclerider", "cyclist", "bicycle", "scooter", "scooterrider"), ObjectCategory.BICYCLE),
        **dict.fromkeys(("pedestrian", "child", "roadworker"), ObjectCategory.PEDESTRIAN),
        **dict.fromkeys(
            ("trashcan", "trafficcone", "cone", "barrier", "constructioncart", "firehydrant"), ObjectCategory.STATIC
        ),
    }
)
"""Labels without case and separators."""
CATEGORY_BY_LENGTH: tuple[tuple[float, ObjectCategory], ...] = (
    (1.2, ObjectCategory.PEDESTRIAN),
    (2.6, ObjectCategory.BICYCLE),
    (6.5, ObjectCategory.CAR),
    (math.inf, ObjectCategory.TRUCK),
)
"""Category of an object without known label by the length of its box [m]; CARLA's motorcycles are up to 2.4 m long."""


@dataclass(frozen=True, slots=True)
class V2xpnpFrame:
    """One file in its own units (degrees, half sizes). All lists refer to the same N objects."""

    infrastructure: bool
    sensor: tuple[float, ...]
    """x, y, z [m], roll, yaw, pitch [degrees] of the lidar."""
    ids: tuple[str, ...]
    labels: tuple[str, ...]
    static: tuple[bool, ...]
    boxes: Float
    """(N, 12): three numbers for each of `COLUMNS`."""
    matrix: Float | None = None
    """(4, 4) from the frame of the lidar, in which the boxes of such a file are, to the world; None: they are in it."""
    shared_ids: tuple[str, ...] = ()
    """`ass_id`: names that an object has for all observers, "" for none; empty if `matrix` is None."""


def read_frame(path: Path, typed: bool = True) -> V2xpnpFrame:
    """Read one file; raise InputError if it is truncated, not YAML, or incomplete.

    `typed`: whether every object needs a type; else a missing one is "", and the pose may be a matrix (V2V4Real).
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected UTF-8 text, found other bytes") from None
    if not text.endswith("\n"):
        raise InputError(f"{path}: expected a last line with its end, found {text[-20:]!r}: the file is cut off")
    frame = _parse_regular(text) or _parse_yaml(path, text, typed)
    _check_finite(path, frame)
    return frame


_NUMBER = r"-?(?:0|[1-9][0-9]*)(?:\.[0-9]+(?:e[-+][0-9]+)?)?"
"""Numbers of YAML 1.1 that Python's float() parses identically."""
_EXPONENT = re.compile(r"-?[0-9]+e[-+][0-9]{1,3}")
_THREE = rf"    - ({_NUMBER})\n" * 3
_SIX = rf"- ({_NUMBER})\n" * 6
_HEAD = re.compile(
    rf"(?:cam[0-9]\w*:\n(?:  [^\n]*\n)+)*ego_speed: {_NUMBER}\ninfra: (true|false)\n"
    rf"lidar_pose:\n{_SIX}true_ego_pose:\n(?:- {_NUMBER}\n){{6}}vehicles:(?: \{{\}})?\n"
)
_OBJECT = re.compile(
    rf"^  (0|[1-9][0-9]*):\n    angle:\n{_THREE}    attribute: (''|static)\n    center:\n{_THREE}    extent:\n{_THREE}"
    rf"    location:\n{_THREE}    obj_type: ([A-Z][A-Za-z]+)\n(    speed: {_NUMBER}\n)?",
    re.MULTILINE,
)
_LINES = 19
"""Number of lines of an object without speed."""
_WORDS = frozenset(("yes", "no", "true", "false", "on", "off", "null"))
"""Labels that YAML does not read as text."""


def _parse_regular(text: str) -> V2xpnpFrame | None:
    """Return the frame if all lines follow the dataset's fixed layout, else None."""
    head = _HEAD.match(text)
    if head is None:
        return None
    rows: list[tuple[str, ...]] = _OBJECT.findall(text, head.end())
    lines = sum(_LINES + (row[15] != "") for row in rows)
    if lines != text.count("\n", head.end()):
        return None
    unique = {row[0]: row for row in rows}  # the YAML parser keeps the last one of equal keys, too
    rows = list(unique.values())
    if any(row[14].lower() in _WORDS for row in rows):
        return None
    numbers = [row[1:4] + row[5:14] for row in rows]
    return V2xpnpFrame(
        infrastructure=head[1] == "true",
        sensor=tuple(map(float, head.groups()[1:])),
        ids=tuple(unique),
        labels=tuple(row[14] for row in rows),
        static=tuple(row[4] == "static" for row in rows),
        boxes=np.array(numbers, dtype=np.float64).reshape(-1, 12),
    )


def _parse_yaml(path: Path, text: str, typed: bool = True) -> V2xpnpFrame:
    """Return the frame of any YAML text; raise InputError."""
    import yaml  # only here, as its loader: most logs do without

    from real2sim.readers.numpy_yaml import NumpyLoader

    try:
        _check_depth(path, text)
        raw: Any = yaml.load(text, NumpyLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: expected well-formed YAML, found: {reason}") from None
    if not isinstance(raw, Mapping):
        raise InputError(f"{path}: expected a mapping with lidar_pose and vehicles, found {type(raw).__name__}")
    vehicles = raw.get("vehicles") or {}
    if not isinstance(vehicles, Mapping):
        raise InputError(f"{path}: vehicles: expected a mapping of objects, found {type(vehicles).__name__}")
    items = [_check_object(path, key, item, typed) for key, item in vehicles.items()]
    where, pose = f"{path}: lidar_pose", raw.get("lidar_pose")
    matrix = None if typed or not isinstance(pose, list) or len(pose) != 4 else _parse_matrix(where, pose)
    sensor = _parse_numbers(where, pose, 6) if matrix is None else _find_pose(matrix)
    if matrix is None:  # same content; incomplete in truncated files
        _parse_numbers(f"{path}: true_ego_pose", raw.get("true_ego_pose", sensor), 6)
    return V2xpnpFrame(
        infrastructure=raw.get("infra") is True,
        sensor=sensor,
        ids=tuple(map(str, vehicles)),
        labels=tuple(str(item.get("obj_type", "")) for item in items),
        static=tuple(item.get("attribute") == "static" for item in items),
        boxes=np.array([_parse_box(path, key, item) for key, item in zip(vehicles, items, strict=True)]).reshape(
            -1, 12
        ),
        matrix=matrix,
        shared_ids=() if matrix is None else tuple(map(_find_shared_id, items)),
    )


def _parse_matrix(where: str, raw: list[Any]) -> Float:
    """Return a transform (4, 4); raise InputError if it does more than move and turn."""
    matrix = np.array([_parse_numbers(f"{where}: row {i}", row, 4) for i, row in enumerate(raw)])
    turn = matrix[:3, :3]
    small = np.isfinite(matrix).all() and np.abs(turn).max() < 2  # else products of large numbers overflow
    rigid = small and np.abs(turn @ turn.T - np.eye(3)).max() < RIGID and np.linalg.det(turn) > 0
    if not rigid or matrix[3].tolist() != [0, 0, 0, 1]:
        raise InputError(f"{where}: expected a rotation, a translation and a last row 0, 0, 0, 1, found {raw}")
    return matrix


def _find_pose(matrix: Float) -> tuple[float, ...]:
    """Return x, y, z [m], roll, yaw, pitch [degrees] of a transform; the inverse of OpenCOOD's `x_to_world`."""
    roll, yaw = math.atan2(-matrix[2, 1], matrix[2, 2]), math.atan2(matrix[1, 0], matrix[0, 0])
    pitch = math.asin(max(-1.0, min(1.0, matrix[2, 0])))
    return (*matrix[:3, 3].tolist(), *map(math.degrees, (roll, yaw, pitch)))


def _find_shared_id(item: Mapping[str, Any]) -> str:
    id_ = item.get("ass_id", -1)
    return str(id_) if type(id_) is int and id_ >= 0 else ""


def _check_depth(path: Path, text: str) -> None:
    """Raise InputError for collections nested so deeply that libyaml's binding overflows the stack and crashes."""
    indents = (len(line) - len(line.lstrip(" -?:")) for line in text.splitlines())
    if text.count("[") + text.count("{") + max(indents, default=0) <= SAFE_DEPTH:
        return
    import yaml

    depth = 0
    for event in yaml.parse(text, yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > SAFE_DEPTH:
            raise InputError(f"{path}: expected values at most {SAFE_DEPTH} deep, found more")


def _check_object(path: Path, key: object, raw: object, typed: bool) -> Mapping[str, Any]:
    if not isinstance(raw, Mapping):
        raise InputError(f"{path}: object {key}: expected a mapping with location, found {describe_value(raw)}")
    if typed and "obj_type" not in raw:
        raise InputError(
            f"{path}: object {key}: expected obj_type, found only {', '.join(map(str, raw))}"
            " (logs without types, as OPV2V has them: mdrive-sumo convert opv2v)"
        )
    return raw


def _parse_box(path: Path, key: object, item: Mapping[str, Any]) -> tuple[float, ...]:
    where = f"{path}: object {key}"
    given = {"center": (0, 0, 0), **item}
    return tuple(number for name in COLUMNS for number in _parse_numbers(f"{where}: {name}", given.get(name), 3))


def _parse_numbers(where: str, raw: object, count: int) -> tuple[float, ...]:
    if not isinstance(raw, list | tuple) or len(raw) != count or not all(map(_is_number, raw)):
        raise InputError(f"{where}: expected {count} numbers, found {describe_value(raw)}")
    try:
        return tuple(map(float, raw))
    except OverflowError:
        raise InputError(f"{where}: expected {count} numbers, found an integer of more than 308 digits") from None


def _is_number(value: object) -> bool:
    """Return whether a value is a number; YAML 1.1 reads those without a point, such as 1e-05, as text."""
    return type(value) in (int, float) or (isinstance(value, str) and _EXPONENT.fullmatch(value) is not None)


def _check_finite(path: Path, frame: V2xpnpFrame) -> None:
    if not all(map(math.isfinite, frame.sensor)):
        raise InputError(f"{path}: lidar_pose: expected finite numbers, found {list(frame.sensor)}")
    bad = np.argwhere(~np.isfinite(frame.boxes))
    if len(bad):
        row, column = bad[0].tolist()
        raise InputError(
            f"{path}: object {frame.ids[row]}: {COLUMNS[column // 3]}: expected finite numbers, "
            f"found {frame.boxes[row, column]}"
        )


def list_agents(folder: Path, named: str) -> list[int]:
    """Return the numbers of the agent folders, CAVs first, then stations, whose numbers are negative.

    `named`: how folders of CAVs are named, for the error. Raises InputError without any CAV.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder with one folder an agent, found none")
    numbers = sorted(int(path.name) for path in folder.iterdir() if path.is_dir() and AGENT.fullmatch(path.name))
    cavs, stations = [n for n in numbers if n >= 0], [n for n in numbers if n < 0][::-1]
    if not cavs:
        raise InputError(f"{folder}: expected agent folders {named} of CAVs, found {numbers or 'none'}")
    return [*cavs, *stations]


def list_frames(folder: Path, digits: str, named: str) -> dict[int, Path]:
    """Return the frame files of an agent by number, in order.

    `digits`: pattern of the numbers. `named`: how the files are named, for the error. Raises InputError without any.
    """
    files = {int(p.stem): p for p in sorted(folder.glob("*.yaml")) if re.fullmatch(digits, p.stem)}
    if not files:
        raise InputError(f"{folder}: expected frames {named}, found no such file")
    check_frame_count(str(folder), len(files))
    return dict(sorted(files.items()))


def find_category(label: str) -> ObjectCategory | None:
    """Return the category of a label in any case and with any separators; None if it is unknown."""
    return CATEGORY_BY_LABEL.get(re.sub(r"[^a-z]", "", label.lower()))


def find_category_by_length(length_m: float) -> ObjectCategory:
    """Return the category that fits the length of a box."""
    return next(category for largest, category in CATEGORY_BY_LENGTH if length_m <= largest)
