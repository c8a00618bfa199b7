"""Scripted road users in the picture of a scenario: who they are by shape and colour, where they go as dotted lines."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Patch, Polygon

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, KindName, LaneMotion, PathMotion, ReplayMotion

COLOURS: dict[KindName, str] = {
    "vehicle": "#3d4047",
    "pedestrian": "#a2467f",
    "cyclist": "#9a5b12",
    "static": "#e8b008",
}
"""As in the replay viewer; props stand out in the yellow of their kind."""
LEAST_M = 0.9
"""Smaller things are drawn this large, or one would not see them."""


def draw_actors(axes: Axes, actors: Sequence[Actor], roads: RoadMap) -> None:
    """Everybody at the start, with the way ahead; a legend if there is anybody."""
    for actor in actors:
        colour = COLOURS[actor.kind]
        axes.add_collection(
            LineCollection([find_actor_path(actor, roads)], colors=colour, linewidths=1.4, linestyles=":", zorder=7.5)
        )
        axes.add_patch(_shape(actor, colour))
    present = {actor.kind for actor in actors}
    kinds: list[KindName] = [kind for kind in COLOURS if kind in present]
    if kinds:
        entries = [Patch(facecolor=COLOURS[kind], edgecolor="white", label=kind) for kind in kinds]
        legend = axes.legend(handles=entries, loc="upper right", fontsize=8, framealpha=0.85)
        legend.set_zorder(15)


def find_actor_path(actor: Actor, roads: RoadMap) -> Float:
    """Points (N, 2) [m] of where an actor goes, from its start on."""
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


def _shape(actor: Actor, colour: str) -> Patch:
    """A disc for a person, else a box."""
    x, y = actor.start.x, actor.start.y
    length, width = max(actor.length, LEAST_M), max(actor.width, LEAST_M)
    if actor.kind == "pedestrian":
        return Circle((x, y), length / 2, facecolor=colour, edgecolor="white", linewidth=0.6, zorder=8)
    corners = box_corners(x, y, actor.start.yaw, length, width)
    return Polygon(corners, facecolor=colour, edgecolor="white", linewidth=0.6, zorder=8)
