"""World: a road network on which scenarios are written; drawn from a seed, packaged, or the user's own."""

import os
from dataclasses import dataclass
from pathlib import Path
from random import Random

from mdrive_sumo.core.atomic_folder import check_new_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.roads import RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE
from mdrive_sumo.scenario.scenario import Scenario, SignalRule, SpeedRule
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.authoring.drawn_scenario import draw_scenario
from mdrive_sumo.worlds.authoring.scenario_builder import ScenarioBuilder
from mdrive_sumo.worlds.places import PLACES_VERSION, Place, draw_place, write_place
from mdrive_sumo.worlds.places.place_parameters import Value

MAP_ENDINGS = (".net.xml", ".net.xml.gz", ".xodr", ".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz")
"""Endings of the map files that `mdrive-sumo convert network` reads."""


@dataclass(frozen=True, eq=False)
class World:
    """A road network for scenarios: `new_scenario` begins one."""

    roads: RoadMap

    @property
    def name(self) -> str:
        """Name of the network."""
        return self.roads.name

    @property
    def folder(self) -> Path:
        """Folder of the network."""
        return self.roads.folder

    def __repr__(self) -> str:
        roads = sum(not lane.junction for lane in self.roads.driving)
        return f"World({self.name!r}, {roads} lanes, {len(self.roads.buildings)} buildings)"

    def new_scenario(
        self,
        id: str,
        *,
        category: str = "own",
        description: str = "",
        signals: SignalRule = "program",
        speeds: SpeedRule = "road",
        weather: WeatherName = "default",
    ) -> ScenarioBuilder:
        """Begin a scenario on this network: add road users, then `build()` or `save(folder)` it."""
        return ScenarioBuilder(id, self.roads, category, description, signals, speeds, weather)

    def scenario(self, seed: int | str = 0, *, cavs: int = 3, demand: str = "town-quiet", id: str = "") -> Scenario:
        """Return a drawn scenario: CAVs that meet at a junction, people who cross their routes, and traffic.

        The same network, seed, number of CAVs and demand give the same scenario on every machine. id: "" for the
        name of the network and the seed. Raises InputError if the network has no room for so many.
        """
        draft = self.new_scenario(id or f"{self.name}_{seed}"[:80], category="drawn")
        draw_scenario(draft, cavs, demand, Random(f"{self.name}/{seed}/{cavs}/{demand}"))
        return draft.build()


def draw(place: str = "crossing", seed: int | str = 0, folder: str | Path | None = None, **parameters: Value) -> World:
    """Return a drawn place: the same kind, seed and parameters give the same bytes on every machine.

    place: a kind of `worlds.places.PLACE_KINDS`; parameters: of that kind. folder: where its network is written, new or
    empty; None: in a cache of the user (`$XDG_CACHE_HOME`, else `~/.cache`). Raises InputError.
    """
    drawn = draw_place(place, seed, **parameters)
    if folder is not None:
        target = Path(folder)
        check_new_folder(target)
        return World(load_road_map(_write(drawn, target)))
    if drawn.kind in list_packaged_networks():
        return load(drawn.kind)
    return World(load_road_map(_write(drawn, find_cache_folder() / f"places_{PLACES_VERSION}" / drawn.name)))


def _write(place: Place, folder: Path) -> Path:
    try:
        return write_place(place, folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None


def find_cache_folder() -> Path:
    """Return the folder of what can be drawn anew, in which a user may delete everything."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mdrive-sumo"


def load(network: str | Path) -> World:
    """Return a packaged network by its name, or one's own by its folder. Raises InputError.

    `mdrive-sumo convert network FILE --out DIR` makes a folder of a SUMO net, an OpenDRIVE map or an OpenStreetMap
    extract.
    """
    packaged = list_packaged_networks()
    folder = packaged.get(str(network), Path(network))
    if (folder / NETWORK_FILE).is_file():
        return World(load_road_map(folder))
    if folder.name.endswith(MAP_ENDINGS) and folder.exists():
        raise InputError(
            f"{network}: expected a network's folder, found a map; `mdrive-sumo convert network {network} --out DIR`"
            " makes one of it"
        )
    raise InputError(
        f"network {str(network)!r}: expected the folder of a network, with {NETWORK_FILE}, or a packaged one"
        f" ({', '.join(packaged)}), found neither{suggest_name(str(network), packaged)}"
    )
