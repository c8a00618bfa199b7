"""Report section on the network: deviation of its centre lines from the source, and what was changed."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure
from real2sim.fidelity_report.html import Markup, join_markup, render_list, render_table, tag
from real2sim.fidelity_report.map_figures import AROUND_M, MapFrame, draw_far_points
from real2sim.fidelity_report.svg import render_path, render_picture, render_scale_bar, render_use
from real2sim.hd_map import HdMap, LaneKind
from real2sim.network import NetworkReport
from real2sim.network.lane_directions import reverse_lane
from real2sim.network.map_measurements import SPACING_M, measure_line_distances
from real2sim.polylines import sample_polylines

FAR_M = 0.2
"""[m] Target of issue C for the mean distance of centre lines; points beyond it are marked."""
MEAN_M, P95_M = 0.2, 0.5
"""Issue C."""


@dataclass(frozen=True)
class CentreLineDeviation:
    """Points every metre on the source's centre lines, and their distances from the network."""

    lines: tuple[Float, ...]
    xy: Float
    distance: Float


def compute_deviation(findings: ConversionFindings) -> CentreLineDeviation:
    """Return the deviation as in `network.measure`, with the positions."""
    lines = _select_lanes(findings.recording.map, findings.network)
    if not lines:
        return CentreLineDeviation((), np.zeros((0, 2)), np.zeros(0))
    distance = measure_line_distances(lines, [lane.centre for lane in findings.roads.driving])
    return CentreLineDeviation(tuple(line.xy for line in lines), sample_polylines(lines, SPACING_M).xy, distance)


def _select_lanes(map: HdMap, network: NetworkReport) -> list[Polyline]:
    """Return the driving lanes that the network contains, in their direction of travel."""
    inverted = set(network.directions.inverted)
    lanes = [
        lane
        for id_, lane in map.lanes.items()
        if lane.kind is LaneKind.DRIVING and (id_ not in network.drop_reason_by_lane or id_ in network.lost_in_part)
    ]
    return [build_polyline((reverse_lane(lane) if lane.id in inverted else lane).centre) for lane in lanes]


def render_network_section(findings: ConversionFindings, map_frame: MapFrame) -> Markup:
    """Return figures, a picture and lists."""
    network = findings.network
    found = compute_deviation(findings)
    return join_markup(
        (
            _describe_size(network),
            _render_deviation_table(network),
            _draw_deviation(found, map_frame),
            _render_lists(network),
        )
    )


def _describe_size(network: NetworkReport) -> Markup:
    side = "left" if network.left_hand else "right"
    return tag(
        "p",
        f"{network.lanes} driving lanes of the source became {network.edges} edges, {network.nodes} nodes and"
        f" {network.connections} connections; traffic keeps to the {side}. "
        f"{network.default_widths} lanes had no width and {network.default_speeds} no speed limit of their own.",
    )


def _render_deviation_table(network: NetworkReport) -> Markup:
    fit = network.deviation
    rows = (
        ("source to network", *(format_figure(value, decimals=3) for value in (fit.mean, fit.p95, fit.max))),
        (
            "network to source",
            *(format_figure(value, decimals=3) for value in (fit.back_mean, fit.back_p95, fit.back_max)),
        ),
        ("allowed", f"{MEAN_M:.3f}", f"{P95_M:.3f}", "–"),
    )
    return render_table(
        ("distance of centre lines", "mean [m]", "p95 [m]", "max [m]"), rows, "Network against its source"
    )


def _draw_deviation(found: CentreLineDeviation, map_frame: MapFrame) -> Markup:
    near = [line for line in found.lines if map_frame.view.is_near(line, AROUND_M)]
    far = found.xy[found.distance > FAR_M]
    label = (
        f"Centre lines of the source over the network: {len(far)} of {len(found.xy)} m deviate by more than {FAR_M:g} m"
    )
    drawing = render_picture(
        label,
        map_frame.svg_frame.view_box_attribute(map_frame.view),
        render_use("roads", "roads"),
        render_path("".join(map_frame.svg_frame.line_path(line) for line in near), class_="source"),
        draw_far_points(map_frame.svg_frame, far),
        render_scale_bar(map_frame.svg_frame, map_frame.view),
        class_="map",
    )
    return tag("figure", tag("div", drawing, class_="wide"), tag("figcaption", f"{label} (marked)."))


def _render_lists(network: NetworkReport) -> Markup:
    def arrows(links: tuple[tuple[str, str], ...]) -> list[str]:
        return [f"{a} → {b}" for a, b in links]

    lists = {
        "lanes reversed: observed motion and links contradict the drawn direction": list(network.directions.inverted),
        "lanes of unknown direction, left as drawn": list(network.directions.undecided),
        "links added: ends that meet in one direction": arrows(network.links_added),
        "links dropped: no vehicle could follow them": arrows(network.links_dropped),
        "lanes not in the network": [f"{id_}: {why}" for id_, why in network.drop_reason_by_lane.items()],
        "lanes with traffic lights, whose program is unknown": list(network.signalled),
    }
    none = "; ".join(title.split(":")[0] for title, items in lists.items() if not items)
    return join_markup(
        (
            *(_render_collapsed(title, items) for title, items in lists.items() if items),
            tag("p", f"None: {none}.", class_="none") if none else None,
        )
    )


def _render_collapsed(title: str, items: list[str]) -> Markup:

    return tag("details", tag("summary", f"{len(items)} {title}"), render_list(items, "columns"))
