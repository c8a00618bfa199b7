"""OpenDRIVE maps become network folders, ready for scenarios."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from real2sim.atomic_folder import atomic_folder
from real2sim.carla.conversion_report import write_networks_report
from real2sim.carla.town_network import TownNetwork, build_opendrive_network


def convert_opendrive(maps: Sequence[Path], out: Path) -> tuple[TownNetwork, ...]:
    """Writes maps `NAME.xodr` as network folders `out`/networks/NAME; raises InputError.

    `networks.{json,md}` tells of their signs and the error of their offset. All or nothing: `out`, which must be new or
    empty, appears only when every map is converted.
    """
    names = [path.stem for path in maps]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not names or twice:
        raise InputError(f"opendrive: expected maps of different names, found {', '.join(twice) or 'no map'}")
    with atomic_folder(out) as draft:
        networks = tuple(build_opendrive_network(path, draft / "networks" / path.stem) for path in maps)
        write_networks_report(networks, draft)
    return networks
