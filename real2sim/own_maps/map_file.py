"""Map files of strangers: read within limits, and told apart by their content."""

import gzip
import zlib
from dataclasses import dataclass
from enum import StrEnum
from io import BytesIO
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from real2sim.xml_file import Element, parse_xml, strip_namespaces

MAX_MAP_BYTES = 64 * 2**20
"""Bytes of a map, unpacked: elements of a tree take ten times as much memory. CARLA's largest town has 4 MB; an
extract of OpenStreetMap of that size covers a town."""
GZIP_MAGIC = b"\x1f\x8b"


class MapKind(StrEnum):
    """The kinds of maps, by what people call them."""

    SUMO = "SUMO net"
    OPENDRIVE = "OpenDRIVE map"
    OPENSTREETMAP = "OpenStreetMap extract"


KIND_BY_ROOT = {"net": MapKind.SUMO, "OpenDRIVE": MapKind.OPENDRIVE, "osm": MapKind.OPENSTREETMAP}
"""Kind of a map by the name of its root element."""


@dataclass(frozen=True)
class MapFile:
    """A map in memory."""

    path: Path
    kind: MapKind
    data: bytes
    """The XML, unpacked."""
    root: Element


def read_map_file(path: Path) -> MapFile:
    """Read a map, gzipped or not. Raises InputError for a file that is too large, broken, or of another kind."""
    data = _unpack(path)
    root = parse_xml(path, data)
    tag = root.tag.rpartition("}")[2]
    if tag not in KIND_BY_ROOT:
        roots = ", ".join(f"<{name}> ({kind})" for name, kind in KIND_BY_ROOT.items())
        raise InputError(f"{path}: expected a map whose root is one of {roots}, found <{tag}>{_suggest_other(tag)}")
    strip_namespaces(root)
    return MapFile(path, KIND_BY_ROOT[tag], data, root)


def _suggest_other(tag: str) -> str:
    """Say what a file is that people may take for a map."""
    others = {
        "routes": "; these are SUMO's vehicles, its net is in another file",
        "additional": "; these are additions to a SUMO net, which is in another file",
        "configuration": "; its entry <net-file> names the net",
        "sumoConfiguration": "; its entry <net-file> names the net",
        "commonRoad": "; `mdrive-sumo convert commonroad` reads it",
        "nodes": "; netconvert compiles plain XML to a net",
        "edges": "; netconvert compiles plain XML to a net",
    }
    return others.get(tag, "")


def _unpack(path: Path) -> bytes:
    try:
        with open_regular(path, MAX_MAP_BYTES) as file:
            data = file.read(MAX_MAP_BYTES + 1)
        if data.startswith(GZIP_MAGIC):
            with gzip.open(BytesIO(data)) as unpacked:
                data = unpacked.read(MAX_MAP_BYTES + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path}: cannot be unpacked: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_MAP_BYTES:
        raise InputError(f"{path}: expected a map of at most {MAX_MAP_BYTES} bytes, found more; cut a smaller part out")
    return data
