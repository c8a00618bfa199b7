"""Small INTERACTION tables and Lanelet2 maps for tests."""

import math
from pathlib import Path

VEHICLES = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"


PEDESTRIANS = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"


SCALE = 0.9996 * (1 + math.radians(3) ** 2 / 2)
"""Of UTM on the equator, 3 degrees off its central meridian (Snyder, Map Projections, 1987, to second order)."""


M_PER_DEGREE = (111_319.491 * SCALE, 110_574.276 * SCALE)
"""East and north on the equator (WGS 84)."""


# --- small maps ---
class Map:
    """Writes `.osm` files; coordinates are metres, turned into degrees with a constant."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[float, float], int] = {}
        self.parts: list[str] = []

    def way(self, id_: int, *points: tuple[float, float], **tags: str) -> None:
        refs = "".join(f"<nd ref='{self.nodes.setdefault(point, len(self.nodes) + 1)}'/>" for point in points)
        self.parts.append(f"<way id='{id_}'>{refs}{format_tags(tags)}</way>")

    def lanelet(self, id_: int, left: int, right: int, rules: tuple[int, ...] = (), **tags: str) -> None:
        members = f"<member type='way' role='left' ref='{left}'/><member type='way' role='right' ref='{right}'/>"
        members += "".join(f"<member type='relation' role='regulatory_element' ref='{rule}'/>" for rule in rules)
        self.relation(id_, members, **({"type": "lanelet", "subtype": "road"} | tags))

    def rule(
        self, id_: int, subtype: str, lines: tuple[int, ...] = (), signs: tuple[int, ...] = (), **tags: str
    ) -> None:
        members = "".join(f"<member type='way' role='ref_line' ref='{line}'/>" for line in lines)
        members += "".join(f"<member type='way' role='refers' ref='{sign}'/>" for sign in signs)
        self.relation(id_, members, type="regulatory_element", subtype=subtype, **tags)

    def relation(self, id_: int, members: str, **tags: str) -> None:
        self.parts.append(f"<relation id='{id_}'>{members}{format_tags(tags)}</relation>")

    def write(self, path: Path) -> Path:
        nodes = "".join(
            f"<node id='{id_}' lat='{y / M_PER_DEGREE[1]:.10f}' lon='{x / M_PER_DEGREE[0]:.10f}'/>"
            for (x, y), id_ in self.nodes.items()
        )
        path.write_text(f"<osm>{nodes}{''.join(self.parts)}</osm>")
        return path


def format_tags(tags: dict[str, str]) -> str:
    return "".join(f"<tag k='{key}' v='{value}'/>" for key, value in tags.items())


def build_street() -> Map:
    """Two lanes east (1 on the right, 2 on the left), then one that follows lane 1, and one west (4) north of them."""
    road = Map()
    road.way(11, (0, 0), (50, 0))
    road.way(12, (50, 4), (0, 4))  # drawn against the direction of travel
    road.way(13, (0, 8), (50, 8))
    road.way(14, (0, 12), (50, 12))
    road.way(15, (50, 0), (90, 0))
    road.way(16, (50, 4), (90, 4))
    road.lanelet(1, left=12, right=11)
    road.lanelet(2, left=13, right=12)
    road.lanelet(3, left=16, right=15)
    road.lanelet(4, left=13, right=14)
    return road


# --- small tables ---
def write_table(path: Path, *rows: str, header: str = VEHICLES) -> Path:
    path.write_text("\n".join((header, *rows)) + "\n")
    return path
