"""Plots with matplotlib: networks, scenarios at their start, and single ticks of recorded episodes."""

import math
import textwrap
from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, PathPatch, Polygon, RegularPolygon
from matplotlib.path import Path as Outline

from mdrive_sumo.core.geometry import Float, box_corners, build_polyline
from mdrive_sumo.core.output_files import make_parents, new_file
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.label_placement import LabelBox, LabelRequest, place_labels
from mdrive_sumo.report.map_view import MapView, fit_view
from mdrive_sumo.report.palette import (
    CAV_COLOURS,
    KIND_COLOURS,
    LIGHT,
    MIN_SIZE_M,
    choose_colours,
)
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import MapGeometry, build_map_geometry
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, KindName, LaneMotion, PathMotion, ReplayMotion
from mdrive_sumo.vehicle.dynamics import MKZ_2017

GROUND, PAVEMENT, APRON, ASPHALT, PAINT = (LIGHT[name] for name in ("ground", "footway", "apron", "road", "line"))
BUILDING, BUILDING_EDGE = LIGHT["building"], LIGHT["building-edge"]
LATER_ALPHA = 0.35
"""Opacity of background vehicles that depart later, where others may be until then."""
SIDE_INCHES = 9.0
"""Longer side of the picture."""
TITLE_ASPECT = 0.72
"""Mean width of a bold letter relative to its size."""
NAME_POINTS, NAME_ASPECT = 9.0, 0.66
"""Size of the names of CAVs, and the mean width of a letter relative to it."""
POINTS_PER_INCH = 72.0
TITLE_INCHES, LEGEND_INCHES, LEGEND_ROW_INCHES = 0.6, 0.35, 0.2
"""Height of the captions above the map, of the first row of CAVs below it, and of each further row."""
LEGEND_ENTRY_INCHES = 1.1
"""Width of a CAV in those rows: its id and the length of its route."""
LEAST_ASPECT = 0.62
"""Least width of a picture as a share of its height: captions need room."""


def draw_map(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw everything of the network that is visible in the view, and fit the axes to the view."""
    axes.set_facecolor(GROUND)
    axes.set(xlim=(view.left, view.right), ylim=(view.low, view.high), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    geometry = build_map_geometry(roads, view.box)
    _add_shapes(axes, geometry.pavements, PAVEMENT, 1)
    _add_shapes(axes, geometry.aprons, APRON, 1.5)
    _add_shapes(axes, geometry.asphalt, ASPHALT, 2)
    _add_shapes(axes, geometry.stripes, PAINT, 2.5)
    _add_lines(axes, geometry.markings.solid, 0.9)
    _add_lines(axes, geometry.markings.dashed, 0.9, (0, (7, 6)))
    _draw_stops(axes, geometry, view)
    _add_shapes(axes, geometry.buildings, BUILDING, 5, edge=BUILDING_EDGE)


def _add_shapes(axes: Axes, shapes: Iterable[shapely.Polygon], colour: str, order: float, edge: str = "none") -> None:
    patches = [PathPatch(_make_path(shape)) for shape in shapes]
    axes.add_collection(PatchCollection(patches, facecolor=colour, edgecolor=edge, linewidth=0.8, zorder=order))


def _make_path(polygon: shapely.Polygon) -> Outline:
    """Return a polygon with its holes as one path."""
    rings = (polygon.exterior, *polygon.interiors)
    return Outline.make_compound_path(*(Outline(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _add_lines(
    axes: Axes, lines: Iterable[Float], width: float, style: str | tuple[int, tuple[int, int]] = "solid"
) -> None:
    axes.add_collection(LineCollection(list(lines), colors=PAINT, linewidths=width, linestyles=style, zorder=3))


def _draw_stops(axes: Axes, geometry: MapGeometry, view: MapView) -> None:
    """Draw the stop lines of traffic lights and stop signs, and the signs."""
    marks = (*geometry.stop_signs, *geometry.light_stops)
    _add_lines(axes, (mark.line for mark in marks), 2.4)
    for mark in marks:
        if mark.sign is not None and view.contains(shapely.Point(mark.sign)):
            x, y = mark.sign.tolist()
            axes.add_patch(RegularPolygon((x, y), 8, radius=1.5, facecolor=LIGHT["bad"], edgecolor="white", zorder=6))
            axes.text(x, y, "STOP", color="white", fontsize=4.5, weight="bold", ha="center", va="center", zorder=7)


def draw_actors(axes: Axes, actors: Sequence[Actor], roads: RoadMap) -> None:
    """Draw every actor at its start with its path, and a legend of the kinds that occur."""
    for actor in actors:
        colour = KIND_COLOURS[actor.kind]
        axes.add_collection(
            LineCollection([find_actor_path(actor, roads)], colors=colour, linewidths=1.4, linestyles=":", zorder=7.5)
        )
        axes.add_patch(_make_shape(actor, colour))
    present = {actor.kind for actor in actors}
    kinds: list[KindName] = [kind for kind in KIND_COLOURS if kind in present]
    if kinds:
        entries = [Patch(facecolor=KIND_COLOURS[kind], edgecolor="white", label=kind) for kind in kinds]
        legend = axes.legend(handles=entries, loc="upper right", fontsize=8, framealpha=0.85)
        legend.set_zorder(15)


def find_actor_path(actor: Actor, roads: RoadMap) -> Float:
    """Return the points (N, 2) [m] of an actor's path from its start on."""
    start = (actor.start.x, actor.start.y)
    match actor.motion:
        case PathMotion(points=points):
            return np.array(points)
        case LaneMotion(lanes=lanes):
            centres = [roads.lanes[lane].centre.xy for lane in lanes if lane in roads.lanes]
            whole = np.concatenate([np.array([start]), *centres])
            first = 1 + int(np.argmin(np.hypot(*(whole[1:] - start).T)))
            return np.concatenate((whole[:1], whole[first:]))
        case ReplayMotion(poses=poses):
            return np.array([pose[1:3] for pose in poses])
        case _:
            return np.array([start, start])


def _make_shape(actor: Actor, colour: str) -> Patch:
    """Return a disc for a pedestrian, and a box for every other kind."""
    x, y = actor.start.x, actor.start.y
    length, width = max(actor.length, MIN_SIZE_M), max(actor.width, MIN_SIZE_M)
    if actor.kind == "pedestrian":
        return Circle((x, y), length / 2, facecolor=colour, edgecolor="white", linewidth=0.6, zorder=8)
    corners = box_corners(x, y, actor.start.yaw, length, width)
    return Polygon(corners, facecolor=colour, edgecolor="white", linewidth=0.6, zorder=8)


def save_scenario_plot(scenario: Scenario, roads: RoadMap, path: Path, dpi: int = 130) -> None:
    """Write the picture of a scenario; the suffix of `path` selects the format, `roads` is its network.

    Raises OSError, and ValueError for an unknown suffix.
    """
    view = fit_view(np.concatenate([ego.xy for ego in scenario.egos]), min_aspect=LEAST_ASPECT)
    figure, axes = _make_figure(view, len(scenario.egos))
    draw_scenario(axes, scenario, roads, view)
    _draw_scale(axes, view)
    _write_captions(figure, scenario, roads)
    _write_cavs(figure, scenario.egos)
    make_parents(path)
    with new_file(path) as file:
        figure.savefig(file, format=path.suffix[1:] or "png", dpi=dpi)


def save_network_plot(roads: RoadMap, path: Path, dpi: int = 130) -> None:
    """Write the picture of a network without a scenario; as `save_scenario_plot`."""
    view = fit_view(np.concatenate([lane.centre.xy for lane in roads.lanes.values()]))
    figure, axes = _make_figure(view)
    draw_map(axes, roads, view)
    _draw_scale(axes, view)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi)


def draw_scenario(axes: Axes, scenario: Scenario, roads: RoadMap, view: MapView) -> None:
    """Draw a scenario at its start: network, background vehicles, scripted actors, CAVs and their routes."""
    draw_map(axes, roads, view)
    for vehicle in scenario.background.vehicles:
        _draw_background(axes, vehicle, roads)
    draw_actors(axes, scenario.actors, roads)
    for ego, colour in zip(scenario.egos, cycle(CAV_COLOURS)):
        _draw_ego(axes, ego, colour)
    _draw_names(axes, scenario.egos, view)


def _make_figure(view: MapView, cavs: int = 0) -> tuple[Figure, Axes]:
    width, height = view.size
    scale = SIDE_INCHES / max(width, height)
    rows = math.ceil(cavs / _count_columns(width * scale))
    below = LEGEND_INCHES + LEGEND_ROW_INCHES * max(rows - 1, 0)
    total = height * scale + TITLE_INCHES + below
    figure = Figure(figsize=(width * scale, total), facecolor="white")
    FigureCanvasAgg(figure)
    return figure, figure.add_axes((0.0, below / total, 1.0, height * scale / total))


def _count_columns(inches: float) -> int:
    """Return how many CAVs a row of the legend holds."""
    return max(int(inches / LEGEND_ENTRY_INCHES), 1)


def _draw_background(axes: Axes, vehicle: BackgroundVehicle, roads: RoadMap) -> None:
    """Draw a background vehicle at its departure; nothing if its edge is not part of the map of car lanes."""
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    if lane is not None:
        s = vehicle.depart_pos_m - vehicle.length / 2
        corners = box_corners(*lane.centre.at(s), lane.centre.yaw_at(s), vehicle.length, vehicle.width)
        alpha, colour = LATER_ALPHA if vehicle.depart_s > 0 else 1.0, LIGHT["vehicle"]
        axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="white", linewidth=0.6, zorder=8, alpha=alpha))


def _draw_ego(axes: Axes, ego: Ego, colour: str) -> None:
    xy = ego.xy
    axes.plot(xy[:, 0], xy[:, 1], color="white", linewidth=4.2, zorder=8, solid_capstyle="round", alpha=0.85)
    axes.plot(xy[:, 0], xy[:, 1], color=colour, linewidth=2.4, zorder=9, solid_capstyle="round")
    _draw_arrows(axes, xy, colour)
    _draw_flag(axes, xy[-1], colour)
    start = ego.start
    corners = box_corners(start.x, start.y, start.yaw, MKZ_2017.length, MKZ_2017.width)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="white", linewidth=1.0, zorder=11))
    nose = (corners[0] + corners[3]) / 2
    glass = np.array((corners[0] * 0.8 + corners[1] * 0.2, nose, corners[3] * 0.8 + corners[2] * 0.2))
    axes.add_patch(Polygon(glass, facecolor="white", alpha=0.75, zorder=12))


def _draw_names(axes: Axes, egos: Sequence[Ego], view: MapView) -> None:
    """Write the name of every CAV on it if it fits there, else beside it where there is room."""
    metres = max(view.size) / (SIDE_INCHES * POINTS_PER_INCH)  # of a point
    size = NAME_POINTS * metres
    colours = [colour for _, colour in zip(egos, cycle(CAV_COLOURS), strict=False)]
    widths = [NAME_ASPECT * size * len(ego.id) for ego in egos]
    long = [i for i, width in enumerate(widths) if width > MKZ_2017.length * 0.6]
    requests = [
        LabelRequest(egos[i].start.x, egos[i].start.y, widths[i] + size, 1.7 * size, MKZ_2017.length / 2) for i in long
    ]
    cars = [LabelBox(ego.start.x, ego.start.y, MKZ_2017.width, MKZ_2017.width) for ego in egos]
    places = dict(zip(long, place_labels(requests, cars), strict=True))
    for i, ego in enumerate(egos):
        place = places.get(i)
        axes.text(
            place.x if place else ego.start.x,
            place.y if place else ego.start.y,
            ego.id,
            color="white",
            fontsize=NAME_POINTS,
            weight="bold",
            ha="center",
            va="center",
            zorder=13,
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.25", "facecolor": colours[i], "edgecolor": "white"} if place else None,
        )


def _draw_arrows(axes: Axes, xy: Float, colour: str) -> None:
    """Draw arrow heads every 10 m along a route."""
    for i in range(10, len(xy) - 3, 10):
        axes.annotate(
            "",
            xy=(float(xy[i + 1, 0]), float(xy[i + 1, 1])),
            xytext=(float(xy[i, 0]), float(xy[i, 1])),
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "mutation_scale": 13,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=10,
        )


def _draw_flag(axes: Axes, goal: Float, colour: str) -> None:
    """Draw a flag at the goal (x, y) [m]."""
    x, y = float(goal[0]), float(goal[1])
    axes.plot([x, x], [y, y + 4.2], color=LIGHT["ink"], linewidth=1.6, zorder=12, solid_capstyle="round")
    cloth = np.array(((x, y + 4.2), (x + 3.2, y + 3.2), (x, y + 2.2)))
    axes.add_patch(Polygon(cloth, facecolor=colour, edgecolor=LIGHT["ink"], linewidth=0.8, zorder=12))
    axes.plot([x], [y], marker="o", markersize=4.5, color=colour, markeredgecolor=LIGHT["ink"], zorder=12)


def _draw_scale(axes: Axes, view: MapView) -> None:
    width, height = view.size
    length = 10.0 if width < 90 else 20.0 if width < 200 else 50.0
    x, y = view.right - 0.03 * width - length, view.low + 0.035 * height
    axes.plot([x, x + length], [y, y], color="black", linewidth=3, solid_capstyle="butt", zorder=14)
    axes.text(x + length / 2, y + 0.012 * height, f"{length:.0f} m", ha="center", fontsize=8, zorder=14)


def _write_captions(figure: Figure, scenario: Scenario, roads: RoadMap) -> None:
    height = float(figure.get_figheight())
    cavs = len(scenario.egos)
    network = () if roads.name == scenario.id else (roads.name,)
    facts = " · ".join(
        (scenario.category, *network, f"{cavs} CAV{'s' if cavs > 1 else ''}", f"signals {scenario.signals}")
    )
    figure.text(0.012, 1 - 0.22 / height, scenario.id, weight="bold", fontsize=12, va="center")
    inches = float(figure.get_figwidth())
    room = 0.97 * inches * POINTS_PER_INCH - TITLE_ASPECT * 12 * len(scenario.id)  # beside the title
    if NAME_ASPECT * 8.5 * len(facts) < room:
        figure.text(0.988, 1 - 0.22 / height, facts, fontsize=8.5, va="center", ha="right", color=LIGHT["muted"])
        facts = ""
    text = " · ".join(filter(None, (scenario.description, facts)))
    line = textwrap.shorten(text, int(inches * POINTS_PER_INCH / (8.5 * NAME_ASPECT) * 1.15), placeholder=" …")
    figure.text(0.012, 1 - 0.45 / height, line, fontsize=8.5, va="center", color=LIGHT["muted"])


def _write_cavs(figure: Figure, egos: Sequence[Ego]) -> None:
    """Write the id and the length of the route of every CAV below the map, in rows."""
    width, height = (float(inches) for inches in figure.get_size_inches())
    columns = _count_columns(width)
    rows = math.ceil(len(egos) / columns)
    for i, (ego, colour) in enumerate(zip(egos, cycle(CAV_COLOURS))):
        row, column = divmod(i, columns)
        figure.text(
            0.012 + LEGEND_ENTRY_INCHES * column / width,
            (0.17 + LEGEND_ROW_INCHES * (rows - 1 - row)) / height,
            f"■ {ego.id}: {build_polyline(ego.xy).length:.0f} m",
            color=colour,
            fontsize=9,
            weight="bold",
            va="center",
        )


def draw_episode(axes: Axes, record: EpisodeRecord, scenario: Scenario, roads: RoadMap, tick: int) -> None:
    """Draw the road users that are present in a tick; CAVs in colour with their routes and the paths driven so far."""
    draw_map(axes, roads, fit_view(np.concatenate([ego.xy for ego in scenario.egos])))
    for ego, colour in zip(scenario.egos, cycle(CAV_COLOURS)):
        axes.plot(*ego.xy.T, color=colour, linewidth=2.0, linestyle=":", zorder=7)
    colours = choose_colours(record)
    for i in np.flatnonzero(record.valid[tick]).tolist():
        if i < record.egos:
            driven = record.valid[: tick + 1, i]
            axes.plot(record.x[: tick + 1, i][driven], record.y[: tick + 1, i][driven], color=colours[i], zorder=7)
        _draw_road_user(axes, record, tick, i, colours[i])
    axes.set_title(f"{record.scenario}, tick {tick} ({tick * DT:.2f} s)", fontsize=10)


def _draw_road_user(axes: Axes, record: EpisodeRecord, tick: int, i: int, colour: str) -> None:
    """Draw the box of the road user in column `i`, and the id of a CAV in it."""
    x, y, yaw = (float(values[tick, i]) for values in (record.x, record.y, record.yaw))
    length, width = max(float(record.length[i]), MIN_SIZE_M), max(float(record.width[i]), MIN_SIZE_M)
    corners = box_corners(x, y, yaw, length, width)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="white", linewidth=0.8, zorder=8 + (i < record.egos)))
    if i < record.egos:
        axes.text(x, y, record.ids[i], color="white", fontsize=8, weight="bold", ha="center", va="center", zorder=10)
