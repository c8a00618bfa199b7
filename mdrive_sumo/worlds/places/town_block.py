"""Kind of place: blocks of a town with several junctions."""

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.building_rows import add_surroundings
from mdrive_sumo.worlds.places.junction_rules import CONTROL_TYPES, list_signal_arguments
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node, Street
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import Drawn, between, choose
from mdrive_sumo.worlds.places.sight_triangles import Approach, build_sight_triangles
from mdrive_sumo.worlds.places.street_lines import draw_arm, trace_line
from mdrive_sumo.worlds.places.surroundings import SURROUNDINGS

AREAS = ("old_town", "town", "suburb")
SHIFT_M = 6.0
"""[m] Largest shift of a junction from the grid in each direction."""
RADIUS_M = 8.0
"""[m] Of corners; RASt 06 has 6 to 10 m for cars."""
PARKING_M = 2.0
"""[m] Width of a parking lane (RASt 06, table 22)."""
OUTER_ARM = 0.75
"""Share of the streets that go on beyond the blocks; each junction keeps three streets or more (chosen)."""
MAIN_ROW = 0
"""The row of junctions on the main street."""
SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
"""Steps in columns and rows to the four neighbours of a junction."""
Corner = tuple[int, int]
"""Column and row of a junction."""


def _weigh_controls(drawn: Drawn) -> tuple[float, ...]:
    return {"old_town": (4.0, 2.0, 0.0), "suburb": (4.0, 2.0, 0.0)}.get(drawn["area"], (1.0, 2.0, 2.0))


def _weigh_sight(drawn: Drawn) -> tuple[float, ...]:
    share = SURROUNDINGS[drawn["area"]].keeps_sight
    return (share, 1.0 - share)


@dataclass(frozen=True)
class TownBlockParameters:
    """Parameters of blocks of a town."""

    area: str = choose(*AREAS, doc="Kind of neighbourhood.")
    columns: int = choose(2, 3, doc="Junctions along the main street.", weights=(3.0, 2.0))
    rows: int = choose(1, 2, doc="Streets along the main street, which is the first.", weights=(1.0, 3.0))
    control: str = choose(
        "right_before_left", "main_street", "signals", doc="Rule of the junctions.", weights=_weigh_controls
    )
    block_m: float = between(58.0, 95.0, doc="Length of a block along the main street [m].")
    depth_m: float = between(58.0, 85.0, doc="Depth of a block [m].")
    parking: bool = choose(False, True, doc="Parking lanes on all streets.")
    keeps_sight: bool = choose(True, False, doc="Whether sight triangles are free of buildings.", weights=_weigh_sight)


def build_town_block(draft: NetworkDraft, parameters: TownBlockParameters, rng: random.Random) -> None:
    """Fill a draft with blocks of a town."""
    surroundings = SURROUNDINGS[parameters.area]
    draft.lane_m = surroundings.lane_m
    rule = {
        "right_before_left": "priority to the right",
        "main_street": "a main street with priority",
        "signals": "a main street with signals",
    }[parameters.control]
    draft.description = (
        f"blocks {surroundings.words} with {parameters.columns * parameters.rows} junctions on narrow streets: {rule}"
    )
    turned = math.radians(rng.uniform(0.0, 360.0))
    corners = {
        (i, j): _rotate(
            i * parameters.block_m + rng.uniform(-SHIFT_M, SHIFT_M),
            j * parameters.depth_m + rng.uniform(-SHIFT_M, SHIFT_M),
            turned,
        )
        for i in range(parameters.columns)
        for j in range(parameters.rows)
    }
    for corner, at in corners.items():
        draft.nodes.append(Node(_name(corner), float(at[0]), float(at[1]), _choose_type(corner, parameters), RADIUS_M))
    for corner in corners:
        for other in ((corner[0] + 1, corner[1]), (corner[0], corner[1] + 1)):
            if other in corners:
                _add_street(draft, parameters, (corner, other), np.array((corners[corner], corners[other])))
    _add_outer_streets(draft, parameters, corners, turned, rng)
    if parameters.control == "signals":
        draft.netconvert = list_signal_arguments("permitted", 50)
    _add_yield_signs(draft, parameters)
    sight = list(_build_sight(draft)) if parameters.keeps_sight else []
    add_surroundings(draft, surroundings, sight, rng)


def _rotate(x: float, y: float, angle: float) -> Float:
    return trace_line((0.0, 0.0), angle, ((x, 0.0),))[-1] + trace_line((0.0, 0.0), angle + math.pi / 2, ((y, 0.0),))[-1]


def _name(corner: Corner) -> str:
    return f"x{corner[0] + 1}{corner[1] + 1}"


def _choose_type(corner: Corner, parameters: TownBlockParameters) -> str:
    """Return SUMO's type of a junction: only those of the main street have signs or signals."""
    if parameters.control == "right_before_left" or corner[1] != MAIN_ROW:
        return CONTROL_TYPES["right_before_left"]
    return CONTROL_TYPES["signals" if parameters.control == "signals" else "priority"]


def _add_outer_streets(
    draft: NetworkDraft,
    parameters: TownBlockParameters,
    corners: Mapping[Corner, Float],
    turned: float,
    rng: random.Random,
) -> None:
    """Add the streets that leave the blocks; each junction keeps three streets or more."""
    for corner, at in corners.items():
        links = sum((corner[0] + i, corner[1] + j) in corners for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1)))
        outward = [
            (i, j) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1)) if (corner[0] + i, corner[1] + j) not in corners
        ]
        for k, (i, j) in enumerate(outward):
            is_main = j == 0 and corner[1] == MAIN_ROW
            missing = max(3 - links, 0)
            if not is_main and len(outward) - k > missing and rng.random() > OUTER_ARM:
                continue
            links += 1
            angle = turned + math.pi / 2 * (0 if i > 0 else 2 if i < 0 else 1 if j > 0 else 3)
            heading = angle + math.radians(rng.uniform(-7.0, 7.0))
            line = trace_line((float(at[0]), float(at[1])), heading, draw_arm(rng, rng.uniform(75.0, 95.0), 0.4))
            end = f"{_name(corner)}{'ewns'[(i < 0) if i else 2 + (j < 0)]}"
            draft.nodes.append(Node(end, float(line[-1, 0]), float(line[-1, 1])))
            _append(draft, parameters, end, (end, _name(corner)), line[::-1], is_main)


def _add_street(draft: NetworkDraft, parameters: TownBlockParameters, ends: tuple[Corner, Corner], line: Float) -> None:
    begin, end = (_name(corner) for corner in ends)
    is_main = all(corner[1] == MAIN_ROW for corner in ends)
    _append(draft, parameters, f"{begin}{end}", (begin, end), line, is_main)


def _append(
    draft: NetworkDraft,
    parameters: TownBlockParameters,
    name: str,
    ends: tuple[str, str],
    line: Float,
    is_main: bool,
) -> None:
    has_priority = is_main and parameters.control != "right_before_left"
    draft.streets.append(
        Street(
            name,
            *ends,
            line,
            (1, 1),
            13.89 if has_priority else 8.33,
            6 if has_priority else 3,
            SURROUNDINGS[parameters.area].pavement_m,
            parking_m=PARKING_M if parameters.parking else 0.0,
        )
    )


def _add_yield_signs(draft: NetworkDraft, parameters: TownBlockParameters) -> None:
    """Add yield signs where a street meets the main street, at junctions without signals."""
    if parameters.control != "main_street":
        return
    for node, street, edge, _ in _list_ends(draft):
        if node.type == CONTROL_TYPES["priority"] and street.priority < 6:
            draft.yields.append(edge)


def _list_ends(draft: NetworkDraft) -> Iterator[tuple[Node, Street, str, Float]]:
    """Return for each street that leads to a junction: junction, street, edge and line from the junction outwards."""
    for node in (node for node in draft.nodes if node.type):
        for street in draft.streets:
            if street.end == node.id:
                yield node, street, street.edge_ids[0], street.line[::-1]
            elif street.begin == node.id:
                yield node, street, street.edge_ids[1], street.line


def _build_sight(draft: NetworkDraft) -> Iterator[BaseGeometry]:
    """Return the sight triangles of all junctions without signals."""
    for node in (node for node in draft.nodes if node.type not in ("", CONTROL_TYPES["signals"])):
        is_equal = node.type == CONTROL_TYPES["right_before_left"]
        yield from build_sight_triangles(
            [
                Approach(
                    line,
                    (1, 1),
                    draft.lane_m,
                    street.speed,
                    is_equal or street.priority >= 6,
                    is_equal or edge in draft.yields,
                )
                for other, street, edge, line in _list_ends(draft)
                if other is node
            ]
        )


TOWN_BLOCK = PlaceKind(
    "town_block", "blocks of a town: two to six junctions on narrow streets", TownBlockParameters, build_town_block
)
