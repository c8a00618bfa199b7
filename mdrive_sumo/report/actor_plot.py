"""Plot scripted actors: their kind as shape and colour, their path as a dotted line."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Patch, Polygon

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, KindName, LaneMotion, PathMotion, ReplayMotion

KINDS: tuple[KindName, ...] = ("vehicle", "pedestrian", "cyclist", "static")
KIND_COLOURS: dict[KindName, str] = {kind: LIGHT[kind] for kind in KINDS}
"""Colour by kind, as in the replay page."""
MIN_SIZE_M = 0.9
"""Smaller actors are drawn at this size, because they would not be visible otherwise."""


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
