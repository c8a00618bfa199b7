"""Write the folder of a network from a compiled net."""

import gzip
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, write_bytes, write_text
from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum
from real2sim.xml_file import Element


def write_network_folder(source: Path, folder: Path, net: Element, about: NetworkFile) -> RoadMap:
    """Write net and `network.json`, whose checksum is set here, and load them.

    source: the map, which errors name. Raises InputError for a broken net.
    """
    xml = ElementTree.tostring(net, encoding="utf-8", xml_declaration=True)
    make_folder(folder)
    write_bytes(folder / NET_FILE, gzip.compress(xml, mtime=0))
    about = about.model_copy(update={"checksum": compute_net_checksum(xml)})
    write_text(folder / NETWORK_FILE, about.model_dump_json(indent=2) + "\n")
    load_road_map.cache_clear()  # the folder may have held the same network without its signs
    try:
        return load_road_map(folder)
    except InputError as error:
        raise InputError(f"{source}: {str(error).removeprefix(f'{folder / NET_FILE}: ')}") from None


def read_offset(path: Path, net: Element) -> tuple[float, float]:
    """Return the netOffset of a net: source coordinates + offset = network coordinates. Raises InputError."""
    location = net.find("location")
    text = "0,0" if location is None else location.get("netOffset", "0,0")
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f'{path}: expected <location netOffset="x,y">, found {text!r:.60}') from None
    return x, y
