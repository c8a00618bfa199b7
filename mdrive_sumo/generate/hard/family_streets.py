"""Streets of the hard tier's corridors: directions, reactive streams, kerbside rows with free places."""

from dataclasses import dataclass

from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.worlds.placement.lane_chains import Lanes
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream

CORRIDOR_NETWORKS = "hard_corridor_"
"""Beginning of the names of dense corridors: with signals, buses, cyclists and pedestrians."""


def is_corridor_network(network: str) -> bool:
    """Return whether a network is a dense corridor."""
    return network.startswith(CORRIDOR_NETWORKS)


@dataclass(frozen=True, slots=True)
class Corridor:
    """A corridor network: segments 0 to `junctions` in a row, SUMO indices of its driving lanes."""

    network: str
    junctions: int
    lanes: tuple[int, ...]
    """From the right; without the left-turn lane."""
    streams: tuple[TrafficStream, ...]
    """Of side streets."""

    def find_chain(self, roads: RoadMap, direction: str, lane: int, first: int = -1) -> Lanes:
        """Return the lanes straight through; direction: east or west; `first`: segment on which it begins."""
        ends = (0, self.junctions) if direction == "east" else (self.junctions, 0)
        begin = ends[0] if first < 0 else first
        return find_lane_path(roads, f"{direction}_{begin}_{lane}", f"{direction}_{ends[1]}_{lane}")

    @property
    def all_streams(self) -> tuple[TrafficStream, ...]:
        """Reactive streams of both directions and of the side streets."""
        east = tuple(f"east_{k}" for k in range(self.junctions + 1))
        west = tuple(f"west_{k}" for k in range(self.junctions, -1, -1))
        return (TrafficStream(east, self.lanes), TrafficStream(west, self.lanes), *self.streams)


def _build_side_streams(*edges: tuple[str, str]) -> tuple[TrafficStream, ...]:
    return tuple(TrafficStream(pair, (1,), 0.3, large=False) for pair in edges)


CORRIDORS = (
    Corridor("hard_corridor_market", 5, (2, 3), _build_side_streams(
        ("north_1_in", "south_1_out"), ("south_3_in", "north_3_out"), ("north_5_in", "south_5_out"))),
    Corridor("hard_corridor_narrow", 4, (2,), _build_side_streams(
        ("north_2_in", "south_2_out"), ("south_2_in", "north_2_out"), ("north_4_in", "south_4_out"))),
    Corridor("hard_corridor_arterial", 4, (2, 3), tuple(
        TrafficStream(pair, (2,), 0.3, large=False)
        for pair in (("north_1_in", "south_1_out"), ("south_3_in", "north_3_out"), ("north_4_in", "south_4_out")))),
)  # fmt: skip
