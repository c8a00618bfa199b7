"""Report of a conversion: moved starts, waypoints off their lane, maps and signs, as JSON and Markdown."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.statistics import SuiteStatistics
from real2sim.carla.town_network import TownNetwork

REPORT_JSON = "conversion.json"
REPORT_MARKDOWN = "conversion.md"
NETWORKS_JSON = "networks.json"
NETWORKS_MARKDOWN = "networks.md"


@dataclass(frozen=True, slots=True)
class ReportedWaypoint:
    """A waypoint of a CAV: `waypoint` 0 is the start. Coordinates [m] are the map's: CARLA's with y flipped."""

    scenario: str
    ego: str
    waypoint: int
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class OffLaneWaypoint:
    """A waypoint off the centre line of the lane it was matched to; the nearest lane may be another one."""

    point: ReportedWaypoint
    lane: str
    distance_m: float
    nearest_lane: str
    nearest_lane_distance_m: float


@dataclass(frozen=True, slots=True)
class DroppedWaypoint:
    """A waypoint that the route does not pass."""

    point: ReportedWaypoint
    nearest_lane: str
    nearest_lane_distance_m: float
    reason: str


@dataclass(frozen=True, slots=True)
class StartShift:
    """A start that was moved forward along its route because its box overlapped another one."""

    scenario: str
    ego: str
    distance_m: float


@dataclass(frozen=True, slots=True)
class ConversionReport:
    """Report of one conversion."""

    source: str
    notes: tuple[str, ...]
    statistics: SuiteStatistics
    waypoints: int
    towns: tuple[TownNetwork, ...]
    shifts: tuple[StartShift, ...]
    left_out: tuple[DroppedWaypoint, ...]
    off_lane_threshold_m: float
    off_lane: tuple[OffLaneWaypoint, ...]
    scenario_notes: Mapping[str, tuple[str, ...]]
    """Scenario id -> what the converter skipped, changed or assumed in its files."""

    @property
    def starts_off_lane(self) -> int:
        """Number of starts among the off-lane waypoints."""
        return sum(off.point.waypoint == 0 for off in self.off_lane)


def write_conversion_report(report: ConversionReport, folder: Path) -> None:
    """Write `conversion.json` and `conversion.md`."""
    towns = [_town_to_json(town) for town in report.towns]
    data = {"format": "mdrive-sumo/conversion/1", **asdict(report), "towns": towns}
    write_text(folder / REPORT_JSON, json.dumps(data, indent=1) + "\n")
    write_text(folder / REPORT_MARKDOWN, _format_markdown(report))


def write_networks_report(networks: Sequence[TownNetwork], folder: Path) -> None:
    """Write `networks.json` and `networks.md`: origin, signs and offset error of the networks."""
    data = {"format": "mdrive-sumo/networks/1", "networks": [_town_to_json(town) for town in networks]}
    write_text(folder / NETWORKS_JSON, json.dumps(data, indent=1) + "\n")
    write_text(folder / NETWORKS_MARKDOWN, "# Networks from OpenDRIVE\n\n" + _format_town_table(networks) + "\n")


def _town_to_json(town: TownNetwork) -> dict[str, object]:
    data = asdict(town)
    del data["folder"]
    data["offset_error_m"] = None if math.isnan(town.offset_error_m) else round(town.offset_error_m, 5)
    data["offset_m"] = data.pop("offset")
    return data


def _format_markdown(report: ConversionReport) -> str:
    numbers = report.statistics
    sections = (
        f"# Conversion of {report.source}",
        f"{numbers.scenarios} scenarios, {numbers.cavs} CAVs ({numbers.mean_cavs:.2f} a scenario),"
        f" {report.waypoints} waypoints. Mean route {numbers.mean_route_m:.2f} m, mean cumulative heading"
        f" change {numbers.mean_heading_change_deg:.2f} deg (over CAVs).",
        *report.notes,
        "## Towns",
        _format_town_table(report.towns),
        "## Starts moved apart",
        _format_table(
            ("scenario", "CAV", "forward [m]"),
            ((s.scenario, s.ego, f"{s.distance_m:.1f}") for s in report.shifts),
        ),
        "## Waypoints left out",
        _format_table(
            ("scenario", "CAV", "waypoint", "x, y [m]", "nearest lane", "distance [m]", "why"),
            (
                (*_format_waypoint(out.point), out.nearest_lane, f"{out.nearest_lane_distance_m:.2f}", out.reason)
                for out in report.left_out
            ),
        ),
        f"## Starts (waypoint 0) and other waypoints over {report.off_lane_threshold_m:g} m off their lane",
        _format_table(
            ("scenario", "CAV", "waypoint", "x, y [m]", "lane", "distance [m]", "nearest lane", "distance [m]"),
            map(_format_off_lane_row, sorted(report.off_lane, key=lambda off: -off.distance_m)),
        ),
        "## Notes",
        _format_table(
            ("scenario", "note"),
            ((id_, note) for id_, notes in report.scenario_notes.items() for note in notes),
        ),
    )
    return "\n\n".join(sections) + "\n"


def _format_town_table(towns: Sequence[TownNetwork]) -> str:
    return _format_table(
        ("network", "made from", "offset [m]", "offset error [m]", "stop signs"), map(_format_town_row, towns)
    )


def _format_town_row(town: TownNetwork) -> tuple[str, ...]:
    error = "not measured" if math.isnan(town.offset_error_m) else f"{town.offset_error_m:.4f}"
    if town.displaced_lanes:
        error += f" ({town.displaced_lanes} of {town.measured_lanes} lanes over 0.5 m off)"
    signs = "signs unknown" if town.stop_signs is None else str(town.stop_signs)
    unplaced = f" (no lane found for {', '.join(town.unplaced_signs)})" if town.unplaced_signs else ""
    mended = f" (mended: {'; '.join(town.repairs)})" if town.repairs else ""
    name = town.name + " (left-hand)" * town.left_hand
    return name, town.source + mended, f"{town.offset[0]:g}, {town.offset[1]:g}", error, signs + unplaced


def _format_off_lane_row(off: OffLaneWaypoint) -> tuple[str, ...]:
    nearest = f"{off.nearest_lane_distance_m:.2f}"
    return *_format_waypoint(off.point), off.lane, f"{off.distance_m:.2f}", off.nearest_lane, nearest


def _format_waypoint(point: ReportedWaypoint) -> tuple[str, ...]:
    return point.scenario, point.ego, str(point.waypoint), f"{point.x:g}, {point.y:g}"


def _format_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    if not lines:
        return "None."
    return "\n".join(("| " + " | ".join(head) + " |", "|" + "---|" * len(head), *lines))
