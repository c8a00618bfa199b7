"""Read OpenStreetMap XML: nodes, ways and relations, projected to the plane."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.readers.input_checks import build_missing_error, parse_points
from real2sim.xml_file import Element, read_number, read_xml

UTM_OF_ORIGIN = "EPSG:32631"
"""UTM zone 31 north, which contains the origin (0, 0)."""


@dataclass(frozen=True)
class OsmWay:
    """A line of nodes."""

    id: str
    nodes: tuple[str, ...]
    tags: Mapping[str, str]

    @property
    def reversed(self) -> "OsmWay":
        """The way in the opposite direction."""
        return replace(self, nodes=self.nodes[::-1])


@dataclass(frozen=True)
class OsmRelation:
    """A relation of members with roles."""

    id: str
    members: tuple[tuple[str, str], ...]
    """Role and id of every member."""
    tags: Mapping[str, str]

    def list_members(self, *roles: str) -> tuple[str, ...]:
        """Return the ids of the members with one of the roles."""
        return tuple(id_ for role, id_ in self.members if role in roles)


@dataclass(frozen=True)
class OsmFile:
    """Contents of a file without deleted elements; nodes are (2,) [m]."""

    path: Path
    nodes: Mapping[str, Float]
    ways: Mapping[str, OsmWay]
    """Ways of at least two distinct points, all of them in the file, and of a plausible length."""
    relations: Mapping[str, OsmRelation]
    unusable_ways: Mapping[str, str]
    """Id of a way that is not among `ways` -> what is wrong with it."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was skipped."""
        if not self.unusable_ways:
            return ()
        first = next(iter(self.unusable_ways.values()))
        return (f"{len(self.unusable_ways)} ways of the map skipped, the first: {first}",)

    def build_line(self, way: OsmWay) -> Float:
        """Return the points (N, 2) [m], N >= 2."""
        return parse_points(f"{self.path}: way {way.id}", [self.nodes[node] for node in way.nodes])

    def list_relations(self, name: str) -> Iterator[OsmRelation]:
        """Yield the relations of a type."""
        return (relation for relation in self.relations.values() if relation.tags.get("type") == name)

    def list_ways(self, relation: OsmRelation, *roles: str) -> tuple[OsmWay, ...]:
        """Return the ways with these roles, each once, without those that the file lacks."""
        return tuple(self.ways[id_] for id_ in dict.fromkeys(relation.list_members(*roles)) if id_ in self.ways)


def read_osm(path: Path, utm_origin: tuple[float, float] | None = None) -> OsmFile:
    """Read a file and project it like Lanelet2's UtmProjector with the origin (0, 0); raise InputError.

    `utm_origin` is another origin, easting and northing [m] in the UTM zone of the map's nodes.
    """
    root = read_xml(path)
    if root.tag != "osm":
        raise InputError(f"{path}: expected the root <osm>, found <{root.tag}>")
    return parse_osm(path, root, lambda degrees: _project(path, degrees, utm_origin))


def parse_osm(path: Path, root: Element, project: Callable[[Float], Float]) -> OsmFile:
    """Return the contents of a file; `project`: longitudes and latitudes (N, 2) to the plane (N, 2) [m].

    path: the file that errors name. Raises InputError.
    """
    nodes = _read_nodes(path, root, project)
    ways = {way.id: way for way in (_read_way(path, element) for element in _list_elements(root, "way"))}
    unusable = {id_: reason for id_, way in ways.items() if (reason := _find_fault(way, nodes))}
    relations = {
        relation.id: relation
        for relation in (_read_relation(path, element) for element in _list_elements(root, "relation"))
    }
    return OsmFile(path, nodes, {id_: ways[id_] for id_ in ways if id_ not in unusable}, relations, unusable)


def _list_elements(root: Element, tag: str) -> Iterator[Element]:
    """Yield elements that exist: the editor JOSM keeps deleted ones, without their contents."""
    return (
        element
        for element in root.iter(tag)
        if element.get("action") != "delete" and element.get("visible", "true") != "false"
    )


def _find_fault(way: OsmWay, nodes: Mapping[str, Float]) -> str:
    """Return why a way is no line; "" if it is one."""
    missing = next((node for node in way.nodes if node not in nodes), None)
    if missing is not None:
        return f"way {way.id}: expected nodes of this file, found node {missing}"
    try:
        points = len(parse_points(f"way {way.id}", [nodes[node] for node in way.nodes])) if way.nodes else 0
    except InputError as error:  # a line that is too long
        return str(error)
    return "" if points > 1 else f"way {way.id}: expected at least two distinct points, found {points}"


def _read_nodes(path: Path, root: Element, project: Callable[[Float], Float]) -> Mapping[str, Float]:
    elements = list(_list_elements(root, "node"))
    if not elements:
        raise InputError(f"{path}: expected nodes, found none")
    degrees = np.array([[read_number(path, element, name) for name in ("lon", "lat")] for element in elements])
    if (np.abs(degrees) > (180.0, 90.0)).any():
        raise InputError(f"{path}: expected latitudes within 90 and longitudes within 180 degrees, found others")
    return dict(zip((_read_id(path, element, "id") for element in elements), project(degrees), strict=True))


def _project(path: Path, degrees: Float, utm_origin: tuple[float, float] | None) -> Float:
    """Project longitudes and latitudes to (N, 2) [m]."""
    crs = UTM_OF_ORIGIN if utm_origin is None else _name_utm_zone(*np.median(degrees, axis=0).tolist())
    transformer: Any = import_pyproj(path).Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    x, y = transformer.transform(*np.vstack(((0.0, 0.0), degrees)).T)
    plane = np.column_stack((x, y))[1:] - (np.array((x[0], y[0])) if utm_origin is None else utm_origin)
    if not np.isfinite(plane).all():
        place = "0 degrees north, 0 degrees east" if utm_origin is None else "each other"
        raise InputError(f"{path}: expected nodes near {place}, found some out of {crs}")
    return plane


def _name_utm_zone(longitude: float, latitude: float) -> str:
    """Return the code of the UTM zone (WGS 84) of a place [degrees]."""
    zone = min(int((longitude + 180.0) // 6.0) + 1, 60)
    return f"EPSG:{(32600 if latitude >= 0.0 else 32700) + zone}"


def import_pyproj(path: Path) -> Any:
    """Import pyproj here because only this format needs it and the import is slow."""
    try:
        import pyproj
    except ImportError:
        raise build_missing_error(path, "pyproj") from None
    return pyproj


def _read_id(path: Path, element: Element, name: str) -> str:
    text = element.get(name)
    if not text:
        raise InputError(f"{path}: {element.tag}: expected the attribute {name}, found none")
    return text


def _read_way(path: Path, element: Element) -> OsmWay:
    return OsmWay(
        _read_id(path, element, "id"),
        tuple(_read_id(path, nd, "ref") for nd in element.iter("nd")),
        _read_tags(element),
    )


def _read_relation(path: Path, element: Element) -> OsmRelation:
    members: Iterable[Element] = element.iter("member")
    roles = tuple((member.get("role", ""), _read_id(path, member, "ref")) for member in members)
    return OsmRelation(_read_id(path, element, "id"), roles, _read_tags(element))


def _read_tags(element: Element) -> Mapping[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")}
