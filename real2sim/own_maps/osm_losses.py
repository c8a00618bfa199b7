"""What of an OpenStreetMap extract a network cannot hold, and what the extract does not say."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from real2sim.own_maps.osm_buildings import FoundBuildings
from real2sim.own_maps.osm_signs import SignedApproaches
from real2sim.readers.osm_file import OsmFile
from real2sim.xml_file import Element

CAR_ROADS = frozenset(
    f"{name}{link}"
    for name in ("motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential")
    for link in ("", "_link")
) | {"living_street", "service", "road"}
"""Values of the tag `highway` for roads that cars use."""


def list_losses(
    root: Element, osm: OsmFile, buildings: FoundBuildings, approaches: SignedApproaches, left_hand: bool
) -> Iterator[str]:
    """Yield what of an extract could not be kept or was assumed, one sentence each."""
    tags = [way.tags for way in osm.ways.values()]
    roads = [one for one in tags if one.get("highway") in CAR_ROADS]
    if not left_hand:
        yield "side of the road: OpenStreetMap does not say it, taken as right; `--left-hand` makes it left"
    if guessed := sum("maxspeed" not in one for one in roads):
        yield f"speed limits: {guessed} of {len(roads)} roads have none in the extract, they get that of their class"
    if guessed := sum("lanes" not in one for one in roads):
        yield f"lanes: {guessed} of {len(roads)} roads do not say how many, they get that of their class"
    if levels := sum(one.get("bridge", "no") != "no" or one.get("tunnel", "no") != "no" for one in roads):
        yield f"levels: {levels} roads are bridges or tunnels, all is driven and seen in one plane"
    yield from _list_roadside_losses(tags, buildings, approaches)
    others = Counter(one["highway"] for one in tags if "highway" in one and one["highway"] not in CAR_ROADS)
    others |= Counter("railway" for one in tags if "railway" in one)
    if others:
        yield (
            "ways that cars do not use: "
            + ", ".join(f"{count} {kind}" for kind, count in sorted(others.items()))
            + ("; footways are drawn only")
        )
    if osm.unusable_ways:
        yield f"ways: {len(osm.unusable_ways)} are cut off by the extract or broken"
    lights = sum(tag.get("v") == "traffic_signals" for node in root.iter("node") for tag in node.iter("tag"))
    if lights:
        yield f"signals: {lights} nodes; their programs are netconvert's, OpenStreetMap has none"


def _list_roadside_losses(
    tags: Sequence[Mapping[str, str]], buildings: FoundBuildings, approaches: SignedApproaches
) -> Iterator[str]:
    for reason, count in buildings.lost.items():
        yield f"buildings: {count} left out, {reason}"
    if approaches.unplaced:
        yield f"signs: {approaches.unplaced} stop or give-way signs left out, not at the end of a road"
    kinds = Counter(one["barrier"] for one in tags if one.get("barrier") in ("wall", "hedge", "fence"))
    if kinds:
        yield "walls: " + ", ".join(f"{count} of kind {kind}" for kind, count in sorted(kinds.items())) + " left out"
