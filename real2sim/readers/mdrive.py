"""MDrive scenario directories: CAVs, actors with their behaviours, weather (protocol 3, data_formats 4).

<scenario>/actors_manifest.json  [actors_behavior.json]
           NAME_<index>.xml            route of a CAV
           NAME_<index>_REPLAY.xml     logged motion of that CAV: not driven
           actors/.../*.xml            the others; the manifest decides which
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.weather import WeatherName
from real2sim.hd_map import HdMap
from real2sim.readers.carla_frame import UCLA_FRAME, CarlaFrame
from real2sim.readers.carla_route import RouteFile, parse_ego_index, read_route_file
from real2sim.readers.mdrive_actors import AuthoredActor, build_actor
from real2sim.readers.mdrive_manifest import (
    MANIFEST,
    ActorRole,
    ManifestEntry,
    map_vehicle_names,
    read_manifest,
    read_scripts,
)
from real2sim.source_scene import CavRoute, SourceScene, TownMap

REPLAY_SUFFIX = "_REPLAY"
MAX_START_GAP_M = 5.0
"""[m] If a CAV's route begins further from its logged motion, the logged path is used instead."""
VIA_SPACING_M = 8.0
"""[m] Spacing of the via points taken from a logged motion."""
CLOUDY = 65.0
"""Cloudiness [%] half-way between MDrive's default (30) and its presets cloudy and overcast (100)."""
RAIN = 22.5
"""Precipitation [%] half-way between MDrive's preset cloudy (15) and CARLA's 0.9.12 soft rain (30)."""


@dataclass(frozen=True)
class VectorMap:
    """Map of V2XPnP's scenarios, and the pose of CARLA's origin in it."""

    map: HdMap
    frame: CarlaFrame = UCLA_FRAME


@dataclass(frozen=True, slots=True)
class _CavFile:
    id: str
    name: str
    route: RouteFile


@dataclass(frozen=True, slots=True)
class _ScenarioDraft:
    """Contents of a scenario directory, with the notes so far."""

    folder: Path
    cavs: tuple[_CavFile, ...]
    actors: tuple[tuple[ActorRole, ManifestEntry], ...]
    notes: list[str] = field(default_factory=list[str])

    @property
    def town(self) -> str:
        return self.cavs[0].route.town

    @property
    def route_id(self) -> str:
        return self.cavs[0].route.id


def find_mdrive_folders(paths: Iterable[Path]) -> tuple[Path, ...]:
    """Return all scenario directories in or below the given ones, in order; raise InputError if one has none."""
    folders: list[Path] = []
    for path in paths:
        here = sorted(manifest.parent for manifest in path.rglob(MANIFEST))
        if not here:
            raise InputError(f"{path}: expected a directory with {MANIFEST} in it or below, found none")
        folders += here
    return tuple(folders)


def read_mdrive(folder: Path, map: Path | VectorMap) -> SourceScene:
    """Read a scenario directory; `map` is a folder of CARLA towns or a vector map. Raises InputError."""
    draft = _read_draft(folder)
    frame = map.frame if isinstance(map, VectorMap) else CarlaFrame()
    weather, note = find_nearest_weather(draft.cavs[0].route.weather)
    routes = tuple(CavRoute(cav.id, frame.to_map_xy(_select_via_points(cav, draft))) for cav in draft.cavs)
    actors = _build_actors(draft, frame)
    category, number = _parse_names(folder)
    logged = isinstance(map, VectorMap)
    return SourceScene(
        id=number if logged else f"{category}_{number}",
        source="mdrive",
        bucket="V2XPnP" if logged else "Interaction",
        category="real2sim" if logged else category,
        map=map.map if isinstance(map, VectorMap) else TownMap(draft.town, map),
        routes=routes,
        actors=actors,
        weather=weather,
        description=f"MDrive {category}/{folder.name}: {len(routes)} CAVs, {len(actors)} actors",
        notes=(*draft.notes, *([note] if note else [])),
    )


def _parse_names(folder: Path) -> tuple[str, str]:
    """Return category and number from the folder names, restricted to characters of ids."""
    category, number = (re.sub(r"[^A-Za-z0-9_.+-]", "_", part) for part in folder.resolve().parts[-2:])
    return category, number


def _read_draft(folder: Path) -> _ScenarioDraft:
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a scenario directory, found none")
    entries = read_manifest(folder)
    cavs = _read_cavs(folder, [entry for role, entry in entries if role == "ego"])
    draft = _ScenarioDraft(folder, cavs, tuple((role, entry) for role, entry in entries if role != "ego"))
    for cav in cavs:
        if (cav.route.town, cav.route.id) != (draft.town, draft.route_id):
            raise InputError(
                f"{cav.route.path}: expected route {draft.route_id!r} in {draft.town} as in {cavs[0].route.path.name},"
                f" found route {cav.route.id!r} in {cav.route.town}"
            )
    return draft


def _read_cavs(folder: Path, entries: Sequence[ManifestEntry]) -> tuple[_CavFile, ...]:
    """Return the CAVs of the manifest sorted by index; those of all route files if it names none."""
    named = {entry.file: entry.name for entry in entries if not Path(entry.file).stem.endswith(REPLAY_SUFFIX)}
    files = list(named) or [p.name for p in folder.glob("*.xml") if parse_ego_index(p) is not None and p.name[0] != "."]
    cavs: dict[int, _CavFile] = {}
    for file in files:
        path = _find_file(folder, file)
        index = parse_ego_index(path)
        if index is None:
            raise InputError(f"{folder / MANIFEST}: ego: expected a file NAME_<number>.xml, found {file!r}")
        if index in cavs:
            raise InputError(f"{folder}: expected one file for each CAV, found {index} twice")
        cavs[index] = _CavFile(str(index), named.get(file, ""), read_route_file(path, at_least=2))
    if not cavs:
        raise InputError(f"{folder}: expected route files NAME_<number>.xml of CAVs, found none")
    return tuple(cavs[index] for index in sorted(cavs))


def _find_file(folder: Path, file: str) -> Path:
    path = folder / file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{folder / MANIFEST}: expected a file in the scenario's folder, found {file!r}")
    if not path.is_file():
        raise InputError(f"{folder / MANIFEST}: expected its file {file} to be there, found no such file")
    return path


def _select_via_points(cav: _CavFile, draft: _ScenarioDraft) -> Float:
    """Return the CAV's via points in CARLA's frame; those of its logged motion if the route begins elsewhere."""
    path = cav.route.path.with_name(cav.route.path.stem + REPLAY_SUFFIX + cav.route.path.suffix)
    if not path.is_file():
        return cav.route.xy_carla
    logged = read_route_file(path).xy_carla
    gap = float(np.hypot(*(cav.route.xy_carla[0] - logged[0])))
    if gap <= MAX_START_GAP_M:
        draft.notes.append(f"CAV {cav.id}: its logged motion {path.name} is not driven")
        return cav.route.xy_carla
    draft.notes.append(f"CAV {cav.id}: route from {path.name}, as its own route begins {gap:.1f} m from there")
    thinned = _thin_points(logged)
    if len(thinned) < 2:
        raise InputError(
            f"{path}: expected a motion of at least 2 points that are {VIA_SPACING_M:g} m apart, found none"
        )
    return thinned


def _thin_points(xy: Float) -> Float:
    kept = [0]
    for i in range(1, len(xy)):
        if np.hypot(*(xy[i] - xy[kept[-1]])) >= VIA_SPACING_M:
            kept.append(i)
    return xy[kept]


def _build_actors(draft: _ScenarioDraft, frame: CarlaFrame) -> tuple[Actor, ...]:
    names = [_get_name(entry) for _, entry in draft.actors]
    vehicles = map_vehicle_names([(cav.id, cav.name) for cav in draft.cavs])
    scripts = read_scripts(draft.folder, draft.route_id, names, vehicles)
    draft.notes.extend(scripts.notes)
    actors: list[Actor] = []
    taken = {cav.id for cav in draft.cavs}
    for role, entry in draft.actors:
        if not _belongs_to_scenario(entry, draft):
            continue
        route = read_route_file(_find_file(draft.folder, entry.file))
        id_ = _find_free_id(_get_name(entry), taken)
        taken.add(id_)
        actor, notes = build_actor(
            id_, AuthoredActor(role, entry, route, scripts.by_actor.get(_get_name(entry))), frame
        )
        actors.append(actor)
        draft.notes.extend(notes)
    return tuple(actors)


def _belongs_to_scenario(entry: ManifestEntry, draft: _ScenarioDraft) -> bool:
    """Return whether the entry has the scenario's route, and its town if it names one."""
    fits = entry.route_id in (None, draft.route_id) and entry.town in (None, draft.town)
    if not fits:
        draft.notes.append(f"{_get_name(entry)} is of route {entry.route_id} in {entry.town}: skipped")
    return fits


def _get_name(entry: ManifestEntry) -> str:
    return entry.name or Path(entry.file).stem


def _find_free_id(name: str, taken: set[str]) -> str:
    """Return the name as a valid id, with a suffix if it is taken."""
    plain = re.sub(r"[^A-Za-z0-9_.+-]", "_", name)[:70]
    plain = plain if plain[:1].isalnum() else f"a{plain}"
    return next(
        candidate for n in range(1, len(taken) + 2) if (candidate := plain if n == 1 else f"{plain}.{n}") not in taken
    )


def find_nearest_weather(numbers: Mapping[str, float]) -> tuple[WeatherName, str]:
    """Return the preset and a note on the original parameters, "" if none is needed. Night precedes rain."""
    sun, clouds = numbers.get("sun_altitude_angle", 70.0), numbers.get("cloudiness", 30.0)
    rain, fog = numbers.get("precipitation", 0.0), numbers.get("fog_density", 0.0)
    name: WeatherName = "default"
    if sun < 0:
        name = "night"
    elif rain >= RAIN:
        name = "rain"
    elif clouds >= CLOUDY:
        name = "cloudy"
    if name == "default" and fog == 0 and rain == 0:
        return name, ""
    return name, (
        f"weather {name}: the nearest to sun altitude {sun:g} deg, cloudiness {clouds:g} %, precipitation {rain:g} %,"
        f" fog {fog:g} %"
    )
