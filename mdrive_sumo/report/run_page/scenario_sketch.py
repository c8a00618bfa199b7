"""A sketch of a scenario for lists: roads and routes of the CAVs as a small SVG image, about one kilobyte."""

from collections.abc import Iterator
from itertools import cycle

import numpy as np
import shapely
from markupsafe import Markup

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.map_view import MapView, fit_view
from mdrive_sumo.report.palette import CAV_COLOURS
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario

WIDTH_PX, HEIGHT_PX = 108, 72
"""[px] Size of a sketch."""
TOLERANCE_M = 0.4
"""How far a drawn line may be from the true one: a pixel is about a metre."""
ROUTE_PX, START_PX = 2.2, 3.4
"""[px] Width of a route, and radius of the dot at its start."""


def draw_scenario_sketch(scenario: Scenario, roads: RoadMap) -> Markup:
    """Return the image: lanes grey, the route of each CAV in its colour with a dot at its start. North is up."""
    view = fit_view(np.concatenate([ego.xy for ego in scenario.egos]), min_aspect=HEIGHT_PX / WIDTH_PX)
    metres = max(view.size[0] / WIDTH_PX, view.size[1] / HEIGHT_PX)  # of a pixel
    lanes = "".join(
        f'<path d="{_format_path(lane.centre.xy, view)}" stroke-width="{lane.width:.1f}"/>'
        for lane in roads.driving
        if view.is_near(lane.centre.xy)
    )
    routes = "".join(
        f'<g stroke="{colour}" fill="{colour}"><path fill="none" d="{_format_path(ego.xy, view)}"/>'
        f'<circle cx="{x - view.left:.1f}" cy="{view.high - y:.1f}" r="{START_PX * metres:.1f}"/></g>'
        for ego, colour in zip(scenario.egos, cycle(CAV_COLOURS))
        for x, y in ego.xy[:1]
    )
    size = f'width="{WIDTH_PX}" height="{HEIGHT_PX}" viewBox="0 0 {view.size[0]:.0f} {view.size[1]:.0f}"'
    return Markup(
        f'<svg class="sketch" {size} aria-hidden="true"><g class="lanes">{lanes}</g>'
        f'<g stroke-width="{ROUTE_PX * metres:.1f}">{routes}</g></svg>'
    )


def _format_path(xy: Float, view: MapView) -> str:
    """Return the commands of an SVG path: what of a line (N, 2) [m] lies in the view, in metres from its upper left."""
    line = shapely.LineString(xy).simplify(TOLERANCE_M).intersection(view.box.buffer(5.0))
    return "".join(
        "M" + "L".join(f"{x - view.left:.1f} {view.high - y:.1f}" for x, y in part) for part in _list_lines(line)
    )


def _list_lines(shape: shapely.Geometry) -> Iterator[Float]:
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.LineString) and not part.is_empty:
            yield shapely.get_coordinates(part)
