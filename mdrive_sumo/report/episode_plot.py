"""Plot one tick of a recorded episode: network, routes, the paths driven so far, and every road user."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.actor_plot import KIND_COLOURS, MIN_SIZE_M
from mdrive_sumo.report.map_plot import draw_map
from mdrive_sumo.report.map_view import fit_view
from mdrive_sumo.report.palette import CAV_COLOURS
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario


def draw_episode(axes: Axes, record: EpisodeRecord, scenario: Scenario, roads: RoadMap, tick: int) -> None:
    """Draw the road users that are present in a tick; CAVs in colour with their routes and the paths driven so far."""
    draw_map(axes, roads, fit_view(np.concatenate([ego.xy for ego in scenario.egos])))
    for ego, colour in zip(scenario.egos, cycle(CAV_COLOURS)):
        axes.plot(*ego.xy.T, color=colour, linewidth=2.0, linestyle=":", zorder=7)
    colours = _choose_colours(record)
    for i in np.flatnonzero(record.valid[tick]).tolist():
        if i < record.egos:
            driven = record.valid[: tick + 1, i]
            axes.plot(record.x[: tick + 1, i][driven], record.y[: tick + 1, i][driven], color=colours[i], zorder=7)
        _draw_road_user(axes, record, tick, i, colours[i])
    axes.set_title(f"{record.scenario}, tick {tick} ({tick * DT:.2f} s)", fontsize=10)


def _choose_colours(record: EpisodeRecord) -> Sequence[str]:
    """Return the colour of every road user by column: CAVs by their order, others by their kind."""
    by_kind = {Kind[name.upper()]: colour for name, colour in KIND_COLOURS.items()}
    egos = [colour for _, colour in zip(range(record.egos), cycle(CAV_COLOURS), strict=False)]
    return [*egos, *(by_kind[Kind(kind)] for kind in record.kind[record.egos :].tolist())]


def _draw_road_user(axes: Axes, record: EpisodeRecord, tick: int, i: int, colour: str) -> None:
    """Draw the box of the road user in column `i`, and the id of a CAV in it."""
    x, y, yaw = (float(values[tick, i]) for values in (record.x, record.y, record.yaw))
    length, width = max(float(record.length[i]), MIN_SIZE_M), max(float(record.width[i]), MIN_SIZE_M)
    corners = box_corners(x, y, yaw, length, width)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="white", linewidth=0.8, zorder=8 + (i < record.egos)))
    if i < record.egos:
        axes.text(x, y, record.ids[i], color="white", fontsize=8, weight="bold", ha="center", va="center", zorder=10)
