"""The page of a network: its lanes with their ids, and a map whose clicks become the steps of a route."""

import json
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import CAV_COLOURS, format_custom_properties
from mdrive_sumo.report.replay_data import pack_line, pack_map
from mdrive_sumo.roads import Lane, RoadMap

SCRIPTS = ("viewer_map.js", "network.js")
MARGIN_M = 15.0
"""[m] Shown around the lanes."""


def render_network_page(roads: RoadMap) -> str:
    """Return a self-contained page that never reaches the network; the same network gives the same bytes."""
    ways = [lane for lane in roads.driving if not lane.junction]
    kilometres = sum(lane.centre.length for lane in ways) / 1000
    script = "\n".join((f"const CAV_COLOURS = {json.dumps(CAV_COLOURS)};", *map(read_static, SCRIPTS)))
    page = render_html_page(
        "network.html",
        title=f"{roads.name} · mdrive-sumo",
        style=format_custom_properties() + read_static("network.css"),
        script=script,
        name=roads.name,
        facts=f"{len(ways)} lanes of {kilometres:.1f} km, {len(roads.buildings)} buildings",
        data=_write_json(_pack_network(roads)),
    )
    return page + "\n"


def _pack_network(roads: RoadMap) -> dict[str, Any]:
    """Return what the page carries; coordinates in cm from an origin in whole metres."""
    points = np.concatenate([lane.centre.xy for lane in roads.driving])
    low, high = points.min(0) - MARGIN_M, points.max(0) + MARGIN_M
    origin = np.rint((low + high) / 2)
    return {
        "origin": origin.tolist(),
        "bounds": [*(low - origin).tolist(), *(high - origin).tolist()],
        "map": pack_map(roads, shapely.box(*low, *high), origin),
        "lanes": [_pack_lane(lane, origin) for lane in roads.driving],
    }


def _pack_lane(lane: Lane, origin: Float) -> tuple[str, list[int], int, float, float]:
    line = pack_line(lane.centre.xy, origin)
    return lane.id, line, int(lane.junction), round(lane.width, 2), round(lane.speed_limit, 2)


def _write_json(data: dict[str, Any]) -> str:
    """Return JSON without the character that could end its element: ids are those of the user's map."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
