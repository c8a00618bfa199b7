"""`mdrive-sumo list networks`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.roads import list_packaged_networks, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE, read_network_file

NETWORKS = "networks"


def list_networks(_: str) -> str:
    """Return the table of the packaged networks."""
    return _format_networks(list_packaged_networks())


def list_networks_of(folder: Path) -> str:
    """Return the table of the networks in a folder, or in its networks/. Raises InputError without any."""
    places = [*sorted(folder.glob("*")), *sorted((folder / NETWORKS).glob("*"))]
    found = {place.name: place for place in places if (place / NETWORK_FILE).is_file()}
    if not found:
        raise InputError(f"{folder}: expected networks in NAME/{NETWORK_FILE} or {NETWORKS}/NAME, found none")
    return _format_networks(found)


def _format_networks(folders: Mapping[str, Path]) -> str:
    rows = _make_network_rows(folders)
    return format_text(make_text_table(("network", "lanes", "buildings", "stop signs", "description"), rows))


def _make_network_rows(folders: Mapping[str, Path]) -> Iterator[Sequence[str]]:
    for name, folder in folders.items():
        roads, about = load_road_map(folder), read_network_file(folder)
        signs = "unknown" if roads.stop_signs is None else str(len(roads.stop_signs))
        yield name, str(len(roads.lanes)), str(len(roads.buildings)), signs, about.description
