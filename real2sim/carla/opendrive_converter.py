"""Convert OpenDRIVE maps to network folders that scenarios can use."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from real2sim.carla.conversion_report import write_networks_report
from real2sim.carla.town_network import TownNetwork, build_opendrive_network, make_network_name


def convert_opendrive(maps: Sequence[Path], out: Path) -> tuple[TownNetwork, ...]:
    """Convert maps `NAME.xodr` to network folders `out`/networks/NAME, see `make_network_name`; raise InputError.

    `networks.{json,md}` reports their signs and the error of their offset. `out` must be new or empty and appears only
    when every map is converted.
    """
    names = [make_network_name(path) for path in maps]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not names or twice:
        raise InputError(f"opendrive: expected maps of different names, found {', '.join(twice) or 'no map'}")
    with atomic_folder(out) as draft:
        networks = tuple(
            build_opendrive_network(path, draft / "networks" / name) for path, name in zip(maps, names, strict=True)
        )
        write_networks_report(networks, draft)
    return networks
