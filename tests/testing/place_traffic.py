"""Traffic by SUMO alone on a network: vehicles from every entry to every exit; what its statistics say."""

import gzip
import importlib.util
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.roads import RoadMap

SECONDS = 120
"""Two cycles of the longest program of a signal."""
HEADWAY_S = 16.0
"""Between two departures on a lane with a limit of 50 km/h: 225 vehicles an hour, an eighth of what a lane can take."""
FULL_MPS = 50 / 3.6
"""[m/s] On roads with a lower limit there are fewer in proportion: 135 an hour at 30 km/h, 45 at 10 km/h."""


@dataclass(frozen=True)
class TrafficStatistics:
    """What SUMO counts in two minutes of traffic."""

    inserted: int
    arrived: int
    waiting: int
    """Vehicles that found no room to depart."""
    teleports: int
    collisions: int
    emergency_stops: int
    mean_waiting_s: float
    """Mean time that an arrived vehicle stood."""


def list_ways(roads: RoadMap) -> list[tuple[str, str]]:
    """Return (entry edge, exit edge) of all ways across a network."""
    streets = [lane for lane in roads.driving if not lane.junction]
    reached = {after for lane in roads.driving for after in lane.successors}
    by_edge: dict[str, list[str]] = {}
    for lane in streets:
        by_edge.setdefault(lane.edge, []).append(lane.id)
    entries = [edge for edge, lanes in by_edge.items() if not reached & set(lanes)]
    exits = [edge for edge, lanes in by_edge.items() if not any(roads.lanes[lane].successors for lane in lanes)]
    return [(entry, exit_) for entry in entries for exit_ in _find_reached(roads, by_edge, entry) if exit_ in exits]


def _find_reached(roads: RoadMap, by_edge: dict[str, list[str]], entry: str) -> Iterator[str]:
    seen, queue = {entry}, [entry]
    while queue:
        edge = queue.pop(0)
        yield edge
        for after in [after for lane in by_edge[edge] for after in roads.lanes[lane].successors]:
            for target in _leave_junction(roads, after):
                if target not in seen:
                    seen.add(target)
                    queue.append(target)


def _leave_junction(roads: RoadMap, lane: str) -> Iterator[str]:
    """Return the edges that a lane leads to, itself if it lies outside junctions."""
    if not roads.lanes[lane].junction:
        yield roads.lanes[lane].edge
    else:
        for after in roads.lanes[lane].successors:
            yield from _leave_junction(roads, after)


def drive_traffic(roads: RoadMap, folder: Path, seconds: int = SECONDS) -> TrafficStatistics:
    """Run two minutes of traffic in SUMO with files in `folder`; each entry sends vehicles to its exits by turns."""
    (folder / "map.net.xml").write_bytes(gzip.decompress(roads.net_file.read_bytes()))
    (folder / "trips.xml").write_text(_format_trips(roads, seconds))
    call = ["-n", "map.net.xml", "-r", "trips.xml", "-e", str(seconds), "--step-length", "0.1", "--no-step-log"]
    call += ["--collision.check-junctions", "--collision.action", "warn", "--time-to-teleport", "100", "--no-warnings"]
    call += ["--statistic-output", "statistics.xml", "--duration-log.statistics", "--xml-validation", "never"]
    subprocess.run([find_sumo(), *call], cwd=folder, check=True, capture_output=True, timeout=60)
    return _read_statistics(ET.parse(folder / "statistics.xml").getroot())


def _format_trips(roads: RoadMap, seconds: int) -> str:
    rows: list[tuple[float, str]] = []
    ways = list_ways(roads)
    entries = list(dict.fromkeys(entry for entry, _ in ways))
    for i, entry in enumerate(entries):
        exits = [exit_ for begin, exit_ in ways if begin == entry]
        lanes = [lane for lane in roads.driving if lane.edge == entry]
        headway = HEADWAY_S / len(lanes) * max(1.0, FULL_MPS / lanes[0].speed_limit)
        for k in range(int(seconds / headway)):
            depart = round(k * headway + i * headway / len(entries), 2)
            attributes = 'departLane="best" departSpeed="desired" departPos="base"'
            way = f'from="{entry}" to="{exits[k % len(exits)]}"'
            rows.append((depart, f'<trip id="v{i}_{k}" depart="{depart}" {way} {attributes}/>'))
    return "<routes>" + "\n".join(row for _, row in sorted(rows)) + "</routes>"


def _read_statistics(root: ET.Element) -> TrafficStatistics:
    values = {child.tag: child.attrib for child in root}
    inserted = int(values["vehicles"]["inserted"])
    return TrafficStatistics(
        inserted,
        inserted - int(values["vehicles"]["running"]),
        int(values["vehicles"]["waiting"]),
        int(values["teleports"]["total"]),
        int(values["safety"]["collisions"]),
        int(values["safety"]["emergencyStops"]),
        float(values["vehicleTripStatistics"]["waitingTime"]),
    )


def find_sumo() -> str:
    """Return SUMO's program of this Python environment."""
    spec = importlib.util.find_spec("sumo")
    assert spec is not None
    assert spec.submodule_search_locations
    return str(Path(spec.submodule_search_locations[0]) / "bin" / "sumo")
