"""Small extracts of OpenStreetMap that tests make themselves. No tests in here."""

import math
from collections.abc import Mapping

CENTRE = (52.5, 13.4)
"""Latitude and longitude [degrees] of the point (0, 0)."""
METRES_PER_DEGREE = 111_320.0


class OsmDraft:
    """Nodes and ways at points [m] around a centre."""

    def __init__(self) -> None:
        self._nodes: list[str] = []
        self._ways: list[str] = []

    def add_node(self, name: int, x: float, y: float, **tags: str) -> int:
        latitude = CENTRE[0] + y / METRES_PER_DEGREE
        longitude = CENTRE[1] + x / (METRES_PER_DEGREE * math.cos(math.radians(CENTRE[0])))
        self._nodes.append(f'<node id="{name}" lat="{latitude:.8f}" lon="{longitude:.8f}">{_write_tags(tags)}</node>')
        return name

    def add_way(self, name: int, nodes: tuple[int, ...], tags: Mapping[str, str]) -> None:
        members = "".join(f'<nd ref="{node}"/>' for node in nodes)
        self._ways.append(f'<way id="{name}">{members}{_write_tags(tags)}</way>')

    def write(self) -> str:
        return f'<?xml version="1.0"?><osm version="0.6">{"".join(self._nodes)}{"".join(self._ways)}</osm>'


def _write_tags(tags: Mapping[str, str]) -> str:
    return "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())


def draw_crossing(**main_street: str) -> OsmDraft:
    """Return a crossing: Main Street from west to east, South Lane with a stop sign, North Lane with a yield sign.

    A house stands north of it in the east. Main Street has a zebra crossing, and signals where East Street meets it.
    """
    draft = OsmDraft()
    for name, x, y in (
        (1, -150, 0),
        (2, 0, 0),
        (4, 0, -150),
        (8, 0, 150),
        (10, 300, 0),
        (6, 150, 120),
        (11, 150, -100),
    ):
        draft.add_node(name, x, y)
    draft.add_node(3, 150, 0, highway="traffic_signals")
    draft.add_node(5, 0, -12, highway="stop", direction="forward")
    draft.add_node(9, 0, 12, highway="give_way")
    draft.add_node(30, 75, 0, highway="crossing")
    for name, x, y in ((20, 20, 15), (21, 40, 15), (22, 40, 30), (23, 20, 30)):
        draft.add_node(name, x, y)
    main = {"highway": "secondary", "lanes": "2", "maxspeed": "50", "name": "Main Street", "sidewalk": "both"}
    draft.add_way(100, (1, 2, 30, 3), main | main_street)
    draft.add_way(103, (3, 10), {"highway": "secondary", "lanes": "2", "maxspeed": "50"} | main_street)
    draft.add_way(101, (4, 5, 2), {"highway": "residential", "maxspeed": "30", "name": "South Lane"})
    draft.add_way(102, (2, 9, 8), {"highway": "residential"})
    draft.add_way(104, (11, 3, 6), {"highway": "tertiary", "maxspeed": "50"})
    draft.add_way(105, (20, 21, 22, 23, 20), {"building": "yes"})
    draft.add_way(106, (11, 4), {"highway": "footway"})
    return draft
