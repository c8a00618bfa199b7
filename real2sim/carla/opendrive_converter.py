"""Convert OpenDRIVE maps to network folders that scenarios can use."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from real2sim.carla.conversion_report import write_networks_report
from real2sim.carla.town_network import TownNetwork, build_opendrive_network


def convert_opendrive(maps: Sequence[Path], out: Path) -> tuple[TownNetwork, ...]:
    """Convert maps `NAME.xodr` to network folders `out`/networks/NAME; raise InputError.

    `networks.{json,md}` reports their signs and the error of their offset. `out` must be new or empty and appears only
    when every map is converted.
    """
    names = [path.stem for path in maps]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not names or twice:
        raise InputError(f"opendrive: expected maps of different names, found {', '.join(twice) or 'no map'}")
    with atomic_folder(out) as draft:
        networks = tuple(build_opendrive_network(path, draft / "networks" / path.stem) for path in maps)
        write_networks_report(networks, draft)
    return networks
