"""The page of an observation: what a policy sees at a tick, drawn from its numbers and nothing else."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.grid_view import RASTER
from mdrive_sumo.rl.observation_vector import (
    DISTANCE_M,
    OBJECT_COLUMNS,
    OWN_COLUMNS,
    ROUTE_AHEAD_M,
    ROUTE_COLUMNS,
    RULE_COLUMNS,
    USER_LENGTH_M,
    USER_WIDTH_M,
)
from mdrive_sumo.sensing.raster_sensor import LAYERS

STYLE = """
.sight svg { min-width: 0; max-width: 560px; }
.layers { display: grid; grid-template-columns: repeat(auto-fill, minmax(230px, 1fr)); gap: 0 18px; }
.layers svg { min-width: 0; }
"""
"""Layers stand side by side: one below the other they are seven screens."""
LIDAR_LAYER_NAMES = ("points on the ground", "points above the ground")


@dataclass(frozen=True, slots=True)
class _Row:
    name: str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of the observation as a table."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[_Row, ...]


@dataclass(frozen=True, slots=True)
class _Box:
    """A road user in the drawing, whose y points down [m]."""

    x: float
    y: float
    turn_deg: float
    """Clockwise."""
    length: float
    width: float
    colour: str
    """Name in the palette."""
    label: str


@dataclass(frozen=True, slots=True)
class _Drawing:
    route: tuple[tuple[float, float], ...]
    boxes: tuple[_Box, ...]


@dataclass(frozen=True, slots=True)
class _Run:
    """Neighbouring cells of a row that are not 0."""

    row: int
    column: int
    cells: int


@dataclass(frozen=True, slots=True)
class _Layer:
    name: str
    rows: int
    columns: int
    runs: tuple[_Run, ...]
    filled: int


def render_observation_page(
    settings: EnvSettings,
    title: str,
    facts: Sequence[tuple[str, str]],
    vector: npt.NDArray[np.float32],
    grid: npt.NDArray[np.uint8],
) -> str:
    """Return a self-contained page that never reaches the network; the same observation gives the same bytes.

    facts: what it says of the tick, name and value. vector: (numbers,). grid: (layers, rows, columns), or no cells.
    """
    own, route, rules, users, heard = _split(settings, vector)
    parts = (
        _make_part("The car itself", OWN_COLUMNS, [""], own),
        _make_part("Route ahead", ROUTE_COLUMNS, [f"{ahead} m" for ahead in ROUTE_AHEAD_M], route),
        _make_part("Next light, stop sign and junction", RULE_COLUMNS, [""], rules),
        _make_part("Road users, nearest first", OBJECT_COLUMNS, [str(row + 1) for row in range(len(users))], users),
        _make_message_part(heard),
    )
    names = LAYERS if settings.grid == RASTER else LIDAR_LAYER_NAMES
    page = render_html_page(
        "observation_page.html",
        title=title,
        style=format_custom_properties() + read_static("comparison_report.css") + STYLE,
        facts=facts,
        drawing=_draw(route, users),
        layers=[_describe_layer(name, layer) for name, layer in zip(names, grid, strict=True)] if grid.size else [],
        parts=[part for part in parts if part.rows],
        count=len(vector),
    )
    return page + "\n"


def _split(settings: EnvSettings, vector: npt.NDArray[np.float32]) -> list[Float]:
    """Return the parts of a vector as tables (rows, columns)."""
    senders = settings.senders if settings.message_bytes else 0
    shapes = (
        (1, len(OWN_COLUMNS)),
        (len(ROUTE_AHEAD_M), len(ROUTE_COLUMNS)),
        (1, len(RULE_COLUMNS)),
        (settings.nearest, len(OBJECT_COLUMNS)),
        (senders, 2 + settings.message_bytes),
    )
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    pieces = np.split(vector.astype(np.float64), ends[:-1])
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]


def _make_part(name: str, columns: tuple[str, ...], names: list[str], numbers: Float) -> _Part:
    rows = zip(names, numbers.tolist(), strict=True)
    return _Part(name, columns, tuple(_Row(one, tuple(f"{number:.3f}" for number in row)) for one, row in rows))


def _make_message_part(heard: Float) -> _Part:
    rows = tuple(
        _Row(
            f"sender {number}",
            (f"{row[0]:.0f}", f"{row[1]:.2f}", np.rint(255 * row[2:]).astype(np.uint8).tobytes().hex(" ")),
        )
        for number, row in enumerate(heard, start=1)
    )
    return _Part("Messages", ("heard", "age [s]", "bytes"), rows)


def _draw(route: Float, users: Float) -> _Drawing:
    """Return route points and road users around a car that looks up: metres, x to the right and y down."""
    boxes: list[_Box] = []
    for number, row in enumerate(users.tolist(), start=1):
        present, ahead, left, cos, sin, *_, length, width, is_vehicle, is_static = row
        if present:
            colour = "vehicle" if is_vehicle else "static" if is_static else "pedestrian"
            turn_deg = round(-math.degrees(portable.atan2(sin, cos)), 1)
            place = (round(-left * DISTANCE_M, 2), round(-ahead * DISTANCE_M, 2))
            boxes.append(_Box(*place, turn_deg, *_scale_size(length, width), colour, str(number)))
    points = tuple((round(-left * DISTANCE_M, 2), round(-ahead * DISTANCE_M, 2)) for ahead, left, _ in route.tolist())
    return _Drawing(points, tuple(boxes))


def _scale_size(length: float, width: float) -> tuple[float, float]:
    return round(USER_LENGTH_M * length, 2), round(USER_WIDTH_M * width, 2)


def _describe_layer(name: str, layer: npt.NDArray[np.uint8]) -> _Layer:
    runs: list[_Run] = []
    for row, cells in enumerate(layer > 0):
        edges = np.flatnonzero(np.diff(np.concatenate(([False], cells, [False])).astype(np.int8)))
        runs += [_Run(row, begin, end - begin) for begin, end in edges.reshape(-1, 2).tolist()]
    rows, columns = layer.shape
    return _Layer(name, rows, columns, tuple(runs), int((layer > 0).sum()))
